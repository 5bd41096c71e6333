"""What files and directories are is found out."""

from __future__ import annotations

import gzip
from pathlib import Path

import polars as pl
import pytest

from graspcast.diagnosis.discovery import discover, method_of
from graspcast.errors import InputError
from sick_files import healthy


def test_a_directory_is_searched(tmp_path: Path) -> None:
    healthy().write(tmp_path)
    found, unknown = discover([tmp_path])
    kinds = sorted(f.kind for f in found)
    assert kinds == ["models", "results", "results", "root", "scenes"]
    assert {f.dataset for f in found} == {"toy"}
    assert unknown == []


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("t.csv", "estimator,dataset,scene_id,im_id,obj_id,gripper,success\n", "outcomes"),
        ("c.csv", "scene_id,im_id,world_T_cam_m\n", "camera-poses"),
        ("r.csv", "1,2,3,0.5,1 0 0 0 1 0 0 0 1,0 0 900,-1\n", "results"),
        ("d.json", '[{"scene_id": 1, "category_id": 2, "bbox": [1, 2, 3, 4]}]', "detections"),
    ],
)
def test_files_by_their_content(tmp_path: Path, name: str, content: str, kind: str) -> None:
    (tmp_path / name).write_text(content)
    found, _ = discover([tmp_path / name])
    assert [f.kind for f in found] == [kind]


def test_what_is_nothing_known(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("a,b\n1,2\n")
    assert discover([tmp_path / "x.csv"]) == ([], [tmp_path / "x.csv"])
    with pytest.raises(InputError, match="no such file"):
        discover([tmp_path / "y"])


def test_names_of_methods_are_kept_apart() -> None:
    path = Path("epos_lmo-test.csv")
    assert method_of(path, []) == "epos"
    assert method_of(path, ["epos"]) == "epos_lmo-test"


def test_directories_of_campaigns_and_what_is_hidden(tmp_path: Path) -> None:
    (tmp_path / "campaign").mkdir()
    frame = pl.DataFrame({"estimator": ["a"], "success": [1]})
    frame.write_parquet(tmp_path / "campaign" / "outcomes.parquet")
    (tmp_path / ".git").mkdir()
    frame.write_parquet(tmp_path / ".git" / "outcomes.parquet")
    frame.write_parquet(tmp_path / "tried.parquet")
    frame.select("estimator").write_parquet(tmp_path / "names.parquet")
    found, unknown = discover([tmp_path, tmp_path / "names.parquet"])
    assert sorted((f.kind, f.path.name) for f in found) == [
        ("outcomes", "campaign"),
        ("outcomes", "tried.parquet"),
    ]
    assert unknown == [tmp_path / "names.parquet"]


def test_packed_files_are_looked_into_and_damaged_ones_are_unknown(tmp_path: Path) -> None:
    row = b"1,2,3,0.5,1 0 0 0 1 0 0 0 1,0 0 900,-1\n"
    whole, cut, other = tmp_path / "r.csv.gz", tmp_path / "cut.csv.gz", tmp_path / "notes.txt"
    whole.write_bytes(gzip.compress(row))
    cut.write_bytes(gzip.compress(row)[:12])
    other.write_bytes(row)
    found, unknown = discover([whole, cut, other])
    assert [(f.kind, f.path) for f in found] == [("results", whole)]
    assert unknown == [cut, other]


def test_a_third_method_of_the_same_file_name_gets_a_number() -> None:
    path = Path("epos_lmo-test.csv")
    assert method_of(path, ["epos", "epos_lmo-test"]) == "epos_lmo-test-2"
    assert method_of(path, ["epos", "epos_lmo-test", "epos_lmo-test-2"]) == "epos_lmo-test-3"
