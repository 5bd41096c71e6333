"""TODO."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.models.encoding import UNSEEN, one_hot_numbers
from graspcast.forecasting.models.mlp.network import Mlp
from graspcast.forecasting.models.mlp.train import train
from graspcast.forecasting.models.mlp.types import MlpSettings, Problem, Watch
from graspcast.forecasting.splits import validation_part

__all__ = ["NetworkEnsemble", "NetworkSettings"]


@dataclass(frozen=True)
class NetworkSettings:
    """How an ensemble is trained.

    Attributes
    ----------
    pools_objects
        One ensemble for all objects, told which by a one-hot vector (MLP-O), or one for each object
        (MLP).
    standardise
        Bring features to mean 0 and deviation 1 first (the paper does not).
    protocol
        ``validated`` or ``last`` (see :mod:`graspcast.paper.configurations`).
    members
        Networks whose probabilities are averaged.
    seed
        Of everything random.
    optimiser
        The paper's, by default.
    """

    pools_objects: bool = True
    standardise: bool = False
    protocol: str = "validated"
    members: int = 5
    seed: int = 0
    optimiser: MlpSettings = field(default_factory=MlpSettings)


@dataclass(frozen=True, eq=False)
class NetworkEnsemble:
    """Networks whose probabilities are averaged, for all objects or for each.

    Attributes
    ----------
    shift, scale
        Features enter as ``(x - shift) / scale``, (d,).
    objects
        How many objects there are.
    pools_objects
        Whether all share the networks.
    members
        For each pool, its networks: ``members[pool][i]``.
    """

    shift: Float[ndarray, "d"]
    scale: Float[ndarray, "d"]
    objects: int
    pools_objects: bool
    members: tuple[tuple[Mlp, ...], ...]

    @classmethod
    def fit(
        cls,
        features: Float[ndarray, "n d"],
        success: Bool[ndarray, "n"],
        objects: ndarray,
        settings: NetworkSettings,
        *,
        progress: Callable[[float], None] | None = None,
    ) -> NetworkEnsemble:
        """Train on samples of the object numbers 0 to k - 1.

        Raises
        ------
        InputError
            For the protocol ``paper``, which needs the outcomes of test samples.
        """
        if settings.protocol not in ("validated", "last"):
            raise InputError(
                f"a forecaster is trained by the protocol validated or last, not "
                f"{settings.protocol!r}"
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
        networks = [(t.watched[0].lowest_loss if t.watched else t.last).mlp for t in trained]
        size = settings.members
        pools = tuple(tuple(networks[i : i + size]) for i in range(0, len(networks), size))
        return cls(shift, scale, count, settings.pools_objects, pools)

    def _inputs(self, features: ndarray, objects: ndarray) -> ndarray:
        scaled = (features - self.shift) / self.scale
        if not self.pools_objects:
            return scaled
        return np.concatenate([scaled, one_hot_numbers(objects, self.objects)], axis=1)

    def probability(self, features: Float[ndarray, "n d"], objects: ndarray) -> Float[ndarray, "n"]:
        """Probability of success of each row, the members' average.

        Raises
        ------
        MismatchError
            For an unseen object, where each object has networks of its own.
        """
        if not self.pools_objects and (objects == UNSEEN).any():
            raise MismatchError("networks for each object cannot answer for an unseen one")
        inputs = self._inputs(features, objects)
        out = np.empty(len(inputs))
        for pool, members in enumerate(self.members):
            mine = slice(None) if self.pools_objects else objects == pool
            rows = inputs[mine]
            if len(rows):
                out[mine] = np.mean([network.predict(rows) for network in members], axis=0)
        return out

    def to_arrays(self) -> dict[str, ndarray]:
        """Named arrays; a network's are ``pool/member/weight_0`` and so on."""
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
        """The inverse of :meth:`to_arrays`."""
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
    part = validation_part(2 * objects + success, seed)
    if not part.any():  # too few samples to spare any
        return Problem(inputs, success, seed=seed)
    watch = Watch(inputs[part], success[part])
    return Problem(inputs[~part], success[~part], watch=(watch,), seed=seed)
