"""Consensus features: the released arrays, invariances, symmetries, names."""

from __future__ import annotations

import dataclasses
import inspect
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.bop.dataset import BopDataset
from graspcast.bop.models import Models
from graspcast.bop.results import read_results
from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates, align
from graspcast.forecasting.features import (
    FEATURE_SETS,
    Features,
    FeatureSet,
    consensus_features,
    describe,
    mean_add,
)
from poses import nudged, random_poses, results_of, write_models

HALF_TURN = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


@pytest.fixture
def models(tmp_path: Path) -> dict[str, Models]:
    return {
        "d": Models(write_models(tmp_path, obj_1={"symmetries_discrete": [HALF_TURN]}, obj_2={}))
    }


def three(n: int = 8, obj_id: int = 1, *, seed: int = 0) -> Estimates:
    truth = random_poses(n, seed)
    tables = {k: results_of(nudged(truth, s), obj_id=obj_id) for s, k in enumerate("abc")}
    return align(tables, dataset="d")


def column(features: Features, name: str) -> np.ndarray:
    return features.values[:, features.names.index(name)]


def attribution(estimates: Estimates, which: slice, by: np.ndarray, *, left: bool) -> Estimates:
    poses = estimates.cam_T_obj.copy()
    poses[which] = by @ poses[which] if left else poses[which] @ by
    return type(estimates)(**{**estimates.__dict__, "cam_T_obj": poses})


@pytest.mark.parametrize(
    "principal",
    ["epos", *(pytest.param(name, marks=pytest.mark.slow) for name in ("gdrnpp", "zebrapose"))],
)
@pytest.mark.slow
def test_paper_features_equal_the_released_arrays(
    data_dir: Path, published: Path, principal: str
) -> None:
    names = ("epos", "gdrnpp", "zebrapose")
    written = {"epos": "EPOS", "gdrnpp": "GDRNPP", "zebrapose": "ZebraPose"}[principal]
    folder = (
        data_dir / "raw/Consensus-Driven-Uncertainty/Train-Grasp-Success-Prediction/Data-Split/t3r3"
    )
    with np.load(folder / f"dataset-{written}-t3r3.npz") as data:
        arrays = data["arr_0"]
    rows = [
        line.split("\t")
        for line in (folder / f"dataset-{written}-t3r3.txt").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    assert len(rows) == 3152
    compared = 0
    for dataset in ("lmo", "ycbv"):
        tables = {n: read_results(published / dataset / f"{n}_{dataset}-test.csv") for n in names}
        estimates = align(tables, dataset=dataset, anchor=principal)
        features = consensus_features(estimates, principal)
        keys = zip(
            estimates.scene_id.tolist(),
            estimates.im_id.tolist(),
            estimates.obj_id.tolist(),
            strict=True,
        )
        number = {k: i for i, k in enumerate(keys)}
        for row in (r for r in rows if r[0].lower() == dataset):
            mine = features.values[number[int(row[1]), int(row[2]), int(row[3])]].reshape(2, 2, 3)
            theirs = arrays[[int(row[5]), int(row[6])]].transpose(0, 2, 1)
            assert_allclose(mine, theirs, atol=1e-12, rtol=0)
            compared += 1
    assert compared == 3152


def test_object_frame_features_do_not_depend_on_the_camera(models: dict[str, Models]) -> None:
    estimates = three()
    rich = consensus_features(estimates, "a", which="rich", models=models)
    elsewhere = attribution(estimates, slice(None), random_poses(1, seed=5), left=True)
    again = consensus_features(elsewhere, "a", which="rich", models=models)
    stems = ("rot_", "angle", "off_", "add_", "offset_between")
    names = [n for n in rich.names if n.startswith(stems)]
    assert len(names) == 2 * 8 + 2 + 2
    for name in names:
        assert_allclose(column(again, name), column(rich, name), atol=1e-9, err_msg=name)


def test_a_symmetric_supporter_is_turned_back(models: dict[str, Models]) -> None:
    turn = np.array(HALF_TURN, dtype=float).reshape(4, 4)
    for obj_id, same in ((1, True), (2, False)):
        estimates = three(obj_id=obj_id)
        turned = attribution(estimates, slice(1, 2), turn, left=False)
        before = consensus_features(estimates, "a", which="rich", models=models)
        after = consensus_features(turned, "a", which="rich", models=models)
        for stem in ("rot_x", "rot_y", "rot_z", "angle", "off_x"):
            name = f"{stem}.b"
            equal = np.allclose(column(before, name), column(after, name), atol=1e-9)
            assert equal is (same or stem == "off_x"), name


def test_agreement_is_zero_and_wrapping_is_not_undone(models: dict[str, Models]) -> None:
    truth = results_of(random_poses(6))
    agree = align({"a": truth, "b": truth, "c": truth}, dataset="d", required=False)
    assert_array_equal(consensus_features(agree, "b").values, 0)
    rich = consensus_features(agree, "b", which="rich", models=models)
    for name in rich.names:
        if not name.startswith(("view", "distance")):
            assert_allclose(column(rich, name), 0, atol=1e-7, err_msg=name)
    # Two poses on both sides of half a turn about z differ by nearly a whole turn.
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, 2, 3] = 1
    for pose, angle in zip(poses, (3.1, -3.1), strict=True):
        pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    out_of_fold = align({"a": results_of(poses[:1]), "b": results_of(poses[1:])}, dataset="d")
    assert column(consensus_features(out_of_fold, "a"), "dpsi_z.b")[0] == pytest.approx(6.2)


