"""Results of one estimator in several files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.bop.results import read_results, write_results
from graspcast.errors import InputError
from graspcast.estimates.loading import load_inputs
from graspcast.estimates.parts import put_together
from poses import random_poses, results_of


def write(folder: Path, *numbers: int) -> list[Path]:
    paths = [folder / f"{name}_kit-test.csv" for name in "abcde"[: len(numbers)]]
    for seed, (path, number) in enumerate(zip(paths, numbers, strict=True)):
        write_results(path, results_of(random_poses(3, seed), obj_id=number))
    return paths


def test_files_of_one_estimator_are_put_together(tmp_path: Path) -> None:
    paths = write(tmp_path, 1, 2, 5, 6)
    inputs = load_inputs([("a", path) for path in paths])
    table = inputs.results["kit"]["a"]
    assert table.obj_id.tolist() == np.repeat([1, 2, 5, 6], 3).tolist()
    assert_array_equal(table.cam_T_obj[3:6], read_results(paths[1]).cam_T_obj)
    assert table.source.endswith("c_kit-test.csv and 1 more")
    assert not table.line.any(), "a line of which file?"
    assert inputs.estimators == ("a",)


def test_an_instance_in_two_files_names_both(tmp_path: Path) -> None:
    paths = write(tmp_path, 1, 2, 1)
    with pytest.raises(InputError, match="give one of them") as caught:
        load_inputs([("mine", path) for path in paths])
    said = f"{paths[2]}, line 2: object 1 in image 1/0 is in {paths[0]}, line 2, too"
    assert said in str(caught.value) and "by mine" in str(caught.value)
    assert caught.value.parameters == ("estimates",)


def test_what_was_dropped_is_added_up(tmp_path: Path) -> None:
    paths = write(tmp_path, 1, 2)
    for path in paths:
        path.write_text(path.read_text() + "1,9,1,0.5,1 0 0 0 1 0 0 0 1,0 0 0,-1\n")
    parts = [read_results(path) for path in paths]
    assert put_together("a", parts).dropped == {"placeholder": 2}
    assert put_together("a", parts[:1]) is parts[0]
