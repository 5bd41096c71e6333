"""Tolerance of a grasp: directions, frames, and what is known of a simple pair."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bricks import brick, from_top
from graspcast.errors import InputError
from graspcast.pose.transforms import exp, rotation_vector
from graspcast.simulation.grasps.tolerance import (
    Tolerance,
    error_in_grasp,
    measure_tolerance,
    tolerated_scale,
    unit_covariance,
)
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.outcome import Outcome
from graspcast.simulation.trial.trial import TrialRunner

GRASP = Grasp(from_top(0.025), "box", "parallel")


class Threshold(TrialRunner):
    """Trials that succeed within known bounds of the hand's displacement."""

    def __init__(self, grasp: Grasp) -> None:
        self.grasp = grasp

    def run(self, obj_T_est: np.ndarray, grasp: Grasp, **_: object) -> Outcome:
        pose = self.grasp.obj_T_grasp
        moved = np.linalg.inv(pose) @ obj_T_est @ pose
        x, y, z = 1e3 * moved[:3, 3]
        turn = np.rad2deg(rotation_vector(moved[:3, :3])[2])
        held = bool(abs(x) < 8 and abs(y) < 30 and -20 < z < 5 and abs(turn) < 25)
        return Outcome(held, "held" if held else "missed", 0.0, 0.0, 0.0, 0)


@pytest.fixture(scope="module")
def known() -> Tolerance:
    # A grasp whose frame is turned and away from the object's.
    grasp = Grasp(exp(np.array([0.02, -0.03, 0.1, 0.7, 2.0, -0.4])), "box", "parallel")
    return measure_tolerance(Threshold(grasp), grasp)


@pytest.mark.slow
def test_each_direction_is_measured_in_the_grasps_frame(known: Tolerance) -> None:
    expected = {
        ("shift", "closing", -1): 0.008,
        ("shift", "closing", 1): 0.008,
        ("shift", "across", -1): 0.030,
        ("shift", "across", 1): 0.030,
        ("shift", "approach", -1): 0.020,
        ("shift", "approach", 1): 0.005,
        ("turn", "approach", -1): np.deg2rad(25),
        ("turn", "approach", 1): np.deg2rad(25),
    }
    found = {(r.kind, r.axis, r.sign): r for r in known.reaches}
    assert len(found) == 12
    for key, size in expected.items():
        assert found[key].half.value == pytest.approx(size, rel=0.25), key
        assert found[key].ninety.value <= found[key].half.value
    for axis in ("closing", "across"):
        assert found["turn", axis, 1].ninety.value == found["turn", axis, 1].limit


def test_the_summary_names_the_smaller_side_and_what_has_no_end(known: Tolerance) -> None:
    assert known.smaller("shift", "approach").value == pytest.approx(0.005, rel=0.25)
    assert "more than 90° about the closing direction" in known.summary()


def test_a_deviation_along_one_axis_leaves_90_percent(known: Tolerance) -> None:
    # P(|N(0, s)| < 8 mm) is .9 at s = 8 / 1.645.
    assert known.deviations[0].value == pytest.approx(0.008 / 1.645, rel=0.25)
    low, high = 0.02 / known.deviations[2].value, 0.005 / known.deviations[2].value
    # One side alone decides: P(z < 5 mm) = .9 at s = 5 / 1.28, of which 20 mm is far.
    assert high == pytest.approx(1.28, rel=0.25) and low > 4


@pytest.mark.slow
def test_the_scale_is_that_at_which_90_percent_succeed(known: Tolerance) -> None:
    rng = np.random.default_rng(1)
    grasp = known.grasp
    runner = Threshold(grasp)
    draws = rng.standard_normal((4000, 6)) * np.repeat([1e-3, np.deg2rad(1)], 3)

    def rate(scale: float) -> float:
        return float(np.mean([runner.run(error_in_grasp(grasp, scale * d), grasp).success
                              for d in draws]))  # fmt: skip

    assert rate(known.scale.low) > 0.88
    assert rate(known.scale.high) < 0.92
    assert known.as_given.value > 0.9


def test_an_error_in_the_grasps_frame_moves_the_hand_by_it() -> None:
    error = np.array([0.004, -0.002, 0.009, 0.0, 0.0, 0.3])
    moved = np.linalg.inv(GRASP.obj_T_grasp) @ error_in_grasp(GRASP, error) @ GRASP.obj_T_grasp
    assert_allclose(moved[:3, 3], error[:3], atol=1e-12)
    assert_allclose(rotation_vector(moved[:3, :3]), error[3:], atol=1e-12)


def test_the_unit_covariance_is_that_of_unit_errors_of_the_hand() -> None:
    grasp = Grasp(exp(np.array([0.02, -0.03, 0.1, 0.7, 2.0, -0.4])), "box", "parallel")
    rng = np.random.default_rng(0)
    draws = rng.standard_normal((20_000, 6)) * np.repeat([1e-3, np.deg2rad(1)], 3)
    poses = np.stack([error_in_grasp(grasp, draw) for draw in draws[:4000]])
    as_numbers = np.concatenate([poses[:, :3, 3], rotation_vector(poses[:, :3, :3])], axis=1)
    expected, found = unit_covariance(grasp), np.cov(as_numbers.T)
    deviation = np.sqrt(np.diag(expected))
    assert_allclose(found / np.outer(deviation, deviation),
                    expected / np.outer(deviation, deviation), atol=0.06)  # fmt: skip


@pytest.mark.slow
def test_a_real_pair_is_as_wide_as_the_hand_and_repeatable() -> None:
    # Jaws that open to 80 mm, around a cube: neither finger comes down on it until it is off.
    runner = TrialRunner(brick(), load_gripper("parallel"))
    curve = tolerated_scale(runner, GRASP, trials=16)
    assert curve.crossing(0.9).value > 1.0
    again = tolerated_scale(runner, GRASP, trials=16)
    assert again.crossing(0.9) == curve.crossing(0.9)
    wide = tolerated_scale(runner, GRASP, 100 * unit_covariance(GRASP), trials=16)
    assert wide.crossing(0.5).value < curve.crossing(0.5).value


def test_what_cannot_be_measured_is_refused() -> None:
    runner = Threshold(GRASP)
    with pytest.raises(InputError, match="0 trials in a direction"):
        measure_tolerance(runner, GRASP, trials=0)
    with pytest.raises(InputError, match="mm²"):
        measure_tolerance(runner, GRASP, covariance=1e6 * unit_covariance(GRASP), trials=8)
