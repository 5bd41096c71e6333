"""From decisions to a log, and from the log to a model and a certificate, as from files."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from attempt_records import decision, frame
from commands import refused
from graspcast.attempt_log import AttemptLog, OutcomeRecord
from graspcast.attempt_log import recorded as recorded_module
from graspcast.bop.results import read_results, write_results
from graspcast.cli import main
from graspcast.estimates.loading import load_inputs
from graspcast.evaluation import logged_certification
from graspcast.forecasting.forecaster import Forecaster
from graspcast.guarantees.certificate import Certificate
from poses import nudged, random_poses, results_of, write_models

# Forests are trained by the command.
pytestmark = pytest.mark.slow

SCENES = 120
PARTS = {"train": range(40), "new": range(40, SCENES)}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes of one image with two objects, by two estimators; files and logs of two parts."""
    root = tmp_path_factory.mktemp("world")
    write_models(root / "made" / "models", obj_1={}, obj_2={})
    n = np.arange(2 * SCENES)
    scene, obj = n // 2, n % 2 + 1
    truth = random_poses(len(n))
    far = np.random.default_rng(0).random(len(n)) < 0.3
    near = nudged(truth, 1, metres=0.001, radians=0.01)
    off = nudged(truth, 2, metres=0.05, radians=0.5)
    poses = {"a": nudged(truth, 0, metres=0.001), "b": np.where(far[:, None, None], off, near)}
    for part, scenes in PARTS.items():
        mine = np.isin(scene, list(scenes))
        for name, values in poses.items():
            table = dataclasses.replace(
                results_of(values[mine]),
                scene_id=scene[mine],
                im_id=np.ones(mine.sum(), dtype=np.int64),
                obj_id=obj[mine],
            )
            write_results(root / part / f"{name}_made-test.csv", table)
        columns = {
            "estimator": "a",
            "dataset": "made",
            "scene_id": scene[mine],
            "im_id": 1,
            "obj_id": obj[mine],
            "gripper": "parallel",
            "success": (~far[mine]).astype(int),
        }
        pl.DataFrame(columns).write_csv(root / f"{part}.csv")
    assert main(train(root, "m.npz", *files(root, "train"))) == 0
    write_log(root, "train", threshold=0.0, every=True)
    write_log(root, "new", threshold=0.0)
    return root


