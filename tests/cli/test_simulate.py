"""The verb simulate."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from commands import refused
from cubes import OBJECTS
from graspcast.cli import main
from graspcast.estimates.outcomes import read_error_outcomes, read_outcomes
from graspcast.simulation.grasps.table import ReferenceGrasp, grasps_in, write_grasps
from graspcast.simulation.objects.types import Grasp
from network_commands import inputs


@pytest.fixture
def tables(world: Path) -> list[str]:
    """A catalogue and a grasp table in which object made-1 is a cube."""
    import trimesh

    trimesh.creation.box(extents=(60, 60, 60)).export(world / "cube.ply")
    text = OBJECTS.replace("objects.cube", "objects.made-1")
    (world / "objects.toml").write_text(text, encoding="utf-8")
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.015
    reference = ReferenceGrasp(Grasp(pose, "made-1", "parallel"), "by a test")
    write_grasps(world / "grasps.toml", [reference])
    return [
        *("--catalogue", str(world / "objects.toml")),
        *("--grasps", str(world / "grasps.toml")),
    ]


def simulate(world: Path, *more: str) -> list[str]:
    out = ["--out", str(world / "campaign"), "--workers", "1"]
    return ["simulate", *inputs(world, "a"), "--gripper", "parallel", *out, *more]


def test_a_trial_for_each_estimate_and_none_twice(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    command = simulate(world, *tables, "--scenes", "0")
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "made-1" in out and "parallel" in out and "campaign: 10 trials" in out
    files = {path: path.stat().st_mtime_ns for path in (world / "campaign").rglob("*.parquet")}
    outcomes = pl.concat([pl.read_parquet(path) for path in files], how="diagonal")
    assert set(outcomes["estimator"]) == {"a"} and set(outcomes["im_id"]) == set(range(0, 60, 6))
    assert main(command) == 0
    assert {path: path.stat().st_mtime_ns for path in files} == files


@pytest.mark.slow
def test_the_protocol_is_the_robot_s_unless_the_paper_s_is_asked_for(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    def campaign(name: str, *more: str) -> tuple[pl.DataFrame, dict[str, object]]:
        command = simulate(world, *tables, "--scenes", "0", "--out", str(world / name), *more)
        assert main(command) == 0
        manifest = json.loads((world / name / "manifest.json").read_text())
        return pl.read_parquet(world / name / "outcomes.parquet"), manifest["setups"][0]

    robot, setup = campaign("robot")
    assert setup["protocol"] == "robot" and setup["settings"]["contact_force_n"] == 40.0
    paper, setup = campaign("paper", "--protocol", "paper")
    assert setup["protocol"] == "paper" and "contact_force_n" not in setup["settings"]
    assert paper["force_n"].is_nan().all() and not robot["force_n"].is_nan().all()
    gentle, setup = campaign("gentle", "--contact-force", "0.001")
    assert setup["settings"]["contact_force_n"] == 0.001
    touched = (robot["force_n"] > 0.001).sum()
    assert (gentle["reason"] == "collided").sum() >= touched
    deep = str(world / "deep.toml")
    (table,) = grasps_in(world / "grasps.toml")
    pose = table.grasp.obj_T_grasp.copy()
    pose[2, 3] -= 0.07
    write_grasps(deep, [replace(table, grasp=replace(table.grasp, obj_T_grasp=pose))])
    capsys.readouterr()
    campaign("deep", "--grasps", deep)
    assert "most trials collide: made-1 by parallel" in capsys.readouterr().err
    collided = gentle.filter(pl.col("reason") == "collided")
    assert not collided["success"].any()
    # Readers of outcomes take a collision for a failure.
    for told in (read_outcomes(world / "gentle"), read_error_outcomes(world / "gentle")[0]):
        assert told["success"].sum() == gentle["success"].sum() < len(told)
    both = simulate(world, *tables, "--protocol", "paper", "--contact-force", "30")
    assert "leave out --contact-force, or give --protocol robot" in refused(both, capsys)
    for wrong in ("0", "-5", "nan", "inf", "strong"):
        with pytest.raises(SystemExit, match="2"):
            main(simulate(world, *tables, "--contact-force", wrong))
        assert "a force above zero, in newtons, is needed" in capsys.readouterr().err
    said = refused([*both[:-2], "--out", str(world / "robot")], capsys)
    assert "protocol (robot there, paper now)" in said
    assert "must be at most 1e+06" in refused(
        simulate(world, *tables, "--contact-force", "1e9"), capsys
    )


def test_what_cannot_be_simulated_is_refused(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "unknown gripper 'claw'" in refused(simulate(world, "--gripper", "claw"), capsys)
    said = refused(simulate(world, "--objects", "made-1"), capsys)
    assert "unknown grasp of 'made-1' by 'parallel'" in said and "propose-grasps" in said
    for more in ([], ["--lenient"]):
        said = refused(simulate(world, *more), capsys)
        assert "no estimate has both a ground truth and a grasp; graspcast propose-grasps" in said
    said = refused(simulate(world, *tables, "--gripper", "franka"), capsys)
    assert "two grippers are called 'parallel': parallel and franka" in said
    assert not (world / "campaign").exists()


def test_an_object_without_grasp_or_mesh_stops_no_trial_of_others(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    # Half of the estimates become those of made-2, which has neither grasp nor mesh.
    path = world / "a_made-test.csv"
    rows = path.read_text().splitlines()
    table = world / "grasps.toml"
    truth = world / "made" / "test" / "000000" / "scene_gt.json"
    content = json.loads(truth.read_text())
    for number, line in enumerate(rows):
        scene, im, _, *rest = line.split(",")
        if scene == "0" and int(im) % 12 == 0:
            rows[number] = ",".join([scene, im, "2", *rest])
            content[im] = [{**entry, "obj_id": 2} for entry in content[im]]
    path.write_text("\n".join(rows) + "\n")
    truth.write_text(json.dumps(content))
    command = simulate(world, *tables, "--scenes", "0")
    assert main(command) == 0
    out, err = capsys.readouterr()
    assert "campaign: 5 trials" in out
    assert "left out 5 trials without a grasp: made-2 by parallel" in err
    assert "made-1 60 mm, 0.1 kg, 463 kg/m³; parallel gripper opens to 80 mm" in err
    text = table.read_text()
    table.write_text(text + text[text.index("[[grasp]]") :].replace("made-1", "made-2"))
    assert main([*command, "--out", str(world / "again")]) == 0
    assert "left out 5 trials of made-2: it is not in the catalogue" in capsys.readouterr().err
    said = refused([*command, "--objects", "made-1", "made-2"], capsys)
    assert "made-2" in said


@pytest.mark.slow
def test_some_of_several_grasps_are_simulated(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (reference,) = grasps_in(world / "grasps.toml")
    named = [replace(reference, grasp=replace(reference.grasp, name=n)) for n in ("top", "low")]
    write_grasps(world / "grasps.toml", [reference, *named])
    command = simulate(world, *tables, "--scenes", "0", "--grasp", "low", "--grasp", "reference")
    assert main(command) == 0
    assert set(read_outcomes(world / "campaign")["grasp"]) == {"reference", "low"}
    one = ["--max-grasps", "1", "--out", str(world / "one")]
    assert main([*simulate(world, *tables, "--scenes", "0"), *one]) == 0
    assert set(read_outcomes(world / "one")["grasp"]) == {"reference"}
    said = refused(simulate(world, *tables, "--grasp", "tip"), capsys)
    assert "unknown grasp 'tip'" in said and "--grasp" in said


def test_errors_are_transferred_or_drawn_without_estimates_of_the_object(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    def campaign(name: str, *more: str) -> tuple[pl.DataFrame, dict[str, str], str]:
        out = ["--objects", "made-1", "--gripper", "parallel", "--workers", "1", *tables]
        out += ["--transferred-errors", "6", "--out", str(world / name)]
        assert main(["simulate", *out, *more]) == 0
        sources = json.loads((world / name / "manifest.json").read_text())["sources"]
        card = (world / name / "README.md").read_text()
        return pl.read_parquet(world / name / "outcomes.parquet"), sources, card

    small, sources, card = campaign("small", "--deviations", "0.1", "0.1", "0.1")
    assert small["estimator"].unique().to_list() == ["transferred"] and len(small) == 6
    assert small["success"].all()
    assert sources == {
        "drawn errors": "Student's t with 4 degrees of freedom, standard deviations of 0.1 mm "
        "across and 0.1 mm along the viewing ray, and 0.1 degrees"
    }
    assert sources["drawn errors"] in card and "`transferred` if its error" in card
    assert sources["drawn errors"] in capsys.readouterr().err
    large, _, _ = campaign("large", "--deviations", "60", "60", "40", "--tails", "inf")
    assert large["success"].sum() < 3
    with pytest.raises(AssertionError):  # of the object itself alone
        campaign("own", *inputs(world, "a"))
    assert "no errors to transfer to made-1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], ["give estimates", "--estimates", "--deviations"]),
        (["--estimates", "a=a.csv"], ["give the BOP directory", "--bop"]),
        (["--deviations", "1", "1", "1", "--estimates", "a=a.csv"], ["one or the other"]),
        (["--tails", "5"], ["give their standard deviations", "--deviations"]),
        (["--deviations", "1", "1", "1", "--transferred-errors", "0"], ["count is 0"]),
        (["--covariances", "none.csv"], ["none.csv", "cannot be read"]),
    ],
)
def test_what_no_errors_can_be_taken_from_is_said(
    world: Path,
    tables: list[str],
    options: list[str],
    words: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = [
        "--objects",
        "made-1",
        "--gripper",
        "parallel",
        *tables,
        "--out",
        str(world / "campaign"),
    ]
    said = refused(["simulate", "--transferred-errors", "4", *out, *options], capsys)
    assert all(word in said for word in words), said
    assert not (world / "campaign").exists()


def test_drawn_errors_need_a_number_of_trials_and_objects(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--gripper", "parallel", *tables, "--out", str(world / "campaign")]
    drawn = ["simulate", *out, "--deviations", "1", "1", "1"]
    assert "--transferred-errors" in refused(drawn, capsys)
    assert "--objects" in refused([*drawn, "--transferred-errors", "4"], capsys)


def test_options_of_the_other_executor_are_refused(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(simulate(world, *tables, "--address", "10.0.0.1:6379"), capsys)
    assert "an address is for the executor ray (see --executor)" in said
    said = refused(simulate(world, *tables, "--executor", "ray"), capsys)
    assert "as many workers as cores" in said and "see --workers" in said
