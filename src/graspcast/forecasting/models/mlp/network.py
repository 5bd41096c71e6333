"""The paper's network: a small multilayer perceptron.

Section III-C: inputs → 16 → 8 → 4 → 4 → 1, ReLU between the layers and a sigmoid at the end, and
inputs that are not standardised. It is trained by
:mod:`graspcast.forecasting.models.mlp.train`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError, MismatchError

__all__ = ["Mlp", "probability"]


def probability(logits: Float[ndarray, " n"]) -> Float[ndarray, " n"]:
    """Compute the logistic function in float64, without overflow."""
    z = np.asarray(logits, np.float64)
    e = np.exp(-np.abs(z))
    result: ndarray = np.where(z > 0, 1.0, e) / (1.0 + e)
    return result


@dataclass(frozen=True, eq=False)
class Mlp:
    """A network: float32 weights and biases of each layer; the last has one output."""

    weights: tuple[Float[ndarray, "_ _"], ...]
    biases: tuple[Float[ndarray, " _"], ...]

    @classmethod
    def random(cls, inputs: int, hidden: Sequence[int], seed: int) -> Mlp:
        """Initialise as ``torch.nn.Linear`` does: uniform in ±1/sqrt(n_in), biases too."""
        rng = np.random.default_rng(seed)
        weights, biases = [], []
        for n_in, n_out in pairwise([inputs, *hidden, 1]):
            bound = 1.0 / math.sqrt(n_in)
            weights.append(rng.uniform(-bound, bound, (n_out, n_in)).astype(np.float32))
            biases.append(rng.uniform(-bound, bound, n_out).astype(np.float32))
        return cls(tuple(weights), tuple(biases))

    @property
    def widths(self) -> tuple[int, ...]:
        """The number of inputs, of the units of each hidden layer, and one for the output."""
        return (self.weights[0].shape[1], *(len(bias) for bias in self.biases))

    def predict(self, inputs: Float[ndarray, "n d"]) -> Float[ndarray, " n"]:
        """Forecast the probability of success of each row.

        Raises
        ------
        MismatchError
            If the rows do not have as many inputs as the network.
        """
        if inputs.ndim != 2 or inputs.shape[1] != self.widths[0]:
            raise MismatchError(
                f"the network takes rows of {self.widths[0]} inputs, but got {inputs.shape}"
            )
        values = np.asarray(inputs, np.float32)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = np.maximum(values @ weight.T + bias, 0)
        return probability((values @ self.weights[-1].T + self.biases[-1])[:, 0])

    def to_arrays(self) -> dict[str, ndarray]:
        """Return the parameters as named arrays."""
        weights = {f"weight_{k}": weight for k, weight in enumerate(self.weights)}
        return weights | {f"bias_{k}": bias for k, bias in enumerate(self.biases)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Mlp:
        """Restore what :meth:`to_arrays` returned; other keys are ignored.

        Raises
        ------
        InputError
            If an array is missing, not finite, or the shapes do not fit together.
        """
        depth = sum(name.startswith("weight_") for name in arrays)
        try:
            weights = tuple(np.asarray(arrays[f"weight_{k}"], np.float32) for k in range(depth))
            biases = tuple(np.asarray(arrays[f"bias_{k}"], np.float32) for k in range(depth))
        except KeyError as missing:
            raise InputError(f"a network lacks the array {missing}: {sorted(arrays)}") from None
        shapes = [weight.shape for weight in weights]
        fits = depth > 0 and all(len(shape) == 2 for shape in shapes) and shapes[-1][0] == 1
        fits = fits and all(below[0] == above[1] for below, above in pairwise(shapes))
        fits = fits and [bias.shape for bias in biases] == [shape[:1] for shape in shapes]
        if not fits:
            raise InputError(f"the layers of a network do not fit together: weights {shapes}")
        if not all(np.isfinite(array).all() for array in (*weights, *biases)):
            raise InputError("a network has parameters that are not finite")
        return cls(weights, biases)
