"""Outcomes of trials: three ways to store them, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.estimates.instances import InstanceKey, Instances
from graspcast.estimates.outcomes import (
    ERROR_COLUMNS,
    TRIAL_COLUMNS,
    error_numbers,
    errors_of_each,
    read_all_outcomes,
    read_error_outcomes,
    read_outcomes,
    success_of_each,
)
from graspcast.io.tables import write_table
from poses import random_poses

HEADER = "estimator,dataset,scene_id,im_id,obj_id,gripper,success"
ROWS = ["epos,lmo,2,3,1,parallel,1", "epos,lmo,2,3,5,parallel,0", "gdrnpp,lmo,2,3,1,parallel,1"]


def write(path: Path, *rows: str, header: str = HEADER) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_csv_parquet_and_shards_say_the_same(tmp_path: Path) -> None:
    from_csv = read_outcomes(write(tmp_path / "a.csv", *ROWS))
    assert from_csv.columns == [*TRIAL_COLUMNS, "success"]
    assert from_csv["est_id"].to_list() == [None] * 3
    assert from_csv["grasp"].to_list() == ["reference"] * 3
    assert from_csv["success"].to_list() == [1, 0, 1]
    write_table(tmp_path / "a.parquet", from_csv.drop("est_id"))
    assert read_outcomes(tmp_path / "a.parquet").equals(from_csv)
    for i in range(3):
        write_table(
            tmp_path / "campaign" / f"{i % 2}" / f"part-{i}.parquet",
            from_csv.drop("est_id")[i : i + 1],
        )
    shards = read_outcomes(tmp_path / "campaign")
    assert shards.sort(TRIAL_COLUMNS).equals(from_csv.sort(TRIAL_COLUMNS))
    write_table(tmp_path / "b.csv", from_csv.drop("est_id"))
    assert read_outcomes(tmp_path / "b.csv").equals(from_csv)


def test_columns_may_stand_in_any_order_with_others_beside_them(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.csv",
        "1,0.5,2,parallel,epos,5,lmo,9,1",
        header="success,score,scene_id,gripper,estimator,im_id,dataset,est_id,obj_id",
    )
    row = ("epos", "lmo", 2, 5, 1, 9, "parallel", "reference", 1)
    assert read_outcomes(path).row(0) == row


def test_success_may_be_true_or_false(tmp_path: Path) -> None:
    frame = read_outcomes(write(tmp_path / "a.csv", *ROWS))
    write_table(
        tmp_path / "b.parquet",
        frame.drop("est_id").with_columns(pl.col("success").cast(pl.Boolean)),
    )
    assert read_outcomes(tmp_path / "b.parquet").equals(frame)


@pytest.mark.parametrize(
    "name", [c for c in (*TRIAL_COLUMNS, "success") if c not in ("est_id", "grasp")]
)
def test_a_column_that_is_not_there_is_named(tmp_path: Path, name: str) -> None:
    header = ",".join(f"{c}s" if c == name else c for c in HEADER.split(","))
    path = write(tmp_path / "a.csv", *ROWS, header=header)
    with pytest.raises(FormatError) as caught:
        read_outcomes(path)
    assert str(caught.value) == f"{path}: no column {name!r}; found {', '.join(header.split(','))}"


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("epos,lmo,2,4,1,parallel,2", "row 4: success is 2, not 0 or 1"),
        ("epos,lmo,2,4,1,parallel,-1", "row 4: success is -1, not 0 or 1"),
        ("epos,lmo,2,4,1,parallel,", "row 4: an empty field"),
        ("epos,lmo,,4,1,parallel,1", "row 4: an empty field"),
        (",lmo,2,4,1,parallel,1", "row 4: an empty field"),
        ("epos,lmo,2,4,1,parallel,yes", "a column does not hold what it should"),
        ("epos,lmo,2,four,1,parallel,1", "a column does not hold what it should"),
        ("epos,lmo,2,4.5,1,parallel,1", "row 4: im_id is 4.5, not a whole number"),
        ("epos,lmo,2,4,1,parallel,0.5", "row 4: success is 0.5, not a whole number"),
        ("epos,lmo,2,4,1,parallel,NaN", "row 4: success is nan, not a whole number"),
        (ROWS[0], "share their trial with another: estimator epos, dataset lmo, scene_id 2, im_id"),
        ("epos,lmo,2,4,1,parallel,1,7", "is not a CSV file"),
    ],
)
def test_a_bad_row_is_refused(tmp_path: Path, row: str, says: str) -> None:
    path = write(tmp_path / "a.csv", *ROWS, row)
    with pytest.raises(FormatError) as caught:
        read_outcomes(path)
    assert says in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_what_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"a\.csv: cannot be read"):
        read_outcomes(tmp_path / "a.csv")
    (tmp_path / "a.parquet").write_bytes(b"PAR1")
    with pytest.raises(FormatError, match=r"a\.parquet: is not a Parquet file"):
        read_outcomes(tmp_path / "a.parquet")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FormatError, match="no Parquet files in this directory"):
        read_outcomes(tmp_path / "empty")
    (tmp_path / "a.csv").write_text("")
    with pytest.raises(FormatError, match="is not a CSV file"):
        read_outcomes(tmp_path / "a.csv")
    assert len(read_outcomes(write(tmp_path / "a.csv"))) == 0


fields = st.sampled_from(["", "1", "0", "x", "-7", "1e9", '"', '"a', "99999999999999999999", "é"])
tables = st.lists(st.lists(fields, max_size=9).map(",".join), max_size=4)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.one_of(
        st.binary(max_size=120),
        tables.map(lambda t: "\n".join([HEADER, *t]).encode()),
        st.binary(max_size=40).map(f"{HEADER}\n{ROWS[0]}\n".encode().__add__),
    ),
)
@example(content=b"\xef\xbb\xbf" + HEADER.encode())
@example(content=b"(\xb5/\xfd")  # begins as Zstandard does
def test_any_bytes_are_read_or_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    try:
        frame = read_outcomes(path)
    except FormatError as error:
        assert str(error).startswith(str(path))
    else:
        assert frame["success"].is_in([0, 1]).all()
        assert frame.drop("est_id").null_count().sum_horizontal().sum() == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lmo", "ycbv"])
def test_the_published_files_agree(published: Path, name: str) -> None:
    from_csv = read_outcomes(published / name / "trials.csv")
    assert from_csv.equals(read_outcomes(published / name / "trials.parquet"))
    assert set(from_csv["gripper"]) == {"parallel", "underactuated"}


# --- Errors that guided trials --------------------------------------------------------------------


def guided(errors: np.ndarray) -> pl.DataFrame:
    n = len(errors)
    columns = {
        "estimator": ["a"] * n,
        "dataset": ["lmo"] * n,
        "scene_id": [0] * n,
        "im_id": list(range(n)),
        "obj_id": [1 + i % 2 for i in range(n)],
        "gripper": ["parallel"] * n,
        "success": [i % 3 // 2 for i in range(n)],
    }
    numbers = zip(ERROR_COLUMNS, error_numbers(errors).T.tolist(), strict=True)
    return pl.DataFrame(columns | dict(numbers))


@pytest.mark.parametrize("name", ["x.csv", "x.parquet"])
def test_errors_come_back_as_the_poses_they_were(tmp_path: Path, name: str) -> None:
    errors = random_poses(40, 3)  # turns of every size
    write_table(tmp_path / name, guided(errors))
    table, found = read_error_outcomes(tmp_path / name)
    assert_allclose(found, errors, atol=1e-9)
    assert table.columns == ["object", "gripper", "grasp", "success"]
    assert table["object"].to_list() == ["lmo-1", "lmo-2"] * 20
    assert_array_equal(table["success"].to_numpy(), np.arange(40) % 3 == 2)
    # The same file still is one of outcomes.
    assert read_outcomes(tmp_path / name)["success"].to_list() == [i % 3 // 2 for i in range(40)]


def test_outcomes_without_errors_or_with_holes_in_them_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    whole = guided(random_poses(5))
    write_table(path, whole.drop("error_ry_rad"))
    with pytest.raises(FormatError, match="no column 'error_ry_rad'; give a campaign of sim"):
        read_error_outcomes(path)
    for hole in (None, float("nan"), float("inf")):
        holed = whole.with_columns(
            error_z_m=pl.when(pl.col("im_id") == 3).then(hole).otherwise(pl.col("error_z_m"))
        )
        write_table(path, holed)
        with pytest.raises(FormatError, match="row 4: an empty field"):
            read_error_outcomes(path)
    write_table(path, whole.with_columns(error_x_m=pl.lit("far")))
    with pytest.raises(FormatError, match="does not hold what it should"):
        read_error_outcomes(path)


# --- Which instance an outcome is of --------------------------------------------------------------

INSTANCES = Instances.of(
    [InstanceKey("lmo", 2, 3, 1, 0), InstanceKey("lmo", 2, 3, 1, 1), InstanceKey("lmo", 2, 3, 5, 0)]
)


def test_outcomes_find_their_instances_by_the_whole_key(tmp_path: Path) -> None:
    rows = [
        "b,lmo,2,3,1,hand,0,0",
        "a,lmo,2,3,1,hand,1,1",
        "a,lmo,2,3,1,hand,0,0",
        "a,icbin,2,3,5,hand,1,0",
    ]
    table = read_outcomes(
        write(tmp_path / "a.csv", *rows, header=HEADER.replace("success", "success,est_id"))
    )
    assert success_of_each(INSTANCES, table, "a", "hand")[:2].tolist() == [0, 1]
    assert np.isnan(success_of_each(INSTANCES, table, "a", "hand")[2])
    assert np.isnan(success_of_each(INSTANCES, table, "a", "claw")).all()
    assert np.isnan(success_of_each(INSTANCES, table, "a", "hand", grasp="side")).all()


def test_outcomes_without_est_id_are_refused_where_an_object_has_several_instances(
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "a.csv", "a,lmo,2,3,1,hand,1", "a,lmo,2,3,5,hand,1")
    table = read_outcomes(path)
    with pytest.raises(
        MismatchError, match="image 2/3 has several instances of lmo-1, but the outc"
    ):
        success_of_each(INSTANCES, table, "a", "hand")
    # Another object's instances, and another estimator's outcomes, are no reason.
    assert success_of_each(INSTANCES.select(np.array([0, 2])), table, "a", "hand").tolist() == [
        1,
        1,
    ]
    assert np.isnan(success_of_each(INSTANCES, table, "b", "hand")).all()
    twice = write(tmp_path / "b.csv", "a,lmo,2,3,1,hand,1", "a,lmo,2,3,1,hand,0")
    with pytest.raises(FormatError, match="add a column est_id"):
        read_outcomes(twice)


def test_the_former_name_of_est_id_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "a,lmo,2,3,1,hand,1,4", header=HEADER + ",inst_id")
    assert read_outcomes(path)["est_id"].to_list() == [4]
    both = write(tmp_path / "b.csv", "a,lmo,2,3,1,hand,1,4,4", header=HEADER + ",inst_id,est_id")
    with pytest.raises(FormatError, match="has both est_id and inst_id"):
        read_outcomes(both)


def test_stored_errors_are_read_back_with_their_outcomes(tmp_path: Path) -> None:
    errors = random_poses(3, 5)
    table = INSTANCES.frame().with_columns(
        estimator=pl.lit("a"), gripper=pl.lit("hand"), success=pl.Series([1, 0, 1])
    )
    columns = dict(zip(ERROR_COLUMNS, error_numbers(errors).T.tolist(), strict=True))
    write_table(
        tmp_path / "a.parquet", table.with_columns(**{k: pl.Series(v) for k, v in columns.items()})
    )
    outcomes = read_outcomes(tmp_path / "a.parquet")
    turned = INSTANCES.select(np.array([2, 0, 1]))
    assert success_of_each(turned, outcomes, "a", "hand").tolist() == [1, 1, 0]
    assert_allclose(errors_of_each(turned, outcomes, "a", "hand"), errors[[2, 0, 1]], atol=1e-9)
    assert np.isnan(errors_of_each(turned, outcomes, "b", "hand")).all()
    write_table(tmp_path / "b.parquet", table.with_columns(estimator=pl.lit("b")))
    both = read_all_outcomes([tmp_path / "a.parquet", tmp_path / "b.parquet"])
    assert np.isnan(errors_of_each(turned, both, "b", "hand")).all()
    assert success_of_each(turned, both, "b", "hand").tolist() == [1, 1, 0]


def test_an_outcome_with_and_one_without_est_id_are_the_same_trial(tmp_path: Path) -> None:
    one = write(tmp_path / "a.csv", "a,lmo,2,3,5,hand,1")
    two = write(tmp_path / "b.csv", "a,lmo,2,3,5,hand,1,0", header=HEADER + ",est_id")
    with pytest.raises(InputError, match=r"a\.csv, .*b\.csv: 2 rows share .* leave one row"):
        read_all_outcomes([one, two])


def test_instances_that_are_not_asked_for_make_outcomes_ambiguous_too(tmp_path: Path) -> None:
    table = read_outcomes(write(tmp_path / "a.csv", "a,lmo,2,3,1,hand,1"))
    first, second = INSTANCES.select(np.array([0])), INSTANCES.select(np.array([1]))
    assert success_of_each(first, table, "a", "hand").tolist() == [1]
    with pytest.raises(MismatchError, match="several instances of lmo-1"):
        success_of_each(first, table, "a", "hand", others=second)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t.with_columns(success=7), "row 1: success is 7, not 0 or 1"),
        (lambda t: t.drop("dataset"), "no column 'dataset'"),
        (lambda t: pl.concat([t, t]), "share their trial.*leave one row of each trial$"),
        (
            lambda t: pl.concat(2 * [t.with_columns(estimator=pl.lit("fused"))]),
            "estimators of their own: fused2, fused3",
        ),
        (lambda t: t.with_columns(obj_id=1.5), "obj_id is 1.5, not a whole number"),
    ],
)
def test_tables_in_memory_are_checked_as_files_are(change: object, says: str) -> None:
    table = INSTANCES.frame().with_columns(
        estimator=pl.lit("a"), gripper=pl.lit("hand"), success=pl.lit(1)
    )
    assert success_of_each(INSTANCES, table, "a", "hand").tolist() == [1, 1, 1]
    with pytest.raises(InputError, match=says):
        success_of_each(INSTANCES, change(table), "a", "hand")  # type: ignore[operator]