def test_ray_features(models: dict[str, Models]) -> None:
    pose = random_poses(5)
    farther = pose.copy()
    distance = np.linalg.norm(pose[:, :3, 3], axis=-1)
    farther[:, :3, 3] *= 1.1
    rich = consensus_features(
        align({"a": results_of(pose), "b": results_of(farther)}, dataset="d"),
        "a",
        which="rich",
        models=models,
    )
    assert_allclose(column(rich, "ray.b"), 0.1 * distance, atol=1e-12)
    assert_allclose(column(rich, "ray_rel.b"), 0.1, atol=1e-12)
    assert_allclose(column(rich, "across_rel.b"), 0, atol=1e-7)
    assert_allclose(column(rich, "distance"), distance, atol=1e-12)
    diameter = models["d"][1].diameter_m
    assert_allclose(column(rich, "add_mean_rel") * diameter, 0.1 * distance, atol=1e-12)
    view = np.stack([column(rich, f"view_{a}") for a in "xyz"], axis=1)
    camera = np.linalg.inv(pose)[:, :3, 3]
    assert_allclose(view, camera / np.linalg.norm(camera, axis=-1, keepdims=True), atol=1e-9)


def test_full_adds_to_rich_what_does_not_depend_on_the_objects_frame(
    models: dict[str, Models],
) -> None:
    estimates = three()
    rich = consensus_features(estimates, "a", which="rich", models=models)
    full = consensus_features(estimates, "a", which="full", models=models)
    count = len(rich.names)
    assert full.names[:count] == rich.names
    assert_array_equal(full.values[:, :count], rich.values)
    other = random_poses(1, 5)[0]
    poses = estimates.cam_T_obj @ other  # another frame with another origin
    poses[..., :3, 3] = estimates.cam_T_obj[..., :3, 3]  # and then the same origin
    turned = consensus_features(
        dataclasses.replace(estimates, cam_T_obj=poses), "a", which="full", models=models
    )
    for name in full.names[count:]:
        same = np.allclose(column(turned, name), column(full, name), rtol=0, atol=1e-9)
        assert same != name.startswith("axis_"), name
    along, rel = column(full, "shift_z.b"), column(full, "ray_rel.b")
    assert_allclose(along, rel, atol=1e-12)
    assert_allclose(np.hypot(column(full, "shift_x.b"), column(full, "shift_y.b")),
                    column(full, "across_rel.b"), atol=1e-12)  # fmt: skip
    middle = np.median([np.zeros(8), column(full, "turn_y.b"), column(full, "turn_y.c")], axis=0)
    assert_array_equal(column(full, "mid_turn_y"), middle)


