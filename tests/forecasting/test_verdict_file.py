"""The verdicts' file."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.errors import FormatError
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.verdict import (
    Verdict,
    VerdictRow,
    decide,
)
from graspcast.forecasting.verdict_file import COLUMNS, read_verdicts, write_verdicts
from graspcast.views.next_look import NextLook
from poses import random_poses

share = st.floats(0, 1)


def verdict_row(
    verdict: Verdict, *key: int, dataset: str = "lmo", cam_T_obj: np.ndarray | None = None
) -> VerdictRow:
    pose = np.eye(4) if cam_T_obj is None else cam_T_obj
    numbers = (*key, 1, 0, 0, 0)[:4]
    return VerdictRow(InstanceKey(dataset, *numbers), "gdrnpp", "parallel", verdict, pose)


HEADER = ",".join(COLUMNS)


def test_the_file_to_the_letter(tmp_path: Path) -> None:
    pose = np.array([[0, -1, 0, 0.1], [1, 0, 0, -0.25], [0, 0, 1, 0.9], [0, 0, 0, 1.0]])
    rows = [
        verdict_row(decide(0.9, 0.5), 2, 3, 1, 0, cam_T_obj=pose),
        verdict_row(Verdict(False, None, "no estimate by epos, zebra"), 2, 3, 1, 1, cam_T_obj=pose),
        verdict_row(
            Verdict(False, 0.25, 'an object that is "unseen"'), 2, 5, 12, 0, cam_T_obj=pose
        ),
    ]
    write_verdicts(tmp_path / "verdicts.csv", rows)
    guide = "0.0 -1.0 0.0 1.0 0.0 0.0 0.0 0.0 1.0,100.0 -250.0 900.0,1,,,,,,"
    assert (tmp_path / "verdicts.csv").read_bytes().decode() == (
        "dataset,scene_id,im_id,obj_id,est_id,principal,gripper,grasp,probability,verdict,reason,R,t,"
        "views,look_direction,look_direction_world,look_axis,look_axis_sd_mm,look_angle_deg,"
        "expected_probability\n"
        f"lmo,2,3,1,0,gdrnpp,parallel,reference,0.900000,attempt,probability 0.900 >= 0.5,{guide}\n"
        f'lmo,2,3,1,1,gdrnpp,parallel,reference,,abstain,"no estimate by epos, zebra",{guide}\n'
        "lmo,2,5,12,0,gdrnpp,parallel,reference,0.250000,abstain,"
        f'"an object that is ""unseen""",{guide}\n'
    )


# Python's csv quotes no lone carriage return; reasons and names of grippers have none.
texts = st.text(st.characters(codec="utf-8", exclude_characters="\0\r"), max_size=20)


@given(
    st.lists(
        st.tuples(st.integers(0, 10**6), texts, st.none() | share),
        max_size=5,
        unique_by=lambda t: t[0],
    ),
    st.integers(0, 2**31),
)
def test_whatever_the_reason_the_file_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    given_rows: list[tuple[int, str, float | None]],
    seed: int,
) -> None:
    path = tmp_path_factory.mktemp("verdicts") / "verdicts.csv"
    poses = random_poses(len(given_rows), seed)
    rows = [
        verdict_row(Verdict(False, p, why), 1, i, 2, cam_T_obj=pose)
        for (i, why, p), pose in zip(given_rows, poses, strict=True)
    ]
    write_verdicts(path, rows)
    back = read_verdicts(path)
    assert [r.key for r in back] == [r.key for r in rows]
    for read, wrote in zip(back, rows, strict=True):
        assert read.verdict.reason == wrote.verdict.reason
        assert (read.principal, read.gripper, read.grasp) == ("gdrnpp", "parallel", "reference")
        # Millimetres come back exactly only where they began as millimetres.
        assert_allclose(read.cam_T_obj, wrote.cam_T_obj, rtol=1e-15)
        if wrote.verdict.probability is None:
            assert read.verdict.probability is None
        else:
            assert read.verdict.probability == pytest.approx(wrote.verdict.probability, abs=5e-7)


