"""What guiding a grasp by a fused pose is worth, by simulated trials of the same instances.

    python benchmarks/guides.py --estimates zebrapose=zebrapose_ycbv-test.csv ... --bop ycbv \
        --ground-truth ycbv/ground_truth --camera-poses ycbv/camera_motion --work work \
        --json guides.json --markdown guides.md

Guides are each estimator's pose from one image, and poses fused from several views. Each is tried
by each gripper, as ``graspcast simulate`` does, in a campaign of its own in ``--work``; the same
command resumes. All guides are compared on the same instances: those of the principal that have
another view, and a pose by every guide. Intervals are by a bootstrap over scenes (of a dataset's
only scene: five blocks of frames); differences to the principal's pose from one image are paired.
The last row is the true pose, tried once for each object and gripper: what a better pose can reach.
Several datasets are also taken together; then one ``--camera-poses`` each, in the order of
``--bop``. Ground truth serves the trials alone. Noise of the camera motion is drawn at random from
a seed, added to the camera poses, and stated to the fusion.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import polars as pl

from fusion import noisy
from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.estimates.alignment import estimate_ids
from graspcast.estimates.instances import Instances, scene_groups
from graspcast.estimates.loading import load_inputs
from graspcast.estimates.matching import match
from graspcast.evaluation.bootstrap import Bootstrap, Interval
from graspcast.evaluation.paired_differences import ScoreDraws, bootstrap_scores, improvements
from graspcast.evaluation.predictions import Forecasts
from graspcast.io.files import write_text
from graspcast.io.json import write_json
from graspcast.io.markdown import table
from graspcast.paper.published_split import read_split
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.from_estimates import trials_from_estimates
from graspcast.simulation.campaign.jobs import available_trials, load_setups
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.table import read_grasps
from graspcast.simulation.grippers import GRIPPERS
from graspcast.simulation.trial.settings import TrialSettings
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.camera_tables import read_camera_motion
from graspcast.views.choice import ViewsFrom
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
from graspcast.views.spread import DEFAULT_SPREAD, Spread, Spreads

PAPER = TrialSettings.paper()
TRUE_POSE = "true pose"
_KEY = ["scene_id", "im_id", "obj_id", "est_id"]
_INSTANCE = ["dataset", "gripper", "gt_row"]
_TRIED = ["dataset", "gripper", "scene_id", "im_id", "obj_id"]


@dataclass(frozen=True)
class Scenario:
    """The estimates of one dataset, and where the camera was."""

    name: str
    dataset: BopDataset
    results: Mapping[str, Results]
    motion: CameraMotion
    principal: str
    spread: Spread = DEFAULT_SPREAD

    def fused(
        self,
        views: int,
        *,
        alone: str | None = None,
        mm: float = 0.0,
        seed: int = 0,
        views_from: ViewsFrom = "all",
    ) -> FusedEstimates:
        """Fuse all estimators, or one, with noise of ``mm`` and 0.1° per mm."""
        noise = CameraNoise(mm / 1e3, np.deg2rad(0.1 * mm))
        return fuse_estimates(
            self.results if alone is None else {alone: self.results[alone]},
            noisy(self.motion, noise, seed) if mm else self.motion,
            dataset=self.name,
            principal=alone or self.principal,
            models={self.name: self.dataset.models},
            views_from=views_from,
            max_views=views,
            noise=noise,
            spreads=Spreads(default=self.spread),
        )

    def with_views(self) -> Results:
        """Return the principal's instances that another image shows from another side."""
        fused = self.fused(2)
        several = np.flatnonzero(fused.gathered.present.any(axis=2).sum(axis=1) > 1)
        keys = pl.DataFrame({name: getattr(fused.instances, name) for name in _KEY})
        results = self.results[self.principal]
        rows = keys_of(results).with_row_index("row").join(keys[several], on=_KEY)["row"]
        return results.select(rows.sort().to_numpy().astype(np.int64))


Guide = Callable[[Scenario], Results]


