"""Mechanics of the Franka Hand."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.trial import TrialRunner
from solids import IDENTITY, box, from_above


@pytest.mark.parametrize("grip_n", [30.0, 60.0])
def test_each_finger_of_the_franka_hand_presses_with_the_set_force(grip_n: float) -> None:
    target = box(0.05, 0.06, 0.08)
    runner = TrialRunner(target, FrankaHand(grip_n=grip_n))
    scene, force = runner.scene, np.zeros(6)
    sums: list[dict[str, float]] = []

    def watch(model: mujoco.MjModel, data: mujoco.MjData, phase: str) -> None:
        totals = {"hand/left_pad": 0.0, "hand/right_pad": 0.0}
        for k in range(data.ncon):
            names = {model.geom(int(g)).name for g in data.contact.geom[k]}
            for pad in names & totals.keys():
                mujoco.mj_contactForce(model, data, k, force)
                totals[pad] += force[0]
        sums.append(totals)

    outcome = runner.run(IDENTITY, Grasp(from_above(target, 0.02), "box", "parallel"), record=watch)
    assert outcome.success
    for pad in ("hand/left_pad", "hand/right_pad"):
        assert sums[-1][pad] == pytest.approx(grip_n, rel=0.05)
    assert scene.data.actuator("hand/fingers").force[0] == pytest.approx(-grip_n)


def test_both_fingers_of_the_franka_hand_move_together_at_the_set_speed() -> None:
    runner = TrialRunner(box(), FrankaHand())
    course: list[tuple[float, float, float]] = []

    def watch(model: mujoco.MjModel, data: mujoco.MjData, phase: str) -> None:
        if phase == "close":
            left, right = (data.joint(f"hand/{side}").qpos[0] for side in ("left", "right"))
            course.append((data.time, left, right))

    # 10 cm too high: the fingers close on nothing.
    runner.run(
        IDENTITY, Grasp(from_above(box(), 0.13), "box", "parallel"), early_stop=False, record=watch
    )
    times, left, right = np.array(course).T
    np.testing.assert_allclose(left, right, atol=1e-4)
    under_way = (left < 0.035) & (left > 0.005)
    speed = np.polyfit(times[under_way], left[under_way], 1)[0]
    assert speed == pytest.approx(-0.05, rel=0.02)
    assert left[-1] == pytest.approx(0.0, abs=5e-4)


def test_the_franka_hand_centres_what_it_grips_off_centre() -> None:
    target = box(0.04, 0.04, 0.05)
    runner = TrialRunner(target, FrankaHand())
    grasp = Grasp(from_above(target, 0.0), "box", "parallel")
    outcome = runner.run(transform(np.eye(3), np.array([0.015, 0, 0])), grasp)
    assert outcome.success
    assert runner.scene.centroid_in_base()[1] == pytest.approx(0.0, abs=1e-3)


def test_the_franka_hand_grips_within_its_manual() -> None:
    for force in (10.0, 140.0):
        with pytest.raises(InputError, match="30 to 70 N"):
            FrankaHand(grip_n=force)


def test_an_object_wider_than_the_stroke_cannot_be_held() -> None:
    target = box(0.09, 0.09, 0.09)
    runner = TrialRunner(target, FrankaHand())
    outcome = runner.run(IDENTITY, Grasp(from_above(target, 0.02), "box", "parallel"))
    assert not outcome.success