def test_every_column_is_described_once(models: dict[str, Models]) -> None:
    for which, count in (("paper", 12), ("rich", 31), ("full", 31 + 2 * 6 + 6 + 9)):
        features = consensus_features(three(), "a", which=which, models=models)  # type: ignore[arg-type]
        assert features.values.shape == (8, count)
        assert len(set(features.names)) == count
        units = {describe(name)[0] for name in features.names}
        assert units <= {"m", "rad", "1"}
    with pytest.raises(UnknownNameError, match="unknown feature 'visibility'"):
        describe("visibility.b")


def test_no_ground_truth_can_get_in() -> None:
    for function in (consensus_features, mean_add):
        names = inspect.signature(function).parameters
        assert set(names) <= {"estimates", "principal", "which", "models"}


@pytest.mark.ill_typed
def test_missing_models_and_names(models: dict[str, Models]) -> None:
    with pytest.raises(MismatchError, match="models for dataset 'd'; there are models of: none"):
        consensus_features(three(), "a", which="rich")
    with pytest.raises(UnknownNameError, match="unknown object '7'; known: 1, 2"):
        consensus_features(three(obj_id=7), "a", which="rich", models=models)
    with pytest.raises(UnknownNameError, match="unknown estimator 'z'"):
        consensus_features(three(), "z")
    with pytest.raises(UnknownNameError, match="known: paper, rich, full"):
        consensus_features(three(), "a", which="poor")  # type: ignore[arg-type]


@pytest.mark.slow
def test_released_add_differences(data_dir: Path, published: Path) -> None:
    """Exact on LM-O; within some per cent on YCB-V, whose meshes here are substitutes."""
    folder = (
        data_dir / "raw/Consensus-Driven-Uncertainty/Train-Grasp-Success-Prediction/Data-Split/add"
    )
    with np.load(folder / "dataset-EPOS-add.npz") as data:
        values = data["arr_0"]
    table = {}
    for line in (folder / "dataset-EPOS-add.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            f = line.split("\t")
            table[f[0].lower(), int(f[1]), int(f[2]), int(f[3])] = (
                values[int(f[5])] + values[int(f[6])]
            ) / 2
    for name, tolerance in (("lmo", 1e-4), ("ycbv", 0.09)):
        tables = {
            n: read_results(published / name / f"{n}_{name}-test.csv")
            for n in ("epos", "gdrnpp", "zebrapose")
        }
        dataset = BopDataset(data_dir / "bop" / name)
        estimates = align(tables, dataset=name)
        estimates = estimates.select(np.isin(estimates.obj_id, list(dataset.models.info)))
        ours = mean_add(estimates, "epos", {name: dataset.models})
        keys = zip(
            estimates.scene_id.tolist(),
            estimates.im_id.tolist(),
            estimates.obj_id.tolist(),
            strict=True,
        )
        theirs = np.array([table[name, *k] for k in keys])
        assert_allclose(ours, theirs, rtol=tolerance)


def test_the_documentation_lists_every_feature() -> None:
    text = (Path(__file__).parents[2] / "docs" / "features.md").read_text()
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| `")]
    documented = {row[1].strip(" `"): (row[2].strip(), row[3].strip()) for row in rows}
    assert documented == {name: describe(name) for name in documented}
    columns = {name.split(".")[0] for which in FEATURE_SETS for name in stems(which)}
    assert set(documented) == columns


def stems(which: FeatureSet) -> set[str]:
    truth = results_of(random_poses(2))
    with TemporaryDirectory() as folder:
        models = {"d": Models(write_models(Path(folder)))}
        estimates = align({"a": truth, "b": truth, "c": truth}, dataset="d", required=False)
        return set(consensus_features(estimates, "a", which=which, models=models).names)