def guides(options: argparse.Namespace, estimators: Sequence[str]) -> dict[str, Guide]:
    """Return the guides by what the tables call them; the first is the one to compare with."""
    first = options.principal or estimators[0]
    everyone = "all" if len(estimators) > 1 else first

    def fused(views: int, **given: Any) -> Guide:
        return lambda scenario: scenario.fused(views, **given).results

    def single(name: str) -> Guide:
        return lambda scenario: scenario.results[name]

    ordered = [first, *(name for name in estimators if name != first)]
    out = {f"{first}, one view": single(first)}
    most = options.noise_views
    for views in sorted(options.views, key=lambda v: v != most):
        title = "one view" if views == 1 else f"{views} views"
        if views > 1 or everyone == "all":
            out[f"{everyone}, {title}"] = fused(views)
    if everyone == "all":
        for name in options.alone or [first]:
            out[f"{name} alone, {most} views"] = fused(most, alone=name)
    for mm in options.noise_mm:
        what = f"{everyone}, {most} views, motion known to {mm:g} mm, {0.1 * mm:.1f}°"
        out[what] = fused(most, mm=mm, seed=options.seed)
    out[f"{everyone}, {most} views, earlier images"] = fused(most, views_from="earlier")
    out |= {f"{name}, one view": single(name) for name in ordered[1:]}
    return out


def keys_of(results: Results) -> pl.DataFrame:
    numbers = {name: getattr(results, name) for name in _KEY[:-1]}
    return pl.DataFrame({**numbers, "est_id": estimate_ids(results)})


class Trials:
    """The trials of one scenario and guide, simulated gripper by gripper, test images first."""

    def __init__(self, scenario: Scenario, guide: str, results: Results, test: pl.DataFrame | None):
        self.scenario, self.guide = scenario, guide
        self.roots = {scenario.name: scenario.dataset.root}
        self.grasps, notes, name = read_grasps(protocol="paper"), list[str](), slug(guide)
        requests = trials_from_estimates(
            {scenario.name: {name: results}},
            {scenario.name: scenario.dataset},
            list(GRIPPERS),
            grasps=self.grasps,
            notes=notes,
        )
        self.requests = available_trials(requests, notes, bop_dirs=self.roots)
        rows = match(results, scenario.dataset.ground_truth)
        self.known = keys_of(results).with_columns(gt_row=pl.Series(rows))
        keys = self.requests.keys.with_row_index("row")
        self.part = np.full(len(keys), "images")
        if test is not None:
            self.part[keys.join(test, on=_TRIED, how="semi")["row"].to_numpy()] = "test"

    def run(self, gripper: str, part: str, work: Path, workers: int) -> pl.DataFrame | None:
        """Return each outcome with the row of its true instance; None without trials."""
        mine = (self.requests.keys["gripper"] == gripper).to_numpy() & (self.part == part)
        if not mine.any():
            return None
        requests = self.requests.select(np.flatnonzero(mine))
        start = perf_counter()
        outcomes = run_campaign(
            requests,
            load_setups(requests, self.grasps, settings=PAPER, bop_dirs=self.roots),
            work / self.scenario.name / f"{slug(self.guide)}-{gripper}-{part}",
            executor=LocalExecutor(workers),
        )
        print(
            f"{self.scenario.name}: {self.guide}, {gripper}, {part}: {len(outcomes)} trials, "
            f"{outcomes['success'].mean():.3f} succeed ({perf_counter() - start:.0f} s)",
            flush=True,
        )
        success = pl.col("success").cast(pl.Int64).alias(self.guide)
        return outcomes.join(self.known, on=_KEY).select(*_INSTANCE, success)


def true_poses_tried(scenario: Scenario, work: Path) -> pl.DataFrame:
    """Simulate the grasp of each object by each gripper, guided by its true pose."""
    grasps, roots = read_grasps(protocol="paper"), {scenario.name: scenario.dataset.root}
    objects = sorted(set(scenario.results[scenario.principal].obj_id.tolist()))
    pairs = [(o, g) for g in GRIPPERS for o in objects if (f"{scenario.name}-{o}", g) in grasps]
    keys = pl.DataFrame(pairs, schema=["obj_id", "gripper"], orient="row").with_columns(
        estimator=pl.lit("true"), dataset=pl.lit(scenario.name), scene_id=0, im_id=0, est_id=0
    )
    requests = TrialRequests(keys, np.tile(np.eye(4), (len(keys), 1, 1)))
    requests = available_trials(requests, [], bop_dirs=roots)
    setups = load_setups(requests, grasps, settings=PAPER, bop_dirs=roots)
    out = work / scenario.name / "true-pose"
    outcomes = run_campaign(requests, setups, out, executor=LocalExecutor(1))
    success = pl.col("success").cast(pl.Int64).alias(TRUE_POSE)
    return outcomes.select("dataset", "gripper", "obj_id", success)


