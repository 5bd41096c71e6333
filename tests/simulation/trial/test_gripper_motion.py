"""Which parts of a closing hand approach one another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspcast.simulation.grippers import TendonHand, load_gripper
from graspcast.simulation.trial.gripper_bench import ParkedHand, standing_column
from graspcast.simulation.trial.gripper_motion import ClosingMotion, closing_motion
from graspcast.simulation.trial.scene import Scene, build_scene
from graspcast.simulation.trial.settings import TrialSettings
from jaws import write_jaws


def closed(gripper: Any) -> tuple[Scene, list[np.ndarray], ClosingMotion | None]:
    hand = ParkedHand(build_scene(standing_column(0.05), gripper, TrialSettings()))
    hand.command(gripper.closing.open, 0.5)
    postures = hand.close(gripper.closing, 1.0)
    return hand.scene, postures, closing_motion(hand.scene, postures)


def names(scene: Scene, geoms: tuple[int, ...]) -> set[str]:
    return {scene.model.body(scene.model.geom_bodyid[g]).name for g in geoms}


def test_two_jaws_meet_along_their_slides(tmp_path: Path) -> None:
    scene, postures, motion = closed(load_gripper(write_jaws(tmp_path)))
    assert motion is not None
    assert np.abs(motion.axis) == pytest.approx([1, 0, 0], abs=1e-6)
    assert {frozenset(names(scene, side)) for side in (motion.first, motion.second)} == {
        frozenset({"hand/l"}),
        frozenset({"hand/r"}),
    }
    # Each of them moves by 45 mm.
    assert motion.nearer_m == pytest.approx(0.09, abs=2e-4)
    assert motion.still == pytest.approx([0, 0, -0.02], abs=1e-6)
    assert closing_motion(scene, postures[:1]) is None


def test_a_thumb_against_two_fingers() -> None:
    scene, _, motion = closed(TendonHand())
    assert motion is not None and not motion.all_sides
    assert np.abs(motion.axis) == pytest.approx([1, 0, 0], abs=1e-3)
    sides = [names(scene, side) for side in (motion.first, motion.second)]
    thumb, fingers = sorted(sides, key=len)
    assert all("thumb" in name for name in thumb)
    assert "hand/upper_distal" in fingers and "hand/lower_distal" in fingers
