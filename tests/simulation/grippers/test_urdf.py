"""Hands described by URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspcast.errors import FormatError
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.grippers.urdf import read_urdf
from graspcast.simulation.trial.gripper_conformance import check_gripper
from jaws import write_urdf_jaws

MESH = '<collision><geometry><mesh filename="{}" scale="0.001 0.001 0.001"/></geometry></collision>'


def test_jaws_of_a_urdf_pass(tmp_path: Path) -> None:
    report = check_gripper(load_gripper(write_urdf_jaws(tmp_path)))
    assert report.passed, str(report)
    assert report.measured is not None
    assert report.measured.opening_m == pytest.approx(0.094, abs=2e-4)
    # One drive of 40 N closes both jaws, so each presses with half of it.
    assert report.measured.grip_n == pytest.approx(20, rel=0.05)


def test_the_example_in_the_docs(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs" / "grippers.md").read_text(encoding="utf-8")
    (example,) = (
        block.split("```")[0] for block in page.split("```toml\n")[1:] if "jaws.urdf" in block
    )
    path = write_urdf_jaws(tmp_path)
    urdf = (tmp_path / "jaws.urdf").read_text()
    urdf = urdf.replace('"tcp"', '"grasp_frame"').replace('"jl"', '"left_finger_joint"')
    (tmp_path / "jaws.urdf").write_text(urdf)
    path.write_text(example.replace("damping = 60.0", "armature = 0.1\ndamping = 60.0"))
    report = check_gripper(load_gripper(path))
    assert report.passed, str(report)


def test_the_force_is_the_effort_limit_unless_it_is_given(tmp_path: Path) -> None:
    path = write_urdf_jaws(tmp_path, effort=30)
    model = load_gripper(path).spec().compile()
    assert model.actuator_forcerange[0].tolist() == [-30, 30]
    path.write_text(path.read_text() + "force = 12\n")
    model = load_gripper(path).spec().compile()
    assert model.actuator_forcerange[0].tolist() == [-12, 12]
    path = write_urdf_jaws(tmp_path, effort=0)
    with pytest.raises(FormatError, match="no effort limit of the joint 'jl': give the actuator's"):
        load_gripper(path)


def test_links_on_fixed_joints_are_kept_and_the_root_is_the_base(tmp_path: Path) -> None:
    write_urdf_jaws(tmp_path)
    model = read_urdf(tmp_path / "jaws.urdf").compile()
    names = [model.body(i).name for i in range(1, model.nbody)]
    assert names[0] == "palm" and set(names) == {"palm", "l", "r", "tcp"}
    np.testing.assert_allclose(model.body("tcp").pos, [0, 0, 0.05])


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("palm.stl", "jaws/urdf/palm.stl"),
        ("../meshes/palm.stl", "jaws/meshes/palm.stl"),
        ("package://jaws/meshes/palm.stl", "jaws/meshes/palm.stl"),
        ("package://other_pkg/palm.stl", "other_pkg/palm.stl"),
    ],
)
def test_meshes_are_found(name: str, place: str, tmp_path: Path) -> None:
    (tmp_path / place).parent.mkdir(parents=True)
    trimesh.creation.box((120, 60, 40)).export(tmp_path / place)
    folder = tmp_path / "jaws" / "urdf"
    folder.mkdir(parents=True, exist_ok=True)
    path = write_urdf_jaws(folder, palm=MESH.format(name))
    model = load_gripper(path).spec().compile()
    assert model.nmesh == 1
    np.testing.assert_allclose(np.ptp(model.mesh_vert, axis=0).max(), 0.12, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"palm": MESH.format("package://jaws/a.stl")},
            "'package://jaws/a.stl', which is not",
        ),
        ({"palm": MESH.format("a.dae")}, "collision mesh 'a.dae', and MuJoCo reads .stl"),
        ({"palm": "", "jaw": ""}, r"no geom of the hand collides .*<collision>"),
        ({"more": "<xacro:macro/>"}, "is a xacro file; expand it"),
        ({"more": "<link>"}, "is not XML"),
        ({"more": '<link name="other"/>'}, "must have one root body.*'palm', 'other'"),
        ({"more": '<joint name="j"/>'}, "is not URDF that MuJoCo reads"),
    ],
)
def test_a_wrong_urdf_is_explained(changes: dict[str, str], message: str, tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text("<COLLADA/>")
    with pytest.raises(FormatError, match=message):
        load_gripper(write_urdf_jaws(tmp_path, **changes))


def test_mjcf_by_the_suffix_of_urdf(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text("<mujoco/>")
    with pytest.raises(FormatError, match="root element is <mujoco>, not <robot>"):
        read_urdf(tmp_path / "a.urdf")
