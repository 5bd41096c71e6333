"""The readers that ``fuzz.py`` tries: a valid file of each, how to change it, how to read it."""

from __future__ import annotations

import gzip
import io
import json
import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import polars as pl

import fuzz_mutations as mutations
from graspcast.bop.dataset import BopDataset, read_ground_truth, read_targets
from graspcast.bop.detections import read_detections
from graspcast.bop.images import read_image
from graspcast.bop.meshes import read_coloured_mesh
from graspcast.bop.models import Models, read_models_info
from graspcast.bop.object_transforms import read_object_transforms
from graspcast.bop.pose_rows import Stated
from graspcast.bop.results import Results, read_results, write_results
from graspcast.errors import FormatError
from graspcast.estimates.outcomes import read_error_outcomes, read_outcomes
from graspcast.evaluation.predictions import Forecasts
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.stage_file import read_stages, write_stages
from graspcast.forecasting.train import train_forecaster
from graspcast.forecasting.verdict import InstanceLooks, verdict_rows
from graspcast.forecasting.verdict_file import read_verdicts, write_verdicts
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify
from graspcast.guarantees.look_policy import LookPolicy
from graspcast.guarantees.monitor_state import MonitorState
from graspcast.io.tables import parquet_bytes
from graspcast.paper.published_split import read_split
from graspcast.paper.release import read_release
from graspcast.perception.network import Network
from graspcast.simulation.campaign.store import COLUMNS, Store
from graspcast.simulation.grasps.table import grasps_in
from graspcast.simulation.grippers.mjcf import MjcfGripper
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.meshes import read_mesh
from graspcast.views.camera_tables import read_camera_motion

ROOT = Path(__file__).parent.parent
TESTS = ROOT / "tests"
sys.path.insert(0, str(TESTS))  # for the small data sets that the tests make

Mutation = Callable[[bytes, Random], bytes]


@dataclass(frozen=True)
class Reader:
    """A reader: ``read`` reads the file ``name`` in the folder that holds all seeds.

    ``weight`` is its share of the inputs beside the other readers'.
    """

    name: str
    read: Callable[[Path], Any]
    mutations: tuple[Mutation, ...]
    weight: float = 1.0
    file: str = ""

    def path(self, folder: Path) -> Path:
        """Return the file that it reads."""
        return folder / (self.file or self.name)

    def mutated(self, seed: bytes, random: Random) -> bytes:
        """Return a changed seed: by its structure, as bytes, or both."""
        try:
            content = random.choice(self.mutations)(seed, random)
        except (ValueError, TypeError, ArithmeticError, RuntimeError, pl.exceptions.PolarsError):
            content = mutations.of_bytes(seed, random)  # it makes no such change here
        return mutations.of_bytes(content, random) if random.random() < 0.1 else content


# --- How files are read ---------------------------------------------------------------------------


def _frame(path: Path) -> Any:
    try:
        table = json.loads(path.read_bytes())
    except ValueError as error:
        raise FormatError(path, "is no JSON, so there is no table to try") from error
    if not isinstance(table, dict):
        raise FormatError(path, "is no table")
    return repr(Results.from_frame(table))


def _forecasts(path: Path) -> Any:
    import synthetic

    forecaster = Forecaster.load(path)
    models = {"d": Models(path.parent / "models")}
    estimates = synthetic.estimates(4, seed=9)
    return repr(forecaster), forecaster.verdicts(estimates, models, explain=True)


def _monitor(folder: Path) -> Any:
    certificate = folder / "certificate_of_monitor.json"
    guarantee = Certificate.load(certificate).overall
    state = MonitorState.open(folder / "monitor_state.json", certificate, guarantee)
    return state.update(folder / "attempt_log.csv", {"unit": "scene"})


def _manifest(path: Path) -> Any:
    return Store(path.parent).manifest


def _gripper(path: Path) -> Any:
    return MjcfGripper.from_toml(path.parent / "gripper.toml").spec()


def _urdf(path: Path) -> Any:
    return MjcfGripper.from_toml(path.parent / "jaws.toml").spec()


