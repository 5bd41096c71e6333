from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from campaign_script import make_requests
from graspcast.errors import (
    FormatError,
    InputError,
    MismatchError,
)
from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.jobs import TrialSetup
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests
from graspcast.simulation.campaign.store import COLUMNS, Store
from graspcast.simulation.trial.trial import TrialSettings

ONE = LocalExecutor(1)


def test_a_directory_that_cannot_be_written(
    requests: TrialRequests, setups: dict[SetupKey, TrialSetup], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        run_campaign(requests, setups, tmp_path / "file" / "out", executor=ONE)


@pytest.mark.parametrize("change", ["settings", "friction", "poses", "more"])
def test_another_configuration_refuses_to_mix(
    complete: Path,
    requests: TrialRequests,
    setups: dict[SetupKey, TrialSetup],
    change: str,
) -> None:
    before = {p.name: p.read_bytes() for p in complete.glob("[!.]*")}
    setup = setups["ycbv-4", "parallel", "reference"]
    named = "ycbv-4 by parallel"
    if change == "settings":
        setup = TrialSetup(
            setup.grasp_object, setup.gripper, setup.grasp, TrialSettings(lift_s=14.0)
        )
    elif change == "friction":
        slippery = replace(setup.grasp_object, friction=0.2)
        setup = TrialSetup(slippery, setup.gripper, setup.grasp, setup.settings)
    elif change == "poses":
        named = "estimates of epos on ycbv"
        moved = requests.obj_T_est.copy()
        moved[3, 0, 3] += 1e-9
        requests = TrialRequests(requests.keys, moved)
    else:
        named = "estimates of epos on ycbv"
        requests = make_requests(41)
    with pytest.raises(MismatchError, match=f"another configuration: {named} .*another directory"):
        run_campaign(requests, {("ycbv-4", "parallel", "reference"): setup}, complete, executor=ONE)
    assert {p.name: p.read_bytes() for p in complete.glob("[!.]*")} == before


def test_a_directory_with_other_files_is_left_alone(
    requests: TrialRequests, setups: dict[SetupKey, TrialSetup], tmp_path: Path
) -> None:
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(InputError, match="holds files but no campaign"):
        run_campaign(requests, setups, tmp_path, executor=ONE)
    with pytest.raises(FormatError, match="not a campaign's directory"):
        Store(tmp_path).outcomes()


def test_two_processes_cannot_share_a_directory(
    complete: Path, requests: TrialRequests, setups: dict[SetupKey, TrialSetup]
) -> None:
    with (
        Store(complete).lock(),
        pytest.raises(InputError, match="another process is running the campaign"),
    ):
        run_campaign(requests, setups, complete, executor=ONE)


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
    out = tmp_path / "out"
    counts, written = [], 0
    for row in range(40):
        store = Store(out)  # as of a process that resumes, which knows of shards by their files
        with store.lock():
            store.begin(Store(complete).manifest)
            before = set((out / "shards").glob("*"))
            store.append(whole[row : row + 1])
        shards = set((out / "shards").glob("*"))
        counts.append(len(shards))
        written += sum(len(pl.read_parquet(path)) for path in shards - before)
    # At most three of each level, and those of the highest, of sixteen trials.
    assert max(counts) <= 3 + 3 + 40 // 16
    # 40 once, and nearly all once more on each of the two higher levels: never all over again.
    assert written <= 3 * 40
    assert store.outcomes().equals(whole)
    assert store.finish().equals(whole)


def test_shards_of_earlier_versions_are_merged_too(complete: Path, tmp_path: Path) -> None:
    whole = Store(complete).outcomes()
    store = Store(tmp_path / "out")
    store.begin(Store(complete).manifest)
    store.append(whole[:7])
    (shard,) = (tmp_path / "out" / "shards").iterdir()
    shard.rename(shard.with_name(shard.name.partition("-")[2]))
    again = Store(tmp_path / "out")
    again.begin(Store(complete).manifest)
    again.append(whole[7:])
    assert again.finish().equals(whole)


@pytest.mark.slow
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


def test_outcomes_from_before_the_robot_s_protocol_are_read_as_of_the_paper_s(
    complete: Path, tmp_path: Path
) -> None:
    directory = tmp_path / "copy"
    shutil.copytree(complete, directory)
    whole = Store(complete).outcomes()
    whole.drop("short_m", "force_n", "hit").write_parquet(directory / "outcomes.parquet")
    old = Store(directory).outcomes()
    assert dict(old.schema) == COLUMNS
    assert old["short_m"].is_nan().all() and old["force_n"].is_nan().all()
    assert old["hit"].is_null().all()
    assert old.drop("short_m", "force_n", "hit").equals(whole.drop("short_m", "force_n", "hit"))


def test_campaigns_of_the_two_protocols_are_not_mixed_and_their_names_are_told(
    complete: Path,
    requests: TrialRequests,
    setups: dict[SetupKey, TrialSetup],
    tmp_path: Path,
) -> None:
    paper = {key: replace(setup, settings=TrialSettings.paper()) for key, setup in setups.items()}
    said = r"another configuration: protocol \(robot there, paper now\), ycbv-4 by parallel"
    with pytest.raises(MismatchError, match=said):
        run_campaign(requests, paper, complete, executor=ONE)
    few = requests.select(np.arange(2))
    run_campaign(few, paper, tmp_path / "paper", executor=ONE)
    manifest = Store(tmp_path / "paper").manifest
    # As before there was another protocol, so that campaigns from then can be resumed.
    assert "protocol" not in manifest["configuration"]
    assert manifest["setups"][0]["protocol"] == "paper"
    assert "Protocol: paper" in (tmp_path / "paper" / "README.md").read_text()
    assert Store(complete).manifest["configuration"]["protocol"] == "robot"
    assert "Protocol: robot" in (complete / "README.md").read_text()
    with pytest.raises(MismatchError, match=r"protocol \(paper there, robot now\)"):
        run_campaign(few, setups, tmp_path / "paper", executor=ONE)


def test_keys_are_the_first_columns() -> None:
    assert list(COLUMNS)[: len(TRIAL_COLUMNS)] == list(TRIAL_COLUMNS)
