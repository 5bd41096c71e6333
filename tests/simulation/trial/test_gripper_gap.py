"""The gap between the fingers, by rays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspcast.simulation.grippers import FrankaHand, load_gripper
from graspcast.simulation.trial.gripper_bench import ParkedHand, standing_column
from graspcast.simulation.trial.gripper_gap import Gap, gap_of
from graspcast.simulation.trial.gripper_motion import closing_motion
from graspcast.simulation.trial.scene import build_scene
from graspcast.simulation.trial.settings import TrialSettings
from jaws import write_jaws


def gap(gripper: object) -> Gap:
    hand = ParkedHand(build_scene(standing_column(0.04), gripper, TrialSettings()))  # type: ignore[arg-type]
    hand.command(gripper.closing.open, 0.5)  # type: ignore[attr-defined]
    postures = hand.close(gripper.closing, 1.0)  # type: ignore[attr-defined]
    motion = closing_motion(hand.scene, postures)
    assert motion is not None
    found = gap_of(hand.scene, postures, motion)
    assert found is not None
    return found


def test_the_gap_of_jaws_is_in_the_frame_of_the_base(tmp_path: Path) -> None:
    # The pads reach from 0 to 60 mm along z; objects reach into the hand by half of 94 mm.
    found = gap(load_gripper(write_jaws(tmp_path, off=0.004)))
    assert found.centre[:2] == pytest.approx([0.004, 0], abs=2e-4)
    assert found.opening_m == pytest.approx(0.094, abs=2e-4)
    assert found.approach == pytest.approx([0, 0, 1], abs=0.1)
    assert found.tip_m == pytest.approx(0.06, abs=1e-3)
    assert found.high_m == pytest.approx(0.06, abs=2e-3)
    assert found.low_m == pytest.approx(0.06 - 0.047, abs=3e-3)


def test_pads_touch_and_not_the_links_behind_them() -> None:
    hand = FrankaHand()
    found = gap(hand)
    # Pads of 17 mm, of which the TCP is the middle; the links behind are 19 mm farther apart.
    assert found.opening_m == pytest.approx(hand.max_opening_m, abs=5e-4)
    assert found.centre == pytest.approx(hand.base_T_tcp[:3, 3], abs=1.5e-3)
    assert (found.low_m, found.high_m) == pytest.approx((0.0949, 0.1114), abs=2e-3)
    assert np.abs(found.approach) == pytest.approx([0, 0, 1], abs=1e-3)
