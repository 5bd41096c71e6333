"""Search for a reference grasp under which simulated outcomes agree with given ones.

Proposals from the object's shape are ranked by geometry alone on the given outcomes of the fit
part, the best of them race in simulation (successive halving on a stratified sample, hard failures
over-represented and weighted back), the winners are varied and race again, twice; then friction
and mass are tried, coarsely, since outcomes hardly identify them. The finalists hold a perfect
estimate under jitter, and the choose part decides among them. The search is given these two parts
and no other: what it finds is reported on the third part by whoever called it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import exp, invert, transform_points
from graspcast.simulation.grasps.agreement import Agreement, agreement
from graspcast.simulation.grasps.proposals import OpenHand, propose, surface_points, vary
from graspcast.simulation.grasps.sampling import FittedTrials, StratifiedSample
from graspcast.simulation.grasps.table import ReferenceGrasp
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.load import with_physics
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.trial import TrialRunner, TrialSettings

__all__ = [
    "FittedGrasp",
    "SearchEffort",
    "fit_grasp",
    "jitter_held",
    "report_grasp",
    "simulated",
]

_SEARCH_LIFT_S = 3.0
_VARIATIONS = ((0.008, 0.15), (0.004, 0.07))
"""Standard deviations of position (m) and rotation (rad) in each round of refinement."""
_RACES = 3 + len(_VARIATIONS)
_SURFACES = ((1.0, 0.25), (1.0, 0.5), (1.0, 1.5))
_NEARBY = ((1.0, 0.7), (1.0, 1.4), (0.5, 1.0), (2.0, 1.0))
"""Factors on mass and friction."""


@dataclass(frozen=True)
class SearchEffort:
    """How much is tried.

    Attributes
    ----------
    proposals
        Grasps proposed from the shape and ranked by geometry.
    racers
        How many of them race in simulation.
    children
        Variations in each of the two rounds of refinement.
    first
        Trials of every racer in a race's first heat; each further heat halves the racers and
        doubles the trials.
    last
        Trials after which a race is over.
    choose
        Trials of each finalist on the choose part.
    """

    proposals: int = 600
    racers: int = 24
    children: int = 10
    first: int = 8
    last: int = 128
    choose: int = 200

    def scaled(self, factor: float) -> SearchEffort:
        """More or less of everything that is simulated."""
        grown = {
            name: max(4, round(getattr(self, name) * factor))
            for name in ("racers", "children", "choose")
        }
        return replace(self, **grown)


@dataclass(frozen=True, eq=False)
class _Candidate:
    obj_T_grasp: Float[ndarray, "4 4"]
    mass_kg: float
    friction: float
    origin: str


@dataclass(frozen=True, eq=False)
class FittedGrasp:
    """The grasp found.

    Attributes
    ----------
    grasp
        The grasp itself.
    mass_kg, friction
        With which it was found.
    origin
        How it came about.
    fit, choose
        Agreement on the two parts; on the fit part as weighted in the search.
    held
        Of 20 perfect estimates jittered by 1 mm and 1 degree, how many were held.
    candidates
        Grasps (and frictions and masses) tried in simulation.
    trials
        Trials simulated.
    """

    grasp: Grasp
    mass_kg: float
    friction: float
    origin: str
    fit: Agreement
    choose: Agreement
    held: int
    candidates: int
    trials: int

    def reference(self, seed: int, report: Agreement) -> ReferenceGrasp:
        """As an entry of a table of grasps, with the figures of all three parts."""
        parts = {"fit": self.fit, "choose": self.choose, "report": report}
        figures: dict[str, str | int | float | bool] = {
            f"{name}_{key}": round(getattr(found, key), 4)
            for name, found in parts.items()
            for key in ("accuracy", "kappa", "majority", "n")
        }
        figures |= {"perfect_held_of_20": self.held, "candidates": self.candidates}
        figures |= {"trials": self.trials, "seed": seed}
        return ReferenceGrasp(
            grasp=self.grasp,
            provenance=f"searched by graspcast fit-grasp on given outcomes; {self.origin}",
            mass_kg=self.mass_kg,
            friction=self.friction,
            agreement=figures,
        )


def jitter_held(
    runner: TrialRunner, grasp: Grasp, count: int = 20, seed: int = 0
) -> tuple[int, int]:
    """Of ``count`` perfect estimates jittered by 1 mm and 1 degree, how many are held.

    The jitter is normal with these lengths as root mean square, in a uniform direction.
    """
    rng = np.random.default_rng(seed)
    scale = np.repeat([1e-3, np.deg2rad(1.0)], 3) / np.sqrt(3)
    twists = rng.standard_normal((count, 6)) * scale
    return sum(runner.run(exp(t), grasp).success for t in twists), count


def simulated(runner: TrialRunner, grasp: Grasp, trials: FittedTrials) -> Bool[ndarray, " n"]:
    """Whether each of the trials succeeds in simulation."""
    return np.array([runner.run(e, grasp).success for e in trials.obj_T_est], dtype=bool)


def report_grasp(
    found: FittedGrasp, grasp_object: GraspObject, gripper: Gripper, report: FittedTrials
) -> Agreement:
    """Agreement on trials that took no part in the search, all of them, at full length."""
    thing = with_physics(grasp_object, mass_kg=found.mass_kg, friction=found.friction)
    outcomes = simulated(TrialRunner(thing, gripper), found.grasp, report)
    return agreement(outcomes, report.success)


def fit_grasp(
    grasp_object: GraspObject,
    gripper: Gripper,
    fit: FittedTrials,
    choose: FittedTrials,
    *,
    seed: int = 0,
    effort: SearchEffort | None = None,
    start: Sequence[Float[ndarray, "4 4"]] = (),
    hold_perfect: bool = True,
    settings: TrialSettings | None = None,
    progress: Callable[[str, float, float], None] | None = None,
) -> FittedGrasp:
    """Find the reference grasp that agrees best with given outcomes.

    Parameters
    ----------
    grasp_object
        The object, with the mass and friction to begin with.
    gripper
        The gripper.
    fit
        What to search on.
    choose
        What decides among the finalists.
    seed
        Of all that is random; the same seed finds the same grasp.
    effort
        How much to try.
    start
        Grasps (``obj_T_grasp``) that race along with the proposals.
    hold_perfect
        Whether only grasps that hold a perfect estimate count. Given outcomes can contradict that:
        where trials with hardly an error failed, no such grasp can agree.
    settings
        Of the trials; searching, the lift is cut to 3 s.
    progress
        Called with what is being done, the share of the races that are over, and the agreement of
        the best so far.

    Raises
    ------
    InputError
        If a part has no trials, or no grasp at all holds a perfect estimate.
    """
    for name, part in (("fit", fit), ("choose", choose)):
        if not len(part):
            raise InputError(f"{grasp_object.name}: there are no outcomes in the {name} part")
    chosen = settings or TrialSettings()
    search = _Search(grasp_object, gripper, fit, seed, hold_perfect, chosen, progress)
    return search.run(choose, effort or SearchEffort(), start)


@dataclass(eq=False)
class _Search:
    grasp_object: GraspObject
    gripper: Gripper
    fit: FittedTrials
    seed: int
    hold_perfect: bool
    settings: TrialSettings
    progress: Callable[[str, float, float], None] | None
    trials: int = 0
    races: int = 0
    _runners: dict[tuple[float, float, bool], TrialRunner] = field(default_factory=dict)
    _results: dict[_Candidate, dict[int, bool]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.sample = StratifiedSample(self.fit, self.rng)

    def run(
        self, choose: FittedTrials, effort: SearchEffort, start: Sequence[ndarray]
    ) -> FittedGrasp:
        best = self._race(self._racers(effort, start), effort, keep=3)
        best = self._race([*best, *self._physics(best[0], _SURFACES)], effort, keep=3)
        for shift_m, turn_rad in _VARIATIONS:
            children = [
                self._candidate(
                    vary(parent.obj_T_grasp, shift_m, turn_rad, self.rng),
                    f"{parent.origin}, varied" if ", varied" not in parent.origin else None,
                    parent,
                )
                for parent in (best[i % len(best)] for i in range(3 * effort.children))
            ]
            steady = self._steady(children, effort.children)
            best = self._race([*best, *steady], effort, keep=3)
        best = self._race([*best, *self._physics(best[0], _NEARBY)], effort, keep=2)
        return self._choose(best, choose, effort)

    def _physics(
        self, like: _Candidate, factors: Sequence[tuple[float, float]]
    ) -> list[_Candidate]:
        """The same grasp with other masses and frictions, as far as it is steady with them."""
        others = [
            replace(like, mass_kg=like.mass_kg * m, friction=like.friction * f) for m, f in factors
        ]
        return self._steady(others, len(others))

    def _candidate(
        self, pose: ndarray, origin: str | None = None, like: _Candidate | None = None
    ) -> _Candidate:
        mass = like.mass_kg if like else self.grasp_object.mass_kg
        friction = like.friction if like else self.grasp_object.friction
        return _Candidate(pose, mass, friction, origin or (like.origin if like else ""))

    def _racers(self, effort: SearchEffort, start: Sequence[ndarray]) -> list[_Candidate]:
        """Proposals by their rank in geometry alone, of which the steady ones race."""
        runner = self._runner(self.grasp_object.mass_kg, self.grasp_object.friction)
        hand = OpenHand.of(runner.scene, self.gripper)
        points = surface_points(self.grasp_object, 4000, self.rng)
        proposals = propose(self.grasp_object, hand, effort.proposals, self.rng, points)
        rows, weights = self.sample.take(120)
        seen = transform_points(invert(self.fit.obj_T_est[rows]), points[:300])
        success = self.fit.success[rows]
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
        by_hand = [self._candidate(np.array(pose), "given") for pose in start]
        proposed = [self._candidate(proposals[i], "proposed") for i in ranked]
        out = self._steady(by_hand, len(by_hand)) + self._steady(proposed, effort.racers)
        if not out:
            raise InputError(
                f"no grasp of {self.grasp_object.name!r} by {self.gripper.name!r} holds a perfect "
                f"estimate: {len(proposed)} proposed, {len(by_hand)} given"
            )
        return out

    def _steady(self, candidates: Sequence[_Candidate], count: int) -> list[_Candidate]:
        """The first ``count`` that hold a perfect estimate, and four that are jittered."""
        if not self.hold_perfect:
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
            if jitter_held(runner, self._grasp(candidate), 4)[0] == 4:
                out.append(candidate)
        return out

    def _race(
        self, candidates: list[_Candidate], effort: SearchEffort, keep: int
    ) -> list[_Candidate]:
        """Successive halving: every heat has half of the racers and twice the trials."""
        trials = effort.first
        while True:
            found = [(self._agreement(c, trials), c) for c in candidates]
            found.sort(key=lambda pair: -_score(pair[0]))
            candidates = [c for _, c in found]
            if self.progress is not None:
                words = f"{len(candidates)} racers, {trials} trials each"
                self.progress(words, self.races / _RACES, found[0][0].accuracy)
            if trials >= effort.last:
                self.races += 1
                return candidates[:keep]
            trials = min(2 * trials, effort.last)
            candidates = candidates[: max(keep, len(candidates) // 2)]

    def _agreement(self, candidate: _Candidate, trials: int) -> Agreement:
        rows, weights = self.sample.take(trials)
        known = self._results.setdefault(candidate, {})
        runner = self._runner(candidate.mass_kg, candidate.friction)
        for row in rows.tolist():
            if row not in known:
                self.trials += 1
                estimate = self.fit.obj_T_est[row]
                known[row] = runner.run(estimate, self._grasp(candidate)).success
        return agreement(np.array([known[r] for r in rows]), self.fit.success[rows], weights)

    def _choose(
        self, finalists: list[_Candidate], part: FittedTrials, effort: SearchEffort
    ) -> FittedGrasp:
        """The finalist that agrees best on the choose part, of those that hold all jitters."""
        rows, weights = StratifiedSample(part, self.rng).take(effort.choose)
        out = []
        for candidate in finalists:
            grasp = self._grasp(candidate)
            full = self._runner(candidate.mass_kg, candidate.friction, full=True)
            held, of = jitter_held(full, grasp)
            runner = self._runner(candidate.mass_kg, candidate.friction)
            simulated = [runner.run(part.obj_T_est[r], grasp).success for r in rows]
            self.trials += of + len(rows)
            found = agreement(np.array(simulated), part.success[rows], weights)
            out.append((held, found, candidate))
        held, chosen, best = max(
            out, key=lambda item: (item[0] if self.hold_perfect else 0, _score(item[1]))
        )
        return FittedGrasp(
            grasp=self._grasp(best),
            mass_kg=best.mass_kg,
            friction=best.friction,
            origin=best.origin,
            fit=self._agreement(best, effort.last),
            choose=chosen,
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
    """What is maximised: the mean of agreement and Cohen's kappa, or agreement without failures."""
    one_sided = found.majority > 1 - 1e-9
    return found.accuracy if one_sided else 0.5 * (found.accuracy + found.kappa)
