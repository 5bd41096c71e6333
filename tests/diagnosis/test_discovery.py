"""What files and directories are is found out."""

from __future__ import annotations

from pathlib import Path

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
