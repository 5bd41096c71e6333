from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import graspcast.errors
from graspcast.simulation.campaign.campaign import (
    always_missed,
    mostly_collided,
    reason_counts,
    run_campaign,
)
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.jobs import TrialSetup
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests
from graspcast.simulation.campaign.store import COLUMNS, Store

SCRIPT = Path(__file__).parents[2] / "campaign_script.py"

ONE = LocalExecutor(1)


def _start(*arguments: object) -> subprocess.Popen[str]:
    source = Path(graspcast.errors.__file__).parents[1]
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": str(source)},
        stderr=subprocess.PIPE,
        text=True,
    )


def _wait_for(condition: Callable[[], object], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


def _same_but_for_time(a: pl.DataFrame, b: pl.DataFrame) -> bool:
    return a.drop("computed_s").equals(b.drop("computed_s"))


def test_outcomes_are_those_of_the_trials_run_one_by_one(
    complete: Path, requests: TrialRequests, setups: dict[SetupKey, TrialSetup]
) -> None:
    outcomes = Store(complete).outcomes()
    assert dict(outcomes.schema) == COLUMNS
    assert 0.1 < outcomes["success"].mean() < 0.9  # type: ignore[operator]
    setup = setups["ycbv-4", "parallel", "reference"]
    runner = setup.runner()
    for row in outcomes.sample(6, seed=1).iter_rows(named=True):
        alone = runner.run(requests.obj_T_est[row["im_id"]], setup.grasp)
        assert (row["success"], row["reason"]) == (alone.success, alone.reason)
        for name in ("offset_m", "short_m", "force_n", "hit", "steps"):
            told, wanted = row[name], getattr(alone, name)
            assert told == wanted or (np.isnan(told) and np.isnan(wanted))


def test_a_complete_campaign_is_four_files_and_is_not_run_again(
    complete: Path, requests: TrialRequests, setups: dict[SetupKey, TrialSetup]
) -> None:
    assert {p.name for p in complete.glob("[!.]*")} == {
        "manifest.json",
        "outcomes.parquet",
        "README.md",
    }
    before = Store(complete).outcomes()
    again = run_campaign(requests, setups, complete, executor=ONE)
    assert again.equals(before)  # even to the seconds it took


@pytest.mark.slow
def test_order_does_not_matter(
    complete: Path,
    requests: TrialRequests,
    setups: dict[SetupKey, TrialSetup],
    tmp_path: Path,
) -> None:
    shuffled = requests.select(np.random.default_rng(0).permutation(len(requests)))
    outcomes = run_campaign(shuffled, setups, tmp_path / "out", executor=ONE)
    assert _same_but_for_time(outcomes, Store(complete).outcomes())
    first, second = (
        json.loads((d / "manifest.json").read_text()) for d in (complete, tmp_path / "out")
    )
    assert first["hash"] == second["hash"]


def test_pairs_of_which_most_trials_collide_are_named() -> None:
    outcomes = pl.DataFrame(
        {
            "object": ["a", "a", "a", "b", "b"],
            "gripper": "parallel",
            "grasp": "reference",
            "reason": ["collided", "held", "collided", "collided", "held"],
            "success": [False, True, False, False, True],
            "steps": 1,
        }
    )
    assert mostly_collided(reason_counts(outcomes)) == ["a by parallel"]
    held = outcomes.filter(pl.col("reason") == "held")
    assert mostly_collided(reason_counts(held)) == []
    assert always_missed(reason_counts(outcomes)) == []
    missed = outcomes.with_columns(
        reason=pl.when(pl.col("object") == "a").then(pl.lit("missed")).otherwise("reason")
    )
    assert always_missed(reason_counts(missed)) == ["a by parallel"]


@pytest.mark.slow
def test_two_workers_give_the_same(
    complete: Path,
    requests: TrialRequests,
    setups: dict[SetupKey, TrialSetup],
    tmp_path: Path,
) -> None:
    outcomes = run_campaign(requests, setups, tmp_path / "out", executor=LocalExecutor(2))
    assert _same_but_for_time(outcomes, Store(complete).outcomes())


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_killed_and_started_again_it_repeats_nothing(tmp_path: Path, workers: int) -> None:
    directory = tmp_path / "out"
    count = 100
    shards = directory / "shards"
    for wanted in (1, 4):
        process = _start(directory, count, workers)
        _wait_for(lambda n=wanted: len(list(shards.glob("[!.]*.parquet"))) >= n)  # type: ignore[misc]
        process.kill()
        process.wait()
        assert process.stderr is not None
        process.stderr.close()
    # The lock goes with the process; its workers may need a moment to notice.
    kept = Store(directory).outcomes()
    assert 0 < len(kept) < count
    process = _start(directory, count, workers)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 0, told
    outcomes = Store(directory).outcomes()
    assert len(outcomes) == count
    # computed_s is never twice the same, so equality means that nothing was run again.
    assert outcomes.join(kept, on=outcomes.columns, how="semi", nulls_equal=True).height == len(
        kept
    )
    assert not shards.exists()


@pytest.mark.slow
def test_workers_end_when_their_campaign_is_killed(tmp_path: Path) -> None:
    process = _start(tmp_path / "out", 100, 2)
    _wait_for(lambda: list((tmp_path / "out" / "shards").glob("[!.]*.parquet")))
    workers = _children(process.pid)
    assert len(workers) >= 2
    process.kill()
    process.wait()
    assert process.stderr is not None
    process.stderr.close()
    _wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers), 10)


