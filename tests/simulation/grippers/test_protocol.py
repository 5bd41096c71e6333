from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from graspcast.simulation.grippers import GRIPPERS, FrankaHand, TendonHand, load_gripper
from graspcast.simulation.grippers.protocol import Equilibrium, Gripper, gripper_digest

THREE_JAW = Path(__file__).parents[2] / "data" / "three_jaw.toml"


def test_every_gripper_satisfies_the_protocol() -> None:
    for name in (*GRIPPERS, THREE_JAW):
        assert isinstance(load_gripper(name), Gripper)


def test_digests_follow_the_model_and_the_commands() -> None:
    hands = [
        FrankaHand(),
        FrankaHand(grip_n=50.0),
        FrankaHand(finger_speed=0.04),
        TendonHand(),
        TendonHand(pulleys_m=(0.010, 0.005)),
        load_gripper(THREE_JAW),
        replace(load_gripper(THREE_JAW), equilibrium=Equilibrium(limit_s=1.0)),
    ]
    assert len({gripper_digest(hand) for hand in hands}) == len(hands)
    assert gripper_digest(FrankaHand()) == gripper_digest(FrankaHand())
