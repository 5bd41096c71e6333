"""Which properties of the hands, shared by all objects, explain the published outcomes?

    python benchmarks/shared_hand_properties.py --data DIR --json properties.json

Every candidate is a hand and a rule, the same for all objects. For each object the reference grasp
is searched anew around the candidate, on *all train images*, by a geometric model of a trial, which
succeeds if the open hand, at the pose to which it is to go, is nowhere deeper in the resting object
than a tolerance, and if there is something to grasp:

- *parallel*: between the pads, where the outermost points on both sides have normals within the
  friction cone;
- *underactuated*: in a column between thumb and fingers, within their reach (one of 28 columns and
  reaches, searched for each object).

The model needs no physics, so a candidate takes a minute. The grasp that agrees best on the train
images is also scored on the *validation* images; test images are not used. The table has means over
- *underactuated*: in a column between thumb and fingers, within their reach (one of 28 columns and
agreement and kappa on the train images.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np

from graspcast.io.markdown import table
from graspcast.paper.dataset import Published
from graspcast.paper.validation import published_trials
from graspcast.pose.transforms import compose, invert, transform
from graspcast.simulation.grasps.agreement import Agreement, agreement
from graspcast.simulation.grasps.observed_trials import ObservedTrials
from graspcast.simulation.grasps.proposals import propose, vary
from graspcast.simulation.grasps.sampling import LabelledTrials
from graspcast.simulation.grasps.table import read_grasps
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.load import load_object
from graspcast.simulation.objects.types import GraspObject
from graspcast.simulation.trial.scene import HAND
from graspcast.simulation.trial.trial import TrialRunner, TrialSettings

ROUNDS = ((0.010, 0.20), (0.006, 0.12), (0.003, 0.06), (0.0015, 0.03))
"""Standard deviations of position (m) and rotation (rad) in each round of variations."""
REACHES_M = (-0.045, -0.03, -0.02, -0.01, 0.0, 0.01, 0.02)
COLUMNS_M = ((0.02, 0.012), (0.02, 0.03), (0.05, 0.012), (0.05, 0.03))


@dataclass(frozen=True)
class Candidate:
    """A hand and a rule; lengths in metres, in the frame of the tool centre point.

    The parallel hand: ``opening_m`` between the pads, the palm ``palm_m`` behind the TCP, the pads'
    half width ``pad_m``, ``hull`` for fingers that are the convex hulls of their meshes (flat from
    palm to tip), ``friction`` of the cone. Both hands: ``tolerance_m``.
    """

    gripper: str
    tolerance_m: float = 0.002
    opening_m: float = 0.08
    palm_m: float = 0.0374
    pad_m: float = 0.0085
    friction: float = 0.8
    hull: bool = False


FRANKA, TENDON = Candidate("parallel"), Candidate("underactuated")
CANDIDATES: dict[str, Candidate] = {
    "parallel: Franka Hand, 2 mm": FRANKA,
    **{f"tolerance {mm} mm": replace(FRANKA, tolerance_m=1e-3 * mm) for mm in (0, 1, 3, 4, 8)},
    **{f"opening {mm} mm": replace(FRANKA, opening_m=1e-3 * mm) for mm in (74, 85)},
    **{f"palm {mm} mm behind the TCP": replace(FRANKA, palm_m=1e-3 * mm) for mm in (24, 50)},
    **{f"friction {mu}": replace(FRANKA, friction=mu) for mu in (0.4, 2.0)},
    "pads 28 mm wide": replace(FRANKA, pad_m=0.014),
    "fingers as convex hulls": replace(FRANKA, hull=True),
    "no rule": replace(FRANKA, tolerance_m=1.0),
    "underactuated: 2 mm": TENDON,
    **{f"underactuated: {mm} mm": replace(TENDON, tolerance_m=1e-3 * mm) for mm in (1, 3, 4, 8)},
    "underactuated: no rule": replace(TENDON, tolerance_m=1.0),
}


@dataclass(frozen=True)
class Shape:
    """Open hand in the TCP's frame: boxes (centre, half sizes) and capsules (ends, radius)."""

    boxes: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    capsules: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))

    @property
    def reach_m(self) -> float:
        """Distance from the hand's middle plane beyond which no part of it is."""
        sides = np.abs(self.capsules[:, [1, 4]]).max(axis=1) + self.capsules[:, 6]
        return float(max([*(np.abs(self.boxes[:, 1]) + self.boxes[:, 4]), *sides]))


