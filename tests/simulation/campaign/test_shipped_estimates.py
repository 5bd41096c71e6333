"""Estimates of the built-in estimators: computed once, and again where a file was changed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import read_results
from graspcast.demo_data import demo_dataset
from graspcast.errors import InputError
from graspcast.simulation.campaign.shipped_estimates import shipped_estimates


@pytest.fixture
def tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BopDataset:
    """Two images of the shipped tables."""
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "cache"))
    shipped, root = demo_dataset().root, tmp_path / "ycbv"
    boxes = json.loads((shipped / "test_detections_jittered.json").read_text())
    first = [box for box in boxes if box["scene_id"] == 1 and box["image_id"] < 2]
    root.mkdir()
    (root / "test_detections_jittered.json").write_text(json.dumps(first))
    shutil.copytree(shipped / "models", root / "models")
    shutil.copytree(shipped / "test" / "000001", root / "test" / "000001")
    shutil.copy(shipped / "camera.json", root)
    return BopDataset(root)


def test_they_are_computed_once(tables: BopDataset) -> None:
    told: list[str] = []
    files = shipped_estimates(tables, progress=lambda share, text: told.append(text))
    assert list(files) == ["dense", "direct", "keypoints"]
    assert told and all("estimator" in text for text in told)
    assert files["dense"].name == "dense_ycbv-test.csv"
    assert set(read_results(files["direct"]).im_id.tolist()) <= {0, 1}
    told.clear()
    assert shipped_estimates(tables, progress=lambda share, text: told.append(text)) == files
    assert not told


@pytest.mark.slow
def test_a_changed_file_is_computed_again(
    tables: BopDataset, caplog: pytest.LogCaptureFixture
) -> None:
    files = shipped_estimates(tables)
    written = read_results(files["dense"]).cam_T_obj
    files["dense"].write_text(files["dense"].read_text().replace("0.", "1.", 1))
    assert (read_results(shipped_estimates(tables)["dense"]).cam_T_obj == written).all()
    assert "computed again" in caplog.text


def test_other_images_have_other_estimates(tables: BopDataset) -> None:
    first = shipped_estimates(tables)["dense"]
    path = tables.root / "test_detections_jittered.json"
    path.write_text(json.dumps(json.loads(path.read_text())[:3]))
    assert shipped_estimates(tables)["dense"].parent != first.parent


def test_a_cache_that_cannot_be_written_is_said(
    tables: BopDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "file"))
    with pytest.raises(InputError, match="GRASPCAST_CACHE"):
        shipped_estimates(tables)
