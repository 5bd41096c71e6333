"""Settings, problems and results of training the networks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.forecasting.models.mlp.network import Mlp

__all__ = [
    "Checkpoint",
    "MlpSettings",
    "Problem",
    "Trained",
    "ValidationResult",
    "ValidationSet",
]


@dataclass(frozen=True)
class MlpSettings:
    """Architecture and optimiser (Adam); the defaults are the paper's, else PyTorch's.

    Attributes
    ----------
    hidden
        Widths of the hidden layers.
    epochs
        Number of epochs.
    batch
        Samples of a batch.
    rate, final_rate
        Learning rate of the first epoch, and its limit after the last, on half a cosine.
    beta1, beta2, epsilon
        Of Adam.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    hidden: tuple[int, ...] = (16, 8, 4, 4)
    epochs: int = 3000
    batch: int = 16
    rate: float = 1e-3
    final_rate: float = 1e-5
    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-8

    def __post_init__(self) -> None:
        if min(self.epochs, self.batch, *self.hidden) < 1:
            raise InputError(f"epochs, batch and hidden widths must be at least 1: {self}")
        if not (self.rate > 0 and self.final_rate >= 0 and self.epsilon > 0):
            raise InputError(f"learning rates and epsilon must be positive: {self}")
        if not (0 <= self.beta1 < 1 and 0 <= self.beta2 < 1):
            raise InputError(f"beta1 and beta2 must be in [0, 1): {self}")

    def rates(self) -> Float[ndarray, " epochs"]:
        """Compute the learning rate of each epoch (Loshchilov and Hutter 2017, eq. 5)."""
        phase = np.pi * np.arange(self.epochs) / self.epochs
        return self.final_rate + (self.rate - self.final_rate) * 0.5 * (1 + np.cos(phase))


@dataclass(frozen=True, eq=False)
class ValidationSet:
    """Held-out samples on which the network is evaluated after every epoch.

    Attributes
    ----------
    inputs
        (n, d).
    labels
        Outcomes, (n,).
    groups
        Group of each sample, for example its object; any integers, (n,). None for one group.
    """

    inputs: Float[ndarray, "n d"]
    labels: Bool[ndarray, " n"]
    groups: Int[ndarray, " n"] | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """The training samples, validation sets and seed of one network."""

    inputs: Float[ndarray, "n d"]
    labels: Bool[ndarray, " n"]
    validation: tuple[ValidationSet, ...] = ()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A network after ``epoch`` epochs, and its probabilities on every validation set."""

    epoch: int
    mlp: Mlp
    probabilities: tuple[Float[ndarray, " _"], ...]


@dataclass(frozen=True, eq=False)
class ValidationResult:
    """Curves on one validation set, and the checkpoints that it selects.

    A prediction of success is a probability above 1/2. A score on the labels by which a checkpoint
    was selected is optimistic.

    Attributes
    ----------
    accuracy, loss
        Accuracy and mean cross-entropy after each epoch, (epochs,).
    accuracy_by_group
        Accuracy on each group after each epoch.
    best
        The first checkpoint with the highest accuracy.
    best_by_group
        The same on each group.
    lowest_loss
        The first checkpoint with the lowest loss.
    """

    accuracy: Float[ndarray, " epochs"]
    accuracy_by_group: dict[int, Float[ndarray, " epochs"]]
    loss: Float[ndarray, " epochs"]
    best: Checkpoint
    best_by_group: dict[int, Checkpoint]
    lowest_loss: Checkpoint


@dataclass(frozen=True, eq=False)
class Trained:
    """The network after the final epoch, and the results on each validation set."""

    last: Checkpoint
    validation: tuple[ValidationResult, ...]
