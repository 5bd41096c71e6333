from __future__ import annotations

from dataclasses import fields, replace

import pytest

from graspcast.errors import InputError
from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.grippers.protocol import ApproachLimits
from graspcast.simulation.trial.trial import TrialSettings


def test_settings_that_cannot_work_are_refused() -> None:
    for wrong, message in (
        ({"timestep": 0.0}, "timestep is 0.0; it must be > 0"),
        ({"settle_s": -1.0}, "settle_s is -1.0"),
        ({"timestep": 0.008}, "below twice the timestep"),
        ({"lift_speed": 0.001}, "too low to detect a failure"),
        ({"lift_ramp_s": 20.0}, "must be below lift_s"),
        ({"standoff_m": 100.0}, r"standoff_m is 100 m, but .*in millimetres \(100 mm\)"),
        ({"tolerance_m": 5.0}, r"tolerance_m is 5.00 m, but .*in centimetres \(50 mm\)"),
        ({"approach_speed": 100.0}, "approach_speed is 100.0; it must be at most 10"),
        ({"contact_force_n": 0.0}, "contact_force_n is 0.0; it must be > 0, or None for no limit"),
        ({"contact_force_n": float("nan")}, "contact_force_n is nan; it must be > 0"),
        ({"contact_force_n": 1e7}, r"contact_force_n is 10000000.0; it must be at most 1e\+06"),
        ({"contact_s": -0.1}, "contact_s is -0.1; it must be >= 0"),
        ({"contact_s": 20.0}, "contact_s is 20.0; it must be at most 10"),
        ({"short_m": -0.001}, "short_m is -0.001; it must be > 0"),
        ({"short_m": 5.0}, r"short_m is 5.00 m, but .*in millimetres \(5 mm\)"),
        ({"lift_s": float("inf")}, "lift_s is inf; it must be at most 600"),
        ({"solver": (-1.0, "dense")}, "solver has the tolerance -1.0; it must be between 0 and 1"),
    ):
        with pytest.raises(InputError, match=message):
            replace(TrialSettings(), **wrong)


@pytest.mark.ill_typed
def test_every_setting_is_in_the_digest() -> None:
    settings = TrialSettings()
    other = {"integrator": "euler", "cone": "pyramidal", "condim": 3, "hand_touches_table": False}
    other |= {"solref": (0.012, 1.0), "solimp": (0.9, 0.95, 0.001), "goal_overlap_m": 0.002}
    other |= {"solver": (1e-9, "dense"), "grip_solver": (1e-14, "dense")}
    digests = {settings.digest()}
    for field in fields(settings):
        value = other.get(field.name) or getattr(settings, field.name) * 1.5
        if field.name == "hand_touches_table":
            value = False
        digests.add(replace(settings, **{field.name: value}).digest())
    assert len(digests) == 1 + len(fields(settings))
    assert TrialSettings().digest() == settings.digest()


def test_the_paper_s_protocol_sets_no_limit_of_contact_and_its_digest_knows_none() -> None:
    paper, robot = TrialSettings.paper(), TrialSettings.robot()
    assert (paper.protocol, robot.protocol) == ("paper", "robot")
    assert robot == TrialSettings() and paper.contact_force_n is None and paper.short_m is None
    assert "contact_s" not in paper.as_dict() and "contact_s" in robot.as_dict()
    assert replace(paper, contact_s=0.2).digest() == paper.digest() != robot.digest()
    assert replace(paper, short_m=0.01).protocol == "robot"
    assert replace(paper, goal_overlap_m=None).protocol == "paper"
    assert "goal_overlap_m" in paper.as_dict() and "goal_overlap_m" not in robot.as_dict()


@pytest.mark.ill_typed
def test_a_gripper_s_limits_replace_the_defaults_and_given_ones_replace_both() -> None:
    class Careful:
        approach = ApproachLimits(force_n=15.0)

    default = TrialSettings()
    own = TrialSettings.robot(Careful())  # type: ignore[arg-type]
    assert (own.contact_force_n, own.short_m) == (15.0, default.short_m)
    both = TrialSettings.robot(Careful(), contact_force_n=90.0, short_m=0.02)  # type: ignore[arg-type]
    assert (both.contact_force_n, both.short_m) == (90.0, 0.02)
    assert TrialSettings.robot(FrankaHand()) == default
