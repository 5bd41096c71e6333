from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.pose.transforms import exp
from graspcast.simulation.grasps.table import (
    GraspTable,
    ReferenceGrasp,
    grasps_in,
    read_grasps,
    write_grasps,
)
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.load import load_object
from graspcast.simulation.objects.types import Grasp

ENTRY = """
[[grasp]]
object = "mug"
gripper = "parallel"
position_m = [0.0, 0.0, 0.03]
quaternion = [0.0, 1.0, 0.0, 0.0]
provenance = "by hand"
"""


def _reference(twist: tuple[float, ...], gripper: str = "parallel") -> ReferenceGrasp:
    grasp = Grasp(exp(np.array(twist)), "mug", gripper)
    return ReferenceGrasp(grasp, 'said "so"\nétwice', 0.4, 0.5, {"κ, part 2": 0.1 + 0.2, "n": 3})


@pytest.mark.slow
@given(twist=st.tuples(*[st.floats(-1, 1)] * 6))
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, twist: tuple[float, ...]
) -> None:
    path = tmp_path_factory.mktemp("grasps") / "mine.toml"
    written = _reference(twist)
    write_grasps(path, [written])
    read = read_grasps(path)("mug", "parallel")
    np.testing.assert_allclose(read.grasp.obj_T_grasp, written.grasp.obj_T_grasp, atol=1e-14)
    assert np.array_equal(read.grasp.obj_T_grasp[:3, 3], written.grasp.obj_T_grasp[:3, 3])
    assert (read.provenance, dict(read.agreement)) == (written.provenance, written.agreement)
    assert (read.mass_kg, read.friction) == (0.4, 0.5)


def test_the_file_is_sorted_and_writing_it_again_changes_nothing(tmp_path: Path) -> None:
    grasps = [
        ReferenceGrasp(Grasp(np.eye(4), name, gripper), "by hand")
        for name in ("lmo-10", "lmo-9", "mug")
        for gripper in ("underactuated", "parallel")
    ]
    write_grasps(tmp_path / "a.toml", grasps)
    assert [t for t in (tmp_path / "a.toml").read_text().split('"') if "lmo" in t] == [
        *["lmo-9"] * 2,
        *["lmo-10"] * 2,
    ]
    again = [g for g in read_grasps(tmp_path / "a.toml") if g.provenance == "by hand"]
    write_grasps(tmp_path / "b.toml", reversed(again))
    assert (tmp_path / "a.toml").read_bytes() == (tmp_path / "b.toml").read_bytes()


def test_the_grasps_that_come_with_it_are_of_known_objects_and_grippers() -> None:
    catalogue = read_catalogue()
    robot, paper = read_grasps(), read_grasps(protocol="paper")
    assert len(robot) and len(robot) == len(paper)
    for reference in (*robot, *paper):
        assert reference.grasp.object in catalogue
        assert load_gripper(reference.grasp.gripper).name == reference.grasp.gripper


def test_a_pair_without_a_grasp_lists_the_grippers_that_have_one(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(ENTRY)
    table = read_grasps(tmp_path / "mine.toml")
    assert ("mug", "parallel") in table and ("ycbv-4", "parallel") in table
    with pytest.raises(UnknownNameError, match="'mug' by 'underactuated'; known: parallel"):
        table("mug", "underactuated")
    with pytest.raises(UnknownNameError, match="known: none"):
        table("cup", "parallel")


def test_a_users_grasp_takes_precedence(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(ENTRY.replace("mug", "ycbv-4"))
    assert read_grasps(tmp_path / "mine.toml")("ycbv-4", "parallel").provenance == "by hand"
    assert len(read_grasps(tmp_path / "mine.toml")) == len(read_grasps())
    paper = read_grasps(tmp_path / "mine.toml", protocol="paper")
    assert paper("ycbv-4", "parallel").provenance == "by hand"


def test_the_paper_s_protocol_has_grasps_of_its_own_which_a_robot_never_gets() -> None:
    robot, paper = read_grasps(), read_grasps(protocol="paper")
    pair = ("ycbv-12", "parallel")
    assert not np.allclose(robot(*pair).grasp.obj_T_grasp, paper(*pair).grasp.obj_T_grasp)
    assert read_grasps(protocol="robot")(*pair).provenance == robot(*pair).provenance


def test_a_pairs_own_friction_and_mass() -> None:
    can = load_object("ycbv-4")
    reference = _reference((0.0,) * 6)
    assert reference.applied_to(can).friction == 0.5
    np.testing.assert_allclose(reference.applied_to(can).inertia * 0.349, can.inertia * 0.4)


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0.0, 1.0, 0.0, 0.0]", "[0.0, 2.0, 0.0, 0.0]", "quaternion has length 2, not 1"),
        ("[0.0, 1.0, 0.0, 0.0]", "[1.0, 0.0, 0.0]", r"mug by parallel\): quaternion should be 4"),
        ('provenance = "by hand"', "", "provenance is missing"),
        ('provenance = "by hand"', 'provenance = ""\nmass_kg = 0', "mass_kg is 0.0"),
        ('provenance = "by hand"', 'provenance = ""\nmasss_kg = 1', "did you mean 'mass_kg'"),
        ('provenance = "by hand"', 'provenance = ""\nagreement.a = [1]', "agreement.a should be"),
        ("[[grasp]]", "[[grip]]", "unknown key 'grip'"),
        ('provenance = "by hand"', 'provenance = ""\nfriction = 80', "friction is 80.0, .* 0 to 3"),
        (
            'provenance = "by hand"',
            'provenance = ""\nname = ""',
            r"mine.toml, grasp\[0\].* named ''",
        ),
        ('provenance = "by hand"', 'provenance = ""\nname = "a\\nb"', "without line breaks"),
        ("[[grasp]]", ENTRY + "[[grasp]]", "there are two grasps of 'mug' by 'parallel'"),
    ],
)
def test_a_file_that_is_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "mine.toml").write_text(ENTRY.replace(old, new))
    with pytest.raises(FormatError, match=message):
        read_grasps(tmp_path / "mine.toml")


