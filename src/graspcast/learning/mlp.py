"""The paper's success predictor, a small multilayer perceptron, and the training of many at once.

Section III-C of the paper: inputs → 16 → 8 → 4 → 4 → 1, ReLU between the layers, a sigmoid at the
end. Section IV-D: binary cross-entropy, Adam, learning rate from 1e-3 to 1e-5 on a cosine over
3,000 epochs. What the paper leaves open follows PyTorch's defaults: batches of 16 shuffled anew
each epoch, the learning rate stepped once an epoch, weights and biases drawn uniformly from
±1/sqrt(number of inputs).

::

    problems = [Problem(x, y, watch=(Watch(x_test, y_test, objects),), seed=3), …]
    for trained in train(problems):
        trained.last.probabilities[0]           # honest: the final epoch, on the first watch
        trained.watched[0].best.epoch           # chosen by looking at the watched labels

Inputs go in as they are, without standardisation.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["Checkpoint", "Mlp", "MlpSettings", "Problem", "Trained", "Watch", "Watched", "train"]


@dataclass(frozen=True)
class MlpSettings:
    """Architecture and optimiser; the defaults are the paper's, and PyTorch's where it is silent.

    ``rate`` falls to ``final_rate`` on half a cosine over ``epochs``, stepped once an epoch.
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
        if self.epochs < 1 or self.batch < 1 or any(width < 1 for width in self.hidden):
            raise InputError(f"epochs, batch and hidden widths must be at least 1: {self}")
        if not (self.rate > 0 and self.final_rate >= 0 and self.epsilon > 0):
            raise InputError(f"learning rates and epsilon must be positive: {self}")
        if not (0 <= self.beta1 < 1 and 0 <= self.beta2 < 1):
            raise InputError(f"beta1 and beta2 must be in [0, 1): {self}")

    def rates(self) -> Float[ndarray, " epochs"]:
        """The learning rate of each epoch (Loshchilov and Hutter 2017, eq. 5, no restart)."""
        phase = np.pi * np.arange(self.epochs) / self.epochs
        return self.final_rate + (self.rate - self.final_rate) * 0.5 * (1 + np.cos(phase))


@dataclass(frozen=True, eq=False)
class Mlp:
    """A network: a weight matrix and a bias for each layer."""

    weights: tuple[Float[ndarray, "n_out n_in"], ...]
    biases: tuple[Float[ndarray, " n_out"], ...]

    @classmethod
    def random(cls, inputs: int, hidden: Sequence[int], seed: int) -> Mlp:
        """Initialise as ``torch.nn.Linear`` does: uniform in ±1/sqrt(n_in), biases too."""
        rng = np.random.default_rng(seed)
        widths = [inputs, *hidden, 1]
        weights, biases = [], []
        for n_in, n_out in zip(widths, widths[1:], strict=False):
            bound = 1.0 / math.sqrt(n_in)
            weights.append(rng.uniform(-bound, bound, (n_out, n_in)).astype(np.float32))
            biases.append(rng.uniform(-bound, bound, n_out).astype(np.float32))
        return cls(tuple(weights), tuple(biases))

    @property
    def inputs(self) -> int:
        """The number of inputs."""
        return int(self.weights[0].shape[1])

    def predict(self, inputs: Float[ndarray, "n d"]) -> Float[ndarray, " n"]:
        """The probability of success of each row."""
        if inputs.ndim != 2 or inputs.shape[1] != self.inputs:
            raise InputError(f"the network takes rows of {self.inputs} inputs, not {inputs.shape}")
        values = np.asarray(inputs, np.float32)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = np.maximum(values @ weight.T + bias, 0)
        return _sigmoid((values @ self.weights[-1].T + self.biases[-1])[:, 0])

    def to_arrays(self) -> dict[str, ndarray]:
        """Named arrays, to be saved with ``numpy.savez`` or the like."""
        pairs = zip(self.weights, self.biases, strict=True)
        named = (((f"weight_{k}", w), (f"bias_{k}", b)) for k, (w, b) in enumerate(pairs))
        return {name: array for pair in named for name, array in pair}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Mlp:
        """The inverse of :meth:`to_arrays`; other keys are ignored.

        Raises:
            InputError: if an array is missing or the shapes do not follow from one another.
        """
        depth = sum(name.startswith("weight_") for name in arrays)
        try:
            weights = tuple(np.asarray(arrays[f"weight_{k}"], np.float32) for k in range(depth))
            biases = tuple(np.asarray(arrays[f"bias_{k}"], np.float32) for k in range(depth))
        except KeyError as missing:
            raise InputError(f"a network's arrays lack {missing}; found {sorted(arrays)}") from None
        shapes = [w.shape for w in weights]
        chained = depth > 0 and all(len(s) == 2 for s in shapes) and shapes[-1][0] == 1
        chained = chained and all(a[0] == b[1] for a, b in zip(shapes, shapes[1:], strict=False))
        if not chained or any(b.shape != s[:1] for b, s in zip(biases, shapes, strict=True)):
            raise InputError(f"the layers of a network do not fit together: weights {shapes}")
        return cls(weights, biases)