def test_no_verdicts_is_a_header(tmp_path: Path) -> None:
    write_verdicts(tmp_path / "deep" / "verdicts.csv", [])
    assert (tmp_path / "deep" / "verdicts.csv").read_text() == HEADER + "\n"
    assert read_verdicts(tmp_path / "deep" / "verdicts.csv") == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "attempt,prob",
            "perhaps,prob",
            "line 2: the verdict is 'perhaps', not attempt, look again or abstain",
        ),
        ("0.900000", "1.5", "line 2: the probability is 1.5, not from 0 to 1"),
        ("0.900000", "high", "line 2: the probability is high, not from 0 to 1"),
        ("lmo,2,3,1,0", "lmo,2,-3,1,0", "line 2: im_id is '-3', not a BOP number"),
        ("lmo,2,3,1,0", "lmo,2,3,1,", "line 2: est_id is '', not a BOP number"),
        ("lmo,2,3", ",2,3", "line 2: dataset is empty"),
        ("gdrnpp", "", "line 2: principal is empty"),
        ("0.0 0.0 1.0,", "0.0 0.0 nan,", "line 2: R is not 9 finite numbers"),
        (",0.0 0.0 0.0,1,", ",0.0 0.0,1,", "line 2: t is not 3 finite numbers"),
        (",R,t", ",R", "no column t; a verdicts file has dataset, scene_id"),
        ("verdict,", "", "no column verdict"),
        ("lmo,2,3,1,0", "lmo,2,3,1,0,6", "line 2: should have 20 fields"),
        ("lmo,2,3,1", "lmo,2,99999999999999999999,1", "im_id is '99999999999999999999'"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "v.csv"
    write_verdicts(path, [verdict_row(decide(0.9, 0.5), 2, 3)])
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(FormatError, match=re.escape(message)):
        read_verdicts(path)


def test_other_separators_are_named(tmp_path: Path) -> None:
    path = tmp_path / "v.csv"
    write_verdicts(path, [verdict_row(decide(0.9, 0.5), 2, 3)])
    path.write_text(path.read_text().replace(",", ";"))
    with pytest.raises(FormatError, match="separated by semicolons; separate them by commas"):
        read_verdicts(path)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [("lmo,2,3,1", "lmo,2,\u0663,1", "im_id is"), (",0.9", ",0_0.9", "not from 0 to 1")],
)
def test_numbers_that_only_python_reads_are_refused(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    path = tmp_path / "v.csv"
    write_verdicts(path, [verdict_row(decide(0.9, 0.5), 2, 3)])
    path.write_text(path.read_text().replace(old, new, 1), encoding="utf-8")
    with pytest.raises(FormatError, match=says):
        read_verdicts(path)


def test_a_file_of_the_former_form_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "v.csv"
    path.write_text(
        "scene_id,im_id,obj_id,gripper,probability,verdict,reason\n2,3,1,hand,.9,attempt,\n"
    )
    with pytest.raises(FormatError, match="former version, which does not say which instance"):
        read_verdicts(path)


def test_two_verdicts_on_one_grasp_are_refused_but_not_those_of_two_datasets(
    tmp_path: Path,
) -> None:
    path = tmp_path / "v.csv"
    one, two = (verdict_row(decide(p, 0.5), 2, 3) for p in (0.9, 0.1))
    write_verdicts(path, [one, two])
    with pytest.raises(
        FormatError, match=r"line 3: line 2 holds a verdict on the same grasp: lmo-1"
    ):
        read_verdicts(path)
    write_verdicts(path, [one, verdict_row(decide(0.1, 0.5), 2, 3, dataset="ycbv")])
    assert [row.key.dataset for row in read_verdicts(path)] == ["lmo", "ycbv"]


def test_where_to_look_again_is_read_back(tmp_path: Path) -> None:
    x, z = np.eye(3)[[0, 2]]
    looks = [
        NextLook(x, z, -z, 0.0123, np.deg2rad(59.0), 0.75),
        NextLook(z, None, x, 0.5, np.deg2rad(12.3), None),
    ]
    rows = [
        dataclasses.replace(verdict_row(Verdict(False, p, "why", look=look), 1, i), views=i + 2)
        for i, (look, p) in enumerate(zip(looks, (0.5, None), strict=True))
    ]
    write_verdicts(tmp_path / "v.csv", rows)
    back = read_verdicts(tmp_path / "v.csv")
    assert [str(row.verdict) for row in back] == ["look again"] * 2
    assert [row.views for row in back] == [2, 3]
    for row, look in zip(back, looks, strict=True):
        found = row.verdict.look
        assert found is not None
        assert_array_equal(found.direction, look.direction)
        assert_array_equal(found.axis, look.axis)
        assert (found.direction_world is None) == (look.direction_world is None)
        assert found.expected_probability == look.expected_probability
        assert_allclose([found.axis_sd_m, found.angle_rad], [look.axis_sd_m, look.angle_rad])


def test_files_without_the_columns_about_views_are_read(tmp_path: Path) -> None:
    write_verdicts(tmp_path / "v.csv", [verdict_row(Verdict(True, 0.9, "why"), 1)])
    lines = (tmp_path / "v.csv").read_text().splitlines()
    former = "\n".join(line.rsplit(",", 7)[0] for line in lines)
    (tmp_path / "v.csv").write_text(former)
    (row,) = read_verdicts(tmp_path / "v.csv")
    assert (row.views, row.verdict.look, row.verdict.attempt) == (1, None, True)
    (tmp_path / "v.csv").write_text(former.replace("attempt", "look again"))
    with pytest.raises(FormatError, match="looks again, but has no look_direction"):
        read_verdicts(tmp_path / "v.csv")
