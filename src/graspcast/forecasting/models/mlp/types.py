"""TODO."""

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
    "Watch",
    "Watched",
]


@dataclass(frozen=True)
class MlpSettings:
    """Architecture and optimiser; the defaults are the paper's, and PyTorch's where it is silent.

    ``rate`` falls to ``final_rate`` on half a cosine over ``epochs``, stepped once an epoch.

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

    def rates(self) -> Float[ndarray, "epochs"]:
        """The learning rate of each epoch (Loshchilov and Hutter 2017, eq. 5, no restart)."""
        phase = np.pi * np.arange(self.epochs) / self.epochs
        return self.final_rate + (self.rate - self.final_rate) * 0.5 * (1 + np.cos(phase))


@dataclass(frozen=True, eq=False)
class Watch:
    """Held-out samples to look at after every epoch.

    ``groups`` says which group (say, which object) a sample belongs to: any integers.
    """

    inputs: Float[ndarray, "n d"]
    labels: Bool[ndarray, "n"]
    groups: Int[ndarray, "n"] | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """What one network is trained on, what it is watched on, and its seed."""

    inputs: Float[ndarray, "n d"]
    labels: Bool[ndarray, "n"]
    watch: tuple[Watch, ...] = ()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A network as it was after ``epoch`` epochs, and its probabilities on every watch."""

    epoch: int
    mlp: Mlp
    probabilities: tuple[Float[ndarray, "_"], ...]


@dataclass(frozen=True, eq=False)
class Watched:
    """What was seen on one watch; place ``e`` of a curve is the state after ``e + 1`` epochs.

    A hit is a probability above 1/2 of a success, or one of at most 1/2 of a failure. ``best``
    and ``best_by_group`` are the first epochs with the most hits on the watched labels, on all of
    them or on those of one group; ``lowest_loss`` that with the lowest cross-entropy. A score on
    the very labels by which a checkpoint was chosen is optimistic.
    """

    accuracy: Float[ndarray, "epochs"]
    accuracy_by_group: dict[int, Float[ndarray, "epochs"]]
    loss: Float[ndarray, "epochs"]
    best: Checkpoint
    best_by_group: dict[int, Checkpoint]
    lowest_loss: Checkpoint


@dataclass(frozen=True, eq=False)
class Trained:
    """The network after the final epoch, and what was seen and kept on each watch."""

    last: Checkpoint
    watched: tuple[Watched, ...]
