"""JSON artefacts: what comes back is what was written, or an error."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspcast.errors import FormatError, InputError
from graspcast.evaluation.predictions import Forecasts
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.guarantees.monitor_state import MonitorState
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.simulation.campaign.store import Store
from worlds import ASKED

CONTENT: dict[str, Any] = {
    "name": "müg",
    "numbers": [1, 2.5, -0.1, 1e-300, 1 / 3],
    "none": None,
    "flags": {"yes": True, "no": False},
    "pair": (1, 2),
    10: "ten",
    9: "nine",
}
PLAIN = json.loads(json.dumps(CONTENT))


def test_content_comes_back_however_it_is_indented(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_artefact(path, CONTENT)
    assert read_artefact(path, "make it again") == PLAIN
    path.write_text(json.dumps(json.loads(path.read_text()), indent=7, sort_keys=True))
    assert read_artefact(path, "make it again") == PLAIN


def test_a_flipped_bit_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_artefact(path, CONTENT)
    content, random = path.read_bytes(), np.random.default_rng(0)
    refused = 0
    for place in random.permutation(8 * len(content)).tolist()[:1500]:
        changed = bytearray(content)
        changed[place // 8] ^= 1 << place % 8
        path.write_bytes(changed)
        try:
            found = read_artefact(path, "make it again")
        except FormatError:
            refused += 1
        else:
            assert json.dumps(found) == json.dumps(PLAIN)
    assert refused > 1000


def test_without_a_digest_or_with_another_it_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    for stated in ({}, {"sha256": None}):
        path.write_text(json.dumps({**PLAIN, **stated}))
        with pytest.raises(
            FormatError, match=r"has no digest: .*former version.*; make it"
        ) as caught:
            read_artefact(path, "make it again", parameters=("state",))
        assert caught.value.parameters == ("state",)
    for wrong in ("0" * 64, 7, [], {}):
        path.write_text(json.dumps({**PLAIN, "sha256": wrong}))
        with pytest.raises(FormatError, match=r"damaged or was edited.*; make it again"):
            read_artefact(path, "make it again")
    with pytest.raises(InputError, match="not finite"):
        write_artefact(path, {"x": float("nan")})


@pytest.mark.parametrize(
    ("content", "says"), [("", "is not valid JSON"), ('{"a"', "is not valid"), ("[]", "an object")]
)
def test_what_is_no_json_object_is_refused_with_the_remedy(
    tmp_path: Path, content: str, says: str
) -> None:
    path = tmp_path / "a.json"
    path.write_text(content)
    with pytest.raises(FormatError, match=rf"{says}.*; make it again$") as caught:
        read_artefact(path, "make it again", parameters=("state",))
    assert caught.value.parameters == ("state",)


def certificate(folder: Path) -> tuple[Path, Callable[[], Any]]:
    n, path = np.arange(80), folder / "certificate.json"
    certify(np.full(80, 0.95), n >= 0, n // 2, **ASKED).save(path)
    return path, lambda: Certificate.load(path).as_dict()


def drift_monitor(folder: Path) -> tuple[Path, Callable[[], Any]]:
    monitor, path = DriftMonitor(0.9), folder / "monitor.json"
    for n in range(20):
        monitor.observe(n % 3 > 0, str(n))
    monitor.save(path)
    return path, lambda: DriftMonitor.load(path).as_dict()


def monitor_state(folder: Path) -> tuple[Path, Callable[[], Any]]:
    made, _ = certificate(folder)
    guarantee, path = Certificate.load(made).overall, folder / "state.json"
    MonitorState.open(path, made, guarantee).save()

    def read() -> Any:
        found = MonitorState.open(path, made, guarantee)
        return found.monitor.as_dict(), found.certificate, found.scope, found.rows_read

    return path, read


def manifest(folder: Path) -> tuple[Path, Callable[[], Any]]:
    Store(folder).begin({"configuration": {"trials": 10, "seed": 3, "speed": 0.25}})
    return folder / "manifest.json", lambda: Store(folder).manifest


def forecasts(folder: Path) -> tuple[Path, Callable[[], Any]]:
    path, names = folder / "f.npz", np.array(["d-1", "d-2"])
    columns = (np.array([0.25, 0.5]), np.array([True, False]), names, names)
    Forecasts("unseen_scenes", "m", "epos", "parallel", *columns).save(path, "x")

    def read() -> Any:
        found = Forecasts.load(path, "x")
        assert found is not None
        return {name: np.asarray(value).tolist() for name, value in vars(found).items()}

    return path, read


@pytest.mark.parametrize(
    "kind",
    [certificate, drift_monitor, monitor_state, manifest, forecasts],
    ids=lambda k: k.__name__,
)
def test_a_flipped_bit_in_any_artefact_changes_nothing_unnoticed(
    tmp_path: Path, kind: Callable[[Path], tuple[Path, Callable[[], Any]]]
) -> None:
    path, read = kind(tmp_path)
    content, expected, random = path.read_bytes(), read(), np.random.default_rng(1)
    refused = 0
    for place in random.permutation(8 * len(content)).tolist()[:400]:
        changed = bytearray(content)
        changed[place // 8] ^= 1 << place % 8
        path.write_bytes(changed)
        try:
            assert read() == expected
        except FormatError:
            refused += 1
    assert refused > 100
