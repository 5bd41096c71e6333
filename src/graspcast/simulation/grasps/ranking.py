"""Ranking of grasps by how often they succeed under pose errors, by successive halving.

All grasps are tried at the true pose; those that hold are tried with few errors, the better ones
with more, and so on. Grasps near the best ones are tried too. Every grasp meets the same errors in
the same order, so that they are compared on equal terms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.io.arguments import checked, number
from graspcast.io.progress import Progress
from graspcast.pose.transforms import exp, invert, rotation_vector
from graspcast.simulation.grasps.diversity import Spacing
from graspcast.simulation.grasps.proposals import vary
from graspcast.simulation.grasps.trial_pool import TrialPool

__all__ = ["Effort", "RankedGrasp", "Ranking", "rank_grasps", "success_interval"]

_JITTER = np.repeat([1e-3, np.deg2rad(1.0)], 3) / np.sqrt(3)
_VARIED = (0.005, 0.1)
"""Standard deviations of variations: position (m) and rotation (rad)."""
_LEVEL = 0.9


@dataclass(frozen=True)
class Effort:
    """Size of a search, in grasps and trials.

    Attributes
    ----------
    candidates
        Grasps tried at the true pose.
    first_errors
        Trials under error of each grasp that holds there. The third with most successes is tried
        with as many again.
    parents, variations
        Number of the best grasps that are varied, and variations of each.
    jitter
        Trials of each kept grasp at the true pose, jittered by 1 mm and 1 degree.
    final
        Number of the best grasps that are tried with twice as many errors as the others.
    """

    candidates: int = 120
    first_errors: int = 6
    parents: int = 8
    variations: int = 2
    jitter: int = 6
    final: int = 10

    @checked(factor=number(0.001, 1000.0))
    def scaled(self, factor: float) -> Effort:
        """Return a larger or smaller effort: more candidates, parents and errors."""
        root = factor**0.5
        return replace(
            self,
            candidates=max(8, round(self.candidates * root)),
            parents=max(1, round(self.parents * root)),
            first_errors=max(2, round(self.first_errors * root)),
        )


@dataclass(eq=False)
class RankedGrasp:
    """A grasp and its trials.

    Attributes
    ----------
    obj_T_grasp
        The grasp.
    origin
        How it was found.
    success
        Outcomes under the first errors, in their order.
    held, of
        Successes among trials at the jittered true pose, and their number.
    """

    obj_T_grasp: Float[ndarray, "4 4"]
    origin: str
    success: list[bool] = field(default_factory=list)
    held: int = 0
    of: int = 0

    @property
    def rate(self) -> float:
        """Share of successes under error."""
        return float(np.mean(self.success)) if self.success else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """The 90 % interval of the success rate under error."""
        return success_interval(sum(self.success), len(self.success))

    def survived_deviations(self, errors: Float[ndarray, "n 4 4"]) -> Float[ndarray, " 6"]:
        """Return root mean squares of the errors that it survived, in its own frame.

        Position (3, metres) and rotation vector (3, radians) of the hand; NaN without a success.
        """
        survived = errors[: len(self.success)][np.array(self.success, dtype=bool)]
        if not len(survived):
            return np.full(6, np.nan)
        moved = invert(self.obj_T_grasp) @ survived @ self.obj_T_grasp
        parts = np.concatenate([moved[:, :3, 3], rotation_vector(moved[:, :3, :3])], axis=1)
        return np.asarray(np.sqrt((parts**2).mean(axis=0)))


@dataclass(frozen=True, eq=False)
class Ranking:
    """Result of a ranking.

    Attributes
    ----------
    grasps
        The best first, by the lower end of the interval of their success rate.
    tried
        Number of grasps tried in simulation.
    reasons
        Outcomes at the true pose, by reason.
    """

    grasps: tuple[RankedGrasp, ...]
    tried: int
    reasons: Counter[str]


def success_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 90 % interval of a success rate (Jeffreys); 0 to 1 without trials."""
    from scipy.stats import beta

    if not trials:
        return 0.0, 1.0
    tail = (1 - _LEVEL) / 2
    failures = trials - successes
    low = beta.ppf(tail, successes + 0.5, failures + 0.5) if successes else 0.0
    high = beta.ppf(1 - tail, successes + 0.5, failures + 0.5) if failures else 1.0
    return float(low), float(high)


def rank_grasps(
    pool: TrialPool,
    grasps: Sequence[RankedGrasp],
    errors: Float[ndarray, "n 4 4"],
    spacing: Spacing,
    rng: np.random.Generator,
    *,
    count: int,
    effort: Effort,
    fixed: int = 0,
    progress: Progress | None = None,
) -> Ranking:
    """Rank grasps by simulation.

    Parameters
    ----------
    pool
        The trials.
    grasps
        The grasps to try, without trials.
    errors
        Pose errors ``obj_T_est``, in random order.
    spacing
        Which grasps count as different.
    rng
        Random generator of variations and jitter.
    count
        Number of grasps to keep.
    effort
        How much is tried.
    fixed
        Number of grasps at the start that are ranked even if they fail, or are like others.
    progress
        Called with the share done and a short message.
    """
    return _Ranking(pool, errors, spacing, rng, effort, progress).run(list(grasps), count, fixed)


