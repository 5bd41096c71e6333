"""BOP results CSV: round trips, and every way in which a file can be wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from graspcast.bop.results import (
    Results,
    read_results,
    score_order,
    write_results,
)
from graspcast.bop.results_rows import COLUMNS
from graspcast.bop.units import metres, millimetres
from graspcast.errors import FormatError, GraspcastError
from poses import ROW, nudged, random_poses, results_of, write_csv


def test_poses_come_back_without_any_error(tmp_path: Path) -> None:
    path = tmp_path / "ours_lmo-test.csv"
    rotation = random_poses(200)
    # Translations as a file in millimetres would give them, of all magnitudes.
    rotation[:, :3, 3] = metres(np.random.default_rng(0).normal(scale=3000, size=(200, 3)))
    rotation[:, 2, 3] = np.abs(rotation[:, 2, 3])
    write_results(path, results_of(rotation))
    back = read_results(path)
    assert_array_equal(back.cam_T_obj, rotation)
    assert_array_equal(back.im_id, np.arange(200))
    assert (back.time_s == -1).all()
    assert back.dropped == {}


def test_a_misspelt_column_is_named(tmp_path: Path) -> None:
    header = ",".join(COLUMNS).replace("obj_id", "object_id")
    with pytest.raises(FormatError, match="no column 'obj_id'; found scene_id, im_id, object_id"):
        read_results(write_csv(tmp_path / "r.csv", ROW, header=header))


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="No such file"):
        read_results(tmp_path / "none.csv")
    with pytest.raises(FormatError, match="directory"):
        read_results(tmp_path)
    (tmp_path / "image.csv").write_bytes(b"\x89PNG\r\n\xff\xfe")
    with pytest.raises(FormatError, match="not UTF-8"):
        read_results(tmp_path / "image.csv")


def test_columns_may_come_in_any_order(tmp_path: Path) -> None:
    path = write_csv(
        tmp_path / "r.csv",
        "7,1,-1,1 0 0 0 1 0 0 0 1,0 0 900,0.5,4",
        header="obj_id,scene_id,time,R,t,score,im_id",
    )
    results = read_results(path)
    assert (results.scene_id[0], results.im_id[0], results.obj_id[0]) == (1, 4, 7)


def test_a_file_without_a_header_is_read_as_bop_reads_it(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "r.csv", ROW, header=ROW.replace("1,2,3", "1,4,3"))
    results = read_results(path)
    assert results.im_id.tolist() == [4, 2]
    assert results.line.tolist() == [1, 2]


def test_times_may_be_missing(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "r.csv", ROW.removesuffix(",-1"), header=",".join(COLUMNS[:-1]))
    results = read_results(path)
    assert results.time_s.tolist() == [-1.0]
    assert (results.scene_id[0], results.obj_id[0]) == (1, 3)


def test_several_detections_of_one_object_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    poses = random_poses(2)
    first = results_of(poses)
    write_results(path, type(first)(**{**first.__dict__, "im_id": np.zeros(2, np.int64)}))
    assert len(read_results(path)) == 2


FRAGMENT = st.sampled_from(
    [
        ROW,
        ",".join(COLUMNS),
        "\n",
        ",",
        '"',
        "1 0 0 0 1 0 0 0 1",
        "nan",
        "\x00",
        "9" * 400,
        "é",
        " ",
    ]
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(st.one_of(st.binary(max_size=300), st.lists(FRAGMENT, max_size=12).map("".join)))
def test_any_bytes_are_read_or_refused(tmp_path: Path, data: bytes | str) -> None:
    path = tmp_path / "fuzz.csv"
    head = ",".join(COLUMNS) + "\n"
    path.write_bytes(data if isinstance(data, bytes) else (head + data).encode())
    for lenient in (False, True):
        try:
            results = read_results(path, lenient=lenient)
        except GraspcastError:
            continue
        assert np.isfinite(results.cam_T_obj).all()


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    write_results(path, results_of(random_poses(3)))
    before = path.read_bytes()
    broken = results_of(nudged(random_poses(3), 1))
    object.__setattr__(broken, "score", np.array(["a", "b", "c"]))
    with pytest.raises(ValueError):
        write_results(path, broken)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_score_order_ignores_the_order_of_the_rows() -> None:
    poses = random_poses(60)
    poses[10:20, :3, 3] = poses[10, :3, 3]  # ten that differ in the rotation only
    poses[20:30, 2, 3] = 0.5  # ten that differ in t_x, t_y
    results = replace(results_of(poses), score=np.repeat([0.3, 0.9, 0.5], 20))
    order = score_order(results)
    assert (np.diff(results.score[order]) <= 0).all()
    shuffled = results.select(np.random.default_rng(1).permutation(60))
    assert_array_equal(shuffled.cam_T_obj[score_order(shuffled)], poses[order])


def test_score_order_takes_the_nearer_of_two_equal_scores_first() -> None:
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :3, 3] = [[0, 0, 2], [1, 0, 1], [0, 1, 1], [0, 0, 1]]
    results = replace(results_of(poses), score=np.ones(4))
    assert score_order(results).tolist() == [3, 2, 1, 0]


def columns(results: Results) -> dict[str, Any]:
    """A table of results as a user has it: lists of numbers, millimetres."""
    return {
        "scene_id": results.scene_id.tolist(),
        "im_id": results.im_id.tolist(),
        "obj_id": results.obj_id.tolist(),
        "score": results.score.tolist(),
        "R": results.cam_T_obj[:, :3, :3].reshape(-1, 9).tolist(),
        "t": millimetres(results.cam_T_obj[:, :3, 3]).tolist(),
        "time": [0.25] * len(results),
    }


def assert_same(one: Results, other: Results) -> None:
    for name in ("scene_id", "im_id", "obj_id", "score", "cam_T_obj"):
        assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.fixture
def some(tmp_path: Path) -> Results:
    """Results whose numbers are those of a file."""
    write_results(tmp_path / "ours_lmo-test.csv", results_of(random_poses(7)))
    return read_results(tmp_path / "ours_lmo-test.csv")


def test_a_polars_frame_gives_the_same_as_a_file(some: Results) -> None:
    results = Results.from_frame(pl.DataFrame(columns(some)))
    assert_same(results, some)
    assert (results.time_s == 0.25).all()
    assert (results.line == 0).all()
    assert results.source == "table"


def test_a_pandas_frame_gives_the_same_as_a_file(some: Results, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="needs pandas: pip install pandas")
    assert_same(Results.from_frame(pandas.DataFrame(columns(some))), some)
    text = pandas.read_csv(tmp_path / "ours_lmo-test.csv")  # R and t stay text
    assert_same(Results.from_frame(text), some)


def test_a_csv_read_by_polars_keeps_its_text(some: Results, tmp_path: Path) -> None:
    assert_same(Results.from_frame(pl.read_csv(tmp_path / "ours_lmo-test.csv")), some)


@pytest.mark.parametrize("shape", [(-1, 9), (-1, 3, 3)])
def test_a_dict_of_arrays(some: Results, shape: tuple[int, ...]) -> None:
    table = {name: np.array(column) for name, column in columns(some).items()}
    table["R"] = table["R"].reshape(shape)
    assert_same(Results.from_frame(table), some)


def test_poses_in_metres_and_no_time(some: Results) -> None:
    names = ("scene_id", "im_id", "obj_id", "score", "cam_T_obj")
    results = Results.from_frame({name: getattr(some, name) for name in names})
    assert_same(results, some)
    assert (results.time_s == -1).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"im_id": [0, -1]}, "row 1: im_id is -1, but should be a whole number, 0 or more"),
        ({"obj_id": [1.0, 1.0]}, "row 0: obj_id is 1.0"),
        ({"scene_id": [True, 1]}, "row 0: scene_id is True"),
        ({"score": [0.5, None]}, "row 1: score is None, but should be a finite number"),
        ({"t": [[0, 0, 900], [0, 900]]}, "row 1: t is [0, 900], but should be three"),
        ({"R": [np.eye(3), np.eye(3) * 1.1]}, "row 1: R is 0.173 away from the nearest"),
        ({"t": [[0, 0, 0.9], [0, 0, 0.8]]}, "is it in metres (0.85 m), not in millimetres?"),
        ({"im_id": [0, 0]}, "row 1: repeats the instance and pose of row 0"),
        ({"score": [1.0]}, "the columns have different lengths"),
    ],
)
def test_a_table_is_checked_as_a_file_is(change: dict[str, Any], says: str) -> None:
    table = {
        "scene_id": [1, 1],
        "im_id": [0, 1],
        "obj_id": [2, 2],
        "score": [0.5, 0.4],
        "R": [np.eye(3), np.eye(3)],
        "t": [[0, 0, 900], [0, 0, 900]],
    }
    assert len(Results.from_frame(table)) == 2
    with pytest.raises(FormatError) as caught:
        Results.from_frame({**table, **change}, source="mine")
    assert str(caught.value).startswith("mine")
    assert says in str(caught.value)


def test_bad_rows_of_a_table_are_skipped_and_placeholders_dropped() -> None:
    table = {
        "scene_id": [1, 1, 1],
        "im_id": [0, 1, 2],
        "obj_id": [2, 2, 2],
        "score": [0.5, float("nan"), 0.4],
        "R": [np.eye(3)] * 3,
        "t": [[0, 0, 900], [0, 0, 900], [0, 0, 0]],
    }
    results = Results.from_frame(table, lenient=True)
    assert len(results) == 1
    assert results.dropped == {"bad row": 1, "placeholder": 1}
    assert len(Results.from_frame(table, lenient=True, placeholders=True)) == 2


def test_missing_columns_are_named() -> None:
    with pytest.raises(FormatError, match="no column 'R', 't'; found scene_id, im_id, obj_id, s"):
        Results.from_frame({"scene_id": [], "im_id": [], "obj_id": [], "score": []})


@pytest.mark.parametrize(
    "matrix", [np.eye(3), [[1, 0, 0, 0]] * 4, [[1, 0, 0, 0], [0, 1, 0, 0]], "x"]
)
def test_what_is_no_pose(matrix: Any) -> None:
    row = {"scene_id": [1], "im_id": [0], "obj_id": [2], "score": [0.5], "cam_T_obj": [matrix]}
    with pytest.raises(FormatError, match=r"cam_T_obj should be 4x4|the last row"):
        Results.from_frame(row)


def test_the_representation_is_short(some: Results) -> None:
    assert repr(some) == "Results(7 poses of 1 object in 7 images, ours_lmo-test.csv)"
    assert repr(some.select(np.array([0]))).startswith("Results(1 pose of 1 object in 1 image, ")


def test_zero_translation_is_a_placeholder_whatever_the_rotation(tmp_path: Path) -> None:
    poses = random_poses(6, 2)
    poses[[1, 4], :3, 3] = 0
    write_results(tmp_path / "a_lmo-test.csv", results_of(poses))
    back = read_results(tmp_path / "a_lmo-test.csv")
    assert back.im_id.tolist() == [0, 2, 3, 5]
    assert back.dropped == {"placeholder": 2}
    assert len(read_results(tmp_path / "a_lmo-test.csv", placeholders=True)) == 6


def test_objects_behind_the_camera_are_refused(tmp_path: Path) -> None:
    poses = random_poses(6, 2)
    poses[3, 2, 3] = -0.5
    write_results(tmp_path / "a_lmo-test.csv", results_of(poses))
    with pytest.raises(
        FormatError, match=r"line 5: the object is behind the camera \(t_z is -500 mm"
    ):
        read_results(tmp_path / "a_lmo-test.csv")
    assert len(read_results(tmp_path / "a_lmo-test.csv", lenient=True)) == 5


@pytest.mark.ill_typed
def test_columns_that_do_not_fit_each_other_are_named(some: Results) -> None:
    with pytest.raises(FormatError, match=r"cam_T_obj should be an array of numbers of shape \(7,"):
        replace(some, cam_T_obj=some.cam_T_obj[:3])
    with pytest.raises(FormatError, match="obj_id should be an array of integers"):
        replace(some, obj_id=some.obj_id * 1.5)
    with pytest.raises(FormatError, match="a score is not a finite number"):
        replace(some, score=np.where(some.im_id == 3, np.nan, some.score))


@pytest.mark.ill_typed
@pytest.mark.parametrize("table", [5, [1, 2], "scene_id"])
def test_what_is_no_table_is_refused(table: Any) -> None:
    kind = type(table).__name__
    with pytest.raises(
        FormatError, match=f"should be a DataFrame, or a dict of columns, not {kind}"
    ):
        Results.from_frame(table)
