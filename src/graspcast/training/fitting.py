"""Fitting of the networks, all on the same batches; it goes on from the last checkpoints."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence

import numpy as np
import torch

from graspcast.io.progress import Count, Progress
from graspcast.training.batches import make_batch
from graspcast.training.checkpoint import Checkpoint
from graspcast.training.geometry import Geometry
from graspcast.training.objects import Objects
from graspcast.training.samples import Samples
from graspcast.training.settings import TrainingSettings

__all__ = ["BATCH", "fit"]

BATCH = 32
"""Crops in a batch."""
_SAVE_S = 60.0
"""A checkpoint is written after this time: what a killed process loses."""
_SAY_S = 1.0


def fit(
    checkpoints: Sequence[Checkpoint],
    samples: Samples,
    objects: Objects,
    settings: TrainingSettings,
    *,
    device: str = "cpu",
    progress: Progress | None = None,
) -> None:
    """Train every network up to ``settings.steps`` steps; those that have done so are left alone.

    Batch k depends on the seed and k alone. So training that was interrupted gives the same weights
    as training that was not, on a CPU and with the same number of threads.

    Parameters
    ----------
    checkpoints
        The networks; each is saved once a minute, and at the end.
    samples
        Training samples.
    objects
        The objects.
    settings
        Steps, seed, augmentation and threads.
    device
        ``cpu`` or ``cuda``, that of the networks.
    progress
        Called with the share of steps done, their number, and the losses.
    """
    torch.set_num_threads(settings.threads or max(1, (os.cpu_count() or 1) // 2))
    if all(one.step >= settings.steps for one in checkpoints):
        return
    geometry = Geometry.of(objects).to(device)
    saved = time.monotonic()
    said = -math.inf
    while any(one.step < settings.steps for one in checkpoints):
        step = min(one.step for one in checkpoints)
        random = torch.Generator().manual_seed(1_000_003 * settings.seed + step)
        rng = np.random.default_rng([settings.seed, step])
        rows = rng.integers(0, len(samples), BATCH)
        batch = make_batch(samples.take(rows), objects, random, settings.strength).to(device)
        for one in checkpoints:
            if one.step == step:
                one.train_on(batch, geometry, settings.steps)
        now = time.monotonic()
        if progress is not None and now - said > _SAY_S:
            said = now
            share = _share(checkpoints, settings.steps)
            progress(share, _words(checkpoints, settings.steps))
        if now - saved > _SAVE_S:
            saved = now
            _save(checkpoints)
    _save(checkpoints)


def _save(checkpoints: Sequence[Checkpoint]) -> None:
    for one in checkpoints:
        one.save()


def _share(checkpoints: Sequence[Checkpoint], steps: int) -> float:
    return sum(min(one.step, steps) for one in checkpoints) / (steps * len(checkpoints))


def _words(checkpoints: Sequence[Checkpoint], steps: int) -> Count:
    losses = ", ".join(f"{one.name} {one.loss:.2f}" for one in checkpoints)
    step = min(one.step for one in checkpoints)
    return Count(step, steps, "training steps", f"loss of {losses}")