def _camera(path: Path) -> Any:
    dataset = BopDataset(path.parent)
    return dataset.camera, dataset.image_size


def _release(path: Path) -> Any:
    return read_release(next(parent for parent in path.parents if parent.name == "release"))


def _parquet(content: bytes, random: Random, *, digest: bool) -> bytes:
    """Write a table again with other columns and values; with a digest or without."""
    frame = pl.read_parquet(io.BytesIO(content))
    for _ in range(random.choice((1, 1, 2))):
        name, kind = random.choice(frame.columns), random.randrange(6)
        column = frame[name]
        if kind == 0:
            frame = frame.drop(name) if frame.width > 1 else frame
        elif kind == 1:
            frame = frame.rename({name: random.choice(("x", name + "_", "success "))})
        elif kind == 2:
            types = (
                pl.String,
                pl.Int8,
                pl.Float32,
                pl.Boolean,
                pl.Int64,
                pl.UInt64,
                pl.Categorical,
            )
            frame = frame.with_columns(column.cast(random.choice(types), strict=False))
        elif kind == 3:
            frame = frame[: random.randrange(len(frame) + 1)] if random.random() < 0.5 else frame
            frame = pl.concat([frame, frame])
        elif kind == 4:
            values: tuple[Any, ...] = (None, 0, -1, 2**40, "x", "", 1e400, float("nan"), [1])
            one = pl.lit(pl.Series([random.choice(values)]))
            frame = frame.with_columns(one.first().alias(name))
        else:
            row = random.randrange(max(1, len(frame)))
            other = column.shuffle(seed=random.randrange(2**31))
            frame = frame.with_columns(other if row else column.reverse())
    if digest:
        return parquet_bytes(frame)
    out = io.BytesIO()
    frame.write_parquet(out)
    return out.getvalue()


# --- The readers ----------------------------------------------------------------------------------

_TEXT: tuple[Mutation, ...] = (mutations.of_text, mutations.of_text, mutations.of_bytes)
_JSON: tuple[Mutation, ...] = (*(mutations.of_json,) * 3, mutations.of_text, mutations.of_bytes)
_SIGNED: tuple[Mutation, ...] = (
    *(partial(mutations.of_json, digest=True),) * 4,
    mutations.of_text,
    mutations.of_bytes,
)
_ARRAYS: tuple[Mutation, ...] = (*(mutations.of_arrays,) * 3, mutations.of_bytes)
_BYTES: tuple[Mutation, ...] = (mutations.of_bytes,)
_LENIENT = partial(read_results, lenient=True, placeholders=True)
_STATED = Stated(1, 3, {"mug": 5, "": 5})

