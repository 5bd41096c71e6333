"""Tolerance of a grasp: how far off the pose may be, in each direction and about each axis.

Errors are expressed in the grasp's frame, that of the gripper's tool centre point: x is the
direction in which the fingers close, z the approach, y across both. An error of +5 mm along z means
that the estimate sends the hand 5 mm too deep. Every figure is from simulated trials.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.io.arguments import a, checked, whole
from graspcast.io.progress import Progress
from graspcast.pose.covariances import check_covariance
from graspcast.pose.transforms import compose, invert, rotation_from_vector, skew, transform
from graspcast.simulation.grasps.fall_off import Bounds, FallOff, bounds_of, measure_fall_off
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.trial import TrialRunner

__all__ = [
    "AXES",
    "Reach",
    "Tolerance",
    "error_in_grasp",
    "measure_tolerance",
    "tolerated_scale",
    "unit_covariance",
]

Kind = Literal["shift", "turn"]

AXES = ("closing", "across", "approach")
"""The axes x, y and z of a grasp's frame."""

_LIMITS: dict[Kind, float] = {"shift": 0.1, "turn": np.pi / 2}
_JITTER = np.repeat([1e-3, np.deg2rad(1.0)], 3) / np.sqrt(3)
_SCALE_LIMIT = 16.0
_FEWEST = 8


@dataclass(frozen=True)
class Reach:
    """How far an error of one kind may go, in one direction of a grasp's frame.

    Attributes
    ----------
    kind
        ``"shift"`` along an axis (metres) or ``"turn"`` about it (radians), about the TCP.
    axis
        One of :data:`AXES`.
    sign
        1 or -1.
    ninety, half
        Sizes of the error at which 90 % and 50 % of the trials succeed; at most ``limit``.
    limit
        The largest size that was tried: a value of this means that success never fell so far.
    trials
        Number of trials.
    """

    kind: Kind
    axis: str
    sign: int
    ninety: Bounds
    half: Bounds
    limit: float
    trials: int


