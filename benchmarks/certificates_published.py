"""Certificates on the published data: certified on some scenes or images, checked on the others.

    python benchmarks/certificates_published.py \
        --data DIR --work DIR --transferred DIR --outcomes DIR

The forecasts are those of the default forecaster for unseen scenes (of ``graspcast evaluate``,
protocol ``unseen_scenes``; use its ``--work`` and the same trials). They are split at random many
times: one half of the scenes (or images) certifies a threshold, which is applied to the other half.
A certificate is false where the success rate of the attempts falls below the certified one. The
share of attempts is also given relative to that of a perfect ranking, which attempts all successes
and then failures until the rate is just reached.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from graspcast.cli.options import write_json
from graspcast.estimates.outcomes import read_all_outcomes
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.held_out_certificates import resample_certificates
from graspcast.evaluation.methods import METHODS
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.run import forecast_all
from graspcast.forecasting.simulated_trials import SimulatedTrials
from graspcast.paper.dataset import Published


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--data", type=Path, required=True)
    options.add_argument("--work", type=Path, required=True)
    options.add_argument("--transferred", type=Path, action="append", default=[])
    options.add_argument("--outcomes", type=Path, action="append", default=[])
    options.add_argument("--rate", type=float, default=0.9)
    options.add_argument("--confidence", type=float, default=0.9)
    options.add_argument("--resamplings", type=int, default=300)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--json", type=Path)
    given = options.parse_args()

    data = Published(given.data)
    grippers = data.outcomes["gripper"].unique().sort().to_list()
    transferred = {
        g: SimulatedTrials.read(given.transferred, g) for g in grippers if given.transferred
    }
    simulated = read_all_outcomes(given.outcomes) if given.outcomes else None
    benchmark = Benchmark.of(data, simulated, transferred)
    methods = {"blend": METHODS["blend"](given.seed)}
    forecasts = forecast_all(benchmark, methods, ["unseen_scenes"], work=given.work)
    images = [f"{d}/{s}/{i}" for d, s, i, *_ in benchmark.estimates.instances.to_keys()]
    print("| certified on | gripper | principal | no threshold | false | attempted | of perfect |")
    print("|---|---|---|---|---|---|---|")
    found = []
    for unit in ("scene", "image"):
        for each in forecasts:
            units = each.scenes if unit == "scene" else _images(benchmark, each, images)
            row = resample_certificates(
                each.probability,
                each.success,
                units,
                rate=given.rate,
                confidence=given.confidence,
                resamplings=given.resamplings,
                seed=given.seed,
            )
            found.append(
                {"unit": unit, "gripper": each.gripper, "principal": each.principal, **row}
            )
            cells = [f"{row[k]:.3f}" for k in ("none", "false", "attempted", "of_perfect")]
            print("| " + " | ".join([unit + "s", each.gripper, each.principal, *cells]) + " |")
    write_json(given.json, found)


def _images(benchmark: Benchmark, each: Forecasts, images: list[str]) -> np.ndarray:
    """The image of each forecast; forecasts are in the order of the protocol's tasks."""
    from graspcast.evaluation.protocols import tasks

    rows = [
        benchmark.rows_of(test.estimates)
        for _, test in tasks(benchmark, "unseen_scenes", each.principal, each.gripper)
    ]
    return np.array(images)[np.concatenate(rows)]


if __name__ == "__main__":
    main()