READERS = (
    Reader("results.csv", read_results, _TEXT, 2),
    Reader("results_lenient.csv", _LENIENT, _TEXT),
    Reader("results_17.csv", _LENIENT, _TEXT),
    Reader("results.csv.gz", read_results, _BYTES, 0.5),
    Reader("detection_pem.json", read_results, _JSON),
    Reader("object_data.json", partial(read_results, stated=_STATED), _JSON),
    Reader("000003.txt", partial(read_results, stated=_STATED), _TEXT),
    Reader("transform.json", read_object_transforms, _JSON),
    Reader("frame.json", _frame, (mutations.of_json,), 2),
    Reader(
        "scene_gt.json",
        lambda p: read_ground_truth(p.parent.parent),
        _JSON,
        2,
        "test/000001/scene_gt.json",
    ),
    Reader(
        "scene_gt_info.json",
        lambda p: read_ground_truth(p.parent.parent),
        _JSON,
        1,
        "test/000001/scene_gt_info.json",
    ),
    Reader(
        "scene_camera.json",
        lambda p: BopDataset(p.parents[2]).scene_cameras,
        _JSON,
        1,
        "test/000001/scene_camera.json",
    ),
    Reader("camera.json", _camera, _JSON),
    Reader("models_info.json", read_models_info, _JSON, 2),
    Reader("targets.json", read_targets, _JSON),
    Reader("detections.json", read_detections, _JSON, 2),
    Reader("boxes_by_image.json", read_detections, _JSON),
    Reader("boxes_coco.json", read_detections, _JSON),
    Reader("outcomes.csv", read_outcomes, _TEXT, 2),
    Reader("error_outcomes.csv", read_error_outcomes, _TEXT),
    Reader("outcomes.parquet", read_outcomes, (partial(_parquet, digest=True), *_BYTES)),
    Reader("foreign.parquet", read_outcomes, (partial(_parquet, digest=False), *_BYTES), 0.001),
    Reader("verdicts.csv", read_verdicts, _TEXT, 2),
    Reader("stages.csv", read_stages, _TEXT, 2),
    Reader("split.csv", read_split, _TEXT),
    Reader("camera_matrices.csv", read_camera_motion, _TEXT),
    Reader("camera_quaternions.csv", read_camera_motion, _TEXT),
    Reader(
        "camera_poses.json",
        lambda p: read_camera_motion(p.parent.parent),
        _JSON,
        file="camera_poses/000001/scene_camera.json",
    ),
    Reader("threshold.npz", _forecasts, _ARRAYS, 0.5),
    Reader("networks.npz", _forecasts, _ARRAYS, 0.5),
    Reader("forests.npz", _forecasts, _ARRAYS, 0.3),
    Reader("forecasts.npz", lambda p: Forecasts.load(p, "x"), _ARRAYS),
    Reader("certificate.json", lambda p: str(Certificate.load(p)), _SIGNED, 2),
    Reader("monitor_state.json", lambda p: _monitor(p.parent), _SIGNED, 1),
    Reader("attempt_log.csv", lambda p: _monitor(p.parent), _TEXT, 1),
    Reader(
        "manifest.json", lambda p: Store(p.parent).manifest, _SIGNED, 1, "campaign/manifest.json"
    ),
    Reader(
        "shard.parquet",
        lambda p: Store(p.parent.parent).outcomes(),
        (partial(_parquet, digest=True), *_BYTES),
        1,
        "campaign/shards/shard.parquet",
    ),
    Reader("catalogue.toml", read_catalogue, _TEXT),
    Reader("grasps.toml", grasps_in, _TEXT),
    Reader("gripper.toml", _gripper, _TEXT, 0.5),
    Reader("gripper.xml", _gripper, _TEXT, 0.5),
    Reader("jaws.urdf", _urdf, _TEXT, 0.5),
    Reader("jaws.toml", _urdf, _TEXT, 0.5),
    Reader("model.ply", read_coloured_mesh, _TEXT, 0.5),
    Reader("model_binary.ply", read_coloured_mesh, _TEXT, 0.5),
    Reader("model_polygons.ply", read_coloured_mesh, _TEXT, 0.5),
    Reader("own.ply", partial(read_mesh, unit="auto"), _TEXT, 0.5),
    Reader("own.obj", partial(read_mesh, unit="auto"), _TEXT, 0.5),
    Reader("own.stl", partial(read_mesh, unit="auto"), _BYTES, 0.5),
    Reader("own_text.stl", partial(read_mesh, unit="auto"), _TEXT, 0.5),
    Reader("image.png", read_image, _BYTES),
    Reader("image.jpg", read_image, _BYTES),
    Reader("image.webp", read_image, _BYTES),
    Reader("image.tif", partial(read_image, gray=True), _BYTES),
    Reader("turned.jpg", read_image, _BYTES),
    Reader("network.onnx", lambda p: Network("dense", p), _BYTES, 0.1),
    Reader(
        "release_index.txt",
        _release,
        _TEXT,
        0.5,
        "release/Pose-Estimates/EPOS/LMO/weights/lmo-1-epos.txt",
    ),
    Reader(
        "release_poses.npz",
        _release,
        _ARRAYS,
        0.5,
        "release/Pose-Estimates/EPOS/LMO/weights/pose_data_lmo-1-epos.npz",
    ),
    Reader(
        "release_trials.txt",
        _release,
        _TEXT,
        0.5,
        "release/Parallel-Gripper/EPOS/LMO/weights/lmo-1-epos-parallel-results.txt",
    ),
)
BY_NAME: Mapping[str, Reader] = {reader.name: reader for reader in READERS}


