"""Scenes as .glb files, read back: poses, metres, counts, names, values and motion."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.errors import InputError
from graspcast.pose.transforms import rotation_from_vector, transform, transform_points
from graspcast.simulation.trial.recording import Recording
from graspcast.simulation.trial.trial import TrialRunner
from graspcast.viewing.glb import glb_bytes, write_glb
from graspcast.viewing.scene import Node, Scene, Shape
from graspcast.viewing.trial_scene import trial_scene


def scene() -> Scene:
    import trimesh

    box = trimesh.creation.box(extents=(0.1, 0.2, 0.3))
    rng = np.random.default_rng(0)
    colours = rng.integers(0, 256, (len(box.vertices), 3), dtype=np.uint8)
    poses = [
        transform(rotation_from_vector(rng.standard_normal(3)), rng.standard_normal(3))
        for _ in range(2)
    ]
    one = np.array([230, 159, 0], dtype=np.uint8)
    given = np.array(box.vertices), np.array(box.faces)
    nodes = (
        Node("truth/a é", Shape(*given, colours), poses[0]),
        Node("estimates/x/a", Shape(*given, one, 0.3), poses[1], {"score": 0.5, "est_id": 2}),
    )
    legend = (("estimate by x", (230, 159, 0)),)
    return Scene("image 1/2", nodes, "-y", "the camera's", legend)


def parts(content: bytes) -> tuple[dict[str, Any], bytes]:
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<II", content, 12)
    assert kind == 0x4E4F534A and size % 4 == 0
    return json.loads(content[20 : 20 + size]), content[20 + size + 8 :]


def values(tree: dict[str, Any], data: bytes, number: int, width: int) -> np.ndarray:
    accessor = tree["accessors"][number]
    view = tree["bufferViews"][accessor["bufferView"]]
    start = view.get("byteOffset", 0)
    return np.frombuffer(data[start : start + view["byteLength"]], "<f4").reshape(-1, width)


def test_a_scene_is_read_back_as_it_was(tmp_path: Path) -> None:
    import trimesh

    given = scene()
    write_glb(tmp_path / "s.glb", given)
    read = trimesh.load_scene(tmp_path / "s.glb")
    assert set(read.graph.nodes_geometry) == {node.name for node in given.nodes}
    for node in given.nodes:
        pose, name = read.graph.get(node.name)
        expected = given.y_up_T_scene @ node.scene_T_node
        assert_allclose(pose, expected, atol=1e-6)
        mesh = read.geometry[name]
        assert len(mesh.faces) == len(node.shape.faces)
        assert_allclose(mesh.bounds, [(-0.05, -0.1, -0.15), (0.05, 0.1, 0.15)], atol=1e-7)
    # A point below the camera is below it in the file too.
    below = given.y_up_T_scene @ (0.0, 1.0, 0.0, 1.0)
    assert below[1] == -1


def test_nodes_say_what_they_are() -> None:
    tree, _ = parts(glb_bytes(scene()))
    nodes = {node["name"]: node for node in tree["nodes"]}
    assert nodes["estimates/x/a"]["extras"] == {"score": 0.5, "est_id": 2}
    about = tree["scenes"][0]["extras"]
    assert about["unit"] == "m" and about["legend"] == {"estimate by x": "#e69f00"}
    assert "y points up" in about["frame"] and tree["asset"]["version"] == "2.0"
    assert not any("matrix" in node for node in tree["nodes"])


def test_colours_are_linear_and_what_is_seen_through_blends() -> None:
    tree, _ = parts(glb_bytes(scene()))
    materials = {m["name"]: m for m in tree["materials"]}
    seen = materials["estimates/x/a"]
    assert seen["alphaMode"] == "BLEND"
    factor = seen["pbrMetallicRoughness"]["baseColorFactor"]
    # IEC 61966-2-1: 159 of 255 in sRGB is 0.347 in linear light.
    assert_allclose(factor, (0.791, 0.347, 0.0, 0.3), atol=0.004)
    solid = materials["truth/a é"]
    assert solid.get("alphaMode", "OPAQUE") == "OPAQUE"
    coloured = [p["attributes"] for m in tree["meshes"] for p in m["primitives"]]
    assert ["COLOR_0" in attributes for attributes in coloured] == [True, False]


def test_a_trial_is_an_animation(runner: TrialRunner, held: Recording) -> None:
    given = trial_scene(held, runner.grasp_object, runner.gripper, "a cube")
    assert given.motion is not None
    tree, data = parts(glb_bytes(given))
    (animation,) = tree["animations"]
    assert animation["name"] == "trial"
    assert list(animation["extras"]["phases"]) == ["approach", "close", "lift"]
    names = [node["name"] for node in tree["nodes"]]
    found: dict[tuple[str, str], np.ndarray] = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        target = names[channel["target"]["node"]], channel["target"]["path"]
        width = 3 if target[1] == "translation" else 4
        found[target] = values(tree, data, sampler["output"], width)
        times = values(tree, data, sampler["input"], 1)[:, 0]
        assert_allclose(times, given.motion.times_s, atol=1e-6)
    assert len(found) == 2 * len(given.motion.scene_T_node)
    for name, poses in given.motion.scene_T_node.items():
        assert_allclose(found[name, "translation"], poses[:, :3, 3], atol=1e-6)
        turned = found[name, "rotation"]
        assert_allclose(np.linalg.norm(turned, axis=1), 1, atol=1e-6)
        assert (np.einsum("ti,ti->t", turned[1:], turned[:-1]) >= 0).all()
    assert len(data) == tree["buffers"][0]["byteLength"]


def test_vertices_without_a_face_have_a_normal_too() -> None:
    """The validator of the Khronos group refuses normals that are not of unit length."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]])
    red = np.array([255, 0, 0], dtype=np.uint8)
    node = Node("a", Shape(corners, np.array([[0, 1, 2], [0, 0, 1]]), red), np.eye(4))
    tree, data = parts(glb_bytes(Scene("t", (node,), "z", "a test's")))
    number = tree["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]
    assert_allclose(np.linalg.norm(values(tree, data, number, 3), axis=1), 1, atol=1e-6)


def test_a_file_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="directory"):
        write_glb(tmp_path, scene())


def test_points_in_the_file_are_turned_by_its_root_alone() -> None:
    given = scene()
    tree, _ = parts(glb_bytes(given))
    root = next(node for node in tree["nodes"] if node["name"] == "scene")
    w, x = root["rotation"][3], root["rotation"][0]
    assert (w, abs(x)) == pytest.approx((0, 1), abs=1e-9), "half a turn about x"
    point = transform_points(given.nodes[0].scene_T_node, np.zeros((1, 3)))[0]
    at = next(n for n in tree["nodes"] if n["name"] == given.nodes[0].name)["translation"]
    assert_allclose(at, point)
