"""What the robot's protocol makes of contact on the approach, beside an arm that presses on.

    python benchmarks/approach_contact.py --data DIR --json contact.json

prints, and writes as JSON,

- ``deep``: success by both protocols of grasps that go 0 to 80 mm too deep, for a mug and a bracket
  made of primitives and for the YCB-V objects with reference grasps;
- ``perfect``: what the true pose leads to by the robot's protocol, for each reference grasp;
- ``published``: for a random sample of the published trials, how many labels differ between the
  protocols, and the agreement of each with the published outcomes;
- ``rule``: for a random sample of the published trials on *train* images, the agreement of the
  simulated with the published outcomes by limits of force and of distance.

Every trial is run once, with limits that are never reached: it then has the label of an arm without
limits, the largest lasting force and how far short the hand was, and so its label by any limits.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.io.markdown import table
from graspcast.paper.dataset import Published
from graspcast.paper.validation import published_trials
from graspcast.pose.transforms import exp, transform
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.jobs import load_setups
from graspcast.simulation.grasps.agreement import agreement
from graspcast.simulation.grasps.evaluation import held_under_jitter
from graspcast.simulation.grasps.observed_trials import ObservedTrials
from graspcast.simulation.grasps.table import read_grasps
from graspcast.simulation.grippers import GRIPPERS, load_gripper
from graspcast.simulation.objects.load import load_object
from graspcast.simulation.objects.types import Grasp, GraspObject, Primitive
from graspcast.simulation.trial.gripper_conformance import standing_column
from graspcast.simulation.trial.trial import Outcome, TrialRunner, TrialSettings

DEPTHS_MM = (0, 5, 10, 20, 40, 80)
ROBOT = TrialSettings()
UNLIMITED = replace(ROBOT, contact_force_n=None, short_m=None)
WATCHED = TrialSettings.robot(contact_force_n=1e6, short_m=2.0)
"""Limits that no trial reaches: the labels without limits, with what happened on the approach."""
FORCES_N = (10, 15, 20, 30, 40, 60, 80, 95)
SHORT_MM = (1, 2, 5, 10, 15, 20, 30)


def mug() -> GraspObject:
    """A mug of 80 mm and 300 g: sixteen boards in a ring, a bottom and a handle."""
    radius, height, wall = 0.038, 0.09, 0.003
    pieces = [Primitive("cylinder", (radius, wall), at(0, 0, wall - height / 2))]
    for angle in np.arange(16) * np.pi / 8:
        turned = at(radius * np.cos(angle), radius * np.sin(angle), 0.0)
        turned[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        pieces.append(Primitive("box", (wall / 2, 0.0078, height / 2), turned))
    pieces.append(Primitive("box", (0.004, 0.006, 0.025), at(radius + 0.02, 0, 0)))
    arm = (0.01, 0.006, 0.004)
    pieces += [Primitive("box", arm, at(radius + 0.01, 0, z)) for z in (-0.02, 0.02)]
    column = standing_column(2 * radius)
    return replace(column, name="mug", pieces=tuple(pieces), sim_T_ref=at(0, 0, height / 2))


def bracket() -> GraspObject:
    """An angle bracket of 250 g, 60 x 40 x 70 mm with legs 8 mm thick."""
    foot = Primitive("box", (0.03, 0.02, 0.004), at(0, 0, -0.031))
    leg = Primitive("box", (0.004, 0.02, 0.035), at(-0.026, 0, 0))
    column = standing_column(0.04, mass_kg=0.25)
    shape = {"pieces": (foot, leg), "centroid": np.array([-0.012, 0.0, -0.016])}
    return replace(column, name="bracket", sim_T_ref=at(0, 0, 0.035), **shape)


def at(x: float, y: float, z: float) -> np.ndarray:
    return transform(np.eye(3), np.array([x, y, z]))


def down(x: float, z: float) -> np.ndarray:
    """Return a grasp from above, closing along x."""
    return transform(np.diag([1.0, -1.0, -1.0]), np.array([x, 0.0, z]))


def cases(bop: Path) -> Iterator[tuple[TrialSettings, GraspObject, Grasp]]:
    """Yield an object and a grasp of it for each row of the table of deep grasps."""
    # On the mug's rim and across the whole mug; on the bracket's leg.
    poses = {
        ("mug", "parallel"): down(0.038, 0.025),
        ("mug", "underactuated"): down(0.0, 0.035),
        ("bracket", "parallel"): down(-0.026, 0.015),
        ("bracket", "underactuated"): down(-0.026, 0.0),
    }
    made = {"mug": mug(), "bracket": bracket()}
    for (name, gripper), pose in poses.items():
        yield WATCHED, made[name], Grasp(pose, name, gripper)
    for reference in read_grasps():
        grasp = reference.grasp
        if grasp.object.startswith("ycbv"):
            target = load_object(grasp.object, bop_dirs={"ycbv": bop / "ycbv"})
            yield WATCHED, reference.applied_to(target), grasp


def label(outcome: Outcome | dict[str, Any], force_n: float, short_m: float) -> bool:
    """Return success by given limits; ``outcome`` is of a trial by limits that are not reached."""
    get = outcome.get if isinstance(outcome, dict) else lambda k: getattr(outcome, k)
    stopped = get("force_n") > force_n or get("short_m") > short_m
    return bool(get("success")) and not stopped


def deep(bop: Path, count: int) -> list[dict[str, Any]]:
    """Return success rates by depth for both protocols, with a jitter of 1 mm and 1 degree."""
    rows = []
    scale = np.repeat([1e-3, np.deg2rad(1.0)], 3) / np.sqrt(3)
    for settings, target, grasp in cases(bop):
        runner = TrialRunner(target, load_gripper(grasp.gripper), settings)
        row: dict[str, Any] = {"object": target.name, "gripper": grasp.gripper, "n": count}
        for depth in DEPTHS_MM:
            rng = np.random.default_rng(depth)
            along = transform(np.eye(3), 1e-3 * depth * grasp.obj_T_grasp[:3, 2])
            errors = [along @ exp(t) for t in rng.standard_normal((count, 6)) * scale]
            outcomes = [runner.run(error, grasp) for error in errors]
            limits = ROBOT.contact_force_n, ROBOT.short_m
            row[f"unlimited {depth}"] = float(np.mean([o.success for o in outcomes]))
            row[f"robot {depth}"] = float(np.mean([label(o, *limits) for o in outcomes]))
            row[f"blocked {depth}"] = sum(o.reason == "blocked" for o in outcomes)
        rows.append(row)
    return rows


def perfect(bop: Path) -> list[dict[str, Any]]:
    """Return what each reference grasp leads to at the true pose by the robot's protocol."""
    rows = []
    for reference in read_grasps():
        grasp = reference.grasp
        name = grasp.object.split("-")[0]
        target = reference.applied_to(load_object(grasp.object, bop_dirs={name: bop / name}))
        gripper = load_gripper(grasp.gripper)
        watched = TrialRunner(target, gripper, WATCHED).run(np.eye(4), grasp)
        robot = TrialRunner(target, gripper).run(np.eye(4), grasp)
        assert robot.success == label(watched, ROBOT.contact_force_n, ROBOT.short_m)
        jittered = {
            f"{who} of 20": held_under_jitter(TrialRunner(target, gripper, settings), grasp)
            for who, settings in (("unlimited", UNLIMITED), ("robot", ROBOT))
        }
        rows.append(
            {
                "object": grasp.object,
                "gripper": grasp.gripper,
                "unlimited": watched.reason,
                **jittered,
            }
            | {"robot": robot.reason, "short_mm": 1e3 * robot.short_m, "hit": robot.hit}
            | {"force_n": watched.force_n}
        )
    return rows