# --- Valid files ----------------------------------------------------------------------------------


def make_seeds(folder: Path) -> None:
    """Write a valid file for every reader, and what it needs beside it."""
    _tables(folder)
    _bop(folder)
    _models(folder)
    _guarantees(folder)
    _campaign(folder)
    _simulation(folder)
    _pictures(folder)
    _release_files(folder)


def _results() -> Results:
    from poses import random_poses, results_of

    return results_of(random_poses(4))


def _tables(folder: Path) -> None:
    results = _results()
    write_results(folder / "results.csv", results)
    shutil.copy(folder / "results.csv", folder / "results_lenient.csv")
    names = ("scene_id", "im_id", "obj_id", "score", "cam_T_obj")
    table = {name: getattr(results, name).tolist() for name in names}
    (folder / "frame.json").write_text(json.dumps(table))
    rows = [
        {
            "estimator": "a",
            "dataset": "d",
            "scene_id": i // 2,
            "im_id": i,
            "obj_id": 1,
            "est_id": 0,
            "gripper": "parallel",
            "grasp": "reference",
            "success": i % 2,
        }
        for i in range(4)
    ]
    outcomes = pl.DataFrame(rows)
    outcomes.write_csv(folder / "outcomes.csv")
    outcomes.write_csv(folder / "attempt_log.csv")
    (folder / "outcomes.parquet").write_bytes(parquet_bytes(outcomes))
    outcomes.write_parquet(folder / "foreign.parquet")
    errors = {f"error_{a}_m": 0.01 for a in "xyz"} | {f"error_r{a}_rad": 0.1 for a in "xyz"}
    outcomes.with_columns(**{k: pl.lit(v) for k, v in errors.items()}).write_csv(
        folder / "error_outcomes.csv"
    )
    split = {
        "principal": ["epos"] * 2,
        "gripper": ["parallel"] * 2,
        "dataset": ["lmo"] * 2,
        "scene_id": [1, 2],
        "im_id": [3, 4],
        "obj_id": [5, 5],
        "split": ["train", "test"],
    }
    pl.DataFrame(split).write_csv(folder / "split.csv")
    _camera_poses(folder)
    _other_forms(folder, results)