@dataclass(frozen=True, eq=False)
class Watch:
    """Held-out samples to look at after every epoch.

    ``groups`` says which group (say, which object) a sample belongs to: any integers.
    """

    inputs: Float[ndarray, "n d"]
    labels: Bool[ndarray, " n"]
    groups: Int[ndarray, " n"] | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """What one network is trained on, what it is watched on, and its seed."""

    inputs: Float[ndarray, "n d"]
    labels: Bool[ndarray, " n"]
    watch: tuple[Watch, ...] = ()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A network as it was after ``epoch`` epochs, and its probabilities on every watch."""

    epoch: int
    mlp: Mlp
    probabilities: tuple[Float[ndarray, " n"], ...]


@dataclass(frozen=True, eq=False)
class Watched:
    """What was seen on one watch; row ``e`` of a curve belongs to epoch ``e + 1``.

    ``best`` and ``best_by_group`` were chosen for their accuracy on the watched labels (the first
    epoch that reached it), ``lowest_loss`` for the cross-entropy: an accuracy quoted on the same
    labels is optimistic.
    """

    accuracy: Float[ndarray, " epochs"]
    loss: Float[ndarray, " epochs"]
    group_accuracy: dict[int, Float[ndarray, " epochs"]]
    best: Checkpoint
    best_by_group: dict[int, Checkpoint]
    lowest_loss: Checkpoint


@dataclass(frozen=True, eq=False)
class Trained:
    """The outcome of one problem."""

    last: Checkpoint
    watched: tuple[Watched, ...] = field(default=())


def train(
    problems: Sequence[Problem],
    settings: MlpSettings | None = None,
    *,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Trained]:
    """Train one network for each problem, all at once.

    Each problem is trained by one thread of compiled code, from its own seed: neither the number
    of threads nor the order of the problems nor their company changes a bit of the result. The
    first call on a machine compiles for some seconds.

    Args:
        problems: They may differ in samples and in the number of inputs.
        settings: One for all.
        threads: As many as there are processors, unless told.
        progress: Is called from the calling thread with the share of the work that is done.

    Raises:
        InputError: if shapes disagree or a number is not finite; the message names the problem.
    """
    settings = settings or MlpSettings()
    for k, problem in enumerate(problems):
        _check(problem, f"problem {k}")
    runs = [_Run(problem, settings) for problem in problems]
    work = [len(p.labels) * (p.inputs.shape[1] + 10) for p in problems]
    order = sorted(range(len(runs)), key=lambda k: -work[k])  # large first: they end together
    chunk = max(1, settings.epochs // 50)

    done = np.zeros(len(runs))
    stopped = False

    def run(k: int) -> None:
        for first in range(0, settings.epochs, chunk):
            if stopped:
                return
            runs[k].advance(first, min(first + chunk, settings.epochs))
            done[k] = work[k] * min(1.0, (first + chunk) / settings.epochs)

    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        waiting: set[Future[None]] = {pool.submit(run, k) for k in order}
        try:
            while waiting:
                finished, waiting = wait(waiting, timeout=0.1, return_when=FIRST_EXCEPTION)
                for future in finished:
                    future.result()
                if progress is not None:
                    progress(float(done.sum() / sum(work)))
        finally:
            stopped = True
            pool.shutdown(cancel_futures=True)
    return [run.result() for run in runs]


def _padded(width: int, multiple: int) -> int:
    return -(-width // multiple) * multiple


class _Run:
    """One problem in the flat arrays of the compiled program."""

    def __init__(self, problem: Problem, settings: MlpSettings):
        from graspcast.learning import mlp_kernel  # compiled code: imported when it is needed

        self.kernel = mlp_kernel
        self.settings = settings
        self.problem = problem
        lanes = mlp_kernel.LANES
        d = problem.inputs.shape[1]
        self.widths = (d, *settings.hidden, 1)
        self.plan, self.size = _plan(self.widths)
        self.inputs = np.ascontiguousarray(problem.inputs, np.float32).ravel()
        self.labels = problem.labels.astype(np.float32)
        self.params = self.pack(Mlp.random(d, settings.hidden, problem.seed))
        self.moments = np.zeros((2, len(self.params)), np.float32)
        self.grads = np.zeros(len(self.params), np.float32)
        self.random = np.array([problem.seed & (2**64 - 1)], np.uint64)
        self.order = np.arange(len(self.labels))
        self.acts, self.deltas = self.buffers()

        self.blocks = [_blocks(w.inputs, lanes) for w in problem.watch]
        truth = [w.labels for w in problem.watch]
        self.group_ids = [np.unique(_groups(w)) for w in problem.watch]
        starts = np.cumsum([0, *(len(g) for g in self.group_ids)])
        slots = []
        for ids, start in zip(self.group_ids, starts[:-1], strict=True):
            whole = (start, start + len(ids))
            slots += [(*whole, 0), (*whole, 1), *((start + g, start + g + 1, 0) for g in range(len(ids)))]
        self.slots = np.array(slots, np.int64).reshape(-1, 3)
        self.truth = np.concatenate([np.zeros(0, bool), *truth])
        # every watch fills whole blocks
        x = [np.zeros((0, d)), *(w.inputs for w in problem.watch)]
        self.watch_blocks = _blocks(np.concatenate(x), lanes)
        groups = [start + np.searchsorted(ids, _groups(w)) for w, ids, start in zip(problem.watch, self.group_ids, starts[:-1], strict=True)]
        self.groups = np.concatenate([np.zeros(0, np.int64), *groups])
        self.out = np.zeros(len(self.watch_blocks) // (d * lanes), np.float32)
        self.out = np.zeros(_padded(len(self.truth), lanes), np.float32)
        self.correct = np.zeros((settings.epochs, starts[-1]), np.int32)
        self.loss = np.zeros((settings.epochs, starts[-1]), np.float64)
        self.kept_epoch = np.zeros(len(slots), np.int64)
        self.kept_score = np.full(len(slots), -np.inf)
        self.kept_params = np.tile(self.params, (len(slots), 1))
        self.rates = settings.rates()

    def buffers(self):
        acts = np.zeros((self.size, self.kernel.LANES), np.float32)
        for n_in, _, _, src, _ in self.plan:
            acts[src // self.kernel.LANES + n_in] = 1.0
        return acts.ravel(), np.zeros_like(acts).ravel()

    def pack(self, mlp):
        flat = []
        for weight, bias, (n_in, n_out, *_) in zip(mlp.weights, mlp.biases, self.plan, strict=True):
            rows = np.zeros((n_in + 1, n_out), np.float32)
            rows[: weight.shape[1], : weight.shape[0]] = weight.T
            rows[n_in, : len(bias)] = bias
            flat.append(rows.ravel())
        return np.concatenate(flat)

    def advance(self, first: int, last: int) -> None:
        s = self.settings
        self.kernel.run_epochs(
            first, last, self.rates, s.batch, s.beta1, s.beta2, s.epsilon,
            self.params, self.moments[0], self.moments[1], self.random, self.plan, self.inputs,
            self.labels, self.order, self.acts, self.deltas, self.grads,
            self.watch_blocks, self.truth, self.groups, self.out, self.correct, self.loss,
            self.slots, self.kept_epoch, self.kept_score, self.kept_params,
        )

    def result(self):
        return self


def _groups(w):
    return np.zeros(len(w.labels), np.int64) if w.groups is None else w.groups


def _plan(widths):
    plan = []
    w = row = 0
    n_in = widths[0]
    for width in widths[1:]:
        n_out = _padded(width, 4)
        plan.append((n_in, n_out, w, row * 16, (row + n_in + 1) * 16))
        w += (n_in + 1) * n_out
        row += n_in + 1
        n_in = n_out
    return np.array(plan, np.int64), row + n_in + 1


def _blocks(inputs, lanes):
    n, d = inputs.shape
    rows = np.zeros((_padded(n, lanes), d), np.float32)
    rows[:n] = inputs
    return np.ascontiguousarray(rows.reshape(-1, lanes, d).transpose(0, 2, 1)).ravel()


def _check(problem, name):
    pass


def _sigmoid(z):
    return 1 / (1 + np.exp(-z))
