"""Ensembles of the paper's networks, for all objects together or for each object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.models.encoding import UNSEEN, one_hot_numbers
from graspcast.forecasting.models.mlp.network import Mlp
from graspcast.forecasting.models.mlp.train import train
from graspcast.forecasting.models.mlp.types import MlpSettings, Problem, ValidationSet
from graspcast.forecasting.splits import validation_mask
from graspcast.io.progress import Progress

__all__ = ["NetworkEnsemble", "NetworkSettings"]


@dataclass(frozen=True)
class NetworkSettings:
    """Settings of an ensemble of networks.

    Attributes
    ----------
    pools_objects
        One ensemble for all objects, with the object's one-hot vector as input (MLP-O), or one for
        each object (MLP).
    standardise
        Scale features to mean 0 and standard deviation 1 (the paper does not).
    protocol
        ``last``, the network after the final epoch, or ``validated``, the checkpoint with the
        lowest loss on a fifth of the training data that is held out.
    members
        Networks whose probabilities are averaged.
    seed
        Of everything random.
    optimiser
        Architecture and optimiser; the paper's by default.
    """

    pools_objects: bool = True
    standardise: bool = False
    protocol: str = "validated"
    members: int = 5
    seed: int = 0
    optimiser: MlpSettings = field(default_factory=MlpSettings)


@dataclass(frozen=True, eq=False)
class NetworkEnsemble:
    """An ensemble of networks, whose probabilities are averaged.

    Attributes
    ----------
    shift, scale
        Inputs are ``(features - shift) / scale``, (d,).
    objects
        Number of objects.
    pools_objects
        Whether all objects share one pool of networks; if not, each has its own.
    members
        Networks of each pool: ``members[pool][i]``.
    """

    shift: Float[ndarray, " d"]
    scale: Float[ndarray, " d"]
    objects: int
    pools_objects: bool
    members: tuple[tuple[Mlp, ...], ...]

    @classmethod
    def fit(
        cls,
        features: Float[ndarray, "n d"],
        success: Bool[ndarray, " n"],
        objects: ndarray,
        settings: NetworkSettings,
        *,
        progress: Progress | None = None,
    ) -> NetworkEnsemble:
        """Train on samples of objects with numbers 0 to k - 1.

        Raises
        ------
        InputError
            For another protocol; ``paper`` would need the outcomes of test samples.
        """
        if settings.protocol not in ("validated", "last"):
            raise InputError(
                f"the protocol must be validated or last, not {settings.protocol!r}",
                parameters=("protocol",),
            )
        count = int(objects.max()) + 1
        d = features.shape[1]
        shift, scale = np.zeros(d), np.ones(d)
        if settings.standardise:
            shift, scale = features.mean(axis=0), features.std(axis=0)
            scale = np.where(scale > 0, scale, 1.0)
        empty = cls(shift, scale, count, settings.pools_objects, ())
        inputs = empty._inputs(features, objects)
        problems = []
        for pool in range(1 if settings.pools_objects else count):
            mine = np.full(len(success), True) if settings.pools_objects else objects == pool
            for member in range(settings.members):
                seed = (settings.seed * 1000 + pool) * 1000 + member
                problems.append(
                    _problem(inputs[mine], success[mine], objects[mine], seed, settings.protocol)
                )
        trained = train(problems, settings.optimiser, progress=progress)
        networks = [(t.validation[0].lowest_loss if t.validation else t.last).mlp for t in trained]
        size = settings.members
        pools = tuple(tuple(networks[i : i + size]) for i in range(0, len(networks), size))
        return cls(shift, scale, count, settings.pools_objects, pools)

    def _inputs(self, features: ndarray, objects: ndarray) -> ndarray:
        scaled = (features - self.shift) / self.scale
        if not self.pools_objects:
            return scaled
        return np.concatenate([scaled, one_hot_numbers(objects, self.objects)], axis=1)

    def probability(
        self, features: Float[ndarray, "n d"], objects: ndarray
    ) -> Float[ndarray, " n"]:
        """Forecast the probability of success of each row: the members' mean.

        Raises
        ------
        MismatchError
            For an unseen object, if each object has its own networks.
        """
        if not self.pools_objects and (objects == UNSEEN).any():
            raise MismatchError(
                "the method MLP has networks for each object, and cannot forecast an unseen object",
                parameters=("method",),
            )
        inputs = self._inputs(features, objects)
        out = np.empty(len(inputs))
        for pool, members in enumerate(self.members):
            mine = slice(None) if self.pools_objects else objects == pool
            rows = inputs[mine]
            if len(rows):
                out[mine] = np.mean([network.predict(rows) for network in members], axis=0)
        return out

    def to_arrays(self) -> dict[str, ndarray]:
        """Return named arrays; a network's are ``pool/member/weight_0`` and so on."""
        out = {
            "shift": self.shift,
            "scale": self.scale,
            "objects": np.array(self.objects),
            "shape": np.array([len(self.members), len(self.members[0])]),
            "pools_objects": np.array(self.pools_objects),
        }
        for pool, members in enumerate(self.members):
            for i, network in enumerate(members):
                out |= {f"{pool}/{i}/{k}": v for k, v in network.to_arrays().items()}
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> NetworkEnsemble:
        """Restore what :meth:`to_arrays` returned."""
        pools, size = arrays["shape"].tolist()

        def network(pool: int, member: int) -> Mlp:
            prefix = f"{pool}/{member}/"
            return Mlp.from_arrays(
                {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}
            )

        members = tuple(tuple(network(p, i) for i in range(size)) for p in range(pools))
        out = cls(
            arrays["shift"],
            arrays["scale"],
            int(arrays["objects"]),
            bool(arrays["pools_objects"]),
            members,
        )
        width = len(out.shift) + (out.objects if out.pools_objects else 0)
        if any(network.widths[0] != width for pool in members for network in pool):
            raise InputError(f"its networks do not take {width} inputs")
        if out.scale.shape != out.shift.shape:
            raise InputError(f"{out.shift.shape} shifts, but {out.scale.shape} scales")
        return out


def _problem(
    inputs: ndarray, success: ndarray, objects: ndarray, seed: int, protocol: str
) -> Problem:
    if protocol == "last":
        return Problem(inputs, success, seed=seed)
    part = validation_mask(2 * objects + success, seed)
    if not part.any():  # too few samples to hold any out
        return Problem(inputs, success, seed=seed)
    validation = ValidationSet(inputs[part], success[part])
    return Problem(inputs[~part], success[~part], validation=(validation,), seed=seed)