def tried(trials: ObservedTrials, data: Published, rows: np.ndarray) -> pl.DataFrame:
    """Run some published trials; return them with the published outcome as ``given``."""
    requests = trials.requests.select(np.sort(rows))
    given = trials.success[np.sort(rows)]
    roots = {name: dataset.root for name, dataset in data.bop.items()}
    setups = load_setups(requests, read_grasps(), settings=WATCHED, bop_dirs=roots)
    with tempfile.TemporaryDirectory() as work:
        outcomes = run_campaign(requests, setups, Path(work) / "c", executor=LocalExecutor(1))
    keys = requests.keys.with_columns(given=pl.Series(given)).select(*TRIAL_COLUMNS, "given")
    return keys.join(outcomes, on=list(TRIAL_COLUMNS), how="inner")


def labels(outcomes: pl.DataFrame, force_n: float, short_m: float) -> np.ndarray:
    return np.array([label(row, force_n, short_m) for row in outcomes.iter_rows(named=True)])


def compared(outcomes: pl.DataFrame, found: np.ndarray) -> dict[str, float]:
    """Return agreement with the published outcomes, over trials and averaged over cells."""
    given = outcomes["given"].to_numpy()
    cells = outcomes.with_columns(same=pl.Series(found == given))
    by_cell = cells.group_by("object", "gripper").agg(pl.col("same").mean())["same"]
    whole = agreement(found, given)
    return {
        "agreement": whole.accuracy,
        "kappa": whole.kappa,
        "mean over cells": float(by_cell.mean()),
        "success": float(found.mean()),
        "published": float(given.mean()),
    }