def test_pairs_without_a_grasp_are_told_what_there_is(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(ENTRY)
    table = GraspTable(grasps_in(tmp_path / "mine.toml"))
    for objects, grippers, there in (
        (["mug"], ["jaws"], "there are grasps of mug by parallel"),
        (["cup"], ["parallel"], "there are grasps of mug by parallel"),
        (["cup"], ["jaws"], "there is no other grasp"),
    ):
        with pytest.raises(InputError, match=rf"no grasp of {objects[0]} by .*; {there}\."):
            table.pairs(objects, grippers, strict=True)


@pytest.mark.ill_typed
def test_figures_are_numbers_or_text(tmp_path: Path) -> None:
    grasp = Grasp(np.eye(4), "mug", "parallel")
    with pytest.raises(InputError, match="'kappa' is None"):
        write_grasps(tmp_path / "x.toml", [ReferenceGrasp(grasp, "", agreement={"kappa": None})])  # type: ignore[dict-item]
    assert not (tmp_path / "x.toml").exists()
    assert len(GraspTable([])) == 0


def test_a_grasp_that_contradicts_its_object_is_not_applied() -> None:
    can, known = load_object("ycbv-4"), read_grasps()("ycbv-4", "parallel")
    with pytest.raises(InputError, match=r"349 kg in .*is the mass in grams"):
        replace(known, mass_kg=349.0).applied_to(can)
    away = known.grasp.obj_T_grasp.copy()
    away[:3, 3] = 0.0, 0.0, 30.0
    with pytest.raises(InputError, match="30 m away from the object, which is 102 mm across"):
        replace(known, grasp=replace(known.grasp, obj_T_grasp=away)).applied_to(can)


def test_several_grasps_of_an_object_have_names_and_keep_their_order(tmp_path: Path) -> None:
    named = [ENTRY.replace("[[grasp]]", f'[[grasp]]\nname = "{name}"') for name in ("top", "side")]
    (tmp_path / "mine.toml").write_text("\n".join(named))
    table = read_grasps(tmp_path / "mine.toml")
    assert [r.grasp.name for r in table.of("mug", "parallel")] == ["top", "side"]
    assert table("mug", "parallel").grasp.name == "top", "none is called reference"
    assert table("mug", "parallel", "side").grasp.name == "side"
    with pytest.raises(UnknownNameError, match="'parallel' named 'left'; known: top, side"):
        table("mug", "parallel", "left")
    write_grasps(tmp_path / "again.toml", table.of("mug", "parallel"))
    again = read_grasps(tmp_path / "again.toml")
    assert [r.grasp.name for r in again.of("mug", "parallel")] == ["top", "side"]
    twice = "\n".join([named[0], named[0]])
    (tmp_path / "twice.toml").write_text(twice)
    with pytest.raises(FormatError, match="two grasps of 'mug' by 'parallel', grasp 'top'"):
        read_grasps(tmp_path / "twice.toml")


def test_a_file_with_grasps_of_a_pair_replaces_the_built_in_one(tmp_path: Path) -> None:
    entry = ENTRY.replace("mug", "ycbv-4").replace("[[grasp]]", '[[grasp]]\nname = "top"')
    (tmp_path / "mine.toml").write_text(entry)
    (only,) = read_grasps(tmp_path / "mine.toml").of("ycbv-4", "parallel")
    assert only.grasp.name == "top"


def test_a_table_may_be_limited_to_names_and_to_the_first_few(tmp_path: Path) -> None:
    named = [ENTRY.replace("[[grasp]]", f'[[grasp]]\nname = "{name}"') for name in "abc"]
    (tmp_path / "mine.toml").write_text("\n".join(named))
    table = read_grasps(tmp_path / "mine.toml")
    assert [r.grasp.name for r in table.limited(most=2).of("mug", "parallel")] == ["a", "b"]
    some = table.limited(["c", "reference"], 1)
    assert [r.grasp.name for r in some.of("mug", "parallel")] == ["c"]
    assert len(some.of("ycbv-4", "parallel")) == 1
    assert len(table.limited()) == len(table)
    assert ("mug", "parallel") not in table.limited(["reference"])
    with pytest.raises(UnknownNameError, match="unknown grasp 'd'; known: a, b, c, reference"):
        table.limited(["d"])


def test_no_file_is_written_that_could_not_be_read(tmp_path: Path) -> None:
    twice = [_reference((0.0,) * 6), _reference((0.1,) * 6)]
    with pytest.raises(InputError, match="there are two grasps of 'mug' by 'parallel'"):
        write_grasps(tmp_path / "mine.toml", twice)
    assert not (tmp_path / "mine.toml").exists()


@pytest.mark.parametrize(("key", "name"), [("object", "mug"), ("gripper", "parallel")])
def test_an_empty_name_is_refused(tmp_path: Path, key: str, name: str) -> None:
    entry = ENTRY.replace(f'{key} = "{name}"', f'{key} = " "')
    assert entry != ENTRY
    (tmp_path / "mine.toml").write_text(entry)
    with pytest.raises(FormatError, match=rf"grasp\[0\]: {key} is ' '; give the {key}'s name"):
        read_grasps(tmp_path / "mine.toml")
