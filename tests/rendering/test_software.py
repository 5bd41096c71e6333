"""Scenes drawn in software, beside the same scenes drawn by OpenGL."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.rendering.backend import Drawer, open_drawer, why_software
from graspcast.rendering.opengl import OpenGLDrawer
from graspcast.rendering.software import SoftwareDrawer
from graspcast.rendering.trials.appearance import Appearance
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.trial.recording import State
from solids import box

WIDTH, HEIGHT = 160, 120
SHAPES = """
<mujoco>
  <visual><global offwidth="160" offheight="120" fovy="30"/><headlight ambient="1 1 1"/></visual>
  <worldbody>
    <geom type="{kind}" size="{size}" rgba="1 0 0 1" euler="20 35 50"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture(params=["parallel", "underactuated"])
def seen(request: pytest.FixtureRequest) -> Appearance:
    return Appearance(box(), load_gripper(request.param), width=WIDTH, height=HEIGHT)


def pose(seen: Appearance, sim_T_est: np.ndarray | None = None) -> None:
    """The hand above and beside the box."""
    turn = rotation_from_vector(np.array([np.pi - 0.3, 0.0, 0.0]))
    above = transform(turn, np.array([0.05, 0.0, 0.25]))
    seen.pose(State("approach", 0.0, box().sim_T_ref, above, seen.data.qpos.copy()), sim_T_est)


def scene_of(
    model: mujoco.MjModel, data: mujoco.MjData, azimuth: float = 60.0, distance: float = 1.0
) -> mujoco.MjvScene:
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = [0, 0, 0.12], distance
    camera.azimuth, camera.elevation = azimuth, -20.0
    scene = mujoco.MjvScene(model, maxgeom=100)
    mujoco.mjv_updateScene(
        model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene
    )
    return scene


def drawn(drawer: Drawer, scene: mujoco.MjvScene) -> np.ndarray:
    try:
        return drawer.draw(scene).astype(int)
    finally:
        drawer.close()


@pytest.fixture
def opengl(seen: Appearance) -> Iterator[OpenGLDrawer]:
    if reason := why_software():
        pytest.skip(f"no OpenGL here ({reason}): apt-get install libegl1 or libosmesa6")
    yield OpenGLDrawer(seen.model, WIDTH, HEIGHT)


def overlap(first: np.ndarray, second: np.ndarray) -> float:
    return float((first & second).sum() / (first | second).sum())


def orange(pixels: np.ndarray) -> np.ndarray:
    return (pixels[..., 0] > pixels[..., 1] + 25) & (pixels[..., 1] > pixels[..., 2] + 25)


@pytest.mark.parametrize("azimuth", [60.0, pytest.param(200.0, marks=pytest.mark.slow)])
def test_it_looks_as_opengl_has_it(seen: Appearance, opengl: OpenGLDrawer, azimuth: float) -> None:
    pose(seen)
    scene = scene_of(seen.model, seen.data, azimuth)
    theirs, ours = drawn(opengl, scene), drawn(SoftwareDrawer(seen.model, WIDTH, HEIGHT), scene)
    assert orange(ours).sum() > 300
    assert overlap(orange(theirs), orange(ours)) > 0.95
    # All that is not table: hand, object and shadow.
    assert overlap(theirs.min(axis=-1) < 200, ours.min(axis=-1) < 200) > 0.9
    assert np.quantile(np.abs(theirs - ours).max(axis=-1), 0.9) < 30


def test_the_estimate_is_green_and_lets_through(seen: Appearance) -> None:
    drawer = SoftwareDrawer(seen.model, WIDTH, HEIGHT)
    aside = box().sim_T_ref @ transform(np.eye(3), np.array([0.0, 0.03, 0.0]))
    pictures = []
    for sim_T_est in (None, aside):
        pose(seen, sim_T_est)
        pictures.append(drawer.draw(scene_of(seen.model, seen.data, distance=0.5)).astype(int))
    plain, over = pictures
    changed = (plain != over).any(axis=-1)
    assert changed.sum() > 200
    assert (np.diff(over[changed][:, :2]) - np.diff(plain[changed][:, :2]) > 0).mean() > 0.95
    # Where it lies over the object, orange is seen through it.
    through = changed & orange(plain)
    assert through.sum() > 20 and over[through][:, 0].mean() > 60


