"""Files of rankings, and of what a robot can reach."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from graspcast.errors import FormatError
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.grasp_file import read_grasps_of, read_reachable, write_grasps_of
from graspcast.forecasting.grasp_ranking import GraspForecast
from graspcast.forecasting.verdict import Verdict, VerdictRow

KEY = InstanceKey("d", 1, 7, 3, 0)
RANKED = (GraspForecast("top, left", 0.75, 40), GraspForecast("side", 0.5, 30))
HEADER = "dataset,scene_id,im_id,obj_id,est_id,grasp\n"


def row(verdict: Verdict, **key: int) -> VerdictRow:
    return VerdictRow(KEY._replace(**key), "a", "p", verdict, np.eye(4), grasp=verdict.grasp)


def test_a_file_of_rankings_is_read_as_what_is_reachable(tmp_path: Path) -> None:
    ranked = Verdict(True, 0.75, "why", 0.5, grasp="top, left", grasps=RANKED)
    plain, none = Verdict(False, 0.25, "why", 0.5), Verdict(False, None, "why")
    path = tmp_path / "g.csv"
    write_grasps_of(path, [row(ranked), row(plain, im_id=8), row(none, im_id=9)])
    with path.open() as stream:
        found = [(r["im_id"], r["grasp"], r["rank"], r["outcomes"]) for r in csv.DictReader(stream)]
    first = [("7", "top, left", "1", "40"), ("7", "side", "2", "30")]
    assert found == [*first, ("8", "reference", "1", "")]
    assert read_reachable(path) == {
        KEY: {"top, left", "side"},
        KEY._replace(im_id=8): {"reference"},
    }


def test_a_file_of_rankings_is_read_back(tmp_path: Path) -> None:
    ranked = Verdict(True, 0.75, "why", 0.5, grasp="top, left", grasps=RANKED)
    plain = Verdict(False, 0.25, "why", 0.5)
    path = tmp_path / "g.csv"
    write_grasps_of(path, [row(ranked), row(plain, im_id=8)])
    assert read_grasps_of(path) == {
        (KEY, "a", "p"): (("top, left", 0.75), ("side", 0.5)),
        (KEY._replace(im_id=8), "a", "p"): (("reference", 0.25),),
    }


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("probability", "chance", "no column probability"),
        ("0.750000", "75 %", "no number"),
        ("0.750000", "7.5", "not a share"),
        ("0.750000", "", "not a share"),
        ("0.750000", "nan", "not a share"),
    ],
)
def test_what_is_no_ranking_is_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "g.csv"
    write_grasps_of(path, [row(Verdict(True, 0.75, "why", 0.5, grasp="top", grasps=RANKED))])
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FormatError, match=said):
        read_grasps_of(path)


def test_est_id_may_be_missing_and_names_may_be_numbers(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("dataset,scene_id,im_id,obj_id,grasp\nd,1,7,3,12\n")
    assert read_reachable(tmp_path / "r.csv") == {KEY: {"12"}}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("dataset,scene_id,im_id,obj_id\nd,1,7,3\n", "no column grasp"),
        (HEADER + "d,1,7,3,0,\n", "row 1.*empty field: grasp"),
        (HEADER + "d,1,7.5,3,0,top\n", "im_id should be whole numbers"),
        (HEADER + "d,1,7,3,0,top\n" * 2, "rows 1, 2 are of one grasp of one instance"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(FormatError, match=said):
        read_reachable(tmp_path / "r.csv")
