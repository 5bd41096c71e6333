"""Pictures of cases: a campaign of a few trials, run again."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from graspcast.bop.results import Results, write_results
from graspcast.cli import main
from graspcast.demo_data import demo_dataset
from graspcast.estimates.outcomes import ERROR_COLUMNS
from graspcast.report.error_sizes import obj_T_est
from graspcast.report.pictures import Painter
from graspcast.report.trials import Trials, read_trials


@pytest.fixture(scope="module")
def estimates() -> Results:
    """The true poses of one object in two images, one of them moved."""
    truth = demo_dataset().ground_truth
    rows = np.flatnonzero((truth.obj_id == 3) & (truth.scene_id == 1))[:2]
    poses = truth.cam_T_obj[rows].copy()
    poses[1, :3, 3] += 0.05
    ones = np.ones(2)
    ids = truth.scene_id[rows], truth.im_id[rows], truth.obj_id[rows]
    return Results(*ids, score=ones, cam_T_obj=poses, time_s=ones, line=np.arange(2))


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory, estimates: Results) -> Trials:
    folder = tmp_path_factory.mktemp("campaign")
    write_results(folder / "mine_ycbv-test.csv", estimates)
    data, mine = str(demo_dataset().root), f"mine={folder / 'mine_ycbv-test.csv'}"
    command = ["simulate", "--bop", data, "--estimates", mine, "--gripper", "parallel"]
    assert main([*command, "--workers", "1", "--out", str(folder / "trials")]) == 0
    return read_trials(folder / "trials")


def painted(trials: Trials) -> Painter:
    return Painter({"ycbv": demo_dataset()}, [trials])


def rows_of(trials: Trials) -> list[dict[str, Any]]:
    return [row | {"object": "ycbv-3"} for row in trials.table.iter_rows(named=True)]


@pytest.mark.slow
def test_the_pose_on_its_image_and_the_moments_of_the_trial(
    trials: Trials, estimates: Results
) -> None:
    painter = painted(trials)
    errors = obj_T_est(trials.table)
    for k, row in enumerate(rows_of(trials)):
        (overlay,) = painter.overlay(row, estimates.cam_T_obj[k], errors[k])
        with Image.open(io.BytesIO(overlay.webp)) as image:
            assert image.format == "WEBP" and image.size == (overlay.width, overlay.height)
        assert "sugar box" in overlay.alt and "true pose solid" in overlay.alt
        moments, words = painter.strip(row, 0, errors[k])
        assert moments[0].name == "pre-grasp" and words.startswith(row["outcome"])
        assert all(words in picture.alt for picture in moments)
    painter.close()
    assert painter.notes == {}


@pytest.mark.slow
def test_the_same_trial_gives_the_same_bytes(trials: Trials) -> None:
    row, error = rows_of(trials)[0], obj_T_est(trials.table)[0]
    first, again = (painted(trials).strip(row, 0, error)[0] for _ in range(2))
    assert [p.webp for p in first] == [p.webp for p in again]


def test_what_cannot_be_drawn_is_noted(trials: Trials, estimates: Results, tmp_path: Path) -> None:
    row, error = rows_of(trials)[0], obj_T_est(trials.table)[0]
    pose = estimates.cam_T_obj[0]
    painter = painted(trials)
    assert painter.overlay(row | {"im_id": 999}, pose, error) == ()
    assert painter.overlay(row | {"dataset": "other"}, pose, error) == ()
    assert painter.strip(row | {"outcome": "slipped"}, 0, error) == ((), "")
    assert painter.strip(row | {"gripper": "claw"}, 0, error) == ((), "")
    assert painter.strip(row, -1, error) == painter.strip(row, 0, None) == ((), "")
    said = " ".join(painter.notes)
    assert "no image 1/999" in said and "not slipped" in said and "parallel" not in said.split()[0]
    assert "its manifest has no trials of ycbv-3 by claw" in said
    # Trials of other settings than those of the manifest are not passed off as these.
    setups = [dict(setup, mass_kg=9.0) for setup in trials.manifest["setups"]]
    other = replace(trials, manifest={**trials.manifest, "setups": setups})
    changed = painted(other)
    assert changed.strip(row, 0, error) == ((), "")
    assert len(changed.notes) == 1
    assert set(ERROR_COLUMNS) <= set(row)
