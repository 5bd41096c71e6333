"""Search for a reference grasp whose simulated outcomes agree with observed ones.

1. Grasps are proposed from the object's shape and ranked by a geometric prediction of the outcomes
   of the train split.
2. The best proposals are compared in simulation by successive halving, on a stratified sample of
   the train split.
3. The best grasps are varied, and the variations compared, twice.
4. Friction and mass are varied coarsely, because outcomes hardly identify them.
5. Of the finalists that hold jittered perfect estimates, the one with the best agreement on the
   validation split is chosen.

The search does not see the test split.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import invert, transform_points
from graspcast.simulation.grasps.agreement import Agreement, agreement
from graspcast.simulation.grasps.evaluation import held_under_jitter
from graspcast.simulation.grasps.proposals import OpenHand, propose, surface_points, vary
from graspcast.simulation.grasps.sampling import LabelledTrials, StratifiedSample
from graspcast.simulation.grasps.table import Figure, ReferenceGrasp
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.load import with_physics
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.trial import TrialRunner, TrialSettings

__all__ = ["FittedGrasp", "SearchEffort", "fit_grasp"]

_SEARCH_LIFT_S = 3.0
_VARIATIONS = ((0.008, 0.15), (0.004, 0.07))
"""Standard deviations of position (m) and rotation (rad) in each round of variations."""
_COMPARISONS = 3 + len(_VARIATIONS)
_FRICTIONS = ((1.0, 0.25), (1.0, 0.5), (1.0, 1.5))
_NEARBY = ((1.0, 0.7), (1.0, 1.4), (0.5, 1.0), (2.0, 1.0))
"""Factors on mass and friction."""


@dataclass(frozen=True)
class SearchEffort:
    """Size of the search.

    Attributes
    ----------
    proposals
        Grasps proposed from the shape and ranked by geometry.
    candidates
        Number of them compared in simulation.
    variations
        Variations in each of the two rounds of refinement.
    first_trials
        Trials of each candidate in the first round of successive halving. Each further round has
        half of the candidates and twice the trials.
    last_trials
        Trials of each candidate in the last round.
    validation_trials
        Trials of each finalist on the validation split.
    """

    proposals: int = 600
    candidates: int = 24
    variations: int = 10
    first_trials: int = 8
    last_trials: int = 128
    validation_trials: int = 200

    def scaled(self, factor: float) -> SearchEffort:
        """Return a larger or smaller search: numbers of candidates and validation trials scaled."""
        scaled = {
            name: max(4, round(getattr(self, name) * factor))
            for name in ("candidates", "variations", "validation_trials")
        }
        return replace(self, **scaled)


@dataclass(frozen=True, eq=False)
class _Candidate:
    obj_T_grasp: Float[ndarray, "4 4"]
    mass_kg: float
    friction: float
    origin: str


@dataclass(frozen=True, eq=False)
class FittedGrasp:
    """Result of the search.

    Attributes
    ----------
    reference
        The grasp, with the mass and friction with which it was found.
    train, validation
        Agreement on the two splits; on the train split weighted as in the search.
    held
        Successes among 20 perfect estimates with a jitter of 1 mm and 1 degree.
    candidates
        Number of grasps, frictions and masses tried in simulation.
    trials
        Number of trials simulated.
    """

    reference: ReferenceGrasp
    train: Agreement
    validation: Agreement
    held: int
    candidates: int
    trials: int

    def with_test(self, test: Agreement, seed: int) -> ReferenceGrasp:
        """Return the entry for a table of grasps, with the agreement on all three splits."""
        splits = {"train": self.train, "validation": self.validation, "test": test}
        figures: dict[str, Figure] = {
            f"{name}_{key}": round(getattr(found, key), 4)
            for name, found in splits.items()
            for key in ("accuracy", "kappa", "majority", "n")
        }
        figures |= {"perfect_held_of_20": self.held, "candidates": self.candidates}
        figures |= {"trials": self.trials, "seed": seed}
        return replace(self.reference, agreement=figures)


def fit_grasp(
    grasp_object: GraspObject,
    gripper: Gripper,
    train: LabelledTrials,
    validation: LabelledTrials,
    *,
    seed: int = 0,
    effort: SearchEffort | None = None,
    start: Sequence[Float[ndarray, "4 4"]] = (),
    require_perfect_hold: bool = True,
    settings: TrialSettings | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> FittedGrasp:
    """Find the reference grasp whose simulated outcomes agree best with observed ones.

    Parameters
    ----------
    grasp_object
        The object, with initial mass and friction.
    gripper
        The gripper.
    train
        Trials to search on.
    validation
        Trials to choose among the finalists.
    seed
        Random seed; the same seed finds the same grasp.
    effort
        Size of the search; the defaults if None.
    start
        Grasps (``obj_T_grasp``) to compare with the proposals.
    require_perfect_hold
        Whether a grasp must hold a perfect estimate. If trials with nearly no error failed, no such
        grasp can agree with them.
    settings
        How the trials are run; the robot's protocol if None. The search shortens the lift to 3 s.
    progress
        Called with the share done and a short message.

    Raises
    ------
    InputError
        If a split has no trials, or no grasp holds a perfect estimate.
    """
    for name, trials in (("train", train), ("validation", validation)):
        if not len(trials):
            raise InputError(
                f"{grasp_object.name} by {gripper.name}: no outcomes in the {name} split; "
                "the search needs some in train and in validation. Without outcomes of real "
                "trials, propose grasps instead (propose_grasps)",
                parameters=("outcomes",),
            )
    chosen = settings or TrialSettings.robot(gripper)
    search = _Search(grasp_object, gripper, train, seed, require_perfect_hold, chosen, progress)
    return search.run(validation, effort or SearchEffort(), start)


@dataclass(eq=False)
class _Search:
    grasp_object: GraspObject
    gripper: Gripper
    train: LabelledTrials
    seed: int
    require_perfect_hold: bool
    settings: TrialSettings
    progress: Callable[[float, str], None] | None
    trials: int = 0
    comparisons: int = 0
    _runners: dict[tuple[float, float, bool], TrialRunner] = field(default_factory=dict)
    _results: dict[_Candidate, dict[int, bool]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.sample = StratifiedSample(self.train, self.rng)

    def run(
        self, validation: LabelledTrials, effort: SearchEffort, start: Sequence[ndarray]
    ) -> FittedGrasp:
        best = self._compare(self._first(effort, start), effort, keep=3)
        best = self._compare([*best, *self._physics(best[0], _FRICTIONS)], effort, keep=3)
        for shift_m, turn_rad in _VARIATIONS:
            variations = [
                self._candidate(
                    vary(parent.obj_T_grasp, shift_m, turn_rad, self.rng),
                    f"{parent.origin}, varied" if ", varied" not in parent.origin else None,
                    parent,
                )
                for parent in (best[i % len(best)] for i in range(3 * effort.variations))
            ]
            holding = self._holding(variations, effort.variations)
            best = self._compare([*best, *holding], effort, keep=3)
        best = self._compare([*best, *self._physics(best[0], _NEARBY)], effort, keep=2)
        return self._choose(best, validation, effort)

    def _physics(
        self, like: _Candidate, factors: Sequence[tuple[float, float]]
    ) -> list[_Candidate]:
        """Return the grasp with other masses and frictions, where it holds a perfect estimate."""
        others = [
            replace(like, mass_kg=like.mass_kg * m, friction=like.friction * f) for m, f in factors
        ]
        return self._holding(others, len(others))

    def _candidate(
        self, pose: ndarray, origin: str | None = None, like: _Candidate | None = None
    ) -> _Candidate:
        mass = like.mass_kg if like else self.grasp_object.mass_kg
        friction = like.friction if like else self.grasp_object.friction
        return _Candidate(pose, mass, friction, origin or (like.origin if like else ""))

    def _first(self, effort: SearchEffort, start: Sequence[ndarray]) -> list[_Candidate]:
        """Return the first candidates: start grasps, and the best proposals by geometry."""
        runner = self._runner(self.grasp_object.mass_kg, self.grasp_object.friction)
        hand = OpenHand.of(runner.scene, self.gripper)
        points = surface_points(self.grasp_object, 4000, self.rng)
        proposals = propose(self.grasp_object, hand, effort.proposals, self.rng, points)
        rows, weights = self.sample.take(120)
        seen = transform_points(invert(self.train.obj_T_est[rows]), points[:300])
        success = self.train.success[rows]
        ranked = sorted(
            range(len(proposals)),
            key=lambda i: (
                -max(
                    _score(agreement(hand.predict(proposals[i], seen, depth), success, weights))
                    for depth in (0.001, 0.004)
                ),
                i,
            ),
        )
        given = [self._candidate(np.array(pose), "given") for pose in start]
        proposed = [self._candidate(proposals[i], "proposed") for i in ranked]
        out = self._holding(given, len(given)) + self._holding(proposed, effort.candidates)
        if not out:
            raise InputError(
                f"no grasp of {self.grasp_object.name!r} by {self.gripper.name!r} holds a perfect "
                f"estimate: {len(proposed)} proposed, {len(given)} given; is the object "
                "narrower than the gripper opens, in some direction?",
                parameters=("require_perfect_hold",),
            )
        return out

    def _holding(self, candidates: Sequence[_Candidate], count: int) -> list[_Candidate]:
        """Return the first ``count`` that hold a perfect estimate and four jittered ones."""
        if not self.require_perfect_hold:
            return list(candidates[:count])
        out: list[_Candidate] = []
        for candidate in candidates:
            if len(out) == count:
                break
            runner = self._runner(candidate.mass_kg, candidate.friction)
            self.trials += 1
            if not runner.run(np.eye(4), self._grasp(candidate)).success:
                continue
            self.trials += 4
            if held_under_jitter(runner, self._grasp(candidate), 4) == 4:
                out.append(candidate)
        return out

    def _compare(
        self, candidates: list[_Candidate], effort: SearchEffort, keep: int
    ) -> list[_Candidate]:
        """Compare by successive halving: half of the candidates and twice the trials a round."""
        trials = effort.first_trials
        while True:
            found = [(self._agreement(c, trials), c) for c in candidates]
            found.sort(key=lambda pair: -_score(pair[0]))
            candidates = [c for _, c in found]
            if self.progress is not None:
                best = found[0][0].accuracy
                self.progress(
                    self.comparisons / _COMPARISONS,
                    f"{len(candidates)} candidates, {trials} trials each, best {best:.3f}",
                )
            if trials >= effort.last_trials:
                self.comparisons += 1
                return candidates[:keep]
            trials = min(2 * trials, effort.last_trials)
            candidates = candidates[: max(keep, len(candidates) // 2)]

    def _agreement(self, candidate: _Candidate, trials: int) -> Agreement:
        rows, weights = self.sample.take(trials)
        known = self._results.setdefault(candidate, {})
        runner = self._runner(candidate.mass_kg, candidate.friction)
        for row in rows.tolist():
            if row not in known:
                self.trials += 1
                estimate = self.train.obj_T_est[row]
                known[row] = runner.run(estimate, self._grasp(candidate)).success
        return agreement(np.array([known[r] for r in rows]), self.train.success[rows], weights)

    def _choose(
        self, finalists: list[_Candidate], validation: LabelledTrials, effort: SearchEffort
    ) -> FittedGrasp:
        """Return the finalist that holds most jittered estimates; of equals, the best agreement."""
        rows, weights = StratifiedSample(validation, self.rng).take(effort.validation_trials)
        out = []
        for candidate in finalists:
            grasp = self._grasp(candidate)
            full = self._runner(candidate.mass_kg, candidate.friction, full=True)
            held = held_under_jitter(full, grasp)
            runner = self._runner(candidate.mass_kg, candidate.friction)
            simulated = [runner.run(validation.obj_T_est[r], grasp).success for r in rows]
            self.trials += 20 + len(rows)
            found = agreement(np.array(simulated), validation.success[rows], weights)
            out.append((held, found, candidate))
        held, chosen, best = max(
            out, key=lambda item: (item[0] if self.require_perfect_hold else 0, _score(item[1]))
        )
        return FittedGrasp(
            reference=ReferenceGrasp(
                grasp=self._grasp(best),
                provenance=f"searched on observed outcomes; {best.origin}",
                mass_kg=best.mass_kg,
                friction=best.friction,
            ),
            train=self._agreement(best, effort.last_trials),
            validation=chosen,
            held=held,
            candidates=len(self._results),
            trials=self.trials,
        )

    def _grasp(self, candidate: _Candidate) -> Grasp:
        return Grasp(candidate.obj_T_grasp, self.grasp_object.name, self.gripper.name)

    def _runner(self, mass_kg: float, friction: float, full: bool = False) -> TrialRunner:
        key = (mass_kg, friction, full)
        if key not in self._runners:
            lift_s = self.settings.lift_s if full else min(self.settings.lift_s, _SEARCH_LIFT_S)
            self._runners[key] = TrialRunner(
                with_physics(self.grasp_object, mass_kg=mass_kg, friction=friction),
                self.gripper,
                replace(self.settings, lift_s=lift_s),
            )
        return self._runners[key]


def _score(found: Agreement) -> float:
    """Return the objective: the mean of accuracy and kappa, or accuracy if kappa is undefined."""
    one_sided = found.majority > 1 - 1e-9
    return found.accuracy if one_sided else 0.5 * (found.accuracy + found.kappa)
