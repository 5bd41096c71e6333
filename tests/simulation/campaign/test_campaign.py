from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import graspcast.errors
from campaign_script import make_requests
from graspcast.errors import (
    CampaignStoppedError,
    FormatError,
    InputError,
    MismatchError,
    UnknownNameError,
)
from graspcast.simulation.campaign.campaign import Progress, run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor, usable_cores
from graspcast.simulation.campaign.jobs import TrialSetup, load_setups
from graspcast.simulation.campaign.requests import KEY_COLUMNS, TrialRequests
from graspcast.simulation.campaign.store import COLUMNS, Store
from graspcast.simulation.grasps.table import read_grasps
from graspcast.simulation.trial.trial import TrialSettings

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


@pytest.fixture(scope="module")
def requests() -> TrialRequests:
    return make_requests(40)


@pytest.fixture(scope="module")
def pairs(requests: TrialRequests) -> dict[tuple[str, str], TrialSetup]:
    return load_setups(requests, read_grasps())


@pytest.fixture(scope="module")
def complete(
    requests: TrialRequests,
    pairs: dict[tuple[str, str], TrialSetup],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    directory = tmp_path_factory.mktemp("campaigns") / "complete"
    run_campaign(requests, pairs, directory, executor=ONE, sources={"epos": "a test"})
    return directory


def test_outcomes_are_those_of_the_trials_run_one_by_one(
    complete: Path, requests: TrialRequests, pairs: dict[tuple[str, str], TrialSetup]
) -> None:
    outcomes = Store(complete).outcomes()
    assert dict(outcomes.schema) == COLUMNS
    assert 0.1 < outcomes["success"].mean() < 0.9  # type: ignore[operator]
    pair = pairs["ycbv-4", "parallel"]
    runner = pair.runner()
    for row in outcomes.sample(6, seed=1).iter_rows(named=True):
        alone = runner.run(requests.obj_T_est[row["im_id"]], pair.grasp)
        assert (row["success"], row["reason"]) == (alone.success, alone.reason)
        assert (row["offset_m"], row["steps"]) == (alone.offset_m, alone.steps)


def test_a_complete_campaign_is_four_files_and_is_not_run_again(
    complete: Path, requests: TrialRequests, pairs: dict[tuple[str, str], TrialSetup]
) -> None:
    assert {p.name for p in complete.glob("[!.]*")} == {
        "manifest.json",
        "outcomes.parquet",
        "README.md",
    }
    before = Store(complete).outcomes()
    again = run_campaign(requests, pairs, complete, executor=ONE)
    assert again.equals(before)  # even to the seconds it took


def test_order_does_not_matter(
    complete: Path,
    requests: TrialRequests,
    pairs: dict[tuple[str, str], TrialSetup],
    tmp_path: Path,
) -> None:
    shuffled = requests.select(np.random.default_rng(0).permutation(len(requests)))
    outcomes = run_campaign(shuffled, pairs, tmp_path / "out", executor=ONE)
    assert _same_but_for_time(outcomes, Store(complete).outcomes())
    first, second = (
        json.loads((d / "manifest.json").read_text()) for d in (complete, tmp_path / "out")
    )
    assert first["hash"] == second["hash"]


@pytest.mark.slow
def test_two_workers_give_the_same(
    complete: Path,
    requests: TrialRequests,
    pairs: dict[tuple[str, str], TrialSetup],
    tmp_path: Path,
) -> None:
    outcomes = run_campaign(requests, pairs, tmp_path / "out", executor=LocalExecutor(2))
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


def _children(pid: int) -> list[int]:
    path = Path(f"/proc/{pid}/task/{pid}/children")
    if not path.exists():
        pytest.skip("this system does not list a process's children in /proc")
    return [int(child) for child in path.read_text().split()]


def _is_worker(pid: int) -> bool:
    return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()


@pytest.mark.slow
def test_a_full_disk_is_a_clear_message_and_a_state_to_go_on_from(tmp_path: Path) -> None:
    directory = tmp_path / "out"
    # A shard of 16 trials is below the limit, the merged file of 60 above it.
    process = _start(directory, 60, 1, "limit")
    _, told = process.communicate(timeout=60)
    assert process.returncode == 2, told
    assert "could not be written (File too large)" in told
    assert f"60 of 60 trials are kept in {directory}; run the same again" in told
    kept = Store(directory).outcomes()
    assert len(kept) == 60
    assert not list(directory.glob(".outcomes*"))
    process = _start(directory, 60, 1)
    process.communicate(timeout=60)
    assert process.returncode == 0
    assert Store(directory).outcomes().equals(kept)


def test_a_directory_that_cannot_be_written(
    requests: TrialRequests, pairs: dict[tuple[str, str], TrialSetup], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        run_campaign(requests, pairs, tmp_path / "file" / "out", executor=ONE)


@pytest.mark.parametrize("change", ["settings", "friction", "poses", "more"])
def test_another_configuration_refuses_to_mix(
    complete: Path,
    requests: TrialRequests,
    pairs: dict[tuple[str, str], TrialSetup],
    change: str,
) -> None:
    before = {p.name: p.read_bytes() for p in complete.glob("[!.]*")}
    pair = pairs["ycbv-4", "parallel"]
    named = "ycbv-4 by parallel"
    if change == "settings":
        pair = TrialSetup(pair.grasp_object, pair.gripper, pair.grasp, TrialSettings(lift_s=14.0))
    elif change == "friction":
        slippery = replace(pair.grasp_object, friction=0.2)
        pair = TrialSetup(slippery, pair.gripper, pair.grasp, pair.settings)
    elif change == "poses":
        named = "estimates of epos on ycbv"
        moved = requests.obj_T_est.copy()
        moved[3, 0, 3] += 1e-9
        requests = TrialRequests(requests.keys, moved)
    else:
        named = "estimates of epos on ycbv"
        requests = make_requests(41)
    with pytest.raises(MismatchError, match=f"another configuration: {named} .*another --out"):
        run_campaign(requests, {("ycbv-4", "parallel"): pair}, complete, executor=ONE)
    assert {p.name: p.read_bytes() for p in complete.glob("[!.]*")} == before


def test_a_directory_with_other_files_is_left_alone(
    requests: TrialRequests, pairs: dict[tuple[str, str], TrialSetup], tmp_path: Path
) -> None:
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(InputError, match="holds files but no campaign"):
        run_campaign(requests, pairs, tmp_path, executor=ONE)
    with pytest.raises(FormatError, match="not a campaign's directory"):
        Store(tmp_path).outcomes()


def test_two_processes_cannot_share_a_directory(
    complete: Path, requests: TrialRequests, pairs: dict[tuple[str, str], TrialSetup]
) -> None:
    with (
        Store(complete).lock(),
        pytest.raises(InputError, match="another process is running the campaign"),
    ):
        run_campaign(requests, pairs, complete, executor=ONE)


def test_an_interrupted_merge_counts_nothing_twice(complete: Path, tmp_path: Path) -> None:
    directory = tmp_path / "copy"
    shutil.copytree(complete, directory)
    store = Store(directory)
    whole = Store(directory).outcomes()
    store.append(whole[:10])
    # As after a kill between writing the merged file and removing its parts.
    assert Store(directory).outcomes().equals(whole)
    assert store.finish().equals(whole)
    assert not (directory / "shards").exists()


def test_many_shards_are_merged_on_the_way(
    complete: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("graspcast.simulation.campaign.store._MOST_SHARDS", 3)
    whole = Store(complete).outcomes()
    store = Store(tmp_path / "out")
    with store.lock():
        store.begin(Store(complete).manifest)
        for row in range(20):
            store.append(whole[row : row + 1])
            assert len(list((tmp_path / "out" / "shards").iterdir())) <= 4
    assert store.outcomes().equals(whole[:20])


def test_a_damaged_shard_is_named_and_the_rest_stays(complete: Path, tmp_path: Path) -> None:
    directory = tmp_path / "copy"
    shutil.copytree(complete, directory)
    content = (directory / "outcomes.parquet").read_bytes()
    (directory / "outcomes.parquet").write_bytes(content[: len(content) // 2])
    with pytest.raises(FormatError, match=r"outcomes.parquet: is damaged .*remove it"):
        Store(directory).outcomes()
    pl.DataFrame({"a": [1]}).write_parquet(directory / "outcomes.parquet")
    with pytest.raises(FormatError, match="should have the columns estimator"):
        Store(directory).outcomes()


def test_progress_is_told(
    requests: TrialRequests, pairs: dict[tuple[str, str], TrialSetup], tmp_path: Path
) -> None:
    told: list[Progress] = []

    class StopError(Exception):
        pass

    def stop(progress: Progress) -> None:
        told.append(progress)
        if progress.done:
            raise StopError

    with pytest.raises(StopError):
        run_campaign(requests, pairs, tmp_path / "out", executor=ONE, progress=stop)
    assert (told[0].done, told[0].left_s) == (0, float("inf"))
    assert told[-1].done == 16 and sum(told[-1].reasons.values()) == 16
    told.clear()
    run_campaign(requests, pairs, tmp_path / "out", executor=ONE, progress=told.append)
    assert [p.done for p in told] == [16, 32, 40]
    assert {p.found for p in told} == {16}
    assert told[-1].left_s == 0 and told[-1].rate > 0


def _changed(requests: TrialRequests, **columns: Any) -> pl.DataFrame:
    return requests.keys.drop("object").with_columns(**columns)


def test_requests_that_are_wrong(requests: TrialRequests) -> None:
    keys, poses = requests.keys, requests.obj_T_est
    with pytest.raises(InputError, match="lack the column 'est_id'"):
        TrialRequests(keys.drop("est_id"), poses)
    with pytest.raises(InputError, match="wrong type"):
        TrialRequests(_changed(requests, im_id=pl.lit("first")), poses)
    with pytest.raises(InputError, match=r"same keys: estimator epos.*im_id 3"):
        TrialRequests(_changed(requests, im_id=pl.lit(3)), poses)
    with pytest.raises(InputError, match="no value in some column"):
        TrialRequests(_changed(requests, gripper=pl.lit(None, dtype=pl.String)), poses)
    with pytest.raises(InputError, match="need poses"):
        TrialRequests(keys, poses[1:])
    broken = poses.copy()
    broken[5, 0, 0] = np.nan
    with pytest.raises(InputError, match=r"1 estimates are not finite.*im_id 5, obj_id 4"):
        TrialRequests(keys, broken)
    broken = poses.copy()
    broken[6, :3, :3] *= 1.01
    with pytest.raises(InputError, match=r"not rigid.*im_id 6"):
        TrialRequests(keys, broken)


def test_an_object_without_a_grasp(requests: TrialRequests) -> None:
    keys = _changed(requests, obj_id=pl.lit(10), dataset=pl.lit("lmo"))
    with pytest.raises(UnknownNameError, match="grasp of 'lmo-10' by 'parallel'"):
        load_setups(TrialRequests(keys, requests.obj_T_est), read_grasps())


def test_workers_must_be_some() -> None:
    with pytest.raises(InputError, match="--workers is 0"):
        LocalExecutor(0)
    assert LocalExecutor().workers == usable_cores() >= 1


def test_a_trial_that_fails_stops_with_its_cause(
    requests: TrialRequests, pairs: dict[tuple[str, str], TrialSetup], tmp_path: Path
) -> None:
    pair = pairs["ycbv-4", "parallel"]
    other = replace(pair.grasp, object="ycbv-9")
    wrong = TrialSetup(pair.grasp_object, pair.gripper, other, pair.settings)
    with pytest.raises(
        CampaignStoppedError, match=r"a trial of ycbv-4 by parallel failed: MismatchError.*0 of 40"
    ):
        run_campaign(requests, {("ycbv-4", "parallel"): wrong}, tmp_path / "o", executor=ONE)


def test_the_card_reads_as_it_says(complete: Path) -> None:
    card = (complete / "README.md").read_text()
    outcomes = pl.read_parquet(complete / "outcomes.parquet")
    for name in outcomes.columns:
        assert f"| `{name}` " in card
    manifest = json.loads((complete / "manifest.json").read_text())
    for name in manifest["pairs"][0]["settings"]:
        assert f"| `{name}` " in card
    assert f"| epos | parallel | 40 | {outcomes['success'].mean():.3f} |" in card
    assert "CC BY 4.0" in card and "- epos: a test" in card and "LM-O" not in card
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    frame = pandas.read_parquet(complete / "outcomes.parquet")
    assert list(frame.columns) == list(COLUMNS) and len(frame) == 40
    datasets = pytest.importorskip("datasets")
    assert datasets.load_dataset(str(complete), split="train").num_rows == 40


def test_keys_are_the_first_columns() -> None:
    assert list(COLUMNS)[: len(KEY_COLUMNS)] == list(KEY_COLUMNS)