@dataclass(eq=False)
class _Ranking:
    pool: TrialPool
    errors: Float[ndarray, "n 4 4"]
    spacing: Spacing
    rng: np.random.Generator
    effort: Effort
    progress: Progress | None

    def run(self, grasps: list[RankedGrasp], count: int, fixed: int) -> Ranking:
        effort, always = self.effort, grasps[:fixed]
        first = effort.first_errors
        self._report(0.0, f"{len(grasps)} grasps at the true pose")
        reasons: Counter[str] = Counter()
        holding = self._holding(grasps[fixed:], reasons)
        self._report(0.06, f"{len(holding)} that hold, with {first} errors each")
        best = self._best([*always, *holding], first)
        self._report(0.28, f"the better ones, with {2 * first} errors each")
        better = max(count + count // 3, len(best) // 3)
        others, best = best[better:], self._best(best[:better], 2 * first)
        self._report(0.41, "grasps near the best")
        varied = [
            RankedGrasp(vary(parent.obj_T_grasp, *_VARIED, self.rng), f"{parent.origin}, varied")
            for parent in best[: effort.parents]
            for _ in range(effort.variations)
        ]
        best = self._best([*best, *self._holding(varied, Counter())], 2 * first)
        chosen = self._spread(best, count + count // 5, always)
        # Where the better ones are alike, others make up the number.
        best = chosen if len(chosen) >= count else self._spread([*best, *others], count, always)
        self._report(0.54, f"{len(best)} grasps with {4 * first} errors each")
        best = self._spread(self._best([*always, *best], 4 * first), count, always)
        self._report(0.75, "jittered true poses")
        kept = [grasp for grasp in self._jittered(best) if grasp.held or grasp in always]
        self._report(0.85, f"the best {effort.final}, with {8 * first} errors each")
        finalists = [*always, *(g for g in kept[: effort.final] if g not in always)]
        self._try_errors(finalists, 8 * first)
        ranked = sorted(kept, key=lambda grasp: (-grasp.interval[0], -grasp.rate))
        self._report(1.0, "")
        return Ranking(tuple(ranked), len(grasps) + len(varied), reasons)

    def _holding(self, grasps: list[RankedGrasp], reasons: Counter[str]) -> list[RankedGrasp]:
        """Return the grasps that hold at the true pose, and count the outcomes."""
        outcomes = self.pool.run([(np.eye(4), grasp.obj_T_grasp) for grasp in grasps])
        reasons.update(outcome.reason for outcome in outcomes)
        return [g for g, outcome in zip(grasps, outcomes, strict=True) if outcome.success]

    def _best(self, grasps: Sequence[RankedGrasp], trials: int) -> list[RankedGrasp]:
        """Try grasps with errors, and sort them, the best first."""
        different = list(dict.fromkeys(grasps))
        self._try_errors(different, trials)
        return sorted(different, key=lambda grasp: -grasp.rate)

    def _try_errors(self, grasps: Sequence[RankedGrasp], trials: int) -> None:
        trials = min(trials, len(self.errors))
        asked = [(g, row) for g in grasps for row in range(len(g.success), trials)]
        outcomes = self.pool.run([(self.errors[row], g.obj_T_grasp) for g, row in asked])
        for (grasp, _), outcome in zip(asked, outcomes, strict=True):
            grasp.success.append(outcome.success)

    def _spread(
        self, grasps: list[RankedGrasp], count: int, always: Sequence[RankedGrasp]
    ) -> list[RankedGrasp]:
        """Return the best grasps that are different, and those that are always kept."""
        if not grasps:
            return []
        others = [g for g in grasps if g not in always]
        poses = np.array([g.obj_T_grasp for g in others]).reshape(-1, 4, 4)
        chosen = [others[row] for row in self.spacing.spread(poses, count)]
        return sorted([*always, *chosen], key=lambda grasp: -grasp.rate)

    def _jittered(self, grasps: list[RankedGrasp]) -> list[RankedGrasp]:
        jitter = exp(self.rng.standard_normal((self.effort.jitter, 6)) * _JITTER)
        asked = [(g, pose) for g in grasps for pose in jitter]
        outcomes = self.pool.run([(pose, g.obj_T_grasp) for g, pose in asked])
        for (grasp, _), outcome in zip(asked, outcomes, strict=True):
            grasp.held += outcome.success
            grasp.of += 1
        return grasps

    def _report(self, share: float, message: str) -> None:
        if self.progress is not None:
            self.progress(share, message)
