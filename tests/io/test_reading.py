"""Files are read whole, or refused: pipes, devices and files that are too large."""

from __future__ import annotations

import errno
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from graspcast.bop.dataset import read_ground_truth
from graspcast.bop.detections import read_detections
from graspcast.bop.images import read_image
from graspcast.bop.meshes import read_mesh
from graspcast.bop.models import Models
from graspcast.bop.results import read_results
from graspcast.errors import FormatError, GraspcastError
from graspcast.estimates.outcomes import read_outcomes
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.verdict_file import read_verdicts
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.io.arrays import read_arrays
from graspcast.io.artefacts import read_artefact
from graspcast.io.hashing import sha256_of_file
from graspcast.io.json import read_json
from graspcast.io.reading import check_regular, read_bytes, read_text
from graspcast.io.tables import read_csv, read_parquet
from graspcast.io.toml import read_toml
from graspcast.paper.published_split import read_split
from graspcast.perception.network import Network
from graspcast.simulation.campaign.store import Store
from graspcast.simulation.grasps.table import grasps_in
from graspcast.simulation.grippers.mjcf import MjcfGripper
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.meshes import read_mesh as read_own_mesh

DATA = Path(__file__).parent.parent / "data"
posix = pytest.mark.skipif(
    sys.platform == "win32", reason="Windows has no such files: run it on Linux or macOS"
)


def test_the_content_of_a_file_and_of_a_link_to_it(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfa\r\n")
    assert read_bytes(tmp_path / "a") == b"\xef\xbb\xbfa\r\n"
    assert read_text(tmp_path / "a") == "a\r\n"
    if sys.platform != "win32":
        (tmp_path / "link").symlink_to(tmp_path / "a")
        assert read_bytes(tmp_path / "link") == read_bytes(tmp_path / "a")


def test_what_is_missing_too_large_a_directory_or_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a"
    for read in (read_bytes, read_text, check_regular):
        with pytest.raises(FormatError, match="cannot be read"):
            read(tmp_path / "none")
        with pytest.raises(FormatError, match="is a directory"):
            read(tmp_path)
        with pytest.raises(FormatError, match="is not a path"):
            read("a\0b")
        path.write_bytes(1001 * b"x")
        with pytest.raises(FormatError, match=r"has 1,001 bytes; .* up to 1,000"):
            read(path, 1000)
    path.write_bytes(b"\xff")
    with pytest.raises(FormatError, match="is not UTF-8 text"):
        read_text(path)


READERS: dict[str, Callable[[Path], Any]] = {
    ".csv": read_results,
    ".a.csv": read_outcomes,
    ".b.csv": read_verdicts,
    ".c.csv": read_csv,
    ".d.csv": read_split,
    ".parquet": read_outcomes,
    ".a.parquet": read_parquet,
    ".json": lambda path: read_json(path, dict),
    ".a.json": lambda path: read_artefact(path, "make it again"),
    ".b.json": Certificate.load,
    ".c.json": DriftMonitor.load,
    ".d.json": read_detections,
    ".npz": Forecaster.load,
    ".a.npz": lambda path: read_arrays(path, "make it again"),
    ".toml": read_toml,
    ".a.toml": read_catalogue,
    ".b.toml": grasps_in,
    ".c.toml": MjcfGripper.from_toml,
    ".png": read_image,
    ".ply": read_mesh,
    ".stl": read_own_mesh,
    ".obj": read_own_mesh,
    ".onnx": lambda path: Network("dense", path),
    ".bin": sha256_of_file,
}


@posix
@pytest.mark.parametrize("suffix", READERS)
def test_every_reader_refuses_pipes_and_devices_at_once(tmp_path: Path, suffix: str) -> None:
    pipe, device = tmp_path / f"pipe{suffix}", tmp_path / f"device{suffix}"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    with pytest.raises(GraspcastError, match="is a pipe, not a regular file"):
        READERS[suffix](pipe)
    with pytest.raises(GraspcastError, match="is a device, not a regular file"):
        READERS[suffix](device)


@posix
def test_readers_of_directories_refuse_pipes(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    for name in ("manifest.json", "three_jaw.xml"):
        os.mkfifo(tmp_path / name)
    os.mkfifo(tmp_path / "models" / "models_info.json")
    (tmp_path / "test" / "000001").mkdir(parents=True)
    os.mkfifo(tmp_path / "test" / "000001" / "scene_gt.json")
    shutil.copy(DATA / "three_jaw.toml", tmp_path)
    with pytest.raises(GraspcastError, match="pipe"):
        MjcfGripper.from_toml(tmp_path / "three_jaw.toml")
    with pytest.raises(GraspcastError, match="pipe"):
        Models(tmp_path / "models")
    with pytest.raises(GraspcastError, match="pipe"):
        _ = Store(tmp_path).manifest
    with pytest.raises(GraspcastError, match="pipe"):
        read_ground_truth(tmp_path / "test")


def test_what_may_not_be_opened_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.csv").write_text("a")

    def refuse(path: object, flags: int) -> int:  # as for others than root
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(FormatError, match=r"a\.csv: cannot be read \(Permission denied\)"):
        read_bytes(tmp_path / "a.csv")


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc: run it on Linux")
def test_a_file_that_is_longer_than_it_says_is_refused() -> None:
    with pytest.raises(FormatError, match=r"status: .*bytes"):
        read_bytes("/proc/self/status", limit=10)