def _other_forms(folder: Path, results: Results) -> None:
    """Poses and boxes as several estimators keep them."""
    from file_variants import boxes_by_image, boxes_of_coco
    from pose_files import megapose_entries, sam6d_entries

    text = (folder / "results.csv").read_text()
    (folder / "results.csv.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    rows = text.partition("\n")[2].replace(" ", ",")
    (folder / "results_17.csv").write_text(rows)
    (folder / "detection_pem.json").write_text(json.dumps(sam6d_entries(results)))
    entries = megapose_entries(results.select(np.array([0])), "mug")
    (folder / "object_data.json").write_text(json.dumps(entries))
    np.savetxt(folder / "000003.txt", results.cam_T_obj[0])
    moved = np.diag([-1.0, -1, 1, 1])
    moved[0, 3] = 12.5
    (folder / "transform.json").write_text(json.dumps({"unit": "mm", "5": moved.tolist()}))
    (folder / "boxes_by_image.json").write_text(json.dumps(boxes_by_image()))
    (folder / "boxes_coco.json").write_text(json.dumps(boxes_of_coco()))


def _bop(folder: Path) -> None:
    from poses import write_models

    write_models(
        folder / "models",
        obj_1={"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]},
        obj_2={"symmetries_discrete": [[-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]]},
    )
    shutil.copy(folder / "models" / "models_info.json", folder)
    scene = folder / "test" / "000001"
    scene.mkdir(parents=True)
    R, K = [1, 0, 0, 0, 1, 0, 0, 0, 1], [570.0, 0, 320, 0, 570, 240, 0, 0, 1]
    pose = {"obj_id": 1, "cam_R_m2c": R, "cam_t_m2c": [10.0, -20, 900]}
    seen = {"visib_fract": 0.9, "bbox_visib": [10, 20, 50, 60], "bbox_obj": [10, 20, 50, 60]}
    camera = {"cam_K": K, "depth_scale": 0.1}
    for name, entry in (("gt", [pose, pose]), ("gt_info", [seen, seen]), ("camera", camera)):
        content = json.dumps({"1": entry, "7": entry})
        (scene / f"scene_{name}.json").write_text(content)
    whole = {"fx": 570.0, "fy": 570, "cx": 320, "cy": 240, "width": 640, "height": 480}
    (folder / "camera.json").write_text(json.dumps({**whole, "depth_scale": 0.1}))
    targets = [{"scene_id": 1, "im_id": i, "obj_id": 1, "inst_count": 2} for i in (1, 7)]
    (folder / "targets.json").write_text(json.dumps(targets))
    boxes = [
        {
            "scene_id": 1,
            "image_id": i,
            "category_id": 1,
            "score": 0.5,
            "time": 0.1,
            "bbox": [10, 20, 50, 60.5],
        }
        for i in (1, 7)
    ]
    (folder / "detections.json").write_text(json.dumps(boxes))


def _models(folder: Path) -> None:
    import synthetic

    models = {"d": Models(folder / "models")}
    short = NetworkSettings(members=2, optimiser=MlpSettings(epochs=5))
    trained = {
        "threshold": train_forecaster(synthetic.tried(200), method="threshold", models=models),
        "networks": train_forecaster(synthetic.tried(60), method="MLP-O", settings=short),
        "forests": train_forecaster(
            synthetic.training_data(60), forests=ForestSettings(trees=2, folds=0), models=models
        ),
    }
    for name, forecaster in trained.items():
        forecaster.save(folder / f"{name}.npz")
    estimates = synthetic.estimates(4)
    verdicts = trained["threshold"].verdicts(estimates, models)
    rows = verdict_rows(estimates, verdicts, principal="a", gripper="parallel")
    write_verdicts(folder / "verdicts.csv", rows)
    write_stages(
        folder / "stages.csv",
        [InstanceLooks((row, row), 1 if row.verdict.look is None else 2) for row in rows],
    )
    n = np.array(["d-1", "d-2"])
    columns = (np.array([0.25, 0.5]), np.array([True, False]), n, n)
    Forecasts("unseen_scenes", "m", "a", "parallel", *columns).save(folder / "forecasts.npz", "x")


def _guarantees(folder: Path) -> None:
    from worlds import ASKED

    n = np.arange(80)
    found = certify(np.full(80, 0.95), n >= 0, n // 2, **ASKED)
    policy = LookPolicy("fused", True, 3, 3, "earlier", 12.0, 0.001, 0.0017, 0.02)
    found = replace(found, policy=policy)
    for name in ("certificate.json", "certificate_of_monitor.json"):
        replace(found, provenance={"model": "0", "ood_alpha": 0.01}).save(folder / name)
    certificate = folder / "certificate_of_monitor.json"
    guarantee = Certificate.load(certificate).overall
    state = MonitorState.open(folder / "monitor_state.json", certificate, guarantee)
    pl.read_csv(folder / "attempt_log.csv").head(2).write_csv(folder / "begun.csv")
    state.update(folder / "begun.csv", {"unit": "scene"})
    state.save()


def _campaign(folder: Path) -> None:
    store = Store(folder / "campaign")
    store.begin({"configuration": {"trials": 2, "seed": 0, "settings": {"speed": 0.25}}})
    row = dict.fromkeys(COLUMNS)
    frame = pl.DataFrame([row, row], schema=COLUMNS).with_columns(
        pl.col("scene_id").fill_null(1), im_id=pl.Series([1, 2], dtype=COLUMNS["im_id"])
    )
    store.append(frame)
    (shard,) = (folder / "campaign" / "shards").iterdir()
    shard.rename(shard.with_name("shard.parquet"))


def _simulation(folder: Path) -> None:
    from jaws import write_urdf_jaws

    text = (TESTS / "data" / "three_jaw.toml").read_text()
    (folder / "gripper.toml").write_text(text.replace("three_jaw.xml", "gripper.xml"))
    shutil.copy(TESTS / "data" / "three_jaw.xml", folder / "gripper.xml")
    write_urdf_jaws(folder)
    package = ROOT / "src" / "graspcast" / "simulation"
    catalogue = (package / "objects" / "objects.toml").read_text().split("\n\n")
    (folder / "catalogue.toml").write_text("\n\n".join(catalogue[1:3]) + "\n")
    grasps = (package / "grasps" / "grasps.toml").read_text().split("\n[[grasp]]")
    (folder / "grasps.toml").write_text("[[grasp]]".join(grasps[:3]) + "\n")


def _pictures(folder: Path) -> None:
    import trimesh
    from PIL import Image

    from file_variants import mixed_polygons

    box: Any = trimesh.creation.box((0.04, 0.06, 0.1))
    for name in ("own.ply", "own.obj", "own.stl"):
        box.export(folder / name)
    (folder / "own_text.stl").write_text(box.export(file_type="stl_ascii"))
    for name, options in (("model.ply", {"encoding": "ascii"}), ("model_binary.ply", {})):
        content = box.copy().apply_scale(1000).export(file_type="ply", **options)
        (folder / name).write_bytes(content)
    pixels = np.random.default_rng(0).integers(0, 255, (12, 16, 3), dtype=np.uint8)
    for kind in ("png", "jpg", "webp"):
        Image.fromarray(pixels).save(folder / f"image.{kind}")
    Image.fromarray(pixels[..., 0]).save(folder / "image.tif")
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(pixels).save(folder / "turned.jpg", exif=exif)
    (folder / "model_polygons.ply").write_bytes(mixed_polygons())
    weights = ROOT / "src" / "graspcast" / "perception" / "weights"
    shutil.copy(weights / "dense.onnx", folder / "network.onnx")


def _camera_poses(folder: Path) -> None:
    identity = " ".join(str(x) for x in np.eye(4).ravel())
    rows = "".join(f"1,{i},{identity}\n" for i in range(3))
    (folder / "camera_matrices.csv").write_text(f"scene_id,im_id,world_T_cam_m\n{rows}")
    names = ",".join(
        f"cam_T_world_{x}" for x in ("qw", "qx", "qy", "qz", "tx_mm", "ty_mm", "tz_mm")
    )
    rows = "".join(f"1,{i},1,0,0,0,{i},20,900\n" for i in range(3))
    (folder / "camera_quaternions.csv").write_text(f"scene_id,im_id,{names}\n{rows}")
    entry = {"cam_R_w2c": np.eye(3).ravel().tolist(), "cam_t_w2c": [1.0, 2.0, 900.0]}
    scene = folder / "camera_poses" / "000001"
    scene.mkdir(parents=True, exist_ok=True)
    (scene / "scene_camera.json").write_text(json.dumps({"0": entry, "1": entry}))


def _release_files(folder: Path) -> None:
    root = folder / "release"
    poses = root / "Pose-Estimates" / "EPOS" / "LMO" / "weights"
    poses.mkdir(parents=True)
    pose = np.eye(4)[None].copy()
    pose[0, 2, 3] = 0.9
    np.savez(poses / "pose_data_lmo-1-epos.npz", T_est=pose, T_gt=pose)
    (poses / "lmo-1-epos.txt").write_text(
        "#  comment\n000002\t3\t0\tTP\t0.5\t0.9\t1\t0.1\t1,2,3,4\t1,2,3,4\n"
        "000002\t8\t*\tFN\t0.25\t*\t*\t*\t1,2,3,4\t*\n"
        "000002\t9\t*\tFP\t*\t0.1\t*\t*\t*\t1,2,3,4\n"
    )
    trials = root / "Parallel-Gripper" / "EPOS" / "LMO" / "weights"
    trials.mkdir(parents=True)
    (trials / "lmo-1-epos-parallel-results.txt").write_text("1\t1\n")