@dataclass(frozen=True, eq=False)
class Tolerance:
    """The tolerance of a grasp of an object by a gripper.

    Attributes
    ----------
    grasp
        The grasp.
    held, of
        Successes and trials at the true pose, with a jitter of 1 mm and 1 degree (root mean
        squares).
    reaches
        The twelve directions: shifts along x, y, z, then turns about them, each first backwards.
    deviations
        For an error along or about one axis alone, normal with mean zero: the standard deviation
        at which 90 % of the trials succeed, in the order x, y, z (m), about x, y, z (rad).
    covariance
        The covariance that :attr:`scale` is of: shift (m) and rotation vector (rad) from the true
        object to the estimate, in the object's axes, (6, 6).
    scale
        The factor by which the standard deviations of that covariance may be multiplied so that
        90 % of the trials succeed, all six errors at once.
    as_given
        The success rate under the covariance itself.
    trials
        Number of all trials.
    """

    grasp: Grasp
    held: int
    of: int
    reaches: tuple[Reach, ...]
    deviations: tuple[Bounds, ...]
    covariance: Float[ndarray, "6 6"]
    scale: Bounds
    as_given: Bounds
    trials: int

    def smaller(self, kind: Kind, axis: str) -> Bounds:
        """Return the 90 % reach along or about an axis, that of the direction with less of it."""
        mine = [r.ninety for r in self.reaches if (r.kind, r.axis) == (kind, axis)]
        return min(mine, key=lambda bounds: bounds.value)

    def summary(self) -> str:
        """Say in one line how far off the pose may be: "8 mm along the closing direction, ..."."""
        shifts = [_told("shift", self.smaller("shift", axis)) for axis in AXES]
        turns = [_told("turn", self.smaller("turn", axis)) for axis in AXES]
        return (
            f"90 % succeed up to {shifts[0]} along the closing direction, {shifts[1]} across, "
            f"{shifts[2]} along the approach; {turns[2]} about the approach, {turns[0]} about the "
            f"closing direction, {turns[1]} about the axis across"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return all figures for JSON, in metres and radians."""
        deviations = zip(_KINDS_AND_AXES, self.deviations, strict=True)
        return {
            "object": self.grasp.object,
            "gripper": self.grasp.gripper,
            "grasp": self.grasp.name,
            "at_true_pose": {"held": self.held, "of": self.of},
            "reaches": [
                {
                    **{"kind": r.kind, "axis": r.axis, "sign": r.sign, "limit": r.limit},
                    **{"success_90": r.ninety._asdict(), "success_50": r.half._asdict()},
                    "trials": r.trials,
                }
                for r in self.reaches
            ],
            "deviations": [
                {"kind": kind, "axis": axis, **bounds._asdict()}
                for (kind, axis), bounds in deviations
            ],
            "covariance_obj": self.covariance.tolist(),
            "scale": self.scale._asdict(),
            "success_under_covariance": self.as_given._asdict(),
            "trials": self.trials,
        }


_KINDS_AND_AXES = tuple((kind, axis) for kind in _LIMITS for axis in AXES)


def _told(kind: Kind, bounds: Bounds) -> str:
    size = bounds.value
    beyond = "more than " if size >= _LIMITS[kind] else ""
    return beyond + (f"{1e3 * size:.2g} mm" if kind == "shift" else f"{np.rad2deg(size):.2g}°")


def error_in_grasp(grasp: Grasp, error: Float[ndarray, " 6"]) -> Float[ndarray, "4 4"]:
    """Return the estimate ``obj_T_est`` that displaces the hand by an error in the grasp's frame.

    Parameters
    ----------
    grasp
        The grasp.
    error
        Shift (m) and rotation vector (rad) of the tool centre point, in its own frame.
    """
    moved = transform(rotation_from_vector(error[3:]), error[:3])
    return compose(grasp.obj_T_grasp, moved, invert(grasp.obj_T_grasp))


def unit_covariance(grasp: Grasp) -> Float[ndarray, "6 6"]:
    """Return the covariance of errors of 1 mm and 1 degree on each axis of a grasp's frame.

    It is in the object's axes, about the object's origin, as
    :attr:`~graspcast.views.fusion.FusedPoses.covariance_obj`.
    """
    rotation, at = grasp.obj_T_grasp[:3, :3], grasp.obj_T_grasp[:3, 3]
    carry = np.zeros((6, 6))
    carry[:3, :3] = carry[3:, 3:] = rotation
    # A turn about the tool centre point also moves the object's origin.
    carry[:3, 3:] = skew(at) @ rotation
    variance = np.repeat([1e-3, np.deg2rad(1.0)], 3) ** 2
    return np.asarray(carry * variance @ carry.T)


def tolerated_scale(
    runner: TrialRunner,
    grasp: Grasp,
    covariance: Float[ndarray, "6 6"] | None = None,
    *,
    trials: int = 72,
    seed: int = 0,
    held: int = 0,
    of: int = 0,
) -> FallOff:
    """Measure how success falls as the standard deviations of a covariance grow by a factor.

    Each trial draws a normal error of its own. ``.crossing(0.9)`` of the result is the factor at
    which 90 % of the trials succeed: 3 means that the grasp withstands three times these standard
    deviations.

    Parameters
    ----------
    runner, grasp
        The trials, and the grasp.
    covariance
        Of shift (m) and rotation vector (rad) in the object's axes, (6, 6); :func:`unit_covariance`
        if None.
    trials
        Number of trials.
    seed
        Random seed.
    held, of
        Successes and trials at the true pose, if known.
    """
    covariance = unit_covariance(grasp) if covariance is None else covariance
    check_covariance(covariance)
    root = np.linalg.cholesky(covariance)
    rng = np.random.default_rng(seed)

    def tried(scale: float) -> bool:
        error = scale * root @ rng.standard_normal(6)
        estimate = transform(rotation_from_vector(error[3:]), error[:3])
        return runner.run(estimate, grasp).success

    return measure_fall_off(tried, _SCALE_LIMIT, trials, rng, held=held, of=of)


@checked(
    runner=(lambda value: hasattr(value, "run"), "a TrialRunner"),
    grasp=a(Grasp),
    covariance=a(np.ndarray),
    trials=whole(),
    seed=whole(0),
)
def measure_tolerance(
    runner: TrialRunner,
    grasp: Grasp,
    *,
    covariance: Float[ndarray, "6 6"] | None = None,
    trials: int = 24,
    seed: int = 0,
    progress: Progress | None = None,
) -> Tolerance:
    """Measure how far off the pose may be, in each direction of a grasp's frame, by simulation.

    In each of the twelve directions the size at which success falls to 90 and to 50 % is measured
    by :func:`.fall_off.measure_fall_off`; the other five errors are a jitter of 1 mm and 1 degree
    (root mean squares). Intervals are 90 % of the posterior.

    Parameters
    ----------
    runner, grasp
        The trials, and the grasp.
    covariance
        Of an estimate, as :func:`tolerated_scale` takes it.
    trials
        Trials in each direction; as many at the true pose, and three times as many for the scale.
    seed
        Random seed; the same seed gives the same figures.
    progress
        Called with the share done and what is measured.

    Raises
    ------
    InputError
        If there are fewer than 8 trials, or the covariance is none of a pose.
    """
    if trials < _FEWEST:
        raise InputError(
            f"{trials} trials in a direction say nothing; give at least {_FEWEST}",
            parameters=("trials",),
        )
    covariance = unit_covariance(grasp) if covariance is None else np.asarray(covariance)
    check_covariance(covariance)
    report = progress or (lambda share, text: None)
    rng = np.random.default_rng(seed)
    report(0.0, "at the true pose")
    held = sum(_tried(runner, grasp, np.zeros(6), rng) for _ in range(trials))
    curves: list[FallOff] = []
    for number, (kind, axis) in enumerate(_KINDS_AND_AXES):
        for sign in (-1, 1):
            report((1 + len(curves)) / 15, f"{kind} {'-+'[sign > 0]} {axis}")
            direction = sign * np.eye(6)[number]
            one = _along(runner, grasp, direction, rng)
            curves.append(measure_fall_off(one, _LIMITS[kind], trials, rng, held=held, of=trials))
    report(13 / 15, "all at once")
    scale = tolerated_scale(
        runner, grasp, covariance, trials=3 * trials, seed=seed, held=held, of=trials
    )
    report(1.0, "")
    pairs = list(zip(curves[::2], curves[1::2], strict=True))
    return Tolerance(
        grasp=grasp,
        held=held,
        of=trials,
        reaches=tuple(
            Reach(kind, axis, sign, c.crossing(0.9), c.crossing(0.5), c.limit, c.trials)
            for (kind, axis), pair in zip(_KINDS_AND_AXES, pairs, strict=True)
            for sign, c in zip((-1, 1), pair, strict=True)
        ),
        deviations=tuple(_deviation(*pair) for pair in pairs),
        covariance=covariance,
        scale=scale.crossing(0.9),
        as_given=bounds_of(scale.rates(np.array([1.0]))[:, 0]),
        trials=trials + sum(c.trials for c in curves) + scale.trials,
    )


def _tried(runner: TrialRunner, grasp: Grasp, error: ndarray, rng: np.random.Generator) -> bool:
    """Run a trial with an error in the grasp's frame and a jitter of its other components."""
    jitter = np.where(error == 0, _JITTER * rng.standard_normal(6), 0.0)
    return runner.run(error_in_grasp(grasp, error + jitter), grasp).success


def _along(
    runner: TrialRunner, grasp: Grasp, direction: ndarray, rng: np.random.Generator
) -> Callable[[float], bool]:
    return lambda size: _tried(runner, grasp, size * direction, rng)


def _deviation(back: FallOff, forth: FallOff) -> Bounds:
    """Return the standard deviation along an axis at which 90 % succeed, at most the limit."""
    # Mean success under |N(0, 1)| scaled, by its quantiles.
    from scipy.stats import halfnorm

    quantiles = halfnorm.ppf((np.arange(40) + 0.5) / 40)
    scales = back.limit * np.geomspace(1 / 400, 1, 160)
    sizes = (scales[:, None] * quantiles).ravel()
    rates = (back.rates(sizes) + _shuffled(forth.rates(sizes))) / 2
    success = rates.reshape(len(rates), len(scales), -1).mean(axis=2)
    enough = success >= 0.9
    # Success falls with the scale, so the number of scales that do names the last of them.
    last = enough.sum(axis=1) - 1
    return bounds_of(np.where(last >= 0, scales[np.maximum(last, 0)], 0.0))


def _shuffled(rates: ndarray) -> ndarray:
    """Pair the draws of one direction with those of the other at random, always the same way."""
    return np.asarray(rates[np.random.default_rng(0).permutation(len(rates))])
