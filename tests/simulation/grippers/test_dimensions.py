from __future__ import annotations

import mujoco
import pytest

from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.grippers.dimensions import hand_size_m, size_problem


def _hand(scale: float, floor: str = "") -> mujoco.MjModel:
    """Compile a hand of one box, 120 x 60 x 40 mm at scale 1."""
    size = f"{0.06 * scale} {0.03 * scale} {0.02 * scale}"
    body = f"<body name='hand'><geom type='box' size='{size}'/></body>"
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{floor}{body}</worldbody></mujoco>")


def test_the_size_is_that_of_the_largest_side() -> None:
    assert hand_size_m(_hand(1.0)) == pytest.approx(0.12)
    floor = "<geom type='plane' size='5 5 .1'/>"
    assert hand_size_m(_hand(1.0, floor)) == pytest.approx(0.12)


@pytest.mark.parametrize("opening", [0.01, 0.09, 0.25])
def test_openings_that_fit_the_hand(opening: float) -> None:
    assert size_problem(_hand(1.0), opening) == ""
    assert size_problem(FrankaHand().spec().compile(), 0.08) == ""


@pytest.mark.parametrize(
    ("scale", "opening", "message"),
    [
        (1.0, 90.0, "max_opening_m is 90 m, but the hand is 120 mm across; is it in millimetres"),
        (1.0, 9.0, "is it in centimetres (90 mm)"),
        (1.0, 3.5, "in inches (88.9 mm)"),
        (1.0, 1e-4, "max_opening_m is 0.1 mm, but"),
        (
            1000.0,
            0.09,
            "the hand's model is 120 m, but hands are 20 mm to 3 m across; is it in mil",
        ),
        (0.001, 0.09, "the hand's model is 0.12 mm, but"),
    ],
)
def test_an_opening_or_a_hand_in_another_unit(scale: float, opening: float, message: str) -> None:
    assert message in size_problem(_hand(scale), opening)


@pytest.mark.parametrize("field", ["body_mass", "geom_size", "actuator_gainprm"])
def test_values_that_are_not_finite(field: str) -> None:
    model = FrankaHand().spec().compile()
    getattr(model, field)[-1] = float("nan")
    assert size_problem(model, 0.08) == (
        f"the hand's model has values of {field} that are not finite numbers"
    )
