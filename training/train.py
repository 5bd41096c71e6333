"""Training of the networks on the same batches; it can be resumed."""

from __future__ import annotations

import math
import signal
import sys
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from graspcast.io.files import atomic_write
from training.crops import Objects
from training.losses import LOSSES, Geometry
from training.networks import NETWORKS
from training.samples import Samples, make_batch

BATCH = 32
_RATE, _WARM, _SAVE_S, _SAY = 1.5e-3, 500, 120.0, 250


def new_network(name: str, objects: Objects) -> nn.Module:
    """Create a network for the number and sizes of the objects."""
    network = NETWORKS[name](len(objects.ids))
    if hasattr(network, "extent"):
        geometry = Geometry.of(objects)
        network.extent[:] = geometry.size / geometry.diameter[:, None]
    return network


class Run:
    """The training state of one network, resumed from its checkpoint."""

    def __init__(self, name: str, objects: Objects, work: Path):
        torch.manual_seed(sum(map(ord, name)))
        self.name, self.path = name, work / f"{name}.pt"
        self.network = new_network(name, objects).to(memory_format=torch.channels_last)
        self.average = AveragedModel(
            self.network, multi_avg_fn=get_ema_multi_avg_fn(0.998), use_buffers=True
        )
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=_RATE, weight_decay=1e-2, fused=True
        )
        self.step, self.lately = 0, []
        if self.path.exists():
            state = torch.load(self.path, weights_only=True)
            self.step = state["step"]
            self.network.load_state_dict(state["network"])
            self.average.load_state_dict(state["average"])
            self.optimizer.load_state_dict(state["optimizer"])

    def save(self) -> None:
        with atomic_write(self.path) as temporary:
            torch.save(
                {
                    "step": self.step,
                    "network": self.network.state_dict(),
                    "average": self.average.state_dict(),
                    "optimizer": self.optimizer.state_dict(),
                },
                temporary,
            )

    def train_on(self, batch, geometry: Geometry, steps: int) -> None:
        share = self.step / steps
        rate = _RATE * min(1.0, (self.step + 1) / _WARM) * 0.5 * (1 + math.cos(math.pi * share))
        for group in self.optimizer.param_groups:
            group["lr"] = max(rate, 1e-5)
        self.network.train()
        loss = LOSSES[self.name](self.network(batch.image, batch.obj), batch, geometry)
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self.optimizer.step()
        self.average.update_parameters(self.network)
        self.step += 1
        self.lately = [*self.lately[-499:], loss.item()]


def train(
    work: Path, objects: Objects, names: list[str], *, steps: int, threads: int, strength: float
) -> None:
    """Train every network for ``steps`` steps in total.

    ``strength`` is that of image augmentation: small for rendered images, 1 for photographs.
    """
    torch.set_num_threads(threads)
    geometry = Geometry.of(objects)
    runs = [Run(name, objects, work) for name in names]
    for run in runs:
        count = sum(p.numel() for p in run.network.parameters())
        print(f"{run.name}: {count} weights, at step {run.step} of {steps}", flush=True)
    samples = Samples(work / "train")
    # On SIGTERM, save and exit.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    try:
        _loop(runs, samples, objects, geometry, steps, strength)
    finally:
        for run in runs:
            run.save()


def _loop(
    runs: list[Run],
    samples: Samples,
    objects: Objects,
    geometry: Geometry,
    steps: int,
    strength: float,
) -> None:
    began = saved = time.monotonic()
    made = 0
    while any(run.step < steps for run in runs):
        step = min(run.step for run in runs)
        # Batch k does not depend on interruptions.
        random = torch.Generator().manual_seed(step)
        if made % 500 == 0:
            samples.refresh()
        rows = np.random.default_rng([3, step]).integers(0, len(samples), BATCH)
        batch = make_batch(samples.take(rows), objects, random, strength)
        batch.image = batch.image.contiguous(memory_format=torch.channels_last)
        for run in runs:
            if run.step == step:
                run.train_on(batch, geometry, steps)
        made += 1
        if made % _SAY == 0:
            said = ", ".join(f"{r.name} {np.mean(r.lately[-_SAY:]):.3f}" for r in runs)
            pace = BATCH * made / (time.monotonic() - began)
            print(f"step {step + 1}: {said}; {pace:.0f}/s of {len(samples)}", flush=True)
        if time.monotonic() - saved > _SAVE_S:
            for run in runs:
                run.save()
            saved = time.monotonic()
