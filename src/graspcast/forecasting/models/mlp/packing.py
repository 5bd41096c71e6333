"""Conversion of problems and networks to the flat arrays of the compiled code, and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32, Int64
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.forecasting.models.mlp.kernel import (
    History,
    Network,
    Optimiser,
    Training,
    Validation,
    evaluate,
    run_epochs,
)
from graspcast.forecasting.models.mlp.network import Mlp, probability
from graspcast.forecasting.models.mlp.simd import LANES, QUAD
from graspcast.forecasting.models.mlp.types import (
    Checkpoint,
    MlpSettings,
    Problem,
    Trained,
    ValidationResult,
)

__all__ = ["Run", "lay_out", "network_of", "pack", "training_on", "unpack"]

_BY_HITS, _BY_LOSS = 0, 1


def lay_out(widths: Sequence[int]) -> Int64[ndarray, "layers 5"]:
    """Compute the plan of a network with layers of these widths, inputs first, output last."""
    plan = []
    n_in, parameters, row = widths[0], 0, 0
    for width in widths[1:]:
        n_out = _ceil(width, QUAD)
        below = row + n_in + 1
        plan.append((n_in, n_out, parameters, row * LANES, below * LANES))
        parameters += (n_in + 1) * n_out
        n_in, row = n_out, below
    return np.array(plan, np.int64)


def pack(mlp: Mlp, plan: Int64[ndarray, "layers 5"]) -> Float32[ndarray, " params"]:
    """Convert the parameters to one flat, padded array."""
    flat = []
    for weight, bias, (n_in, n_out, *_) in zip(mlp.weights, mlp.biases, plan, strict=True):
        rows = np.zeros((n_in + 1, n_out), np.float32)
        rows[: weight.shape[1], : weight.shape[0]] = weight.T
        rows[n_in, : len(bias)] = bias
        flat.append(rows.ravel())
    return np.concatenate(flat)


def unpack(
    params: Float32[ndarray, " params"], plan: Int64[ndarray, "layers 5"], widths: Sequence[int]
) -> Mlp:
    """Restore what :func:`pack` converted."""
    weights, biases = [], []
    for k, (n_in, n_out, start, *_) in enumerate(plan):
        rows = params[start : start + (n_in + 1) * n_out].reshape(n_in + 1, n_out)
        weights.append(rows[: widths[k], : widths[k + 1]].T.copy())
        biases.append(rows[n_in, : widths[k + 1]].copy())
    return Mlp(tuple(weights), tuple(biases))


def network_of(mlp: Mlp) -> Network:
    """Allocate a network for the compiled code, with buffers for one block of samples."""
    plan = lay_out(mlp.widths)
    n_out, dst = plan[-1, [1, 4]]
    acts = np.zeros(dst + n_out * LANES, np.float32)
    deltas = np.zeros_like(acts)
    for n_in, _, _, src, _ in plan:
        acts[src + n_in * LANES : src + (n_in + 1) * LANES] = 1.0
    return Network(plan, pack(mlp, plan), acts, deltas)


def training_on(problem: Problem, params: int) -> Training:
    """Convert the samples of a problem, and initialise the optimiser."""
    grads, mean, square = np.zeros((3, params), np.float32)
    return Training(
        inputs=np.ascontiguousarray(problem.inputs, np.float32).ravel(),
        labels=problem.labels.astype(np.float32),
        order=np.arange(len(problem.labels)),
        places=np.zeros(LANES, np.int64),
        # Another stream than that of the initial weights, which uses the seed itself.
        random=np.random.SeedSequence([problem.seed, 1]).generate_state(1, np.uint64),
        grads=grads,
        mean=mean,
        square=square,
    )


class Run:
    """The training of one problem."""

    def __init__(self, problem: Problem, settings: MlpSettings):
        mlp = Mlp.random(problem.inputs.shape[1], settings.hidden, problem.seed)
        self._widths = mlp.widths
        self._network = network_of(mlp)
        self._training = training_on(problem, len(self._network.params))
        self._optimiser = Optimiser(
            settings.rates(), settings.batch, settings.beta1, settings.beta2, settings.epsilon
        )
        self._sizes = [len(part.labels) for part in problem.validation]
        none = np.zeros((0, problem.inputs.shape[1]))
        self._validation = _validation_arrays(
            np.concatenate([none, *(part.inputs for part in problem.validation)]),
            np.concatenate([none[:, 0], *(part.labels for part in problem.validation)]) > 0,
        )
        self._groups: list[list[int]] = []
        criteria = []
        start = first = 0
        for part, size in zip(problem.validation, self._sizes, strict=True):
            groups = np.zeros(size, int) if part.groups is None else part.groups
            names, index = np.unique(groups, return_inverse=True)
            self._validation.groups[start : start + size] = first + index
            stop = first + len(names)
            criteria += [(first, stop, _BY_HITS), (first, stop, _BY_LOSS)]
            criteria += [(group, group + 1, _BY_HITS) for group in range(first, stop)]
            self._groups.append([int(name) for name in names])
            start, first = start + size, stop
        self._history = History(
            hits=np.zeros((settings.epochs, first), np.int32),
            loss=np.zeros((settings.epochs, first)),
            criteria=np.array(criteria, np.int64).reshape(-1, 3),
            epochs=np.zeros(len(criteria), np.int64),
            scores=np.full(len(criteria), -np.inf),
            params=np.tile(self._network.params, (len(criteria), 1)),
        )

    def advance(self, first: int, stop: int) -> None:
        """Train from epoch ``first``, counted from zero, up to ``stop``."""
        run_epochs(
            first,
            stop,
            self._optimiser,
            self._network,
            self._training,
            self._validation,
            self._history,
        )

    def result(self) -> Trained:
        """Return the trained network and its validation results.

        Raises
        ------
        InputError
            If the training diverged.
        """
        epochs = len(self._optimiser.rates)
        if not np.isfinite(self._network.params).all():
            raise InputError("training diverged; lower the learning rate or scale the inputs")
        last = self._checkpoint(epochs, self._network.params.copy())
        history = self._history
        checkpoints = [
            self._checkpoint(int(e), p) for e, p in zip(history.epochs, history.params, strict=True)
        ]
        sizes = np.bincount(self._validation.groups, minlength=history.hits.shape[1])
        results = []
        at = first = 0
        for names in self._groups:
            best, lowest_loss, *by_group = checkpoints[at : at + 2 + len(names)]
            mine = slice(first, first + len(names))
            total = sizes[mine].sum()
            curves = (history.hits[:, mine] / sizes[mine]).T
            results.append(
                ValidationResult(
                    accuracy=history.hits[:, mine].sum(axis=1) / total,
                    accuracy_by_group=dict(zip(names, curves, strict=True)),
                    loss=history.loss[:, mine].sum(axis=1) / total,
                    best=best,
                    best_by_group=dict(zip(names, by_group, strict=True)),
                    lowest_loss=lowest_loss,
                )
            )
            at, first = at + 2 + len(names), first + len(names)
        return Trained(last, tuple(results))

    def _checkpoint(self, epoch: int, params: Float32[ndarray, " params"]) -> Checkpoint:
        # Evaluated by the same compiled code as in training, so that the bits are equal.
        evaluate(self._network._replace(params=params), self._validation)
        probabilities: list[Float[ndarray, " n"]] = np.split(
            probability(self._validation.logits[: sum(self._sizes)]), np.cumsum(self._sizes[:-1])
        )
        return Checkpoint(
            epoch,
            unpack(params, self._network.plan, self._widths),
            tuple(probabilities[: len(self._sizes)]),
        )


def _ceil(number: int, multiple: int) -> int:
    return -(-number // multiple) * multiple


def _validation_arrays(inputs: Float[ndarray, "m d"], labels: ndarray) -> Validation:
    n, d = inputs.shape
    rows = np.zeros((_ceil(n, LANES), d), np.float32)
    rows[:n] = inputs
    return Validation(
        blocks=rows.reshape(-1, LANES, d).transpose(0, 2, 1).ravel(),
        labels=labels,
        groups=np.zeros(n, np.int64),
        logits=np.zeros(len(rows), np.float32),
        softplus=np.zeros(len(rows), np.float32),
    )
