"""Proposed grasps: found from an object's shape, tried in simulation, ranked under pose errors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.io.arguments import a, checked, sequence, whole
from graspcast.io.progress import Progress
from graspcast.pose.transforms import invert, transform_points
from graspcast.simulation.grasps.candidates import Candidates, candidates_of
from graspcast.simulation.grasps.diversity import Spacing, hand_symmetries
from graspcast.simulation.grasps.no_grasp import why_no_grasp
from graspcast.simulation.grasps.pose_files import GraspPoses
from graspcast.simulation.grasps.pose_frames import PoseFrame, check_pose_frame
from graspcast.simulation.grasps.proposals import OpenHand, surface_points
from graspcast.simulation.grasps.ranking import Effort, RankedGrasp, rank_grasps
from graspcast.simulation.grasps.table import Figure, ReferenceGrasp
from graspcast.simulation.grasps.trial_pool import TrialPool
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.trial import TrialSettings

__all__ = ["APART_M", "APART_RAD", "ImportedPoses", "ProposedGrasps", "propose_grasps"]

APART_M, APART_RAD = 0.015, np.deg2rad(20.0)
"""Two kept grasps are at least this far apart, in position or in rotation."""

_SEARCH_LIFT_S = 3.0
_LOOKED_AT, _POINTS = 24, 200
_MOST_ERRORS = 1000


@dataclass(frozen=True, eq=False)
class ProposedGrasps:
    """Grasps of an object by a gripper, the best first, and how they were found.

    Attributes
    ----------
    grasps
        The grasps with their names.
    ranked
        Their trials, in the same order.
    errors
        The pose errors under which they were tried, in the order of the trials.
    tried
        Number of grasps tried in simulation.
    trials
        Number of trials.
    rejected
        Number of proposals that were left out before, by reason.
    reasons
        Outcomes at the true pose, by reason.
    seed
        Random seed.
    """

    grasps: tuple[Grasp, ...]
    ranked: tuple[RankedGrasp, ...]
    errors: Float[ndarray, "n 4 4"]
    tried: int
    trials: int
    rejected: Counter[str]
    reasons: Counter[str]
    seed: int

    def figures(self, number: int) -> dict[str, Figure]:
        """Return the figures of a grasp, by name.

        ``success_under_error`` with its 90 % interval (``success_low``, ``success_high``) over
        ``trials``; ``perfect_held`` of ``perfect_of`` jittered true poses; ``survived_rms_…``, the
        root mean square of the errors that it survived, of the hand in the grasp's frame.
        """
        found = self.ranked[number]
        low, high = found.interval
        figures: dict[str, Figure] = {
            "success_under_error": round(found.rate, 4),
            "success_low": round(low, 4),
            "success_high": round(high, 4),
            "trials": len(found.success),
            "perfect_held": found.held,
            "perfect_of": found.of,
        }
        survived = found.survived_deviations(self.errors)
        if np.isfinite(survived).all():
            figures |= {
                f"survived_rms_{axis}_mm": round(1e3 * float(value), 2)
                for axis, value in zip("xyz", survived[:3], strict=True)
            }
            figures |= {
                f"survived_rms_about_{axis}_deg": round(float(np.degrees(value)), 2)
                for axis, value in zip("xyz", survived[3:], strict=True)
            }
        return figures

    def as_references(
        self, errors: str, *, mass_kg: float | None = None, friction: float | None = None
    ) -> list[ReferenceGrasp]:
        """Return the entries for a table of grasps.

        Parameters
        ----------
        errors
            Where the pose errors come from, in words.
        mass_kg, friction
            Written with each grasp, where they are not the catalogue's.
        """
        common: dict[str, Figure] = {
            "errors": errors,
            "candidates": self.tried,
            "trials_in_all": self.trials,
            "seed": self.seed,
        }
        return [
            ReferenceGrasp(
                grasp,
                f"proposed by graspcast propose-grasps; {ranked.origin}",
                mass_kg=mass_kg,
                friction=friction,
                agreement=self.figures(number) | common,
            )
            for number, (grasp, ranked) in enumerate(zip(self.grasps, self.ranked, strict=True))
        ]


@dataclass(frozen=True, eq=False)
class ImportedPoses:
    """Grasps from elsewhere, and the frame that they are said to be in.

    Attributes
    ----------
    poses
        The poses as their file has them.
    frame
        What they are poses of; checked by trials at the true pose.
    """

    poses: GraspPoses
    frame: PoseFrame

    def candidates(self, pool: TrialPool) -> Candidates:
        """Return the grasps, after the check; raises as ``check_pose_frame``."""
        check_pose_frame(pool, self.poses.obj_T_hand, self.frame)
        grasps = self.frame.obj_T_grasp(self.poses.obj_T_hand, pool.gripper)
        return Candidates(grasps, tuple(f"imported, {n}" for n in self.poses.names), float("nan"))


@checked(
    grasp_object=a(GraspObject),
    gripper=(lambda value: hasattr(value, "base_T_tcp"), "a gripper (load_gripper)"),
    errors=a(np.ndarray),
    count=whole(),
    seed=whole(0),
    symmetries=a(np.ndarray),
    known=sequence(a(Grasp)),
)
def propose_grasps(
    grasp_object: GraspObject,
    gripper: Gripper,
    errors: Float[ndarray, "n 4 4"],
    *,
    count: int = 30,
    seed: int = 0,
    effort: Effort | None = None,
    settings: TrialSettings | None = None,
    symmetries: Float[ndarray, "s 4 4"] | None = None,
    known: Sequence[Grasp] = (),
    poses: ImportedPoses | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> ProposedGrasps:
    """Find grasps of an object by a gripper that succeed under pose errors.

    Grasps are proposed from the object's shape, or given; those that the open hand reaches are
    tried at the true pose; those that hold are ranked by their success under the errors
    (:mod:`~graspcast.simulation.grasps.ranking`). The same seed finds the same grasps, whatever the
    number of workers.

    Parameters
    ----------
    grasp_object
        The object, with a closed mesh.
    gripper
        The gripper.
    errors
        Pose errors ``obj_T_est``, estimates in the true object's frame.
    count
        Largest number of grasps.
    seed
        Random seed.
    effort
        Size of the search; the default if None.
    settings
        How the trials are run; the robot's protocol if None. Lifts are shortened to 3 s.
    symmetries
        Symmetries of the object, with the identity; grasps that differ by one are the same. None if
        there is none.
    known
        Grasps that are tried too, and kept under their names, however good they are.
    poses
        Grasps from elsewhere, which are tried in place of proposals.
    workers
        Number of threads; all usable cores if None.
    progress
        Called with the share done and a short message.

    Raises
    ------
    InputError
        If no grasp is found; the message says why. If the object has no mesh, ``count`` is below 1,
        or there are no errors.
    MismatchError
        If grasps from elsewhere are not in the frame that is stated, or known grasps are of another
        object or gripper.
    """
    _check(grasp_object, gripper, errors, count, known)
    chosen = settings or TrialSettings.robot(gripper)
    chosen = replace(chosen, lift_s=min(chosen.lift_s, _SEARCH_LIFT_S))
    pool = TrialPool(grasp_object, gripper, chosen, workers)
    rng = np.random.default_rng(seed)
    errors = errors[rng.permutation(len(errors))[:_MOST_ERRORS]]
    hand = OpenHand.of(pool.scene, gripper)
    spacing = Spacing(
        APART_M,
        APART_RAD,
        np.eye(4)[None] if symmetries is None else symmetries,
        hand_symmetries(hand),
    )
    effort = effort or Effort()
    if poses is None:
        candidates = candidates_of(pool, hand, rng)
        rows = _promising(candidates, pool, hand, errors, spacing, effort.candidates, rng)
    else:
        candidates = poses.candidates(pool)
        rows = list(range(len(candidates)))
    given = [RankedGrasp(grasp.obj_T_grasp, grasp.name) for grasp in known]
    proposed = [RankedGrasp(candidates.obj_T_grasp[row], candidates.origin[row]) for row in rows]
    ranking = rank_grasps(
        pool,
        [*given, *proposed],
        errors,
        spacing,
        rng,
        count=count,
        effort=effort,
        fixed=len(given),
        progress=progress,
    )
    if len(ranking.grasps) == len(given):
        raise InputError(why_no_grasp(grasp_object, gripper, candidates, ranking.reasons))
    names = _names(ranking.grasps, given, known)
    return ProposedGrasps(
        tuple(
            Grasp(found.obj_T_grasp, grasp_object.name, gripper.name, name)
            for name, found in zip(names, ranking.grasps, strict=True)
        ),
        ranking.grasps,
        errors,
        ranking.tried,
        pool.trials,
        candidates.rejected,
        ranking.reasons,
        seed,
    )


def _check(
    grasp_object: GraspObject,
    gripper: Gripper,
    errors: ndarray,
    count: int,
    known: Sequence[Grasp],
) -> None:
    if count < 1:
        raise InputError(f"count is {count}; give at least 1", parameters=("count",))
    if not len(errors):
        raise InputError("there are no pose errors to try grasps under", parameters=("errors",))
    if errors.shape[1:] != (4, 4):
        raise InputError(f"the pose errors have the shape {errors.shape}, not (n, 4, 4)")
    for grasp in known:
        if (grasp.object, grasp.gripper) != (grasp_object.name, gripper.name):
            raise MismatchError(
                f"a known grasp is of {grasp}, not of {grasp_object.name!r} by {gripper.name!r}",
                parameters=("grasps",),
            )
    if not len(grasp_object.faces):
        raise InputError(f"object {grasp_object.name!r} has no mesh to propose grasps from")


def _names(
    ranked: Sequence[RankedGrasp], given: Sequence[RankedGrasp], known: Sequence[Grasp]
) -> list[str]:
    """Return the names of known grasps, and g01, g02, … for the others, the best first."""
    own = {id(grasp): named.name for grasp, named in zip(given, known, strict=True)}
    taken = set(own.values())
    width = max(2, len(str(len(ranked))))
    free = (
        name
        for name in (f"g{number:0{width}d}" for number in range(1, 10 * len(ranked) + 100))
        if name not in taken
    )
    return [own[id(grasp)] if id(grasp) in own else next(free) for grasp in ranked]


def _promising(
    candidates: Candidates,
    pool: TrialPool,
    hand: OpenHand,
    errors: Float[ndarray, "n 4 4"],
    spacing: Spacing,
    count: int,
    rng: np.random.Generator,
) -> list[int]:
    """Choose candidates to try: most by geometry, the others at random, all different."""
    if not len(candidates):
        return []
    points = surface_points(pool.grasp_object, _POINTS, rng)
    seen = transform_points(invert(errors[:_LOOKED_AT]), points)
    poses = candidates.obj_T_grasp
    predicted = pool.map(lambda _, pose: float(hand.predict(pose, seen, 0.002).mean()), list(poses))
    closer = replace(spacing, apart_m=spacing.apart_m / 2, apart_rad=spacing.apart_rad / 2)
    order = np.argsort(-np.array(predicted), kind="stable")
    best = order[closer.spread(poses[order], 2 * count // 3)]
    others = rng.permutation(np.setdiff1d(np.arange(len(poses)), best))
    rows = np.concatenate([best, others])
    return [int(rows[k]) for k in closer.spread(poses[rows], count, kept=len(best))]
