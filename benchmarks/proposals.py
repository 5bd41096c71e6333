"""Proposed against reference grasps, under the errors of the published estimators.

    python benchmarks/proposals.py --data DIR --work DIR [--gripper NAME] [--errors 60]

For each published object and gripper, grasps are chosen under the errors of all estimators on the
train and validation images, and the best one and the reference grasp are tried with the same errors
on test images (contiguous blocks of frames, ``estimates/image_split.py``). The reference grasps
were not fitted on those either. Poses that differ by a symmetry of the object are the same.

Each pair is stored in ``--work``, as figures and as grasps, and is not computed again. The table is
printed, and written to ``--work/proposals.md``.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from graspcast.bop.results import read_results
from graspcast.estimates.image_split import frames_of, split_of
from graspcast.io import markdown
from graspcast.io.files import write_text
from graspcast.paper.dataset import DATASETS, ESTIMATORS, GRIPPERS, Published
from graspcast.pose.metrics import nearest_symmetric
from graspcast.pose.transforms import project_to_rotation, transform
from graspcast.simulation.campaign.from_estimates import trials_from_estimates
from graspcast.simulation.grasps.proposing import propose_grasps
from graspcast.simulation.grasps.ranking import success_interval
from graspcast.simulation.grasps.table import ReferenceGrasp, read_grasps, write_grasps
from graspcast.simulation.grasps.trial_pool import TrialPool
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.load import load_object
from graspcast.simulation.trial.settings import TrialSettings

TOLD = "the three estimators' errors on the train and validation images"


class Errors:
    """Errors of the published estimators, by object and split."""

    def __init__(self, data: Published):
        self.data = data
        results = {
            name: {e: read_results(data.results_path(e, name)) for e in ESTIMATORS}
            for name in DATASETS
        }
        self.trials = trials_from_estimates(results, data.bop, ["parallel"])
        keys = self.trials.keys
        frames = frames_of({name: dataset.ground_truth for name, dataset in data.bop.items()})
        columns = (keys[name].to_numpy() for name in ("dataset", "scene_id", "im_id"))
        self.split = split_of(*columns, frames)

    def symmetries(self, name: str) -> ndarray:
        dataset, _, number = name.rpartition("-")
        return self.data.bop[dataset].models[int(number)].symmetries

    def of(self, name: str, *, test: bool) -> ndarray:
        rows = np.flatnonzero(
            (self.trials.keys["object"].to_numpy() == name) & ((self.split == "test") == test)
        )
        near = nearest_symmetric(self.trials.obj_T_est[rows], self.symmetries(name))
        # The rotations in a file of symmetries are rounded.
        return transform(project_to_rotation(near[:, :3, :3]), near[:, :3, 3])


def one_pair(name: str, gripper: str, errors: Errors, work: Path, most: int) -> dict[str, Any]:
    """Propose grasps of a pair and try the best and the reference grasp; stored figures count."""
    stored = work / f"{name}-{gripper}.json"
    if stored.exists():
        return json.loads(stored.read_text(encoding="utf-8"))
    hand = load_gripper(gripper)
    reference = read_grasps()(name, gripper)
    bop_dirs = {dataset: found.root for dataset, found in errors.data.bop.items()}
    target = reference.applied_to(load_object(name, bop_dirs=bop_dirs))
    wall, cpu = time.perf_counter(), time.process_time()
    found = propose_grasps(
        target,
        hand,
        errors.of(name, test=False),
        symmetries=errors.symmetries(name),
        known=[reference.grasp],
    )
    figures: dict[str, Any] = {
        "wall_s": time.perf_counter() - wall,
        "cpu_s": time.process_time() - cpu,
        "kept": len(found.grasps),
        "trials": found.trials,
        "reasons": dict(found.reasons),
    }
    entries = found.as_references(TOLD, mass_kg=reference.mass_kg, friction=reference.friction)
    entries = [_own(reference, e) if e.grasp.name == "reference" else e for e in entries]
    write_grasps(work / f"{name}-{gripper}.toml", entries)
    best = next(k for k, grasp in enumerate(found.grasps) if grasp.name != "reference")
    figures["chosen_at"] = found.ranked[best].rate
    unseen = errors.of(name, test=True)
    unseen = unseen[np.random.default_rng(0).permutation(len(unseen))[:most]]
    figures["n"] = len(unseen)
    pool = TrialPool(target, hand, TrialSettings.robot(hand))
    for which, grasp in (("reference", reference.grasp), ("best", found.grasps[best])):
        outcomes = pool.run([(error, grasp.obj_T_grasp) for error in unseen])
        figures[f"{which}_robot"] = [outcome.success for outcome in outcomes]
    write_text(stored, json.dumps(figures))
    return figures


def _own(reference: ReferenceGrasp, tried: ReferenceGrasp) -> ReferenceGrasp:
    """Return the reference grasp with its own provenance and the figures of the trials."""
    return ReferenceGrasp(
        reference.grasp,
        reference.provenance,
        reference.mass_kg,
        reference.friction,
        tried.agreement,
    )


def table(found: dict[tuple[str, str], dict[str, Any]]) -> str:
    """Return the table, with means over the pairs of each gripper."""
    rows = []
    for gripper in dict.fromkeys(gripper for _, gripper in found):
        mine = {name: figures for (name, g), figures in found.items() if g == gripper}
        rows += [_row(name, gripper, figures) for name, figures in mine.items()]
        means = [
            f"{np.mean([np.mean(figures[key]) for figures in mine.values()]):.3f}"
            for key in ("reference_robot", "best_robot", "chosen_at")
        ]
        seconds = np.mean([figures["cpu_s"] for figures in mine.values()])
        rows.append([f"mean of {len(mine)}", gripper, *means, "", "", f"{seconds:.0f}"])
    head = ["object", "gripper", "reference", "best proposed", "when chosen"]
    head += ["errors", "kept", "CPU s"]
    return markdown.table(head, rows)


def _row(name: str, gripper: str, figures: dict[str, Any]) -> list[str]:
    def with_interval(key: str) -> str:
        low, high = success_interval(sum(figures[key]), len(figures[key]))
        return f"{np.mean(figures[key]):.2f} [{low:.2f}, {high:.2f}]"

    return [
        name,
        gripper,
        with_interval("reference_robot"),
        with_interval("best_robot"),
        f"{figures['chosen_at']:.2f}",
        str(figures["n"]),
        str(figures["kept"]),
        f"{figures['cpu_s']:.0f}",
    ]


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--gripper", action="append", choices=GRIPPERS)
    parser.add_argument("--errors", type=int, default=60)
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    errors = Errors(Published(options.data))
    found = {}
    for gripper in options.gripper or GRIPPERS:
        for reference in read_grasps():
            grasp = reference.grasp
            if grasp.gripper != gripper:
                continue
            found[grasp.object, gripper] = figures = one_pair(
                grasp.object, gripper, errors, options.work, options.errors
            )
            line = _row(grasp.object, gripper, figures)
            print(*line, sep="  ", flush=True)
            write_text(options.work / "proposals.md", table(found))
    print(table(found))


if __name__ == "__main__":
    main()