def franka(candidate: Candidate) -> Shape:
    """Return the boxes of the open Franka Hand; dimensions of ``FrankaHand`` and the menagerie."""
    palm, tip, half = candidate.palm_m, 0.0085, candidate.opening_m / 2
    boxes = [(0.0, 0.0, -palm - 0.045, 0.1025, 0.0315, 0.045)]
    parts = [(0.0, 0.0095, -0.009, tip, candidate.pad_m), (0.0095, 0.0235, -palm, -0.009, 0.010)]
    if candidate.hull:
        edges = np.linspace(-palm, tip, 6)
        along = (edges[1:] + edges[:-1] - 2 * edges[0]) / (2 * (edges[-1] - edges[0]))
        parts = [
            (0.0025 * (1 - a), 0.0263 - 0.0111 * a, low, high, 0.0104 - 0.0017 * a)
            for a, low, high in zip(along, edges[:-1], edges[1:], strict=True)
        ]
    for near, far, low, high, wide in parts:
        # Parts of one finger: the tolerance must not open a gap between them.
        start, stop = low - candidate.tolerance_m, min(tip, high + candidate.tolerance_m)
        for side in (-1.0, 1.0):
            middle = side * (half + (near + far) / 2), 0.0, (start + stop) / 2
            boxes.append((*middle, (far - near) / 2, wide, (stop - start) / 2))
    return Shape(boxes=np.array(boxes))


