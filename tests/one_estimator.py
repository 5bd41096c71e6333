"""A dataset with images, and one estimator whose grasps succeed where an object is seen well."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy import ndarray

from bop_images import FOCAL, SIZE, write_image
from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results, write_results
from graspcast.cli import main
from graspcast.estimates.alignment import align
from graspcast.forecasting.training_data import TrainingData
from poses import nudged, random_poses, write_models

SCENES, IMAGES = 6, 8


@dataclass
class Seen:
    """Estimates of objects 1 and 2 in every image by ``a``, and what became of its grasps."""

    results: Results
    success: ndarray

    @property
    def data(self) -> TrainingData:
        """Training data without image fit."""
        estimates = align({"a": self.results}, dataset="d")
        place = {key: i for i, key in enumerate(keys_of(self.results))}
        order = [place[key[1:4]] for key in estimates.instances.to_keys()]
        truth = np.full((len(estimates), 4, 4), np.nan)
        return TrainingData(estimates, "a", "p", truth, self.success[order][None])


def keys_of(results: Results) -> list[tuple[int, int, int]]:
    columns = (results.scene_id, results.im_id, results.obj_id)
    return list(zip(*(column.tolist() for column in columns), strict=True))


def seen(seed: int = 0) -> Seen:
    """Success follows how well an object is seen, and so does the score, with noise."""
    rng = np.random.default_rng(seed)
    n = SCENES * IMAGES * 2
    visible = rng.uniform(size=n)
    place = np.arange(n)
    results = Results(
        scene_id=1 + place // (2 * IMAGES),
        im_id=place // 2 % IMAGES,
        obj_id=1 + place % 2,
        score=np.clip(visible + rng.normal(0, 0.1, n), 0, 1),
        cam_T_obj=random_poses(n, seed, depth_m=0.8),
        time_s=np.full(n, -1.0),
        line=place + 2,
    )
    return Seen(results, (visible > rng.uniform(0.35, 0.65, n)).astype(float))


def write_world(root: Path) -> Seen:
    """Write ``d`` with images but those of scene 6, a black one, estimates by a and b, outcomes."""
    write_models(root / "d" / "models", obj_1={}, obj_2={})
    camera = {"fx": FOCAL, "fy": FOCAL, "cx": SIZE[0] / 2, "cy": SIZE[1] / 2}
    camera |= {"width": SIZE[0], "height": SIZE[1], "depth_scale": 1.0}
    (root / "d" / "camera.json").write_text(json.dumps(camera))
    given = seen()
    for scene in range(1, SCENES):
        for image in range(IMAGES):
            path = root / "d" / "test" / f"{scene:06d}" / "rgb" / f"{image:06d}.png"
            write_image(path, seed=100 * scene + image)
    from PIL import Image

    Image.new("RGB", SIZE).save(root / "d" / "test" / "000005" / "rgb" / "000000.png")
    write_results(root / "a_d-test.csv", given.results)
    b = replace(given.results, cam_T_obj=nudged(given.results.cam_T_obj, 1))
    # What b does not find in the last image of each scene, a finds alone.
    write_results(root / "b_d-test.csv", b.select(b.im_id < IMAGES - 1))
    lines = ["estimator,dataset,scene_id,im_id,obj_id,gripper,success"]
    for (scene, image, number), held in zip(keys_of(given.results), given.success, strict=True):
        lines.append(f"a,d,{scene},{image},{number},p,{int(held)}")
    (root / "outcomes.csv").write_text("\n".join(lines))
    return given


def inputs(root: Path, *names: str) -> list[str]:
    out = ["--bop", str(root / "d")]
    for name in names or ("a",):
        out += ["--estimates", f"{name}={root / f'{name}_d-test.csv'}"]
    return out


def train_command(root: Path, out: Path, *more: str, names: tuple[str, ...] = ("a",)) -> list[str]:
    out_of = ["--outcomes", str(root / "outcomes.csv"), "--trees", "6", "--out", str(out)]
    who = ["--principal", "a", "--gripper", "p"]
    return ["train", *inputs(root, *names), *who, *out_of, *more]


def predict(
    root: Path, models: tuple[Path, ...], out: Path, *more: str, names: tuple[str, ...] = ("a",)
) -> list[dict[str, str]]:
    """Run the verb, and read the verdicts."""
    given = [part for model in models for part in ("--model", str(model))]
    assert main(["predict", *inputs(root, *names), *given, "--out", str(out), *more]) == 0
    with out.open() as stream:
        return list(csv.DictReader(stream))


def dataset(root: Path) -> BopDataset:
    return BopDataset(root / "d")
