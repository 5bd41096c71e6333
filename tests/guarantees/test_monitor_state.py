"""Monitor state: updates from a growing attempt log, and files that do not belong together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from graspcast.errors import FormatError, MismatchError
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.guarantees.monitor_state import MonitorState
from graspcast.io.artefacts import read_artefact, write_artefact
from worlds import ASKED


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A certificate."""
    path = tmp_path_factory.mktemp("certificate") / "certificate.json"
    n = np.arange(80)
    objects = np.array(["d-1", "d-2"])[n % 2]
    certify(np.full(80, 0.95), n >= 0, n // 2, objects=objects, **ASKED).save(path)
    return path


def write_log(path: Path, success: list[bool]) -> Path:
    """Four attempts a scene, in two images, of two objects in turn."""
    n = np.arange(len(success))
    columns = {"scene_id": n // 4, "im_id": n // 2, "obj_id": n % 2 + 1, "success": success}
    names = {"estimator": "a", "dataset": "d", "gripper": "parallel"}
    pl.DataFrame({**columns, **{k: [v] * len(n) for k, v in names.items()}}).with_columns(
        pl.col("success").cast(pl.Int64)
    ).write_csv(path)
    return path


@pytest.mark.parametrize("scope", ["all objects", "d-2"])
@pytest.mark.parametrize("unit", ["scene", "image"])
def test_updates_in_parts_are_those_of_one_pass(
    path: Path, tmp_path: Path, unit: str, scope: str
) -> None:
    success = (np.random.default_rng(0).random(40) < 0.8).tolist()
    guarantee = Certificate.load(path).of(scope)
    added = 0
    for length in (0, 7, 7, 23, 40):
        log = write_log(tmp_path / "log.csv", success[:length])
        state = MonitorState.open(tmp_path / "s.json", path, guarantee)
        added += state.update(log, {"unit": unit})
        state.save()
    straight = DriftMonitor(0.9)
    for i, held in enumerate(success):
        if scope == "all objects" or i % 2 == 1:
            name = f"d/{i // 4}" if unit == "scene" else f"d/{i // 4}/{i // 2}"
            straight.observe(held, name)
    assert state.monitor == straight
    assert added == straight.trials
    assert MonitorState.open(tmp_path / "s.json", path, guarantee) == state


def test_a_changed_log_is_refused(path: Path, tmp_path: Path) -> None:
    state = MonitorState.open(tmp_path / "s.json", path, Certificate.load(path).overall)
    state.update(write_log(tmp_path / "log.csv", [True] * 8), {})
    for success in ([True] * 7, [False] + [True] * 8):
        with pytest.raises(MismatchError, match="does not begin with the 8 attempts") as caught:
            state.update(write_log(tmp_path / "log.csv", success), {})
        assert caught.value.parameters == ("attempt_log",)
    with pytest.raises(MismatchError, match="estimator a, but the guarantee is for b"):
        state.update(tmp_path / "log.csv", {"principal": "b"})


def test_states_of_other_guarantees_settings_and_formats_are_refused(
    path: Path, tmp_path: Path
) -> None:
    certificate, file = Certificate.load(path), tmp_path / "s.json"
    MonitorState.open(file, path, certificate.overall, alpha=0.1).save()
    assert MonitorState.open(file, path, certificate.overall).monitor.alpha == 0.1
    with pytest.raises(MismatchError, match="of another guarantee"):
        MonitorState.open(file, path, certificate.of("d-1"))
    with pytest.raises(MismatchError, match=r"made with alpha 0\.1, not 0\.2"):
        MonitorState.open(file, path, certificate.overall, alpha=0.2)
    content = read_artefact(file, "")
    write_artefact(file, {**content, "rows_read": -1})
    with pytest.raises(FormatError, match="rows_read is -1"):
        MonitorState.open(file, path, certificate.overall)
    content["monitor"]["format"] = 1
    write_artefact(file, content)
    with pytest.raises(FormatError, match="format 1, not 2"):
        MonitorState.open(file, path, certificate.overall)


@pytest.mark.parametrize(
    ("provenance", "says"),
    [
        ({"principal": "b"}, "attempts of estimator a, but the guarantee is for b"),
        ({"principal": "a", "guides": ["b", "fused2"]}, "but the guarantee is for b, fused2"),
        ({"gripper": "claw"}, "attempts of gripper parallel, but the guarantee is for claw"),
        ({"datasets": ["e", "f"]}, "attempts of dataset d, but the guarantee is for e, f"),
        ({"grasp": "handle"}, "attempts of grasp reference, but the guarantee is for handle"),
    ],
)
def test_attempts_of_something_else_are_refused(
    path: Path, tmp_path: Path, provenance: dict[str, object], says: str
) -> None:
    overall = Certificate.load(path).overall
    state = MonitorState.open(tmp_path / "s.json", path, overall)
    log = write_log(tmp_path / "log.csv", [True] * 8)
    with pytest.raises(MismatchError, match=says):
        state.update(log, provenance)
    assert state.update(log, {"principal": "a", "datasets": ["c", "d"], "grasp": "reference"}) == 8