def test_the_shadow_lies_where_the_light_does_not_reach(seen: Appearance) -> None:
    model, data = seen.model, seen.data
    pose(seen)
    drawer = SoftwareDrawer(model, WIDTH, HEIGHT)
    lit = drawer.draw(scene_of(model, data)).astype(int)
    model.light_castshadow[:] = 0
    without = drawer.draw(scene_of(model, data)).astype(int)
    dark = (without - lit).max(axis=-1) > 20
    assert dark.sum() > 100 and not (lit > without).any()
    # A pixel at the object's border shows the table too.
    assert (dark & orange(without)).sum() < 0.1 * dark.sum()


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        ("sphere", ".12"),
        ("box", ".1 .05 .15"),
        ("ellipsoid", ".1 .05 .15"),
        ("capsule", ".05 .1"),
        ("cylinder", ".06 .1"),
    ],
)
def test_every_kind_of_geom_is_where_a_ray_meets_it(kind: str, size: str) -> None:
    model = mujoco.MjModel.from_xml_string(SHAPES.format(kind=kind, size=size))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = scene_of(model, data)
    ours = drawn(SoftwareDrawer(model, WIDTH, HEIGHT), scene)
    eyes = scene.camera
    origin = (np.array(eyes[0].pos) + np.array(eyes[1].pos)) / 2.0
    forward, up = np.array(eyes[0].forward), np.array(eyes[0].up)
    half = np.tan(np.radians(15.0))
    met, rows, columns = [], range(0, HEIGHT, 2), range(0, WIDTH, 2)
    for v in rows:
        for u in columns:
            across = (2 * (u + 0.5) - WIDTH) / HEIGHT * half * np.cross(forward, up)
            ray = forward + across + (1 - 2 * (v + 0.5) / HEIGHT) * half * up
            at = np.zeros(1, dtype=np.int32)
            met.append(mujoco.mj_ray(model, data, origin, ray, None, 1, -1, at) >= 0)
    hit = np.array(met).reshape(len(rows), len(columns))
    ours = ours[::2, ::2]
    assert hit.sum() > 200
    assert overlap(hit, ours[..., 0] > ours[..., 1] + 127) > 0.97


def test_what_draws_is_as_mujoco_gl_says(seen: Appearance, monkeypatch: pytest.MonkeyPatch) -> None:
    for word in ("disable", "Off ", "0"):
        monkeypatch.setenv("MUJOCO_GL", word)
        assert "MUJOCO_GL" in (why_software() or "")
        assert isinstance(open_drawer(seen.model, WIDTH, HEIGHT), SoftwareDrawer)
    monkeypatch.delenv("MUJOCO_GL")
    kind = OpenGLDrawer if why_software() is None else SoftwareDrawer
    drawer = open_drawer(seen.model, WIDTH, HEIGHT)
    assert isinstance(drawer, kind)
    drawer.close()


def test_meshes_are_drawn_from_their_faces() -> None:
    corners = " ".join(
        f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.05, 0.05) for z in (-0.15, 0.15)
    )
    shapes = SHAPES.replace(
        "<worldbody>", f'<asset><mesh name="m" vertex="{corners}"/></asset><worldbody>'
    )
    pictures = []
    for text in (
        SHAPES.format(kind="box", size=".1 .05 .15"),
        shapes.replace('size="{size}"', 'mesh="m"').format(kind="mesh"),
    ):
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        pictures.append(drawn(SoftwareDrawer(model, WIDTH, HEIGHT), scene_of(model, data)))
    one, other = (p[..., 0] > p[..., 1] + 127 for p in pictures)
    assert one.sum() > 200 and overlap(one, other) > 0.97
