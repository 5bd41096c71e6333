"""The whole run: from models to weights, in one call that can be repeated."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")
pytest.importorskip("onnxscript", reason="needs onnxscript: pip install 'graspcast[train]'")

from graspcast.errors import InputError, MismatchError
from graspcast.io.locks import exclusive_lock
from graspcast.io.progress import Progress
from graspcast.perception.network import Network
from graspcast.training.objects import Objects
from graspcast.training.run import train_estimators
from graspcast.training.settings import TrainingSettings

SETTINGS = TrainingSettings(
    estimators=("direct",), images=16, steps=3, validation_images=8, threads=1
)


class Stages:
    """Names of the stages."""

    def __init__(self) -> None:
        self.names: list[str] = []

    @contextmanager
    def __call__(self, name: str) -> Iterator[Progress]:
        self.names.append(name)
        yield lambda share, message: None


@pytest.fixture(scope="module")
def work(solids: Objects, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("run")
    train_estimators(solids, root / "work", root / "out", SETTINGS, stages=Stages())
    return root / "work"


def test_the_weights_know_dataset_sizes_and_errors(work: Path) -> None:
    network = Network("direct", work.parent / "out" / "direct.onnx")
    assert network.trained.dataset == "toy" and list(network.objects) == [1, 4]
    assert network.made["steps"] == 3
    errors = network.validation["errors"]
    assert [row["obj_id"] for row in errors] == [1, 4, None]
    assert errors[-1]["poses"] > 0 and errors[-1]["rotation_deg_90"] > 0
    assert "Errors on 8 rendered images" in (work.parent / "out" / "direct.md").read_text()


def test_the_same_call_does_nothing_twice_and_more_steps_go_on(work: Path, solids: Objects) -> None:
    stages = Stages()
    (again,) = train_estimators(solids, work, work.parent / "more", SETTINGS, stages=stages)
    assert again.steps == 3 and not any(name.startswith("training on") for name in stages.names)
    more = replace(SETTINGS, steps=5)
    (longer,) = train_estimators(solids, work, work.parent / "more", more, stages=stages)
    assert longer.steps == 5 and longer.path.is_file()


def test_other_objects_or_settings_are_refused(work: Path, solids: Objects) -> None:
    with pytest.raises(MismatchError, match=r"was begun with seed 1 \(now 2\)") as error:
        train_estimators(solids, work, work, replace(SETTINGS, seed=2), stages=Stages())
    assert error.value.parameters == ("work", "seed")
    one = Objects.read(solids.models.directory, [4])
    with pytest.raises(MismatchError, match=r"objects \[1, 4\] \(now \[4\]\), other meshes"):
        train_estimators(one, work, work, SETTINGS, stages=Stages())


def test_two_processes_do_not_share_a_directory(work: Path, solids: Objects) -> None:
    with (
        exclusive_lock(work / ".lock", "no"),
        pytest.raises(InputError, match="another process trains here"),
    ):
        train_estimators(solids, work, work, SETTINGS, stages=Stages())


@pytest.mark.slow
def test_a_killed_run_goes_on(solids: Objects, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "graspcast", "train-estimator", "--estimator", "dense"]
    command += ["--models", str(solids.models.directory), "--objects", "1", "4"]
    command += ["--images", "96", "--steps", "30", "--validation-images", "8", "--threads", "1"]
    command += ["--work", str(tmp_path / "work"), "--out", str(tmp_path / "out")]
    killed = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        until = time.monotonic() + 300
        first = tmp_path / "work" / "samples" / "00000.npz"
        while not first.exists() and time.monotonic() < until:
            assert killed.poll() is None
            time.sleep(0.2)
    finally:
        killed.kill()
        killed.wait()
    assert first.exists() and not (tmp_path / "out").exists()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "dense after 30 steps" in done.stdout
    assert (tmp_path / "out" / "dense.onnx").is_file()
