"""Synthetic worlds in which the truth is known: scenes, forecasts, outcomes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.special import expit

ASKED = {"rate": 0.9, "confidence": 0.9}


@dataclass(frozen=True)
class World:
    """A logistic world: success follows what is seen (with noise), and the scene.

    Attributes:
        scenes, repeats: Calibration data.
        scene: Deviation of the scene's effect on the logit of success, unknown to the forecaster.
        mislead: Deviation of the scene's effect on the forecast alone.
        over: Factor on the logit of the forecast: above 1 it promises too much.
        alike: Correlation among a scene's trials, of what is to be seen and of how it is misseen:
            1 for bare repeats.
    """

    scenes: int
    repeats: int
    scene: float = 1.0
    mislead: float = 0.0
    over: float = 1.0
    alike: float = 0.0

    def draw(self, rng: np.random.Generator, scenes: int) -> tuple[ndarray, ndarray, ndarray]:
        """Probabilities, outcomes and scenes, each (scenes * repeats,)."""
        shape = (scenes, self.repeats)
        x, misseen = (self._normal(rng, scenes) for _ in range(2))
        success = rng.random(shape) < expit(1.5 + 4 * x + rng.normal(0, self.scene, (scenes, 1)))
        seen = (x + 0.5 * misseen) / 1.25
        # The factor that makes the forecast calibrated but for the scene's misleading effect.
        spread = np.sqrt(1 + np.pi / 8 * (16 * 0.2 + self.scene**2))
        logit = self.over * (1.5 + 4 * seen) / spread + self.mislead * rng.normal(size=(scenes, 1))
        return expit(logit).ravel(), success.ravel(), np.repeat(np.arange(scenes), self.repeats)

    def _normal(self, rng: np.random.Generator, scenes: int) -> ndarray:
        common, own = rng.normal(size=(scenes, 1)), rng.normal(size=(scenes, self.repeats))
        return np.sqrt(self.alike) * common + np.sqrt(1 - self.alike) * own

    def truth(self, *, trials: int = 1_000_000) -> Truth:
        """What perfect knowledge would say, from many scenes."""
        rng = np.random.default_rng(987_654)
        probability, success, _ = self.draw(rng, trials // self.repeats)
        order = np.argsort(-probability)
        return Truth(probability[order], np.cumsum(success[order]) / (np.arange(len(order)) + 1))


@dataclass(frozen=True)
class Truth:
    """Success rates above every threshold, from very many trials."""

    descending: ndarray
    rates: ndarray

    def rate(self, threshold: float) -> float:
        """P(success | probability >= threshold)."""
        return float(self.rates[self._count(threshold) - 1])

    def attempts(self, threshold: float) -> float:
        """P(probability >= threshold)."""
        return self._count(threshold) / len(self.rates)

    def best_attempts(self, rate: float) -> float:
        """The largest share that can be attempted at this success rate."""
        fine = np.flatnonzero(self.rates >= rate)
        fine = fine[fine > 1000]  # a rate of fewer trials is noise
        return (int(fine[-1]) + 1) / len(self.rates) if len(fine) else 0.0

    def _count(self, threshold: float) -> int:
        return max(1, int(np.searchsorted(-self.descending, -threshold, side="right")))


def drawn(world: World, number: int) -> tuple[ndarray, ndarray, ndarray]:
    """The calibration data of one of the world's seeds."""
    return world.draw(np.random.default_rng([1, number]), world.scenes)