@pytest.mark.slow
def test_a_dead_worker_is_a_clear_message_and_a_state_to_go_on_from(tmp_path: Path) -> None:
    directory = tmp_path / "out"
    process = _start(directory, 100, 2)
    _wait_for(lambda: list((directory / "shards").glob("[!.]*.parquet")))
    victim = next(pid for pid in _children(process.pid) if _is_worker(pid))
    os.kill(victim, signal.SIGKILL)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "CampaignStoppedError: a worker process died" in told
    assert "Traceback" not in told
    kept = Store(directory).outcomes()
    assert f"{len(kept)} of 100 trials are kept in {directory}" in told
    process = _start(directory, 100, 1)
    process.communicate(timeout=120)
    assert len(Store(directory).outcomes()) == 100


@pytest.mark.slow
@pytest.mark.parametrize("after_s", [0.0, 0.2])
def test_a_worker_that_dies_while_it_starts_does_not_hang_the_campaign(
    tmp_path: Path, after_s: float
) -> None:
    process = _start(tmp_path / "out", 40, 2)
    _wait_for(lambda: any(map(_is_worker, _children(process.pid))))
    time.sleep(after_s)
    os.kill(next(filter(_is_worker, _children(process.pid))), signal.SIGKILL)
    _, told = process.communicate(timeout=30)
    assert process.returncode == 2
    assert "a worker process died: it was killed by signal 9" in told
    with Store(tmp_path / "out").lock():
        pass


def _children(pid: int) -> list[int]:
    path = Path(f"/proc/{pid}/task/{pid}/children")
    if not path.exists():
        pytest.skip("needs lists of a process's children in /proc: run it on Linux")
    return [int(child) for child in path.read_text().split()]


def _is_worker(pid: int) -> bool:
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


@pytest.mark.slow
def test_a_full_disk_is_a_clear_message_and_a_state_to_go_on_from(tmp_path: Path) -> None:
    directory = tmp_path / "out"
    # A shard of 16 trials is below the limit, the merged file of 60 above it.
    process = _start(directory, 60, 1, "limit")
    _, told = process.communicate(timeout=60)
    assert process.returncode == 2, told
    assert "could not be written (File too large)" in told
    assert f"60 of 60 trials are kept in {directory}; run the same again to resume" in told
    kept = Store(directory).outcomes()
    assert len(kept) == 60
    assert not list(directory.glob(".outcomes*"))
    process = _start(directory, 60, 1)
    process.communicate(timeout=60)
    assert process.returncode == 0
    assert Store(directory).outcomes().equals(kept)


def test_progress_is_reported(
    requests: TrialRequests, setups: dict[SetupKey, TrialSetup], tmp_path: Path
) -> None:
    reported: list[tuple[float, str]] = []

    class StopError(Exception):
        pass

    def stop(share: float, message: str) -> None:
        reported.append((share, message))
        if share:
            raise StopError

    with pytest.raises(StopError):
        run_campaign(requests, setups, tmp_path / "out", executor=ONE, progress=stop)
    assert [share for share, _ in reported] == [0, 16 / 40]
    assert "16 of 40 trials" in reported[-1][1]
    reported.clear()
    run_campaign(
        requests,
        setups,
        tmp_path / "out",
        executor=ONE,
        progress=lambda share, message: reported.append((share, message)),
    )
    assert [share for share, _ in reported] == [16 / 40, 32 / 40, 1]


def test_several_grasps_are_tried_with_the_same_estimates(
    requests: TrialRequests, setups: dict[SetupKey, TrialSetup], tmp_path: Path
) -> None:
    some = requests.select(np.arange(6))
    reference = setups["ycbv-4", "parallel", "reference"]
    higher = replace(
        reference.grasp, name="higher", obj_T_grasp=reference.grasp.obj_T_grasp @ translated(-0.08)
    )
    both = TrialRequests(
        pl.concat([some.keys, some.keys.with_columns(grasp=pl.lit("higher"))]),
        np.concatenate([some.obj_T_est, some.obj_T_est]),
    )
    more = {**setups, ("ycbv-4", "parallel", "higher"): replace(reference, grasp=higher)}
    outcomes = run_campaign(both, more, tmp_path / "both", executor=ONE)
    alone = run_campaign(some, setups, tmp_path / "alone", executor=ONE)
    assert _same_but_for_time(outcomes.filter(pl.col("grasp") == "reference"), alone)
    assert not outcomes.filter(pl.col("grasp") == "higher")["success"].any()
    assert reason_counts(outcomes)["grasp"].to_list() == ["higher", "reference"]
    manifest = Store(tmp_path / "both").manifest
    assert "ycbv-4 by parallel, grasp higher" in manifest["configuration"]


def translated(z: float) -> np.ndarray:
    out = np.eye(4)
    out[2, 3] = z
    return out
