"""Messages of readers get stable codes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspcast.bop.results import read_results, write_results
from graspcast.diagnosis.refusals import code_of, refusal
from graspcast.errors import FormatError, GraspcastError, InputError
from sick_files import healthy


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda p: p * [1, 1, 1, 1e-3], "results-unit"),
        (lambda p: np.linalg.inv(np.diag([1.0, -1, -1, 1])) @ p, "camera-axes"),
        (lambda p: p * [-1, 1, 1, 1], "poses-mirrored"),
    ],
)
def test_what_readers_say_of_results(tmp_path: Path, change: object, code: str) -> None:
    files = healthy()
    files.estimates["a"] = {i: change(p) for i, p in files.estimates["a"].items()}  # type: ignore[operator]
    path = tmp_path / "a.csv"
    table = files.results("a", files.estimates["a"])
    table.cam_T_obj[:, 3] = [0, 0, 0, 1]
    write_results(path, table)
    with pytest.raises(GraspcastError) as caught:
        read_results(path)
    assert refusal(caught.value, "results", path).code == code


def test_what_is_not_known_is_unreadable() -> None:
    assert code_of(InputError("odd"), "outcomes")[0] == "outcomes-unreadable"


def test_file_and_place_are_kept() -> None:
    found = refusal(FormatError("f.json", "is odd", where="entry 3"), "boxes", "other")
    assert (found.path, found.message) == ("f.json", "entry 3: is odd")