def slug(guide: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", guide.lower().replace("°", "deg")).strip("-")


def same_instances(
    scenario: Scenario, outcomes: Sequence[pl.DataFrame], ideal: pl.DataFrame
) -> pl.DataFrame:
    """Return the outcomes of all guides, of the principal's instances with several views."""
    results = scenario.with_views()
    rows = match(results, scenario.dataset.ground_truth)
    keys = keys_of(results).with_columns(gt_row=pl.Series(rows), dataset=pl.lit(scenario.name))
    together = keys
    for i, each in enumerate(outcomes):
        together = together.join(each, on=_INSTANCE if i else [_INSTANCE[0], _INSTANCE[2]])
    together = together.join(ideal, on=["dataset", "gripper", "obj_id"])
    return together.sort("dataset", *_KEY, "gripper")


def test_images(principal: str, split: Sequence[Path]) -> pl.DataFrame | None:
    """Return the principal's instances of published test images, where a split is given."""
    tables = [read_split(path).filter(principal=principal, split="test") for path in split]
    return pl.concat(tables).select(_TRIED) if tables else None


def parts(
    together: pl.DataFrame, test: pl.DataFrame | None, which: str
) -> Iterator[tuple[str, pl.DataFrame]]:
    """Yield the instances of each dataset, of all together, and of their test images."""
    names = together["dataset"].unique(maintain_order=True).to_list()
    for name in [*names, " + ".join(names)] if len(names) > 1 else names:
        mine = together if name not in names else together.filter(dataset=name)
        if which == "all":
            yield name, mine
        if test is not None and len(some := mine.join(test, on=_TRIED, how="semi")):
            yield f"{name}, test images", some


def compared(outcomes: pl.DataFrame, names: Sequence[str], bootstrap: Bootstrap) -> dict[str, Any]:
    """Return success rates of some guides and their differences to the first, for a gripper."""
    instances = Instances.from_frame(outcomes)
    groups, drawn = scene_groups(instances), dict[str, ScoreDraws]()
    out: dict[str, Any] = {"n": len(outcomes), "scenes": len(set(groups.tolist())), "guides": {}}
    for name in names:
        success = outcomes[name].to_numpy() > 0
        # Only the outcomes are scored; any probability will do.
        even, of = np.full(len(success), 0.5), instances.objects
        forecasts = Forecasts("", name, "", "", even, success, of, groups)
        drawn[name] = bootstrap_scores(forecasts, ["success"], bootstrap.draws, bootstrap.seed)
        values = drawn[name]["success"]
        rate = Interval.of(values[0], values[1:], (0.0, 1.0), confidence=bootstrap.confidence)
        gain = improvements(drawn[name], drawn[names[0]])["success"]
        out["guides"][name] = {
            "success": rate.value,
            "success_interval": rate.ends,
            "difference": gain.value,
            "difference_interval": gain.ends,
            "objects": {o: float(success[of == o].mean()) for o in np.unique(of).tolist()},
        }
    return out


def rendered(part: str, found: Mapping[str, Any]) -> str:
    """Render the guides of a part as a Markdown table: both grippers, rates and differences."""
    header = ["guide"]
    for gripper, cell in found.items():
        header += [f"{gripper} (n {cell['n']})", "difference"]
    first = next(iter(found.values()))["guides"]
    rows = []
    for i, name in enumerate(first):
        row = [name]
        for cell in found.values():
            mine = cell["guides"][name]
            row.append(f"{mine['success']:.3f} {_ends(mine['success_interval'], '')}")
            row.append("" if not i else _signed(mine))
        rows.append(row)
    return f"## {part}\n\n{table(header, rows)}\n\n{_by_object(found)}\n"


def _by_object(found: Mapping[str, Any]) -> str:
    """Render the success rate on each object of the first two guides and of the true pose."""
    first = next(iter(found.values()))["guides"]
    names = [*list(first)[:2], TRUE_POSE]
    header = ["object", *(f"{gripper}: {name}" for gripper in found for name in names)]
    objects = dict.fromkeys(
        o for cell in found.values() for o in cell["guides"][TRUE_POSE]["objects"]
    )
    rows = []
    for o in objects:
        rates = [
            cell["guides"][name]["objects"].get(o) for cell in found.values() for name in names
        ]
        rows.append([o, *("" if rate is None else f"{rate:.3f}" for rate in rates)])
    return table(header, rows)


def _signed(mine: Mapping[str, Any]) -> str:
    return f"{mine['difference']:+.3f} {_ends(mine['difference_interval'], '+')}"


def _ends(ends: Sequence[float] | None, sign: str) -> str:
    return "" if ends is None else f"[{ends[0]:{sign}.3f}, {ends[1]:{sign}.3f}]"


def scenarios(options: argparse.Namespace) -> list[Scenario]:
    pairs = [(name, path) for name, _, path in (e.partition("=") for e in options.estimates)]
    inputs = load_inputs(
        pairs,
        bop=options.bop,
        ground_truth=options.ground_truth or (),
        scenes=options.scenes or (),
        lenient=True,
    )
    if len(options.camera_poses) != len(options.bop):
        raise SystemExit("give one --camera-poses for each --bop, in their order")
    motions = {
        name: read_camera_motion(path)
        for name, path in zip(inputs.datasets, options.camera_poses, strict=True)
    }
    first = options.principal or inputs.estimators[0]
    spread = replace(DEFAULT_SPREAD, along=options.along or DEFAULT_SPREAD.along)
    return [
        Scenario(name, inputs.datasets[name], results, motions[name], first, spread)
        for name, results in inputs.results.items()
    ]


def parser() -> argparse.ArgumentParser:
    out = argparse.ArgumentParser(description=__doc__)
    out.add_argument("--estimates", action="append", required=True, metavar="NAME=FILE")
    out.add_argument("--bop", type=Path, action="append", required=True)
    out.add_argument("--ground-truth", type=Path, action="append")
    out.add_argument("--camera-poses", type=Path, action="append", required=True)
    out.add_argument("--work", type=Path, required=True, help="directory of the campaigns")
    out.add_argument("--principal", help="default: the first estimator")
    out.add_argument("--gripper", nargs="+", default=sorted(GRIPPERS))
    out.add_argument("--views", type=int, nargs="+", default=[1, 2, 3, 5])
    out.add_argument("--noise-views", type=int, default=3, help="views of all other guides")
    out.add_argument("--noise-mm", type=float, nargs="*", default=[1, 3, 5])
    out.add_argument("--alone", nargs="*", metavar="NAME", help="default: the principal")
    out.add_argument("--split", type=Path, action="append", default=[], help="published split.csv")
    out.add_argument("--along", type=float, help="assumed spread along the ray, of the distance")
    out.add_argument("--part", choices=("all", "test"), default="all", help="images of --split")
    out.add_argument("--scenes", type=int, nargs="+", metavar="N", help="default: all")
    out.add_argument("--seed", type=int, default=0, help="of the noise")
    out.add_argument("--draws", type=int, default=2000, help="of the bootstrap")
    out.add_argument("--workers", type=int, default=1)
    out.add_argument("--json", type=Path)
    out.add_argument("--markdown", type=Path)
    return out


def main(arguments: Sequence[str] | None = None) -> None:
    options = parser().parse_args(arguments)
    found, each = {}, scenarios(options)
    test = test_images(each[0].principal, options.split)
    wanted = guides(options, list(each[0].results))
    trials = {s.name: [Trials(s, g, poses(s), test) for g, poses in wanted.items()] for s in each}
    outcomes: dict[str, dict[str, list[pl.DataFrame]]] = {
        s.name: {guide: [] for guide in wanted} for s in each
    }
    todo = ["test"] if options.part == "test" else ["test", "images"]
    for part, gripper in ((p, g) for p in todo for g in options.gripper):
        for name, mine in trials.items():
            for one in mine:
                if (done := one.run(gripper, part, options.work, options.workers)) is not None:
                    outcomes[name][one.guide].append(done)
    tables = []
    for scenario in each:
        mine = [pl.concat(done) for done in outcomes[scenario.name].values()]
        tables.append(same_instances(scenario, mine, true_poses_tried(scenario, options.work)))
    names, bootstrap = [*wanted, TRUE_POSE], Bootstrap(draws=options.draws)
    for part, rows in parts(pl.concat(tables), test, options.part):
        found[part] = {
            gripper: compared(rows.filter(gripper=gripper), names, bootstrap)
            for gripper in options.gripper
        }
    text = "\n".join(rendered(part, cells) for part, cells in found.items())
    print(text)
    if options.json:
        write_json(options.json, found)
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
