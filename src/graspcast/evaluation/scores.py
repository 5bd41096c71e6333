"""Scores of predicted probabilities: accuracy, AUROC, Brier score, calibration error, AURC.

References
----------
Naeini, Cooper and Hauskrecht (2015). Obtaining Well Calibrated Probabilities Using Bayesian
Binning. AAAI.

Geifman and El-Yaniv (2017). Selective Classification for Deep Neural Networks. NeurIPS.

Geifman, Uziel and El-Yaniv (2019). Bias-Reduced Uncertainty Estimation for Deep Neural Classifiers.
ICLR.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError

__all__ = [
    "BINS",
    "RiskCoverage",
    "Scores",
    "bin_of",
    "calibration_error",
    "risk_coverage",
    "score",
]

BINS = 15
"""Number of equal-width bins of the calibration error."""


@dataclass(frozen=True)
class RiskCoverage:
    """The risk-coverage curve: failure rate of the attempts against the share attempted.

    Instances are attempted by falling probability (selective classification: Geifman and El-Yaniv
    2017).

    Attributes
    ----------
    coverage
        Share attempted, ascending to 1, (n,).
    risk
        Share of these that fail, (n,); samples of equal probability count as their mean.
    """

    coverage: Float[ndarray, " n"]
    risk: Float[ndarray, " n"]

    @property
    def area(self) -> float:
        """AURC: the mean risk over all coverages (Geifman et al. 2019); lower is better."""
        return float(self.risk.mean())

    def success_at(self, coverage: float) -> float:
        """Return the success rate when this share is attempted."""
        count = max(1, round(coverage * len(self.risk)))
        return float(1.0 - self.risk[count - 1])


@dataclass(frozen=True)
class Scores:
    """Scores of one set of predictions.

    Attributes
    ----------
    n
        Number of samples.
    accuracy
        At a probability of 0.5, averaged over objects, as in the paper.
    accuracy_se
        Its standard error if samples were independent (video frames are not, so the true one is
        larger).
    accuracy_micro
        At 0.5, over all samples.
    majority
        Accuracy of always predicting each object's more frequent outcome, averaged over objects.
    auroc
        Area under the ROC curve over all samples; NaN if there is only one class.
    brier
        Brier score: mean squared difference of probability and outcome.
    ece
        Expected calibration error, 15 bins of equal width.
    aurc
        Area under the risk-coverage curve.
    success_at_50, success_at_70, success_at_90
        Success rate of the 50, 70, 90 % with the highest probabilities.
    success
        Success rate of all samples.
    """

    n: int
    accuracy: float
    accuracy_se: float
    accuracy_micro: float
    majority: float
    auroc: float
    brier: float
    ece: float
    aurc: float
    success_at_50: float
    success_at_70: float
    success_at_90: float
    success: float

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers, for JSON; NaN becomes None."""
        return {k: None if v != v else v for k, v in asdict(self).items()}


def bin_of(probability: Float[ndarray, " n"], *, bins: int = BINS) -> Int[ndarray, " n"]:
    """Return each probability's bin, from 0; bins include their lower edge, the last both."""
    return np.minimum((probability * bins).astype(np.int64), bins - 1)


def calibration_error(
    probability: Float[ndarray, " n"],
    success: Bool[ndarray, " n"] | Float[ndarray, " n"],
    *,
    bins: int = BINS,
) -> float:
    """Return the expected calibration error (Naeini et al. 2015) over bins of equal width.

    It is the mean absolute difference between a bin's mean probability and its success rate,
    weighted by the number of samples in the bin. In place of outcomes there may be probabilities.
    """
    gap = np.bincount(bin_of(probability, bins=bins), weights=probability - success, minlength=bins)
    return float(np.abs(gap).sum() / len(success))


def risk_coverage(probability: Float[ndarray, " n"], success: Bool[ndarray, " n"]) -> RiskCoverage:
    """Return the failure rate against the share attempted."""
    order = np.argsort(-probability, kind="stable")
    sorted_probability = probability[order]
    failed = (~success[order]).astype(np.float64)
    # Equal probabilities have no order, so each counts as the mean of its run.
    _, run, size = np.unique(-sorted_probability, return_inverse=True, return_counts=True)
    failed = (np.bincount(run, weights=failed) / size)[run]
    attempted = np.arange(1, len(order) + 1)
    return RiskCoverage(attempted / len(order), np.cumsum(failed) / attempted)


def score(
    probability: Float[ndarray, " n"],
    success: Bool[ndarray, " n"],
    objects: ndarray,
) -> Scores:
    """Score probabilities against outcomes.

    Parameters
    ----------
    probability
        Probability of success, from 0 to 1, (n,).
    success
        Outcomes, (n,).
    objects
        Each sample's object, (n,); accuracy is averaged over objects.

    Raises
    ------
    InputError
        If there are no samples.
    """
    from sklearn.metrics import brier_score_loss, roc_auc_score

    if len(success) == 0:
        raise InputError("there are no samples to score")
    right = (probability >= 0.5) == success
    accuracy, variance, majority = [], [], []
    for name in np.unique(objects):
        mine = objects == name
        rate = float(right[mine].mean())
        accuracy.append(rate)
        variance.append(rate * (1 - rate) / mine.sum())
        success_rate = float(success[mine].mean())
        majority.append(max(success_rate, 1 - success_rate))
    both = bool(success.any() and not success.all())
    curve = risk_coverage(probability, success)
    return Scores(
        n=len(success),
        accuracy=float(np.mean(accuracy)),
        accuracy_se=float(np.sqrt(np.sum(variance)) / len(variance)),
        accuracy_micro=float(right.mean()),
        majority=float(np.mean(majority)),
        auroc=float(roc_auc_score(success, probability)) if both else float("nan"),
        brier=float(brier_score_loss(success, probability)),
        ece=calibration_error(probability, success),
        aurc=curve.area,
        success_at_50=curve.success_at(0.5),
        success_at_70=curve.success_at(0.7),
        success_at_90=curve.success_at(0.9),
        success=float(success.mean()),
    )
