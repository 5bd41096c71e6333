from __future__ import annotations

from dataclasses import fields, replace

import pytest

from graspcast.errors import InputError
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
        ({"lift_s": float("inf")}, "lift_s is inf; it must be at most 600"),
    ):
        with pytest.raises(InputError, match=message):
            replace(TrialSettings(), **wrong)


@pytest.mark.ill_typed
def test_every_setting_is_in_the_digest() -> None:
    settings = TrialSettings()
    other = {"integrator": "euler", "cone": "pyramidal", "condim": 3, "hand_touches_table": False}
    other |= {"solref": (0.012, 1.0), "solimp": (0.9, 0.95, 0.001)}
    digests = {settings.digest()}
    for field in fields(settings):
        value = other.get(field.name) or getattr(settings, field.name) * 1.5
        if field.name == "hand_touches_table":
            value = False
        digests.add(replace(settings, **{field.name: value}).digest())
    assert len(digests) == 1 + len(fields(settings))
    assert TrialSettings().digest() == settings.digest()
