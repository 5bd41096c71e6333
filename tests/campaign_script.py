"""A campaign of real trials as a program, so that tests can kill it.

Usage: campaign_script.py DIRECTORY COUNT WORKERS [limit]; `limit` lets no file grow over 10.5 KiB.
"""

from __future__ import annotations

import signal
import sys

import numpy as np
import polars as pl

from graspcast.errors import GraspcastError
from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.pose.transforms import exp
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.jobs import load_setups
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.table import read_grasps


def make_requests(count: int, grippers: tuple[str, ...] = ("parallel",)) -> TrialRequests:
    """Estimates of the tomato soup can that are off by about a centimetre and 6 degrees."""
    rng = np.random.default_rng(7)
    rows = [("epos", "ycbv", 48, k, 4, 0, g) for k in range(count) for g in grippers]
    twists = rng.normal(size=(len(rows), 6)) * ([0.01] * 3 + [0.1] * 3)
    return TrialRequests(
        pl.DataFrame(rows, schema=list(TRIAL_COLUMNS)[:-1], orient="row"), exp(twists)
    )


def main() -> int:
    directory, count, workers = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    requests = make_requests(count)
    setups = load_setups(requests, read_grasps())
    if sys.argv[4:] == ["limit"]:
        import resource

        # What a full disk does to a write, with the error of a file that is too large instead.
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(
            resource.RLIMIT_FSIZE, (10752, resource.getrlimit(resource.RLIMIT_FSIZE)[1])
        )
    try:
        run_campaign(requests, setups, directory, executor=LocalExecutor(workers))
    except GraspcastError as error:
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
