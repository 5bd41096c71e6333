"""The verbs certify and monitor, on small files of a dataset "made"."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from commands import refused
from graspcast.bop.results import write_results
from graspcast.cli import main
from graspcast.forecasting.forecaster import Forecaster
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.drift_monitor import DriftMonitor
from poses import nudged, random_poses, results_of, write_models

N = 240
SCENES = 80


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Estimates of 80 scenes by two estimators, their outcomes, and a model trained on others."""
    root = tmp_path_factory.mktemp("world")
    write_models(root / "made" / "models", obj_1={}, obj_2={})
    numbers = np.arange(2 * N)
    scene, obj = numbers * 2 * SCENES // (2 * N), numbers % 2 + 1
    truth = random_poses(2 * N)
    far = np.random.default_rng(0).random(2 * N) < 0.4
    near = nudged(truth, 1, metres=0.001, radians=0.01)
    off = nudged(truth, 2, metres=0.05, radians=0.5)
    poses = {"a": nudged(truth, 0, metres=0.001), "b": np.where(far[:, None, None], off, near)}
    for part, mine in (("train", numbers < N), ("field", numbers >= N)):
        for name, values in poses.items():
            table = dataclasses.replace(
                results_of(values[mine]),
                scene_id=scene[mine],
                im_id=numbers[mine],
                obj_id=obj[mine],
            )
            write_results(root / part / f"{name}_made-test.csv", table)
        columns = {
            "estimator": "a",
            "dataset": "made",
            "scene_id": scene[mine],
            "im_id": numbers[mine],
            "obj_id": obj[mine],
            "gripper": "parallel",
            "success": (~far[mine]).astype(int),
        }
        pl.DataFrame(columns).write_csv(root / f"{part}.csv")
    shared = ["--bop", str(root / "made"), *estimates(root, "train")]
    assert (
        main(
            ["train", *shared, "--principal", "a", "--gripper", "parallel", "--folds", "0"]
            + ["--outcomes", str(root / "train.csv"), "--out", str(root / "m.npz")]
            + ["--method", "direct"]
        )
        == 0
    )
    return root


def estimates(root: Path, part: str) -> list[str]:
    return [
        text
        for name in "ab"
        for text in ("--estimates", f"{name}={root / part / f'{name}_made-test.csv'}")
    ]


def certify(world: Path, out: Path, *more: str, part: str = "field") -> list[str]:
    paths = ["--model", str(world / "m.npz"), "--outcomes", str(world / f"{part}.csv")]
    inputs = ["--bop", str(world / "made"), *estimates(world, part)]
    return ["certify", *inputs, *paths, "--out", str(out), *more]


