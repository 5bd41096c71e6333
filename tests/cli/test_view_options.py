"""train and predict with camera poses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from commands import refused
from graspcast.bop.results import read_results, write_results
from graspcast.cli import main
from graspcast.forecasting.forecaster import Forecaster
from graspcast.guarantees.certificate import Certificate
from looked_at import CAMERAS, NAMES, SCENES, Training, training


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("recorded")
    given = training(root / "d" / "models")
    for name, table in given.results.items():
        write_results(root / f"{name}_d-test.csv", table)
    write_truth(root, given)
    rows = [
        f"{s},{i},{' '.join(map(repr, pose.ravel().tolist()))}"
        for s in range(1, SCENES + 1)
        for i, pose in enumerate(CAMERAS)
    ]
    (root / "cameras.csv").write_text("\n".join(["scene_id,im_id,world_T_cam_m", *rows]))
    estimates = given.data.estimates
    lines = ["estimator,dataset,scene_id,im_id,obj_id,gripper,success"]
    for name, success in zip(estimates.estimators, given.data.success, strict=True):
        for key, held in zip(estimates.instances.to_keys(), success.tolist(), strict=True):
            lines.append(f"{name},d,{key.scene_id},{key.im_id},{key.obj_id},parallel,{int(held)}")
    (root / "outcomes.csv").write_text("\n".join(lines))
    return root


def write_truth(root: Path, given: Training) -> None:
    images: dict[int, dict[str, list[dict[str, object]]]] = {}
    for key, pose in zip(given.data.estimates.instances.to_keys(), given.data.truth, strict=True):
        entry = {
            "obj_id": key.obj_id,
            "cam_R_m2c": pose[:3, :3].ravel().tolist(),
            "cam_t_m2c": (1000 * pose[:3, 3]).tolist(),
        }
        images.setdefault(key.scene_id, {}).setdefault(str(key.im_id), []).append(entry)
    for scene_id, content in images.items():
        folder = root / "d" / "test" / f"{scene_id:06d}"
        folder.mkdir(parents=True)
        (folder / "scene_gt.json").write_text(json.dumps(content))


def inputs(root: Path, names: tuple[str, ...] = NAMES) -> list[str]:
    out = ["--bop", str(root / "d")]
    for name in names:
        out += ["--estimates", f"{name}={root / f'{name}_d-test.csv'}"]
    return out


def train(root: Path, out: Path, *more: str, names: tuple[str, ...] = NAMES) -> int:
    given = ["train", *inputs(root, names), "--principal", "a", "--gripper", "parallel"]
    given += ["--outcomes", str(root / "outcomes.csv"), "--trees", "8", "--folds", "0"]
    return main([*given, "--out", str(out), *more])


def predict(
    root: Path, model: Path, *more: str, names: tuple[str, ...] = NAMES
) -> list[dict[str, str]]:
    out = model.with_suffix(".csv")
    given = ["predict", *inputs(root, names), "--model", str(model), "--threshold", "0.8"]
    assert main([*given, "--out", str(out), *more]) == 0
    with out.open() as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
def test_one_model_serves_several_views_one_view_and_every_guide(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = ("--camera-poses", str(folder / "cameras.csv"))
    model = tmp_path / "model.npz"
    assert train(folder, model, *poses, "--camera-noise", "0.5mm,0.05deg") == 0
    assert "one or more views" in capsys.readouterr().out
    assert Forecaster.load(model).guides == ("a", "b", "c")
    assert Forecaster.load(model).card.views["noise_m"] == 0.0005
    many = predict(folder, model, *poses, "--views-from", "all", "--guide", "fused")
    assert {row["views"] for row in many} == {"3"} and {r["principal"] for r in many} == {"fused"}
    again = predict(folder, model, *poses, "--guide", "fused", "--max-looks", "3")
    looks = [row for row in again if row["verdict"] == "look again"]
    assert looks
    for row in looks:
        vector = np.array(row["look_direction_world"].split(), dtype=float)
        assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-5)
        assert float(row["expected_probability"]) > float(row["probability"] or 0)
    alone = predict(folder, model)
    assert {row["views"] for row in alone} == {"1"}
    by_b = predict(folder, model, "--guide", "b")
    assert {row["principal"] for row in by_b} == {"b"}


def trials_of(stages: Path, out: Path) -> Path:
    """Write outcomes of all grasps in a file of verdicts after each look: likely ones succeed."""
    with stages.open() as stream:
        rows = list(csv.DictReader(stream))
    lines = ["estimator,dataset,scene_id,im_id,obj_id,est_id,gripper,success"]
    for row in rows:
        held = int(float(row["probability"] or 0) > 0.6)
        key = [row[name] for name in ("dataset", "scene_id", "im_id", "obj_id", "est_id")]
        lines.append(",".join([row["principal"], *key, "parallel", str(held)]))
    out.write_text("\n".join(lines))
    return out


@pytest.mark.slow
def test_looking_again_is_scored_certified_predicted_and_monitored(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = ("--camera-poses", str(folder / "cameras.csv"), "--views-from", "all")
    model = tmp_path / "model.npz"
    assert train(folder, model, "--camera-poses", str(folder / "cameras.csv")) == 0
    looking = (*poses, "--guide", "fused", "--max-looks", "3")
    stages, figures = tmp_path / "stages.csv", tmp_path / "figures.json"
    rows = predict(folder, model, *looking, "--stages", str(stages))
    assert len(rows) == SCENES * len(CAMERAS) * 2
    trials = trials_of(stages, tmp_path / "trials.csv")

    score = ["score", "--stages", str(stages), "--outcomes"]
    assert main([*score, str(trials), "--json", str(figures)]) == 0
    assert "always three looks" in capsys.readouterr().out
    content = json.loads(figures.read_text())
    again = content["policies"][2]
    assert content["n"] == len(rows) and content["untried"] == 0
    assert again["attempts"] == sum(row["verdict"] == "attempt" for row in rows)
    err = refused([*score, str(folder / "outcomes.csv")], capsys)
    assert "no outcomes of fused2 on d" in err and "up to 2 views" in err
    assert "holds the verdicts after each look" in refused(
        ["score", "--verdicts", str(stages), "--outcomes", str(trials)], capsys
    )

    promise = tmp_path / "promise.json"
    certify = ["certify", *inputs(folder), "--model", str(model), "--outcomes", str(trials)]
    certify += ["--unit", "image", "--rate", "0.7", "--allow-training-scenes"]
    assert main([*certify, *looking, "--out", str(promise)]) == 0
    said = capsys.readouterr()
    assert "guide fused, up to 3 looks" in said.out and "around the target rate" in said.err
    certificate = Certificate.load(promise)
    assert certificate.overall.threshold is not None

    verdicts = tmp_path / "certified.csv"
    certified = ["predict", *inputs(folder), "--model", str(model), "--out", str(verdicts)]
    certified += ["--certificate", str(promise)]
    assert main([*certified, *looking]) == 0
    with verdicts.open() as stream:
        attempts = [row for row in csv.DictReader(stream) if row["verdict"] == "attempt"]
    assert len(attempts) == certificate.overall.attempts
    assert {row["principal"] for row in attempts} <= {"a", "fused2", "fused3"}
    other = refused([*certified, *poses, "--guide", "best", "--max-looks", "3"], capsys)
    assert "guide is fused, not best" in other and "(see --guide)" in other
    assert "but the verdicts are of one view" in refused(certified, capsys)

    log, state = tmp_path / "log.csv", tmp_path / "state.json"
    header, *lines = trials.read_text().splitlines()
    tried = {(r["principal"], r["scene_id"], r["im_id"], r["obj_id"]) for r in attempts}
    mine = [line for line in lines if (f := line.split(","))[0] and (f[0], *f[2:5]) in tried]
    log.write_text("\n".join([header, *mine]) + "\n")
    monitor = ["monitor", "--certificate", str(promise), "--attempt-log", str(log)]
    assert main([*monitor, "--state", str(state)]) == 0
    log.write_text(
        "\n".join([header, *mine, mine[0].replace(mine[0].split(",")[0], "b", 1)]) + "\n"
    )
    assert "estimator b, but the guarantee is for a, fused, fused2, fused3" in refused(
        [*monitor, "--state", str(tmp_path / "new.json")], capsys
    )


def half_of_the_images(root: Path, out: Path) -> Path:
    """Write the camera poses of every other image, and of the last one alone in the first scene."""
    header, *rows = (root / "cameras.csv").read_text().splitlines()
    keys = [row.split(",")[:2] for row in rows]
    last = str(len(CAMERAS) - 1)
    kept = [i == last if s == "1" else int(i) % 2 == 0 for s, i in keys]
    out.write_text("\n".join([header, *(row for row, k in zip(rows, kept, strict=True) if k)]))
    return out


@pytest.mark.slow
def test_single_views_are_counted_once_where_camera_poses_are_missing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    half = half_of_the_images(folder, tmp_path / "half.csv")
    poses = ("--camera-poses", str(half), "--views-from", "all")
    fuse = ["fuse", *inputs(folder), *poses, "--out", str(tmp_path / "fused_d-test.csv")]
    assert main(fuse) == 0
    lines = [
        line for line in capsys.readouterr().out.splitlines() if line.startswith("single views")
    ]
    # Two objects: without a pose, four images of the first scene and two of each other one.
    assert len(lines) == 2
    assert lines[0].startswith(f"single views: {2 * (4 + 2 * (SCENES - 1))} instances have no cam")
    assert (
        lines[1] == "single views: 2 instances have no other image with an estimate of the object"
    )

    model, stages = tmp_path / "m.npz", tmp_path / "stages.csv"
    looking = ("--guide", "fused", "--max-looks", "3", "--stages", str(stages))
    assert train(folder, model, *poses) == 0
    assert [
        x for x in capsys.readouterr().err.splitlines() if x.startswith("single views")
    ] == lines
    for more in ((), looking):
        predict(folder, model, *poses, *more)
        err = capsys.readouterr().err.splitlines()
        assert [x for x in err if x.startswith("single views")] == lines
        assert not any("judged alone" in line for line in err)
    trials = trials_of(stages, tmp_path / "trials.csv")
    certify = ["certify", *inputs(folder), "--model", str(model), "--outcomes", str(trials)]
    certify += ["--unit", "image", "--allow-training-scenes", "--out", str(tmp_path / "c.json")]
    assert main([*certify, *poses, "--guide", "fused", "--max-looks", "3"]) == 0
    assert [
        x for x in capsys.readouterr().err.splitlines() if x.startswith("single views")
    ] == lines

    said = "there are no camera poses: each image is judged alone"
    for more in ((), ("--guide", "fused")):
        predict(folder, model, *more)
        err = capsys.readouterr().err
        assert err.count(said) == 1
        assert ("its principal guides instead of the fused pose" in err) is bool(more)
    certify[certify.index(str(trials))] = str(folder / "outcomes.csv")
    assert main([*certify, "--guide", "b"]) == 0
    assert capsys.readouterr().err.count(said) == 1


@pytest.mark.slow
def test_a_model_without_views_says_so_where_the_fused_pose_should_guide(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train(folder, tmp_path / "m.npz") == 0
    predict(folder, tmp_path / "m.npz")
    assert "trained without views" not in capsys.readouterr().err
    predict(folder, tmp_path / "m.npz", "--guide", "fused")
    said = "trained without views: each image is judged alone; its principal guides instead"
    assert capsys.readouterr().err.count(said) == 1


@pytest.mark.slow
def test_one_estimator_is_enough_with_views(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = ("--camera-poses", str(folder / "cameras.csv"))
    model = tmp_path / "one.npz"
    assert train(folder, model, *poses, names=("a",)) == 0
    assert "a alone, one or more views" in capsys.readouterr().out
    rows = predict(folder, model, *poses, "--views-from", "all", names=("a",))
    assert all(row["probability"] for row in rows)
    first = predict(folder, model, *poses, "--max-looks", "3", names=("a",))
    said = {row["verdict"] for row in first if row["im_id"] == "0"}
    assert said == {"look again"}
    # From one view the same file forecasts by visibility, as one does that was trained without.
    assert train(folder, tmp_path / "x.npz", names=("a",)) == 0
    assert "a alone, one view, parallel" in capsys.readouterr().out
    single = predict(folder, model, names=("a",))
    assert all("one view of one estimator: rests on" in row["reason"] for row in single)
    alone = predict(folder, tmp_path / "x.npz", names=("a",))
    assert [row["probability"] for row in alone] == [row["probability"] for row in single]
    for row in first:
        if row["im_id"] == "0":
            assert "mostly visibility; after a further look" in row["reason"]


@pytest.mark.slow
def test_what_does_not_fit_is_told(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = ("--camera-poses", str(folder / "cameras.csv"))
    model = tmp_path / "single.npz"
    assert train(folder, model) == 0
    asked = ["predict", *inputs(folder), "--model", str(model), "--out", str(tmp_path / "v.csv")]
    assert "trained without views" in refused([*asked, *poses], capsys)
    assert "unknown guide 'z'" in refused([*asked, "--guide", "z"], capsys)
    wrong = ("--camera-poses", f"other={folder / 'cameras.csv'}")
    assert "no estimates of other" in refused([*asked, *wrong], capsys)
    looks = [*asked, "--stages", str(tmp_path / "s.csv")]
    assert "take two looks or more (see --max-looks)" in refused(looks, capsys)
    assert "already camera poses of d" in refused([*asked, *poses, *poses], capsys)
    given = ["train", *inputs(folder), "--principal", "a", "--gripper", "parallel", *poses]
    given += ["--outcomes", str(folder / "outcomes.csv"), "--out", str(tmp_path / "y.npz")]
    assert "does not forecast with several views" in refused([*given, "--method", "direct"], capsys)


@pytest.mark.slow
def test_one_estimator_learns_from_outcomes_of_others_and_needs_none_of_them(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = ("--camera-poses", str(folder / "cameras.csv"))
    learned = ("--learn-from", "c", "--learn-from", "b")
    model, own = tmp_path / "model.npz", tmp_path / "own.npz"
    assert train(folder, model, *poses, *learned) == 0
    out, err = capsys.readouterr()
    count = SCENES * len(CAMERAS) * 2
    assert f"also learned from: {count} outcomes of b, {count} outcomes of c" in err
    assert "a alone, one or more views" in out
    assert f"{count} samples, {count} of b, {count} of c" in out
    assert Forecaster.load(model).card.estimators == ("a",)
    assert train(folder, own, *poses, names=("a",)) == 0
    looks = (*poses, "--views-from", "all")
    better = predict(folder, model, *looks, names=("a",))
    plain = predict(folder, own, *looks, names=("a",))
    assert {row["views"] for row in better} == {"3"}
    assert [r["probability"] for r in better] != [r["probability"] for r in plain]


@pytest.mark.slow
def test_an_instance_that_another_did_not_find_is_learned_from_all_the_same(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = read_results(folder / "c_d-test.csv")
    write_results(tmp_path / "c_d-test.csv", table.select(table.im_id > 0))
    given = ["train", *inputs(folder, ("a", "b"))]
    given += ["--estimates", f"c={tmp_path / 'c_d-test.csv'}", "--learn-from", "c"]
    given += ["--principal", "a", "--gripper", "parallel", "--trees", "4", "--folds", "2"]
    given += ["--outcomes", str(folder / "outcomes.csv"), "--out", str(tmp_path / "m.npz")]
    assert main(given) == 0
    out, err = capsys.readouterr()
    count = SCENES * len(CAMERAS) * 2
    assert f"{count} samples, {SCENES * (len(CAMERAS) - 1) * 2} of c" in out
    assert "dropped" not in err
    assert Forecaster.load(tmp_path / "m.npz").card.supporters == ("b",)


def test_whom_nothing_can_be_learned_from_is_told(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*more: str, outcomes: Path = folder / "outcomes.csv") -> str:
        given = ["train", *inputs(folder), "--principal", "a", "--gripper", "parallel"]
        given += ["--outcomes", str(outcomes), "--out", str(tmp_path / "m.npz")]
        return refused([*given, *more], capsys)

    text = said("--learn-from", "a")
    assert "a is the principal" in text and "(see --learn-from, --principal)" in text
    text = said("--learn-from", "d")
    assert "unknown estimator 'd'; known: a, b, c (see --learn-from)" in text
    text = said("--learn-from", "b", "--learn-from", "c")
    assert "give camera poses" in text and "--camera-poses" in text
    text = said("--learn-from", "c", "--method", "direct")
    assert "the method direct learns nothing from outcomes of estimators that are not" in text
    lines = (folder / "outcomes.csv").read_text().splitlines()
    few = tmp_path / "few.csv"
    few.write_text("\n".join(line for line in lines if not line.startswith("c,")))
    text = said("--learn-from", "c", outcomes=few)
    assert "nothing can be learned from c: no instance has an outcome" in text
    assert "(see --learn-from, --outcomes)" in text
    assert not (tmp_path / "m.npz").exists()
