"""A crude estimator, as an object and as a command, for tests of what runs estimators."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections, read_detections
from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.perception.estimator import Poses
from graspcast.perception.run import run_external
from graspcast.pose.transforms import transform

SCRIPT = Path(__file__).parent / "foreign_estimator.py"


def command(python: Path, *words: object) -> str:
    out = [shlex.quote(str(python)), shlex.quote(str(SCRIPT)), "{bop} {detections} {out}"]
    return " ".join([*out, *(shlex.quote(str(word)) for word in words)])


def run(
    python: Path, dataset: BopDataset, boxes: Path, out: Path, *words: object, **options: Any
) -> Results:
    detections = read_detections(boxes, dataset)
    template = command(python, *words)
    return run_external(template, dataset, detections, out, **options)


def left_behind(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


class BoxEstimator:
    """Upright, where the box is, as far away as the diameter fills it; too small boxes: nothing."""

    name = "box"
    obj_ids: tuple[int, ...] = (1, 5)

    def __init__(self, models: Models):
        self.models = models
        self.calls: list[tuple[ndarray, ndarray, Detections]] = []

    def estimate(self, image: ndarray, K: ndarray, detections: Detections) -> Poses:
        self.calls.append((image, K, detections))
        time.sleep(0.01)
        side = detections.box_xywh[:, 2:].max(axis=1)
        diameter = np.array([self.models[i].diameter_m for i in detections.obj_id.tolist()])
        centre = detections.box_xywh[:, :2] + detections.box_xywh[:, 2:] / 2
        pixel = np.column_stack([centre, np.ones(len(centre))])
        ray = np.linalg.solve(K, pixel.T).T
        found = side >= 5
        depth = np.where(found, diameter * K[0, 0] / side, 0.0)
        eye = np.broadcast_to(np.eye(3), (len(side), 3, 3))
        return Poses(transform(eye, ray * depth[:, None]), np.where(found, 0.5, 0.0))


def make_python(folder: Path) -> Path:
    """Make the Python of another virtual environment, which has no package at all."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def verb(dataset: BopDataset, boxes: Path, out: Path, estimator: str, *more: str) -> list[str]:
    paths = ["--bop", str(dataset.root), "--detections", str(boxes), "--out", str(out)]
    return ["estimate", *paths, "--estimator", estimator, *more]
