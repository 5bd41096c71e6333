"""Estimates that contradict models, ground truth or each other are refused, with both numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from graspcast.bop.results import Results, write_results
from graspcast.cli import main
from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.estimates.consistency import check_pairs, check_tables
from graspcast.estimates.loading import load_inputs
from graspcast.pose.lengths import METRES, UNIT_NAMES
from poses import nudged, random_poses, results_of

UNITS = [unit for unit in METRES if unit != "mm"]
TRUTH = random_poses(12, 7)
SIZE = np.array([0.04, 0.06, 0.1])


def scaled(poses: np.ndarray, unit: str) -> np.ndarray:
    """Return poses whose translations are read in millimetres, but written in ``unit``."""
    out = poses.copy()
    out[:, :3, 3] *= METRES["mm"] / METRES[unit]
    return out


def write_kit(
    root: Path, *, truth: str = "mm", results: str = "mm", models: str = "mm", mesh: str = "mm"
) -> list[str]:
    """Write a dataset with one quantity in another unit; return the options that name it."""
    from graspcast.bop.meshes import Mesh, write_mesh

    one = METRES["mm"] / METRES[models]
    entry = {"diameter": 1000 * float(np.linalg.norm(SIZE)) * one}
    for axis, side in zip("xyz", (1000 * SIZE * one).tolist(), strict=True):
        entry |= {f"min_{axis}": -side / 2, f"size_{axis}": side}
    folder = root / "kit" / "models"
    folder.mkdir(parents=True)
    (folder / "models_info.json").write_text(json.dumps({"1": entry}))
    corners = np.stack(np.meshgrid(*(np.array([-0.5, 0.5])[:, None] * SIZE).T), -1).reshape(-1, 3)
    faces = np.array([[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7]])
    write_mesh(folder / "obj_000001.ply", Mesh(corners * METRES["mm"] / METRES[mesh], faces))
    camera = {"fx": 600, "fy": 600, "cx": 320, "cy": 240, "width": 640, "height": 480}
    (root / "kit" / "camera.json").write_text(json.dumps(camera))
    scene = root / "kit" / "test" / "000001"
    scene.mkdir(parents=True)
    poses = scaled(TRUTH, truth)
    listed = {
        str(i): [
            {
                "cam_R_m2c": pose[:3, :3].ravel().tolist(),
                "cam_t_m2c": (1000 * pose[:3, 3]).tolist(),
                "obj_id": 1,
            }
        ]
        for i, pose in enumerate(poses)
    }
    (scene / "scene_gt.json").write_text(json.dumps(listed))
    for seed, name in enumerate("ab"):
        found = nudged(TRUTH, seed)
        write_results(
            root / f"{name}_kit-test.csv",
            results_of(scaled(found, results) if name == "a" else found),
        )
    return [
        *("--bop", str(root / "kit")),
        *("--estimates", f"a={root / 'a_kit-test.csv'}"),
        *("--estimates", f"b={root / 'b_kit-test.csv'}"),
    ]


def test_what_is_in_millimetres_passes_and_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["errors", *write_kit(tmp_path)]) == 0
    line = next(x for x in capsys.readouterr().err.splitlines() if x.startswith("kit: "))
    assert "kit: models 123 mm across (models_info.json; 1 mesh agrees)" in line
    low, high = np.percentile(np.linalg.norm(TRUTH[:, :3, 3], axis=1), [5, 95])
    assert f"nine of ten distances: ground truth {low:.2f} to {high:.2f} m, a " in line


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("quantity", ["truth", "results", "models", "mesh"])
def test_one_quantity_in_another_unit_is_refused_with_the_unit_that_fits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], quantity: str, unit: str
) -> None:
    assert main(["errors", *write_kit(tmp_path, **{quantity: unit})]) == 2
    said = capsys.readouterr().err
    file = {"truth": "scene_gt.json", "results": "a_kit-test.csv"}.get(quantity, "models")
    assert file in said
    assert f"in {UNIT_NAMES[unit]} (" in said
    assert "not in millimetres" in said
    assert said.partition("is it")[0].count(" mm") + said.partition("is it")[0].count(" m ") >= 2


def test_estimators_in_different_units_are_refused_without_models_and_truth(tmp_path: Path) -> None:
    for unit in UNITS:
        root = tmp_path / unit
        write_kit(root, results=unit)
        files = {name: root / f"{name}_kit-test.csv" for name in "ab"}
        with pytest.raises((FormatError, MismatchError), match=f"in {UNIT_NAMES[unit]}"):
            load_inputs(files)


def test_transposed_rotations_are_refused() -> None:
    wrong = TRUTH.copy()
    wrong[:, :3, :3] = np.swapaxes(wrong[:, :3, :3], 1, 2)
    with pytest.raises(MismatchError, match=r"12 of 12 poses in a.csv agree with .* transposed"):
        check_pairs("a.csv", wrong, "the truth", TRUTH)
    check_pairs("a.csv", nudged(TRUTH, 1, radians=1.0), "the truth", TRUTH)


def test_a_bad_estimator_is_no_contradiction() -> None:
    rng = np.random.default_rng(0)
    bad = random_poses(12, 99)
    bad[:, :3, 3] *= rng.uniform(0.5, 2.0, (12, 1))
    check_pairs("a.csv", bad, "the truth", TRUTH)


@pytest.mark.slow
def test_the_published_estimates_pass(data_dir: Path) -> None:
    for name in ("lmo", "ycbv"):
        folder = data_dir / "published" / name
        inputs = load_inputs(
            {e: folder / f"{e}_{name}-test.csv" for e in ("epos", "gdrnpp", "zebrapose")},
            bop=[data_dir / "bop" / name],
            ground_truth=[folder / "ground_truth"],
            lenient=True,
        )
        assert len(inputs.datasets[name].ground_truth) > 1000
        assert "ground truth 0." in inputs.lengths[0]


def test_lengths_are_those_of_results_alone_where_no_dataset_is_known(tmp_path: Path) -> None:
    write_kit(tmp_path)
    (line,) = load_inputs({"a": tmp_path / "a_kit-test.csv"}).lengths
    assert line.startswith("kit: nine of ten distances: a ")


def test_placeholders_are_left_out() -> None:
    poses = TRUTH.copy()
    poses[:10, :3, 3] = 0
    check_pairs("a.csv", poses, "the truth", TRUTH)
    table: Results = results_of(poses)
    check_tables({"a": table, "b": results_of(TRUTH)}, None)


@pytest.mark.parametrize("unit", UNITS)
def test_true_poses_in_another_unit_are_refused_where_they_are_learned_from(
    tmp_path: Path, unit: str
) -> None:
    write_kit(tmp_path, truth=unit)
    files = {name: tmp_path / f"{name}_kit-test.csv" for name in "ab"}
    inputs = load_inputs(files, bop=[tmp_path / "kit"])
    with pytest.raises(InputError, match=rf"scene_gt\.json: the median .* in {UNIT_NAMES[unit]}"):
        inputs.truth(inputs.estimates("a"), "a")
