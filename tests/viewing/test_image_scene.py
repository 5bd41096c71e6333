"""What was seen in an image, as a scene: poses, ellipsoids, hands at grasps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results, read_results
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.instances import InstanceKey
from graspcast.pose.transforms import compose, invert
from graspcast.simulation.grasps.table import GraspTable
from graspcast.simulation.grippers import load_gripper
from graspcast.viewing.colours import of_probability
from graspcast.viewing.image_scene import Grasps, Seen, image_scene
from graspcast.viewing.scene import Node
from graspcast.views.covariance_table import CovarianceTable
from overlays import verdict_row

IMAGE = (1, 3)
KEY = InstanceKey("made", *IMAGE, 1, 0)


@pytest.fixture
def results(seen: Path) -> dict[str, Results]:
    return {name: read_results(seen / f"{name}_made-test.csv") for name in "ab"}


def by_name(dataset: BopDataset, seen: Seen, **options: list[str]) -> dict[str, Node]:
    return {node.name: node for node in image_scene(dataset, IMAGE, seen, **options).nodes}


def pose_of(table: Results, obj_id: int) -> np.ndarray:
    rows = (table.scene_id == IMAGE[0]) & (table.im_id == IMAGE[1]) & (table.obj_id == obj_id)
    (row,) = np.flatnonzero(rows)
    return table.cam_T_obj[row]


def test_truth_and_estimates_are_where_the_camera_sees_them(
    dataset: BopDataset, results: dict[str, Results]
) -> None:
    nodes = by_name(dataset, Seen(results))
    assert set(nodes) == {
        *("truth/made-1 gt 0", "truth/made-5 gt 1", "camera"),
        *(f"estimates/{e}/made-{o} est 0" for e in "ab" for o in (1, 5)),
    }
    node = nodes["estimates/b/made-5 est 0"]
    assert_allclose(node.scene_T_node, pose_of(results["b"], 5))
    assert node.about["estimator"] == "b" and node.about["est_id"] == 0
    assert_allclose(node.shape.vertices, dataset.models.mesh(5).vertices)
    assert nodes["truth/made-1 gt 0"].shape.opacity == 1 > node.shape.opacity
    colours = {tuple(nodes[f"estimates/{e}/made-1 est 0"].shape.colours) for e in "ab"}
    assert len(colours) == 2


def test_an_ellipsoid_has_two_standard_deviations_along_each_axis_of_the_object(
    dataset: BopDataset, results: dict[str, Results]
) -> None:
    covariance = np.diag([1e-6, 4e-6, 9e-6, 1e-4, 1e-4, 1e-4])[None]
    table = CovarianceTable(np.array(["made-1"]), covariance, "c.csv", (KEY,))
    seen = Seen({}, results["a"], table)
    nodes = by_name(dataset, seen, objects=["made-1"])
    node = nodes["ellipsoids/made-1 est 0"]
    pose = pose_of(results["a"], 1)
    points = (node.shape.vertices @ node.scene_T_node[:3, :3].T) @ pose[:3, :3]
    assert_allclose(np.ptp(points, axis=0) / 2, (0.002, 0.004, 0.006), rtol=0.02)
    assert_allclose(node.scene_T_node[:3, 3], pose[:3, 3])
    assert np.linalg.det(node.scene_T_node[:3, :3]) == pytest.approx(1)
    assert node.about["sd_position_mm"] == [1.0, 2.0, 3.0]
    larger = by_name(dataset, replace(seen, ellipsoid_sd=4.0), objects=["made-1"])
    vertices = larger["ellipsoids/made-1 est 0"].shape.vertices
    assert_allclose(vertices, 2 * node.shape.vertices)
    with pytest.raises(MismatchError, match=r"c.csv: has no covariance of made-5"):
        image_scene(dataset, IMAGE, seen)


def test_an_open_hand_is_at_each_grasp_in_the_colour_of_its_probability(
    dataset: BopDataset, table: GraspTable
) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 0.1, 0.2, 0.7
    rows = [
        verdict_row(*IMAGE, 1, probability=0.9, cam_T_obj=pose),
        verdict_row(1, 8, 1, probability=0.2, cam_T_obj=pose),  # of another image
    ]
    ranked = {(KEY, "a", "parallel"): (("reference", 0.9), ("higher", 0.3))}
    gripper = load_gripper("parallel")
    seen = Seen(grasps=Grasps(rows, table, load_gripper, ranked))
    nodes = [n for n in by_name(dataset, seen).values() if n.group == "grasps"]
    assert [n.about["probability"] for n in nodes] == [pytest.approx(0.9), 0.3]
    for node, name in zip(nodes, ("reference", "higher"), strict=True):
        grasp = table("made-1", "parallel", name).grasp
        tip = compose(node.scene_T_node, gripper.base_T_tcp)
        assert_allclose(tip, compose(pose, grasp.obj_T_grasp), atol=1e-12)
        assert tuple(node.shape.colours) == of_probability(node.about["probability"])
        assert f"{name} P {node.about['probability']:.2f}" in node.name
    assert nodes[0].shape.opacity == 1 > nodes[1].shape.opacity
    assert nodes[0].about["verdict"] == "attempt" and "verdict" not in nodes[1].about
    # The hand is open: its fingers reach to both sides of the tool centre point.
    points = nodes[0].shape.vertices @ invert(gripper.base_T_tcp)[:3, :3].T
    assert np.ptp(points[:, 0]) >= gripper.max_opening_m


def test_a_verdict_on_a_grasp_that_no_table_has_is_refused(
    dataset: BopDataset, table: GraspTable
) -> None:
    row = replace(verdict_row(*IMAGE, 1, probability=0.5), grasp="sideways")
    with pytest.raises(UnknownNameError, match="sideways") as caught:
        image_scene(dataset, IMAGE, Seen(grasps=Grasps([row], table, load_gripper)))
    assert "grasps" in caught.value.parameters


def test_what_is_not_there_is_named(dataset: BopDataset, results: dict[str, Results]) -> None:
    with pytest.raises(UnknownNameError, match="made-7"):
        image_scene(dataset, IMAGE, Seen(results), objects=["made-7"])
    with pytest.raises(InputError, match=r"image 9/9 of made: has neither estimates"):
        image_scene(dataset, (9, 9), Seen(results))


def test_grasps_with_verdicts_of_their_own_are_shown_once(
    dataset: BopDataset, table: GraspTable
) -> None:
    first = verdict_row(*IMAGE, 1, probability=0.9)
    rows = [first, replace(first, grasp="higher")]
    ranked = {(KEY, "a", "parallel"): (("reference", 0.9), ("higher", 0.3), ("higher", 0.3))}
    nodes = by_name(dataset, Seen(grasps=Grasps(rows, table, load_gripper, ranked)))
    assert sum(node.group == "grasps" for node in nodes.values()) == 2