@pytest.fixture
def same_scenes(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Episodes are numbered like the scenes of the files, so that draws are the same."""
    for module in (recorded_module, logged_certification):
        monkeypatch.setattr(module, "scene_of", int)


def files(root: Path, part: str) -> list[str]:
    inputs = [f"{name}={root / part / f'{name}_made-test.csv'}" for name in "ab"]
    return [
        *(text for each in inputs for text in ("--estimates", each)),
        *("--outcomes", str(root / f"{part}.csv")),
    ]


def train(root: Path, out: str, *data: str) -> list[str]:
    who = ["--principal", "a", "--gripper", "parallel", "--method", "direct", "--folds", "0"]
    return ["train", "--bop", str(root / "made"), *who, "--out", str(root / out), *data]


def write_log(
    root: Path, part: str, *, threshold: float, name: str = "", every: bool = False
) -> str:
    """Decide as a robot does, with the model, and report what came of attempts, or of all."""
    forecaster = Forecaster.load(root / "m.npz")
    inputs = load_inputs(
        {name: root / part / f"{name}_made-test.csv" for name in "ab"}, bop=[root / "made"]
    )
    estimates = inputs.estimates("a")
    verdicts = forecaster.verdicts(estimates, inputs.models, threshold=threshold)
    held = pl.read_csv(root / f"{part}.csv")["success"].to_list()
    tables = {n: read_results(root / part / f"{n}_made-test.csv") for n in "ab"}
    path = root / f"{name or part}.db"
    with AttemptLog.open(path) as log:
        for scene in PARTS[part]:
            rows = np.flatnonzero(estimates.scene_id == scene)
            found = [
                decision(
                    id=f"{part} {row}",
                    instance=i,
                    object_name=str(estimates.objects[row]),
                    action="attempt" if verdicts[row].attempt else "abstain",
                    probability=verdicts[row].probability,
                    threshold=threshold,
                    guide="a",
                    cam_T_obj=estimates.of("a")[row],
                    gripper="parallel",
                )
                for i, row in enumerate(rows)
            ]
            seen = {
                n: [
                    (f"made-{t.obj_id[i]}", t.cam_T_obj[i], float(t.score[i]))
                    for i in np.flatnonzero(t.scene_id == scene)
                ]
                for n, t in tables.items()
            }
            model = forecaster.card.digest
            log.add([frame(0, *found, episode=str(scene), estimates=seen, model=model)])
        for row, success in enumerate(held):
            if every or verdicts[row].attempt:
                log.add_outcome(OutcomeRecord(f"{part} {row}", success == 1))
    return str(path)


def certify(root: Path, out: Path, *data: str) -> list[str]:
    return ["certify", "--model", str(root / "m.npz"), "--out", str(out), *data]


@pytest.mark.usefixtures("same_scenes")
@pytest.mark.slow
def test_a_model_from_a_log_is_that_from_files(world: Path) -> None:
    assert main(train(world, "logged.npz", "--from-log", str(world / "train.db"))) == 0
    one, two = (Forecaster.load(world / name) for name in ("m.npz", "logged.npz"))
    assert one.card.samples == two.card.samples == 80
    assert one.card.digest == two.card.digest


@pytest.mark.usefixtures("same_scenes")
def test_a_certificate_from_a_log_is_that_from_files(world: Path, tmp_path: Path) -> None:
    by_files = ["--bop", str(world / "made"), *files(world, "new"), "--per-object"]
    assert main(certify(world, tmp_path / "f.json", *by_files)) == 0
    by_log = ["--from-log", str(world / "new.db"), "--per-object"]
    assert main(certify(world, tmp_path / "l.json", *by_log)) == 0
    one, two = (Certificate.load(tmp_path / name) for name in ("f.json", "l.json"))
    assert one.overall.threshold is not None
    assert one.guarantees == two.guarantees
    assert (two.policy, two.provenance["model"]) == (None, one.provenance["model"])


def test_no_threshold_below_the_one_that_was_used(world: Path, tmp_path: Path, capsys) -> None:
    path = write_log(world, "new", threshold=0.97, name="strict")
    out = tmp_path / "c.json"
    assert main(certify(world, out, "--from-log", path, "--rate", "0.8")) == 0
    assert "nothing below the threshold 0.97 was attempted" in capsys.readouterr().err
    overall = Certificate.load(out).overall
    assert overall.threshold is not None
    assert overall.threshold >= 0.97
    assert overall.units == 80
    assert 0.0 < overall.attempt_rate < 1.0


def test_what_was_not_reported_is_left_out(world: Path, tmp_path: Path, capsys) -> None:
    path = write_log(world, "new", threshold=0.0, name="more")
    with AttemptLog.open(path) as log:
        model = Forecaster.load(world / "m.npz").card.digest
        more = decision(
            id="unreported", object_name="made-1", gripper="parallel", guide="a", threshold=0.0
        )
        other = decision(id="other", object_name="made-1", gripper="parallel", guide="a")
        log.add([frame(0, more, episode="999", model=model), frame(0, other, episode="998")])
    assert main(certify(world, tmp_path / "c.json", "--from-log", path)) == 0
    err = capsys.readouterr().err
    assert "left out 1 decision: attempts without an outcome" in err
    assert "left out 1 decision: another model's" in err


@pytest.mark.slow
def test_scenes_of_a_log_that_was_trained_on_are_known_again(
    world: Path, tmp_path: Path, capsys
) -> None:
    log = str(world / "train.db")
    assert main(train(world, "own.npz", "--from-log", log)) == 0
    own = Forecaster.load(world / "own.npz").card
    path = tmp_path / "own.db"
    with AttemptLog.open(path) as writer:
        made = {"object_name": "made-1", "gripper": "parallel", "guide": "a"}
        writer.add([frame(0, decision(0, **made), episode="3", model=own.digest)])
        writer.add_outcome(OutcomeRecord("d0", True))
    arguments = certify(world, tmp_path / "c.json", "--from-log", str(path))
    arguments[2] = str(world / "own.npz")
    assert "was trained on 1 of the 1 calibration scenes" in refused(arguments, capsys)


@pytest.mark.slow
def test_a_policy_that_looks_again_is_certified_at_its_threshold(
    world: Path, tmp_path: Path, capsys
) -> None:
    path = write_log(world, "new", threshold=0.5, name="looks")
    arguments = certify(world, tmp_path / "c.json", "--from-log", path, "--rate", "0.8")
    arguments += ["--max-looks", "3", "--guide", "a"]
    figures = tmp_path / "f.json"
    assert main([*arguments, "--json", str(figures)]) == 0
    certificate = Certificate.load(tmp_path / "c.json")
    assert certificate.overall.threshold == 0.5
    assert certificate.policy is not None
    assert certificate.policy.max_looks == 3
    assert json.loads(figures.read_text())["sequence"]["thresholds"] == [0.5]
    second = write_log(world, "train", threshold=0.6, name="looks2")
    said = refused([*arguments, "--from-log", second], capsys)
    assert "run with the thresholds 0.5, 0.6" in said


def test_what_cannot_be_done_from_a_log(world: Path, tmp_path: Path, capsys) -> None:
    log = ["--from-log", str(world / "new.db")]
    out = tmp_path / "c.json"
    for more, said in (
        ([*log, *files(world, "new")], "give either logs, or files of both"),
        ([], "there are no estimates"),
        (files(world, "new")[:-2], "there are no outcomes"),
        ([*log, "--sequence-share", "0.5"], "leave out the share of units"),
        ([*log, "--objects", "1"], "as they were made, without further data"),
        (["--from-log", str(tmp_path / "no.db")], "there is no attempt log"),
        (["--from-log", str(world / "new.csv")], "is no attempt log"),
    ):
        assert said in refused(certify(world, out, *more), capsys)
    other = tmp_path / "other.db"
    with AttemptLog.open(other) as writer:
        writer.add([frame(0)])
        writer.add_outcome(OutcomeRecord("d0", True))
    said = refused(certify(world, out, "--from-log", str(other)), capsys)
    assert "no outcome of an attempt of this model" in said
    assert "models there: mmmmmmmmmmmm" in said
    said = refused(train(world, "x.npz", *log, "--scenes", "3"), capsys)
    assert "a log has no scenes" in said
    said = refused(train(world, "x.npz", "--from-log", str(other)), capsys)
    assert "known: epos, gdrnpp" in said or "'a'" in said
    method = [*train(world, "x.npz", *log), "--method", "blend"]
    assert "choose the method direct" in refused(method, capsys)
