"""The authors' release becomes the files that were published from it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.bop.results import read_results
from graspcast.errors import FormatError, InputError
from graspcast.paper.release import Imported, import_release
from graspcast.views.camera_tables import read_camera_motion


@pytest.fixture(scope="module")
def imported(
    data_dir: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[Imported]]:
    out = tmp_path_factory.mktemp("release")
    return out, import_release(data_dir / "raw" / "Consensus-Driven-Uncertainty", out)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lmo", "ycbv"])
def test_estimates_outcomes_and_splits_equal_the_published(
    imported: tuple[Path, list[Imported]], published: Path, name: str
) -> None:
    ours, theirs = imported[0] / name, published / name
    same = ["trials.csv", "split.csv", "visibility.csv"]
    for file in [*same, *(f"{e}_{name}-test.csv" for e in ("epos", "gdrnpp", "zebrapose"))]:
        assert (ours / file).read_bytes() == (theirs / file).read_bytes(), file
    assert pl.read_parquet(ours / "trials.parquet").equals(
        pl.read_parquet(theirs / "trials.parquet")
    )
    read = (json.loads((d / "targets_all_gt.json").read_text()) for d in (ours, theirs))
    assert next(read) == next(read)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lmo", "ycbv"])
def test_ground_truth_equals_the_published_but_for_what_no_estimator_found(
    imported: tuple[Path, list[Imported]], published: Path, name: str
) -> None:
    absent = []
    for file in ("scene_gt.json", "scene_gt_info.json"):
        for path in sorted((published / name / "ground_truth").glob(f"*/{file}")):
            theirs = json.loads(path.read_text())
            ours = json.loads(
                (imported[0] / name / "ground_truth" / path.parent.name / file).read_text()
            )
            assert ours.keys() == theirs.keys()
            for image, instances in theirs.items():
                extra = [i for i in instances if i not in ours[image]]
                assert [i for i in instances if i in ours[image]] == ours[image]
                if file == "scene_gt.json":
                    absent += [(path.parent.name, image, i["obj_id"]) for i in extra]
    found = {"lmo": [], "ycbv": [("000050", im, 4) for im in ("681", "701", "722", "737")]}
    assert absent == found[name]
    assert {i.dataset: i.unseen for i in imported[1]}[name] == len(absent)


@pytest.mark.slow
def test_camera_motion_is_that_of_the_annotation_where_scenes_are_static(
    imported: tuple[Path, list[Imported]], published: Path
) -> None:
    theirs = read_camera_motion(published / "ycbv" / "camera_motion").world_T_cam
    ours = read_camera_motion(imported[0] / "ycbv" / "camera_motion").world_T_cam
    assert ours.keys() == theirs.keys()
    for image, world_T_cam in theirs.items():
        assert_allclose(ours[image], world_T_cam, atol=1e-6)
    assert not (imported[0] / "lmo" / "camera_motion").exists()


@pytest.mark.slow
def test_poses_are_those_of_the_arrays(
    imported: tuple[Path, list[Imported]], data_dir: Path
) -> None:
    folder = data_dir / "raw" / "Consensus-Driven-Uncertainty" / "Pose-Estimates"
    with np.load(folder / "ZebraPose" / "YCBV" / "pose_data_ycbv-4-zebrapose.npz") as data:
        expected = data["T_est"]
    results = read_results(imported[0] / "ycbv" / "zebrapose_ycbv-test.csv", placeholders=True)
    ours = results.cam_T_obj[results.obj_id == 4]

    # The files are sorted by image, the arrays are not.
    def order(poses: np.ndarray) -> np.ndarray:
        return poses[np.lexsort(poses[:, :3, 3].T)]

    assert_array_equal(order(ours), order(expected))


def make_release(root: Path) -> Path:
    """A release of one object and two images, the second one not found."""
    folder = root / "Pose-Estimates" / "EPOS" / "LMO" / "weights"
    folder.mkdir(parents=True)
    pose = np.eye(4)[None].copy()
    pose[0, 2, 3] = 0.9
    np.savez(folder / "pose_data_lmo-1-epos.npz", T_est=pose, T_gt=pose)
    (folder / "lmo-1-epos.txt").write_text(
        "#  comment\n000002\t3\t0\tTP\t0.5\t0.9\t1\t0.1\t1,2,3,4\t1,2,3,4\n"
        "000002\t8\t*\tFN\t0.25\t*\t*\t*\t1,2,3,4\t*\n"
        "000002\t9\t*\tFP\t*\t0.1\t*\t*\t*\t1,2,3,4\n"
    )
    trials = root / "Parallel-Gripper" / "EPOS" / "LMO" / "weights"
    trials.mkdir(parents=True)
    (trials / "lmo-1-epos-parallel-results.txt").write_text("1\t1\n")
    return folder


def test_a_small_release(tmp_path: Path) -> None:
    make_release(tmp_path / "release")
    lmo, _ = import_release(tmp_path / "release", tmp_path / "out")
    assert lmo == Imported("lmo", {"epos": 1}, trials=1, instances=2, unseen=1)
    trials = pl.read_csv(tmp_path / "out" / "lmo" / "trials.csv")
    assert trials.row(0) == ("epos", "lmo", 2, 3, 1, "parallel", 1)


def test_estimates_by_weights_that_no_trial_used_are_left_out(tmp_path: Path) -> None:
    folder = make_release(tmp_path / "release")
    other = folder.parent / "a-other-weights"
    shutil.copytree(folder, other)
    pose = np.eye(4)[None].copy()
    pose[0, 2, 3] = 0.7
    np.savez(other / "pose_data_lmo-1-epos.npz", T_est=pose, T_gt=pose)
    (other / "NOTE.txt").write_text("The weights are damaged.\n")
    lmo, _ = import_release(tmp_path / "release", tmp_path / "out")
    assert lmo == Imported("lmo", {"epos": 1}, trials=1, instances=2, unseen=1)
    poses = read_results(tmp_path / "out" / "lmo" / "epos_lmo-test.csv").cam_T_obj
    assert_allclose(poses[0, 2, 3], 0.9)


@pytest.mark.parametrize(
    ("file", "content", "says"),
    [
        ("lmo-1-epos.txt", "1\t2\t3\n", "line 1: should have ten fields"),
        ("lmo-1-epos.txt", "# nothing\n", "names 0 of the 1 poses"),
        ("lmo-1-epos.txt", "2\t3\t7\tTP\t0\t0\t0\t0\t1,2\t0\n", "line 1: names row 7 of 1"),
        ("lmo-1-epos.txt", "2\tx\t0\tTP\t0\t0\t0\t0\t1,2\t0\n", "line 1: unexpected fields"),
        ("pose_data_lmo-1-epos.npz", "PK", "not a complete npz file"),
        ("lmo-one-epos.txt", "", "is not named as an index"),
        (
            "../../../../Parallel-Gripper/EPOS/LMO/weights/lmo-1-epos-parallel-results.txt",
            "2\t1\n",
            "position 2, outcome 1",
        ),
    ],
)
def test_a_damaged_release_is_refused(tmp_path: Path, file: str, content: str, says: str) -> None:
    folder = make_release(tmp_path / "release")
    (folder / file).write_text(content)
    with pytest.raises(FormatError) as caught:
        import_release(tmp_path / "release", tmp_path / "out")
    assert says in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_some_other_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no folder Pose-Estimates"):
        import_release(tmp_path, tmp_path / "out")
