"""One change of convention that explains objects that are each seen from one side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy import ndarray

from graspcast.diagnosis.agreement import conventions
from graspcast.diagnosis.pairs import pairs_of, sources_of
from graspcast.diagnosis.single_changes import single_changes
from graspcast.pose.transforms import invert, rotation_from_vector, transform
from sick_files import IMAGES, SickFiles, case_of, healthy


def from_one_side() -> SickFiles:
    files, rng = healthy(), np.random.default_rng(3)
    for i, axis in ((1, [0.9, 0.4, -1.2]), (2, [-1.0, 1.1, 0.3])):
        errors = {n: invert(files.truth[i]) @ e[i] for n, e in files.estimates.items()}
        R = rotation_from_vector(np.array(axis) + rng.normal(0, 0.03, (IMAGES, 3)))
        files.truth[i] = transform(R, files.truth[i][:, :3, 3])
        for name, poses in files.estimates.items():
            poses[i] = files.truth[i] @ errors[name]
    files.boxes = None
    return files


def transposed(poses: ndarray) -> ndarray:
    return transform(np.swapaxes(poses[:, :3, :3], 1, 2), poses[:, :3, 3])


def test_nothing_of_whole_files(tmp_path: Path) -> None:
    case = case_of(from_one_side().write(tmp_path))
    sources, _ = sources_of(case)
    assert list(single_changes(case, sources, pairs_of(sources, case.name))) == []


def test_several_objects_from_one_side(tmp_path: Path) -> None:
    files = from_one_side()
    files.estimates["b"] = {i: transposed(p) for i, p in files.estimates["b"].items()}
    case = case_of(files.write(tmp_path))
    sources, _ = sources_of(case)
    pairs = pairs_of(sources, case.name)
    assert list(conventions(case, sources, pairs)) == []
    (finding,) = single_changes(case, sources, pairs)
    assert (finding.code, finding.estimator) == ("poses-transposed", "b")
