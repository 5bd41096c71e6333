"""Checkpoints: the state of one network in training, kept in a file, from which it goes on."""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from graspcast.errors import FormatError, InputError
from graspcast.io.files import atomic_write
from graspcast.training.batches import Batch
from graspcast.training.geometry import Geometry
from graspcast.training.losses import LOSSES
from graspcast.training.networks import NETWORKS
from graspcast.training.objects import Objects

__all__ = ["Checkpoint", "new_network"]

_RATE, _LEAST_RATE, _WARM_UP = 1.5e-3, 1e-5, 500
"""Largest and smallest learning rate; number of the first steps, in which it rises."""
_AVERAGED = 0.998
_STATES = ("network", "average", "optimizer")


def _averaged(average: Tensor, now: Tensor, count: Tensor) -> Tensor:
    """Return the running average of a weight; the first weights do not count for long."""
    keep = min(_AVERAGED, (1 + int(count)) / (10 + int(count)))
    return average + (1 - keep) * (now - average)


def new_network(name: str, objects: Objects) -> nn.Module:
    """Create the network of an estimator for the number and sizes of the objects."""
    network = NETWORKS[name](len(objects.ids))
    if hasattr(network, "extent"):
        geometry = Geometry.of(objects)
        network.extent[:] = geometry.size / geometry.diameter[:, None]
    return network


class Checkpoint:
    """The state of one network in training, and the file that it is kept in.

    Parameters
    ----------
    name
        The estimator.
    objects
        The objects.
    directory
        The directory of the file; if the file is there, training goes on from it.
    seed
        Random seed of the first weights.
    device
        ``cpu`` or ``cuda``.

    Attributes
    ----------
    step
        Number of steps done.
    loss
        The mean of the loss over the last steps, NaN before the first.

    Raises
    ------
    FormatError
        If the file is damaged, or of another network.
    """

    def __init__(
        self, name: str, objects: Objects, directory: Path, *, seed: int = 1, device: str = "cpu"
    ):
        torch.manual_seed(1000 * seed + sum(map(ord, name)))
        self.name, self.path = name, directory / f"{name}.pt"
        self.network = new_network(name, objects).to(device, memory_format=torch.channels_last)
        self.average = AveragedModel(self.network, avg_fn=_averaged, use_buffers=True)
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=_RATE, weight_decay=1e-2, fused=True
        )
        self.step, self.loss = 0, math.nan
        if self.path.exists():
            self._load(device)

    def _load(self, device: str) -> None:
        try:
            state = torch.load(self.path, weights_only=True, map_location=device)
            self.step = int(state["step"])
            for part in _STATES:
                getattr(self, part).load_state_dict(state[part])
        except Exception as error:  # torch raises many types
            first = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise FormatError(
                self.path,
                f"is not a checkpoint of {self.name} ({first}); delete it to train from the start",
            ) from error

    def save(self) -> None:
        """Write the file, atomically."""
        state = {part: getattr(self, part).state_dict() for part in _STATES}
        with atomic_write(self.path) as temporary:
            torch.save({"step": self.step, **state}, temporary)

    def train_on(self, batch: Batch, geometry: Geometry, steps: int) -> None:
        """Do one step of ``steps``, which set the learning rate.

        Raises
        ------
        InputError
            If the loss is not finite; nothing is learned from this batch.
        """
        share = min(1.0, self.step / steps)
        warmth = min(1.0, (self.step + 1) / _WARM_UP)
        rate = _RATE * warmth * 0.5 * (1 + math.cos(math.pi * share))
        for group in self.optimizer.param_groups:
            group["lr"] = max(rate, _LEAST_RATE)
        self.network.train()
        loss: Tensor = LOSSES[self.name](self.network(batch.image, batch.obj), batch, geometry)
        now = loss.item()
        if not math.isfinite(now):
            raise InputError(
                f"{self.name}: the loss is {now} at step {self.step + 1}, and the network would "
                f"learn no more; is an object of the dataset flat, or {self.path} damaged?"
            )
        self.optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self.optimizer.step()
        self.average.update_parameters(self.network)
        self.step += 1
        self.loss = now if math.isnan(self.loss) else 0.98 * self.loss + 0.02 * now

    def averaged(self, objects: Objects) -> nn.Module:
        """Return a network on the CPU with the running average of the weights, for use."""
        network = new_network(self.name, objects).eval()
        network.load_state_dict(self.average.module.state_dict())
        return network