def tendon_hand(target: GraspObject) -> Shape:
    """Return the boxes and capsules of the open tendon hand, from its model."""
    hand = load_gripper("underactuated")
    scene = TrialRunner(target, hand, TrialSettings.paper()).scene
    scene.park()
    model, data = scene.model, scene.data
    base = transform(data.xmat[scene.base_body].reshape(3, 3), data.xpos[scene.base_body])
    boxes, capsules = [], []
    for geom in np.flatnonzero(scene.kind == HAND):
        placed = transform(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
        pose, size = invert(compose(base, hand.base_T_tcp)) @ placed, model.geom_size[geom]
        along = pose[:3, 2] * size[1]
        if len(boxes) == 0:
            boxes.append(np.concatenate([pose[:3, 3], size]))
        else:
            capsules.append(np.concatenate([pose[:3, 3] - along, pose[:3, 3] + along, size[:1]]))
    return Shape(np.array(boxes), np.array(capsules))


@numba.njit(cache=True, fastmath=True)
def deep(x: float, y: float, z: float, boxes: Any, capsules: Any, tolerance: float) -> bool:
    """Return whether a point is deeper in the hand than the tolerance."""
    for i in range(boxes.shape[0]):
        if (
            abs(y - boxes[i, 1]) < boxes[i, 4] - tolerance
            and abs(x - boxes[i, 0]) < boxes[i, 3] - tolerance
            and abs(z - boxes[i, 2]) < boxes[i, 5] - tolerance
        ):
            return True
    for i in range(capsules.shape[0]):
        px, py, pz = x - capsules[i, 0], y - capsules[i, 1], z - capsules[i, 2]
        ax = capsules[i, 3] - capsules[i, 0]
        ay = capsules[i, 4] - capsules[i, 1]
        az = capsules[i, 5] - capsules[i, 2]
        u = min(1.0, max(0.0, (px * ax + py * ay + pz * az) / (ax * ax + ay * ay + az * az)))
        gap = (px - u * ax) ** 2 + (py - u * ay) ** 2 + (pz - u * az) ** 2
        radius = capsules[i, 6] - tolerance
        if radius > 0 and gap < radius**2:
            return True
    return False


@numba.njit(cache=True, fastmath=True)
def seen(
    points: Any, normals: Any, rotations: Any, shifts: Any, boxes: Any, capsules: Any,
    reach: float, tolerance: float, half: float, wide: float, out: Any,
) -> None:  # fmt: skip
    """For each estimate, write what lies in the open hand at its goal; -1 in column 0 if blocked.

    Columns: 1 between the pads, the outermost points' cosines with the closing direction (2, 3);
    for a hand without pads (``wide`` 0), the nearest point to the palm in each of the four columns
    between the digits (4 to 7). ``reach`` is that of the hand from its middle plane.
    """
    for i in range(len(rotations)):
        r, t = rotations[i], shifts[i]
        out[i, :4], out[i, 4:] = 0.0, 1e9
        right, left = -1e9, 1e9
        for k in range(len(points)):
            p, q, s = points[k, 0], points[k, 1], points[k, 2]
            x = r[0, 0] * p + r[0, 1] * q + r[0, 2] * s + t[0]
            y = r[1, 0] * p + r[1, 1] * q + r[1, 2] * s + t[1]
            z = r[2, 0] * p + r[2, 1] * q + r[2, 2] * s + t[2]
            if abs(y) < reach and deep(x, y, z, boxes, capsules, tolerance):
                out[i, 0] = -1.0
                break
            if wide > 0.0 and abs(z) < 0.0085 and abs(y) < wide and abs(x) < half + 0.002:
                n = r[0, 0] * normals[k, 0] + r[0, 1] * normals[k, 1] + r[0, 2] * normals[k, 2]
                if x > right:
                    right, out[i, 2] = x, n
                if x < left:
                    left, out[i, 3] = x, -n
            for c in range(0 if wide > 0.0 else 4):
                within = abs(x) < (0.02 if c < 2 else 0.05)
                if within and abs(y) < (0.012 if c % 2 == 0 else 0.03):
                    out[i, 4 + c] = min(out[i, 4 + c], z)
        out[i, 1] = 1.0 if right > left + 5e-4 else 0.0


class Model:
    """Geometric model of the trials of one object by a candidate."""

    def __init__(self, target: GraspObject, candidate: Candidate, shape: Shape, count: int):
        self.candidate, self.shape = candidate, shape
        corners = target.vertices[target.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area, rng = np.linalg.norm(across, axis=1), np.random.default_rng(0)
        faces = rng.choice(len(area), size=count, p=area / area.sum())
        u, v = np.sqrt(rng.random(count)), rng.random(count)
        weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
        self.points = np.einsum("pk,pkj->pj", weights, corners[faces])
        outward = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()
        self.normals = np.sign(outward) * across[faces] / area[faces, None]

    def predict(
        self, obj_T_grasp: np.ndarray, trials: LabelledTrials, reach: tuple[int, float] | None
    ) -> tuple[np.ndarray, tuple[int, float] | None, Agreement]:
        """Return success, the reach (the best one if None is given), and the agreement."""
        to_grasp = invert(obj_T_grasp) @ invert(trials.obj_T_est)
        out, c = np.zeros((len(trials), 8)), self.candidate
        seen(
            self.points, self.normals, np.ascontiguousarray(to_grasp[:, :3, :3]),
            np.ascontiguousarray(to_grasp[:, :3, 3]), self.shape.boxes, self.shape.capsules,
            self.shape.reach_m, c.tolerance_m, c.opening_m / 2,
            c.pad_m if c.gripper == "parallel" else 0.0, out,
        )  # fmt: skip
        free = out[:, 0] >= 0
        if c.gripper == "parallel":
            cone = 1.0 / np.sqrt(1.0 + c.friction**2)
            found = free & (out[:, 1] > 0) & (out[:, 2:4].min(axis=1) > cone)
            return found, None, agreement(found, trials.success)
        choices = [(k, z) for k in range(len(COLUMNS_M)) for z in REACHES_M]
        tried = []
        for column, z in choices if reach is None else [reach]:
            found = free & (out[:, 4 + column] < z)
            tried.append((found, (column, z), agreement(found, trials.success)))
        return max(tried, key=lambda item: objective(item[2]))


def objective(found: Agreement) -> float:
    """Return the mean of agreement and kappa; agreement if all outcomes are the same."""
    one_sided = found.majority > 1 - 1e-9
    return found.accuracy if one_sided else 0.5 * (found.accuracy + found.kappa)


def search(
    model: Model, target: GraspObject, trials: LabelledTrials, start: np.ndarray, effort: int
) -> tuple[np.ndarray, int]:
    """Return the grasp that agrees best, and the number of grasps tried."""
    rng = np.random.default_rng(1)
    reach = model.candidate.palm_m if model.candidate.gripper == "parallel" else 0.075
    opening = model.candidate.opening_m if model.candidate.gripper == "parallel" else 0.12
    hand: Any = SimpleNamespace(reach_m=max(0.012, reach), opening_m=opening)
    score: Callable[[np.ndarray], float] = lambda g: objective(model.predict(g, trials, None)[2])  # noqa: E731
    grasps = [start, *propose(target, hand, 25 * effort, rng, model.points)]
    pool = sorted(((score(g), i, g) for i, g in enumerate(grasps)), key=lambda item: -item[0])
    count, keep = len(grasps), effort
    for shift_m, turn_rad in ROUNDS:
        pool = pool[:keep]
        for _, _, parent in list(pool):
            for _ in range(effort):
                varied = vary(parent, shift_m, turn_rad, rng)
                pool.append((score(varied), count, varied))
                count += 1
        pool.sort(key=lambda item: -item[0])
        keep = max(5, 2 * keep // 3)
    return pool[0][2], count


def results(
    trials: ObservedTrials, targets: Mapping[str, GraspObject], effort: int
) -> Iterator[dict[str, Any]]:
    """Yield the figures of each candidate."""
    grasps = read_grasps()
    for name, candidate in CANDIDATES.items():
        row: dict[str, Any] = {"candidate": name, "cells": {}}
        for pair in [key[:2] for key in trials.requests.setups() if key[1] == candidate.gripper]:
            target = targets[pair[0]]
            parallel = candidate.gripper == "parallel"
            shape = franka(candidate) if parallel else tendon_hand(target)
            model = Model(target, candidate, shape, 800 if parallel else 400)
            train, validation = (trials.of(*pair, split) for split in ("train", "validation"))
            start = grasps(*pair).grasp.obj_T_grasp
            best, count = search(model, target, train, start, effort)
            _, reach, fitted = model.predict(best, train, None)
            _, _, other = model.predict(best, validation, reach)
            row["cells"][pair[0]] = {
                "objective": objective(fitted),
                "train": fitted.accuracy,
                "validation": other.accuracy,
                "validation_kappa": other.kappa,
                "tried": count,
            }
        for key in ("objective", "train", "validation", "validation_kappa", "tried"):
            row[key] = float(np.mean([cell[key] for cell in row["cells"].values()]))
        yield row


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--effort", type=int, default=14, help="size of the searches")
    options = parser.parse_args()
    data = Published(options.data)
    trials = published_trials(data)
    roots = {name: dataset.root for name, dataset in data.bop.items()}
    names = sorted({name for name, *_ in trials.requests.setups()})
    targets = {name: load_object(name, bop_dirs=roots) for name in names}
    found = []
    for row in results(trials, targets, options.effort):
        found.append(row)
        options.json.write_text(json.dumps(found, indent=1))
        print(row["candidate"], f"{row['objective']:.4f}", f"{row['validation']:.4f}", flush=True)
    keys = ("objective", "train", "validation", "validation_kappa")
    rows = [[r["candidate"], *(f"{r[k]:.3f}" for k in keys), f"{r['tried']:.0f}"] for r in found]
    print(table(["candidate", *(k.replace("_", " ") for k in keys), "grasps tried"], rows))


if __name__ == "__main__":
    main()
