"""Options of one trial, which watch and view share."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest

from cubes import write_tables
from graspcast.cli.one_trial import add_trial, record


def test_the_trial_of_the_options_is_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = argparse.ArgumentParser()
    add_trial(parser)
    options = parser.parse_args(
        [*write_tables(tmp_path), *["--offset", "0", "5", "0", "0", "0", "0"]]
    )
    options.object, options.gripper = "cube", "parallel"
    trial = record(options)
    assert "wooden cube" in trial.title and trial.recording.outcome.success
    obj_T_est = np.linalg.inv(trial.runner.grasp_object.sim_T_ref) @ trial.recording.sim_T_est
    np.testing.assert_allclose(obj_T_est[:3, 3], (0, 0.005, 0), atol=1e-12)
    assert "wooden cube" in capsys.readouterr().out
