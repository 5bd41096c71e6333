"""The paper's four network configurations, and three ways to select a checkpoint.

A *cell* is one (principal, object, gripper). Section III-C: ``MLP`` trains one network for each
cell; ``MLP-O`` pools objects, ``MLP-G`` grippers, ``MLP-OG`` both, with one-hot vectors of object
and gripper as further inputs. Protocols of checkpoint selection:

- ``paper``: the checkpoint with the best accuracy **on the test set**; where objects are pooled,
  one for each object. Optimistic; it is what the paper's Table III reports.
- ``last``: the network after the final epoch.
- ``validated``: trained without a fifth of the training set; the checkpoint with the lowest
  loss on that fifth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.forecasting.models.encoding import one_hot
from graspcast.forecasting.models.mlp.train import train
from graspcast.forecasting.models.mlp.types import (
    Checkpoint,
    MlpSettings,
    Problem,
    Trained,
    ValidationSet,
)
from graspcast.forecasting.splits import validation_mask
from graspcast.io.progress import Progress

__all__ = [
    "CONFIGURATIONS",
    "PROTOCOLS",
    "Cell",
    "CellKey",
    "Configuration",
    "Protocol",
    "run",
]

Protocol = Literal["paper", "last", "validated"]
PROTOCOLS: tuple[Protocol, ...] = ("paper", "last", "validated")

CellKey = tuple[str, str, str]
"""Principal, object, gripper."""


@dataclass(frozen=True)
class Configuration:
    """Which cells share one network."""

    name: str
    pools_objects: bool
    pools_grippers: bool

    def pool(self, key: CellKey) -> tuple[str, str, str]:
        """Return the key of the network that a cell shares."""
        principal, name, gripper = key
        return (
            principal,
            "*" if self.pools_objects else name,
            "*" if self.pools_grippers else gripper,
        )


CONFIGURATIONS: Mapping[str, Configuration] = {
    c.name: c
    for c in (
        Configuration("MLP", pools_objects=False, pools_grippers=False),
        Configuration("MLP-O", pools_objects=True, pools_grippers=False),
        Configuration("MLP-G", pools_objects=False, pools_grippers=True),
        Configuration("MLP-OG", pools_objects=True, pools_grippers=True),
    )
}


@dataclass(frozen=True, eq=False)
class Cell:
    """Features and outcomes of one (principal, object, gripper).

    Attributes
    ----------
    features
        (n, d).
    success
        Outcomes, (n,).
    is_train
        Which of them are for training; the others are for testing, (n,).
    """

    features: Float[ndarray, "n d"]
    success: Bool[ndarray, " n"]
    is_train: Bool[ndarray, " n"]


def run(
    configuration: Configuration,
    cells: Mapping[CellKey, Cell],
    *,
    seed: int,
    protocols: Iterable[Protocol] = PROTOCOLS,
    settings: MlpSettings | None = None,
    progress: Progress | None = None,
) -> dict[Protocol, dict[CellKey, Float[ndarray, " test"]]]:
    """Train a configuration on every cell, and forecast each cell's test samples, in order.

    Parameters
    ----------
    configuration
        Which cells share a network.
    cells
        Every cell; each needs training and test samples.
    seed
        Of initial weights, the order of samples, and the validation set.
    protocols
        Protocols of checkpoint selection (``paper`` and ``last`` share their networks).
    settings
        Architecture and optimiser; by default the paper's.
    progress
        Called with the share of the work that is done and a message.
    """
    pools: dict[tuple[str, str, str], list[CellKey]] = {}
    for key in cells:
        pools.setdefault(configuration.pool(key), []).append(key)
    objects = tuple(sorted({key[1] for key in cells}))
    grippers = tuple(sorted({key[2] for key in cells}))
    wanted = tuple(protocols)
    whole = [p for p in ("paper", "last") if p in wanted]
    makers = [False] * bool(whole) + [True] * ("validated" in wanted)

    problems: list[Problem] = []
    for held_out in makers:
        for number, keys in enumerate(pools.values()):
            data = [_inputs(configuration, k, cells[k], objects, grippers) for k in keys]
            problems.append(_problem(keys, cells, data, objects, held_out, seed * 1000 + number))
    trained = train(problems, settings, progress=progress)
    out: dict[Protocol, dict[CellKey, ndarray]] = {p: {} for p in wanted}
    for i, keys in enumerate(pools.values()):
        if whole:
            _collect(out, configuration, keys, cells, objects, trained[i])
        if "validated" in wanted:
            chosen = trained[i + len(pools) * bool(whole)].validation[1].lowest_loss
            _share(out["validated"], keys, cells, chosen.probabilities[0])
    return out


def _inputs(
    configuration: Configuration,
    key: CellKey,
    cell: Cell,
    objects: tuple[str, ...],
    grippers: tuple[str, ...],
) -> Float[ndarray, "n d"]:
    parts = [cell.features]
    n = len(cell.success)
    if configuration.pools_objects:
        parts.append(one_hot([key[1]] * n, objects, "object"))
    if configuration.pools_grippers:
        parts.append(one_hot([key[2]] * n, grippers, "gripper"))
    return np.concatenate(parts, axis=1)


def _problem(
    keys: list[CellKey],
    cells: Mapping[CellKey, Cell],
    data: list[ndarray],
    objects: tuple[str, ...],
    held_out: bool,
    seed: int,
) -> Problem:
    """Collect one network's samples; validation set 0 is the test set, 1 a held-out fifth."""
    inputs = np.concatenate(data)
    success = np.concatenate([cells[k].success for k in keys])
    is_train = np.concatenate([cells[k].is_train for k in keys])
    cell = np.repeat(np.arange(len(keys)), [len(cells[k].success) for k in keys])
    group = np.array([objects.index(k[1]) for k in keys])[cell]
    validation = [ValidationSet(inputs[~is_train], success[~is_train], group[~is_train])]
    if held_out:
        part = np.zeros_like(is_train)
        strata = 2 * cell[is_train] + success[is_train]
        part[is_train] = validation_mask(strata, seed)
        validation.append(ValidationSet(inputs[part], success[part]))
        is_train = is_train & ~part
    return Problem(inputs[is_train], success[is_train], validation=tuple(validation), seed=seed)


def _collect(
    out: dict[Protocol, dict[CellKey, ndarray]],
    configuration: Configuration,
    keys: list[CellKey],
    cells: Mapping[CellKey, Cell],
    objects: tuple[str, ...],
    trained: Trained,
) -> None:
    if "last" in out:
        _share(out["last"], keys, cells, trained.last.probabilities[0])
    if "paper" not in out:
        return
    on_test = trained.validation[0]
    for key in keys:
        best: Checkpoint = on_test.best
        if configuration.pools_objects:
            best = on_test.best_by_group[objects.index(key[1])]
        every: dict[CellKey, ndarray] = {}
        _share(every, keys, cells, best.probabilities[0])
        out["paper"][key] = every[key]


def _share(
    out: dict[CellKey, ndarray],
    keys: list[CellKey],
    cells: Mapping[CellKey, Cell],
    probability: Float[ndarray, " n"],
) -> None:
    """Split a pool's test probabilities into those of each cell."""
    sizes: Int[ndarray, " cells"] = np.array([int((~cells[k].is_train).sum()) for k in keys])
    parts = np.split(probability, np.cumsum(sizes)[:-1])
    out.update(zip(keys, parts, strict=True))
