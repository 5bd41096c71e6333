"""Other model frames, and symmetries that are not stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspcast.bop.meshes import Mesh
from graspcast.bop.models_writing import info_entry
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.frames import frame_findings, symmetry_findings
from graspcast.diagnosis.pairs import pairs_of, sources_of
from graspcast.pose.transforms import invert, rotation_angle, rotation_from_vector, transform
from sick_files import SickFiles, boxes_of, case_of, healthy

D = transform(rotation_from_vector(np.array([0.3, -0.8, 0.5])), np.array([0.03, -0.01, 0.05]))


def findings(files: SickFiles, tmp_path: Path) -> list[Finding]:
    case = case_of(files.write(tmp_path))
    sources, _ = sources_of(case)
    pairs = pairs_of(sources, case.name)
    return [*symmetry_findings(case, pairs), *frame_findings(case, sources, pairs)]


def test_nothing_of_whole_files(tmp_path: Path) -> None:
    assert findings(healthy(), tmp_path) == []


def test_the_repair_mends_the_odd_one(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["b"] = {i: p @ invert(D) for i, p in files.estimates["b"].items()}
    (finding,) = findings(files, tmp_path)
    assert (finding.code, finding.estimator) == ("other-model-frame", "b")
    assert set(finding.repair) == {1, 2}
    for repair in finding.repair.values():
        apart = invert(D) @ repair
        assert np.linalg.norm(apart[:3, 3]) < 1.5e-3
        assert rotation_angle(apart[:3, :3]) < np.radians(1.0)


def test_thirty_images_and_three_unbiased_estimators_repair_to_half_a_millimetre(
    tmp_path: Path,
) -> None:
    files = healthy(names=("a", "b", "c"))
    for name in files.estimates:
        files.estimates[name] = {
            i: files.truth[i]
            @ transform(
                rotation_from_vector(
                    np.random.default_rng([i, ord(name)]).normal(0, 0.008, (24, 3))
                ),
                np.random.default_rng([ord(name), i]).normal(0, 0.001, (24, 3)),
            )
            @ invert(D)
            for i in files.truth
        }
    (finding,) = findings(files, tmp_path)
    assert finding.message.startswith("all estimators")
    for repair in finding.repair.values():
        apart = invert(D) @ repair
        assert np.linalg.norm(apart[:3, 3]) < 0.5e-3
        assert rotation_angle(apart[:3, :3]) < np.radians(0.2)


@pytest.mark.slow
def test_usual_frames_are_repaired_exactly(tmp_path: Path) -> None:
    files = healthy()
    low = files.meshes[1].vertices.min(axis=0)
    middle = low + np.ptp(files.meshes[1].vertices, axis=0) / 2
    bottom = np.array([middle[0], middle[1], low[2]])
    turn = rotation_from_vector(np.array([0, 0, np.pi / 2]))
    frame = transform(turn, -turn @ bottom)
    files.estimates["b"][1] = files.estimates["b"][1] @ invert(frame)
    (finding,) = findings(files, tmp_path)
    assert finding.numbers["1"]["exact"]
    np.testing.assert_allclose(finding.repair[1], frame, atol=1e-4)


def test_a_symmetry_that_is_not_stated(tmp_path: Path) -> None:
    """A box: one estimator sees it either way round."""
    files = healthy()
    box = trimesh.creation.box((0.06, 0.09, 0.03)).subdivide().subdivide()
    files.meshes[1] = Mesh(np.array(box.vertices), np.array(box.faces))
    files.info["1"] = info_entry(files.meshes[1].vertices)
    files.boxes[1] = boxes_of(files.meshes[1], files.truth[1])
    turn = transform(rotation_from_vector(np.array([0, 0, np.pi])), np.zeros(3))
    files.estimates["b"][1][::2] = files.estimates["b"][1][::2] @ turn
    (finding,) = findings(files, tmp_path)
    assert finding.code == "symmetry-unstated"
    assert abs(finding.numbers["axis"][2]) > 0.99


def test_one_estimator_in_another_frame_than_ground_truth_and_without_models(
    tmp_path: Path,
) -> None:
    """Of two either may be the odd one; a turn without a mesh may be a symmetry."""
    files = healthy(names=("a",))
    small = transform(rotation_from_vector(np.array([0.1, -0.2, 0.1])), np.array([0.03, 0, 0.04]))
    files.estimates["a"] = {i: p @ invert(small) for i, p in files.estimates["a"].items()}
    (finding,) = findings(files, tmp_path)
    assert finding.code == "other-model-frame"
    assert finding.message.startswith("a differs from ground truth by a constant transform")
    case = case_of([(n, p) for n, p in files.write(tmp_path / "2")])
    case.models = None
    sources, _ = sources_of(case)
    (finding,) = frame_findings(case, sources, pairs_of(sources, case.name))
    for repair in finding.repair.values():
        assert np.linalg.norm((invert(small) @ repair)[:3, 3]) < 3e-3


def test_few_images_prove_no_frame(tmp_path: Path) -> None:
    files = healthy()
    files.estimates["b"] = {i: p @ invert(D) for i, p in files.estimates["b"].items()}
    case = case_of(files.write(tmp_path))
    few = {n: t.select(t.im_id < 5) for n, t in case.results.items()}
    assert list(frame_findings(case, few, pairs_of(few, case.name))) == []


def test_a_solid_of_revolution_that_is_seen_at_any_turn(tmp_path: Path) -> None:
    files, rng = healthy(), np.random.default_rng(4)
    rod = trimesh.creation.cylinder(0.03, 0.09, sections=48).subdivide()
    files.meshes[1] = Mesh(np.array(rod.vertices), np.array(rod.faces))
    files.info["1"] = info_entry(files.meshes[1].vertices)
    files.boxes[1] = boxes_of(files.meshes[1], files.truth[1])
    n = len(files.truth[1])
    turns = np.stack([np.zeros(n), np.zeros(n), rng.uniform(-np.pi, np.pi, n)], axis=1)
    spun = transform(rotation_from_vector(turns), np.zeros((n, 3)))
    files.estimates["b"][1] = files.estimates["b"][1] @ spun
    (finding,) = (f for f in findings(files, tmp_path) if f.code == "symmetry-unstated")
    assert abs(finding.numbers["axis"][2]) > 0.99 and "° to 1" in finding.message