def published(outcomes: pl.DataFrame) -> dict[str, Any]:
    out: dict[str, Any] = {"n": len(outcomes)}
    for gripper in (*GRIPPERS, "both"):
        mine = outcomes if gripper == "both" else outcomes.filter(pl.col("gripper") == gripper)
        unlimited, robot = (
            labels(mine, *limits)
            for limits in ((np.inf, np.inf), (ROBOT.contact_force_n, ROBOT.short_m))
        )
        out[gripper] = {
            "n": len(mine),
            "changed": int((unlimited != robot).sum()),
            "unlimited": compared(mine, unlimited),
            "robot": compared(mine, robot),
            "hit": dict(mine.filter(pl.Series(unlimited != robot))["hit"].value_counts().rows()),
        }
    return out


def rule(outcomes: pl.DataFrame) -> list[dict[str, Any]]:
    """Return the agreement by each pair of limits, the best first."""
    rows = []
    for force in (*FORCES_N, np.inf):
        for short in (*SHORT_MM, np.inf):
            found = compared(outcomes, labels(outcomes, force, 1e-3 * short))
            rows.append({"force_n": float(force), "short_mm": float(short), **found})
    return sorted(rows, key=lambda row: -row["agreement"])


def rendered(found: dict[str, Any]) -> str:
    """Render what there is as Markdown tables."""
    out = []
    if "deep" in found:
        head = ["object", "gripper", *(f"{depth} mm" for depth in DEPTHS_MM)]
        rows = []
        for row in found["deep"]:
            pairs = [[row[f"{who} {d}"] for who in ("unlimited", "robot")] for d in DEPTHS_MM]
            shares = [" / ".join(f"{x:.2f}" for x in pair) for pair in pairs]
            rows.append([row["object"], row["gripper"], *shares])
        count = len(found["deep"])
        means = [
            " / ".join(
                f"{sum(row[f'{who} {d}'] for row in found['deep']) / count:.2f}"
                for who in ("unlimited", "robot")
            )
            for d in DEPTHS_MM
        ]
        out.append(table(head, [*rows, ["mean", "", *means]], text_columns=2))
    if "perfect" in found:
        rows = [
            [r["object"], r["gripper"], r["unlimited"], r["robot"], f"{r['force_n']:.0f} N"]
            + [f"{r[f'{who} of 20']}/20" for who in ("unlimited", "robot")]
            for r in found["perfect"]
            if r["robot of 20"] < 20 or r["robot"] != "held"
        ]
        head = ["true pose not held", "gripper", "unlimited", "robot", "force"]
        head += ["jittered, unlimited", "robot"]
        out.append(table(head, rows, text_columns=4))
    if "published" in found:
        head = [
            "gripper",
            "n",
            "labels changed",
            "agreement, unlimited",
            "robot",
            "κ, unlimited",
            "robot",
        ]
        rows = []
        for name in (*GRIPPERS, "both"):
            part = found["published"][name]
            figures = [
                part[who][k] for k in ("agreement", "kappa") for who in ("unlimited", "robot")
            ]
            rows.append([name, part["n"], part["changed"], *(f"{x:.3f}" for x in figures)])
        out.append(table(head, rows))
    if "rule" in found:
        agreed = {(r["force_n"], r["short_mm"]): r["agreement"] for r in found["rule"]}
        for name, unit, limits in (("force", "N", FORCES_N), ("short", "mm", SHORT_MM)):
            # The other limit is out of reach; with both, the force decides nearly alone.
            of = {x: agreed[(x, np.inf) if name == "force" else (np.inf, x)] for x in limits}
            head = [f"fails with {name} above", *(f"{x} {unit}" for x in limits), "no rule"]
            values = [f"{x:.3f}" for x in (*of.values(), agreed[np.inf, np.inf])]
            out.append(table(head, [["agreement", *values]]))
    return "\n\n".join(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="holds published/ and bop/")
    parser.add_argument("--trials", type=int, default=2000, help="size of each sample")
    parser.add_argument("--jitters", type=int, default=8, help="trials of each deep grasp")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", default=["deep", "perfect", "published", "rule"])
    parser.add_argument("--json", type=Path, required=True)
    options = parser.parse_args()
    data = Published(options.data)
    bop = options.data / "bop"
    found: dict[str, Any] = {"limits": ROBOT.as_dict(), "seed": options.seed}

    def keep(name: str, value: Any) -> None:
        found[name] = value
        options.json.write_text(json.dumps(found, indent=1))
        print(f"{name}: {time.perf_counter() - started:.0f} s", flush=True)

    started = time.perf_counter()
    if "perfect" in options.only:
        keep("perfect", perfect(bop))
    if "deep" in options.only:
        keep("deep", deep(bop, options.jitters))
    trials, rng = published_trials(data), np.random.default_rng(options.seed)
    everything, train = np.arange(len(trials.success)), np.flatnonzero(trials.split == "train")
    samples = [rng.choice(rows, options.trials, replace=False) for rows in (everything, train)]
    for name, rows, summary in zip(("published", "rule"), samples, (published, rule), strict=True):
        if name in options.only:
            keep(name, summary(tried(trials, data, rows)))
    print(rendered(found))


if __name__ == "__main__":
    main()
