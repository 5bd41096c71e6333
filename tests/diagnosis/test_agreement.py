"""Sources of poses against each other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray

from graspcast.diagnosis.agreement import (
    belonging,
    conventions,
    copies,
    refined_copies,
    renumbered,
)
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.pairs import TRUTH, pairs_of, sources_of
from graspcast.pose.transforms import (
    invert,
    quaternion,
    rotation_from_quaternion,
    rotation_from_vector,
    rotation_vector,
    transform,
)
from sick_files import SickFiles, case_of, healthy


def findings(files: SickFiles, tmp_path: Path) -> list[Finding]:
    case = case_of(files.write(tmp_path))
    found = list(belonging(case))
    sources, _ = sources_of(case)
    found += renumbered(case, sources)
    pairs = pairs_of({n: t for n, t in sources.items() if n not in case.blamed}, case.name)
    found += [*copies(case, pairs), *conventions(case, sources, pairs)]
    return [*found, *refined_copies(case, pairs)]


def rotated(poses: ndarray, turn: Callable[[ndarray], ndarray]) -> ndarray:
    return transform(turn(poses[:, :3, :3]), poses[:, :3, 3])


def test_nothing_of_whole_files(tmp_path: Path) -> None:
    assert findings(healthy(), tmp_path) == []


@pytest.mark.parametrize(
    ("turn", "code"),
    [
        (lambda R: np.swapaxes(R, 1, 2), "poses-transposed"),
        (lambda R: rotation_from_quaternion(quaternion(R)[:, [3, 0, 1, 2]]), "quaternion-order"),
    ],
)
def test_the_odd_one_of_three_is_named(
    tmp_path: Path, turn: Callable[[ndarray], ndarray], code: str
) -> None:
    files = healthy()
    files.estimates["b"] = {i: rotated(p, turn) for i, p in files.estimates["b"].items()}
    (finding,) = findings(files, tmp_path)
    assert (finding.code, finding.estimator) == (code, "b")


def test_ground_truth_is_the_odd_one_where_estimators_agree(tmp_path: Path) -> None:
    files = healthy()
    files.truth = {i: rotated(p, lambda R: np.swapaxes(R, 1, 2)) for i, p in files.truth.items()}
    (finding,) = findings(files, tmp_path)
    assert (finding.code, finding.estimator) == ("poses-transposed", "")
    assert finding.path.endswith("test")


def test_copies_refined_copies_and_ground_truth(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["b"] = files.estimates["a"]
    assert [f.code for f in findings(files, tmp_path / "1")] == ["estimator-copied"]
    files.estimates["b"] = files.truth
    assert [f.code for f in findings(files, tmp_path / "2")] == ["estimator-is-truth"]
    errors = {i: invert(files.truth[i]) @ files.estimates["a"][i] for i in files.truth}
    files.estimates["b"] = {
        i: files.truth[i]
        @ transform(rotation_from_vector(0.6 * rotation_vector(e[:, :3, :3])), 0.6 * e[:, :3, 3])
        for i, e in errors.items()
    }
    (finding,) = findings(files, tmp_path / "3")
    assert (finding.code, finding.severity) == ("estimator-refines", "warning")


def test_objects_of_other_numbers(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["b"] = {2: files.estimates["b"][1], 1: files.estimates["b"][2]}
    (finding,) = findings(files, tmp_path)
    assert finding.code == "objects-renumbered"
    assert finding.numbers["mapping"] == {"1": 2, "2": 1}


def test_objects_and_images_of_another_dataset(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["b"] = {7: files.estimates["b"][1]}
    (finding,) = findings(files, tmp_path)
    assert (finding.code, finding.estimator or "b") == ("other-dataset", "b")


def test_without_ground_truth_the_last_of_two_is_asked(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["b"] = {
        i: rotated(p, lambda R: np.swapaxes(R, 1, 2)) for i, p in files.estimates["b"].items()
    }
    case = case_of(files.write(tmp_path, with_truth=False))
    sources, scenes = sources_of(case)
    assert scenes is None
    assert TRUTH not in sources
    (finding,) = conventions(case, sources, pairs_of(sources, case.name))
    assert finding.code == "poses-transposed"


def test_images_that_ground_truth_does_not_have(tmp_path: Path) -> None:
    paths = healthy(names=("a",)).write(tmp_path)
    path = tmp_path / "a_toy-test.csv"
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *("9" + row[1:] for row in rows)]) + "\n")
    (finding,) = belonging(case_of(paths))
    assert (finding.code, finding.path) == ("other-dataset", str(path))
    assert "has estimates of scenes 9, which are not in" in finding.message
    path.write_text("\n".join([header, *("1,9" + row[2:] for row in rows)]) + "\n")
    (finding,) = belonging(case_of(paths))
    assert (finding.code, finding.path) == ("other-dataset", str(path))
    assert "none of its images is in" in finding.message


def test_objects_that_neither_the_models_nor_ground_truth_have(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["b"] = files.estimates["b"] | {7: files.estimates["b"][1]}
    (finding,) = findings(files, tmp_path)
    assert (finding.severity, finding.code) == ("warning", "objects-unknown")
    assert finding.numbers == {"objects": [7]} and finding.path.endswith("b_toy-test.csv")


def test_numbers_that_are_mixed_up_at_random_are_no_renumbering(tmp_path: Path) -> None:
    """Each object's estimates are of both objects, by turns."""
    files = healthy()
    one, two = files.estimates["b"][1], files.estimates["b"][2]
    turn = (np.arange(len(one)) % 2 == 0)[:, None, None]
    files.estimates["b"] = {1: np.where(turn, two, one), 2: np.where(turn, one, two)}
    assert "objects-renumbered" not in [f.code for f in findings(files, tmp_path)]


def test_few_common_instances_prove_no_refinement(tmp_path: Path) -> None:
    files = healthy()
    case = case_of(files.write(tmp_path))
    case.results = {n: t.select(np.arange(5)) for n, t in case.results.items()}
    sources, _ = sources_of(case)
    pairs = pairs_of(sources, case.name)
    assert list(refined_copies(case, pairs)) == []
    case.blamed.add("a")
    assert list(refined_copies(case, pairs)) == []
