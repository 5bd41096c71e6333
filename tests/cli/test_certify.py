"""The verb certify, on small files of a dataset "made"."""

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
    for part, mine in (("train", numbers < N), ("new", numbers >= N)):
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


def certify(world: Path, out: Path, *more: str, part: str = "new") -> list[str]:
    paths = ["--model", str(world / "m.npz"), "--outcomes", str(world / f"{part}.csv")]
    inputs = ["--bop", str(world / "made"), *estimates(world, part)]
    return ["certify", *inputs, *paths, "--out", str(out), *more]


def test_from_outcomes_to_a_certificate(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, figures = tmp_path / "p.json", tmp_path / "f.json"
    assert main(certify(world, path, "--per-object", "--json", str(figures))) == 0
    out = capsys.readouterr().out
    assert "success rate >= 0.9, confidence 0.9 (each individually)" in out
    assert "made-1" in out
    certificate = Certificate.load(path)
    assert [g.scope for g in certificate.guarantees] == ["all objects", "made-1", "made-2"]
    assert certificate.overall.threshold is not None
    assert certificate.overall.units == SCENES
    assert certificate.overall.trials == N
    assert certificate.provenance["unit"] == "scene"
    assert certificate.provenance["gripper"] == "parallel"
    assert len(certificate.provenance["model"]) == 64
    stored = json.loads(path.read_text())
    assert len(stored.pop("sha256")) == 64
    assert json.loads(figures.read_text()) == stored
    again = tmp_path / "again.json"
    assert main(certify(world, again, "--per-object")) == 0
    assert again.read_bytes() == path.read_bytes()


def test_images_units_and_families(world: Path, tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    options = ["--unit", "image", "--per-object", "--simultaneous", "--other-guarantees", "1"]
    assert main(certify(world, path, *options, "--weight", "unit", "--seed", "3")) == 0
    certificate = Certificate.load(path)
    assert certificate.family_size == 4
    assert certificate.overall.confidence == pytest.approx(1 - 0.1 / 4)
    assert certificate.overall.units == N
    assert (certificate.weight, certificate.seed) == ("unit", 3)
    assert main(certify(world, path, "--sequence-share", "0.25")) == 0
    certificate = Certificate.load(path)
    assert certificate.sequence.source == "20 of 80 units, not used for certification"
    assert certificate.overall.units == SCENES - 20


def test_without_a_threshold_the_verb_says_so(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.json"
    assert main(certify(world, path, "--rate", "0.99", "--confidence", "0.99")) == 0
    assert "no threshold can be certified" in capsys.readouterr().out
    assert Certificate.load(path).overall.threshold is None


def test_without_a_threshold_a_lower_rate_is_promised_and_used_if_accepted(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked, lower = tmp_path / "asked.json", tmp_path / "lower.json"
    hard = ["--rate", "0.99", "--confidence", "0.99"]
    assert main(certify(world, asked, *hard)) == 0
    out = capsys.readouterr().out
    assert "Promised with confidence 0.99: a success rate of" in out
    assert "--accept-lower" in out
    assert "no promises" in out and "all scenes weighted equally" in out
    assert main(certify(world, lower, *hard, "--accept-lower")) == 0
    assert "the rate asked for was 0.99" in capsys.readouterr().out
    first, second = (Certificate.load(path) for path in (asked, lower))
    assert first.overall.lower is not None
    assert second.overall.threshold == first.overall.lower.threshold
    assert second.overall.rate == first.overall.lower.rate
    assert second.alternatives == first.alternatives
    verdicts = tmp_path / "v.csv"
    command = ["predict", "--bop", str(world / "made"), *estimates(world, "new")]
    command += ["--model", str(world / "m.npz"), "--out", str(verdicts)]
    assert main([*command, "--certificate", str(asked)]) == 0
    out = capsys.readouterr().out
    assert ", 0 to attempt" in out
    assert "Nothing is attempted; certify --accept-lower accepts the lower rate" in out
    assert main([*command, "--certificate", str(lower)]) == 0
    out = capsys.readouterr().out
    assert ", 0 to attempt" not in out
    assert f"at a rate of at least {int(second.overall.rate * 1000) / 1000:g}" in out


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
    assert "(see --outcomes, --allow-training-scenes)" in err
    assert not path.exists()
    assert main(certify(world, path, "--allow-training-scenes")) == 0
    assert "trained on 2 calibration scenes: the guarantee is invalid" in capsys.readouterr().err
    assert Certificate.load(path).provenance["training_scenes"] == 2
    object.__setattr__(forecaster.card, "scenes", ())
    assert main(certify(world, path)) == 0
    assert "does not state its training scenes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--rate", "1", "--model", "no.npz"], "rate should be above 0 and below 1"),
        (["--sequence-share", "0.999"], "parts empty (see --sequence-share)"),
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
