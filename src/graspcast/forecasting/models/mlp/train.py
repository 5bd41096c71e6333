"""Training of many small networks in parallel.

Section IV-D of the paper: binary cross-entropy, Adam, learning rate from 1e-3 to 1e-5 on a cosine
over 3,000 epochs. What the paper does not state follows PyTorch's defaults: batches are shuffled
each epoch, the learning rate is stepped once an epoch, and parameters are drawn uniformly from
±1/sqrt(number of inputs). The batch size of 16 is ours.

::

    problems = [Problem(x, y, validation=(ValidationSet(x_test, y_test, objects),), seed=3), …]
    for trained in train(problems):
        trained.last.probabilities[0]        # on the validation set, after the final epoch
        trained.validation[0].best.epoch     # selected on the validation set, so optimistic
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait

import numpy as np

from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.models.mlp.types import MlpSettings, Problem, Trained, ValidationSet
from graspcast.io.progress import Progress

__all__ = ["train"]

_REPORTS = 50  # times that a problem reports progress and can be interrupted
_LARGEST = 1e12  # input; sums of products of such inputs stay within float32


def train(
    problems: Sequence[Problem],
    settings: MlpSettings | None = None,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> list[Trained]:
    """Train one network for each problem, in parallel.

    Each problem is trained by one thread of compiled code, from its own seed. A result does not
    depend on the number of threads, nor on the other problems or their order. The first call on a
    machine compiles for some seconds.

    Parameters
    ----------
    problems
        They may differ in their samples and in the number of inputs.
    settings
        Of all networks.
    threads
        Number of threads; the number of processors by default.
    progress
        Called from the calling thread with the share of the work that is done and a message.

    Raises
    ------
    MismatchError
        If the arrays of a problem do not fit together.
    InputError
        If a problem has no samples, or a number that is not finite.
    """
    from graspcast.forecasting.models.mlp.packing import Run

    settings = settings or MlpSettings()
    for k, problem in enumerate(problems):
        _check(problem, f"problem {k}")
    runs = [Run(problem, settings) for problem in problems]
    work = np.array([len(p.labels) * (p.inputs.shape[1] + 20) for p in problems], float)
    share = np.zeros(len(runs))
    stride = -(-settings.epochs // _REPORTS)
    stopped = False

    def run(k: int) -> None:
        for first in range(0, settings.epochs, stride):
            if stopped:
                return
            stop = min(first + stride, settings.epochs)
            runs[k].advance(first, stop)
            share[k] = stop / settings.epochs

    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        try:
            # The largest first, so that the threads finish at about the same time.
            waiting: set[Future[None]] = {pool.submit(run, int(k)) for k in np.argsort(-work)}
            while waiting:
                finished, waiting = wait(waiting, timeout=0.1, return_when=FIRST_EXCEPTION)
                for future in finished:
                    future.result()
                if progress is not None:
                    progress(float(min(1.0, work @ share / work.sum())), "training networks")
        finally:
            stopped = True
            pool.shutdown(cancel_futures=True)
    return [run.result() for run in runs]


def _check(problem: Problem, name: str) -> None:
    parts: list[tuple[str, Problem | ValidationSet]] = [(name, problem)]
    parts += [(f"{name}, validation set {k}", v) for k, v in enumerate(problem.validation)]
    for where, part in parts:
        shape, labels = part.inputs.shape, part.labels
        if len(shape) != 2 or labels.shape != shape[:1]:
            raise MismatchError(f"{where}: inputs are {shape}, but labels are {labels.shape}")
        if 0 in shape:
            raise InputError(f"{where}: there are no samples or no inputs: {shape}")
        if shape[1] != problem.inputs.shape[1]:
            raise MismatchError(
                f"{where}: {shape[1]} inputs, but {problem.inputs.shape[1]} are trained on"
            )
        wrong = np.argwhere(~(np.abs(part.inputs) < _LARGEST))
        if len(wrong):
            row, column = wrong[0]
            raise InputError(
                f"{where}: input {column} of row {row} is {part.inputs[row, column]}; "
                f"drop rows that are not finite or beyond {_LARGEST:g}"
            )
        if not np.isin(labels, (0, 1)).all():
            raise InputError(f"{where}: labels must be true or false, or 0 or 1")
        if (
            isinstance(part, ValidationSet)
            and part.groups is not None
            and len(part.groups) != shape[0]
        ):
            raise MismatchError(f"{where}: {len(part.groups)} groups for {shape[0]} samples")