def test_from_outcomes_to_a_promise(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, figures = tmp_path / "p.json", tmp_path / "f.json"
    assert main(certify(world, path, "--per-object", "--json", str(figures))) == 0
    out = capsys.readouterr().out
    assert "success rate >= 0.9, confidence 0.9 (each promise for itself)" in out
    assert "made-1" in out
    certificate = Certificate.load(path)
    assert [p.scope for p in certificate.guarantees] == ["all objects", "made-1", "made-2"]
    assert certificate.overall.threshold is not None
    assert certificate.overall.units == SCENES
    assert certificate.overall.trials == N
    assert certificate.provenance["unit"] == "scene"
    assert certificate.provenance["gripper"] == "parallel"
    assert len(certificate.provenance["model"]) == 64
    assert json.loads(figures.read_text()) == json.loads(path.read_text())
    again = tmp_path / "again.json"
    assert main(certify(world, again, "--per-object")) == 0
    assert again.read_bytes() == path.read_bytes()


def test_images_units_and_families(world: Path, tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    options = ["--unit", "image", "--per-object", "--simultaneous", "--others", "1"]
    assert main(certify(world, path, *options, "--weight", "unit", "--seed", "3")) == 0
    certificate = Certificate.load(path)
    assert certificate.family == 4
    assert certificate.overall.confidence == pytest.approx(1 - 0.1 / 4)
    assert certificate.overall.units == N
    assert (certificate.weight, certificate.seed) == ("unit", 3)
    assert main(certify(world, path, "--explore", "0.25")) == 0
    certificate = Certificate.load(path)
    assert certificate.sequence.source == "20 of 80 units, spent on it"
    assert certificate.overall.units == SCENES - 20


def test_what_cannot_be_promised_is_said(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.json"
    assert main(certify(world, path, "--rate", "0.99", "--confidence", "0.99")) == 0
    assert "no threshold can be certified" in capsys.readouterr().out
    assert Certificate.load(path).overall.threshold is None
    err = refused(monitor(path, tmp_path, tmp_path / "no.csv"), capsys)
    assert "promises nothing" in err


def test_scenes_that_were_trained_on_are_refused(
    world: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    forecaster = Forecaster.load(world / "m.npz")
    monkeypatch.setattr(Forecaster, "load", lambda _: forecaster)
    seen = tuple(f"made/{scene}" for scene in range(SCENES + 2))
    object.__setattr__(forecaster.card, "scenes", seen)
    path = tmp_path / "p.json"
    err = refused(certify(world, path), capsys)
    assert f"trained on 2 of the {SCENES} calibration scenes (made/80, made/81)" in err
    assert not path.exists()
    assert main(certify(world, path, "--allow-training-scenes")) == 0
    assert "the promise means nothing" in capsys.readouterr().err
    object.__setattr__(forecaster.card, "scenes", ())
    assert main(certify(world, path)) == 0
    assert "does not say which scenes it was trained on" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--rate", "1"], "rate should be above 0 and below 1"),
        (["--explore", "0.999"], "leaves a side without any"),
        (["--objects", "2", "--model", "no.npz"], "no.npz: cannot be read"),
    ],
)
def test_bad_input_to_certify(
    world: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
    message: str,
) -> None:
    assert message in refused(certify(world, tmp_path / "p.json", *more), capsys)
    assert not list(tmp_path.iterdir())


# The monitor.


@pytest.fixture(scope="module")
def guarantee(world: Path) -> Path:
    path = world / "promise.json"
    assert main(certify(world, path, "--per-object", "--rate", "0.8")) == 0
    return path


def monitor(guarantee: Path, tmp_path: Path, log: Path, *more: str) -> list[str]:
    paths = ["--certificate", str(guarantee), "--state", str(tmp_path / "s.json")]
    return ["monitor", *paths, "--outcomes", str(log), *more]


def write_log(path: Path, success: list[bool], **change: object) -> Path:
    """Two attempts a scene, one object each."""
    n = np.arange(len(success))
    columns = {
        "estimator": "a",
        "dataset": "made",
        "scene_id": n // 2,
        "im_id": n,
        "obj_id": n % 2 + 1,
        "gripper": "parallel",
        "success": np.array(success, dtype=int),
    }
    pl.DataFrame({**columns, **change}).write_csv(path)
    return path


def test_a_log_that_grows_is_taken_in_once(
    guarantee: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, state = tmp_path / "log.csv", tmp_path / "s.json"
    success = [i % 7 > 0 for i in range(40)]
    arguments = monitor(guarantee, tmp_path, write_log(log, success[:15]))
    assert main(arguments) == 0
    assert "no alarm. 15 new attempts, 15 in all" in capsys.readouterr().out
    once = state.read_bytes()
    assert main(arguments) == 0
    assert "0 new attempts, 15 in all" in capsys.readouterr().out
    assert state.read_bytes() == once
    write_log(log, success)
    assert main([*arguments, "--close", "--json", str(tmp_path / "m.json")]) == 0
    straight = DriftMonitor(0.8)
    for i, held in enumerate(success):
        straight.observe(held, f"made/{i // 2}")
    straight.close()
    assert json.loads((tmp_path / "m.json").read_text()) == json.loads(
        json.dumps(straight.as_dict())
    )


def test_an_alarm_is_exit_code_3_until_the_restart(
    guarantee: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_log(tmp_path / "log.csv", [False] * 30)
    arguments = monitor(guarantee, tmp_path, log)
    assert main(arguments) == 3
    assert "ALARM since attempt" in capsys.readouterr().out
    write_log(log, [False] * 30 + [True] * 4)
    assert main(arguments) == 3
    assert "4 new attempts" in capsys.readouterr().out
    write_log(log, [False] * 30 + [True] * 6)
    assert main([*arguments, "--restart"]) == 0
    assert "no alarm. 2 new attempts, 2 in all" in capsys.readouterr().out


def test_one_objects_promise_is_watched_on_its_attempts(
    guarantee: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_log(tmp_path / "log.csv", [i % 2 == 0 for i in range(60)])  # made-2 always fails
    assert main(monitor(guarantee, tmp_path, log, "--object", "made-1", "--close")) == 0
    assert "made-1: no alarm. 30 new attempts" in capsys.readouterr().out
    (tmp_path / "s.json").unlink()
    assert main(monitor(guarantee, tmp_path, log, "--object", "made-2", "--close")) == 3


def test_what_the_monitor_refuses_changes_nothing(
    guarantee: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, state = tmp_path / "log.csv", tmp_path / "s.json"
    arguments = monitor(guarantee, tmp_path, write_log(log, [True] * 10))
    assert main(arguments) == 0
    before = state.read_bytes()
    other = tmp_path / "other.json"
    other.write_text(guarantee.read_text() + " ")
    for success, change, message in (
        ([True] * 9, {}, "does not begin with the 10 attempts"),
        ([False] + [True] * 11, {}, "does not begin with the 10 attempts"),
        ([True] * 12, {"gripper": "other"}, "attempts of gripper other"),
        ([True] * 12, {"estimator": "b"}, "the promise is about a"),
    ):
        write_log(log, success, **change)
        assert message in refused(arguments, capsys)
    write_log(log, [True] * 12)
    for more, message in (
        (["--alpha", "0.2"], "was begun with alpha 0.05, not 0.2"),
        (["--most-attempts", "4"], "was begun with most-attempts None"),
        (["--object", "made-1"], "the state of another promise (all objects)"),
        (["--object", "made-9"], "unknown scope of a promise 'made-9'"),
        (["--certificate", str(other)], "the state of another promise"),
        (["--certificate", str(tmp_path / "no.json")], "cannot be read"),
        (["--outcomes", str(tmp_path / "no.csv")], "cannot be read"),
    ):
        assert message in refused([*arguments, *more], capsys)
    assert state.read_bytes() == before
    state.write_text(state.read_text()[:100])
    assert "not valid JSON" in refused(arguments, capsys)
    state.write_text("{}")
    assert "no 'monitor'" in refused(arguments, capsys)
