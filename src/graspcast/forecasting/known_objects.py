"""What a model file carries of its objects: sizes, symmetries, some points, and grasps.

So a robot needs the file alone. Of a mesh of more than :data:`MOST_POINTS` vertices there are as
many of these, spread as they are, which changes ADD by a few parts in ten thousand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.meshes import Mesh
from graspcast.bop.models import ContinuousSymmetry, ModelInfo, Models
from graspcast.bop.units import metres, millimetres
from graspcast.errors import FormatError
from graspcast.estimates.instances import split_object_name
from graspcast.forecasting.model_card import ModelCard
from graspcast.io.wording import counted
from graspcast.pose.sanity import rotation_problem

if TYPE_CHECKING:
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.simulation.grasps.table import GraspTable

__all__ = ["MOST_POINTS", "KnownModels", "KnownObjects", "spread_points", "with_objects"]

MOST_POINTS = 1000
"""The most vertices of an object that a model file carries."""
_GRID = 1024
_NO_FACES = np.empty((0, 3), dtype=np.int64)
Grasps = Mapping[str, Mapping[str, Float[ndarray, "4 4"]]]


class KnownModels(Models):
    """Object models without files.

    Parameters
    ----------
    info
        Sizes and symmetries by object id.
    points
        Some vertices of each object, metres.
    """

    def __init__(self, info: Mapping[int, ModelInfo], points: Mapping[int, Float[ndarray, "p 3"]]):
        self.directory = Path("the model file")
        self.info = dict(info)
        self._meshes = {n: Mesh(some, _NO_FACES) for n, some in points.items() if len(some)}
        self._checked = set()

    def __repr__(self) -> str:
        return f"KnownModels({counted(len(self.info), 'object')})"


@dataclass(frozen=True, eq=False)
class KnownObjects:
    """Sizes, symmetries, points and grasps of a forecaster's objects.

    Attributes
    ----------
    models
        Dataset's name to its object models.
    grasps
        Object's name to name and pose of each grasp by the forecaster's gripper, metres.
    """

    models: Mapping[str, Models]
    grasps: Grasps

    @classmethod
    def of(
        cls, card: ModelCard, models: Mapping[str, Models], grasps: GraspTable | None
    ) -> KnownObjects:
        """Gather what is known of a forecaster's objects; objects without a model are left out."""
        kept: dict[str, tuple[dict[int, ModelInfo], dict[int, ndarray]]] = {}
        poses: dict[str, dict[str, ndarray]] = {}
        for name in card.objects:
            dataset, obj_id = split_object_name(name)
            if grasps is not None and (name, card.gripper) in grasps:
                some = grasps.of(name, card.gripper)
                poses[name] = {r.grasp.name: r.grasp.obj_T_grasp for r in some}
            if dataset not in models or obj_id not in models[dataset].info:
                continue
            info, points = kept.setdefault(dataset, ({}, {}))
            info[obj_id] = models[dataset][obj_id]
            try:
                points[obj_id] = spread_points(models[dataset].mesh(obj_id).vertices)
            except FormatError:  # a method that needs the mesh has said so in training
                points[obj_id] = np.empty((0, 3))
        every = {dataset: KnownModels(*parts) for dataset, parts in kept.items()}
        return cls(every, poses)

    def to_arrays(self) -> dict[str, ndarray]:
        """Return arrays, for :meth:`from_arrays`."""
        pairs = [(d, n, m) for d, m in self.models.items() for n in sorted(m.info)]
        infos = [m.info[n] for _, n, m in pairs]
        points = [m._meshes[n].vertices if n in m._meshes else _NO_FACES for _, n, m in pairs]
        turns = [np.concatenate([c.axis, c.offset]) for i in infos for c in i.continuous]
        named = [(o, n, pose) for o, some in self.grasps.items() for n, pose in some.items()]
        return {
            "names": np.array([f"{d}-{n}" for d, n, _ in pairs], dtype=np.str_),
            "diameter_m": np.array([i.diameter_m for i in infos], dtype=np.float64),
            "bounds": _stacked([np.stack([i.lower, i.size]) for i in infos], (2, 3)),
            "discrete": _stacked([p for i in infos for p in i.discrete], (4, 4)),
            "discrete_count": _counts([i.discrete for i in infos]),
            "continuous": _stacked(turns, (6,)),
            "continuous_count": _counts([i.continuous for i in infos]),
            "points_mm": _compact(np.concatenate([np.empty((0, 3)), *points])),
            "points_count": _counts(points),
            "grasp_objects": np.array([o for o, _, _ in named], dtype=np.str_),
            "grasp_names": np.array([n for _, n, _ in named], dtype=np.str_),
            "obj_T_grasp": _stacked([pose for _, _, pose in named], (4, 4)),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> KnownObjects:
        """Restore what :meth:`to_arrays` returned; raise a ValueError if it is wrong."""
        names = [str(name) for name in arrays["names"].tolist()]
        n = len(names)
        diameter, bounds = _floats(arrays, "diameter_m", (n,)), _floats(arrays, "bounds", (n, 2, 3))
        if len(set(names)) != n or not (diameter > 0).all():
            raise ValueError("objects are there twice, or have no size")
        discrete = _split(arrays, "discrete", "discrete_count", n, (4, 4))
        continuous = _split(arrays, "continuous", "continuous_count", n, (6,))
        points = _split(arrays, "points_mm", "points_count", n, (3,))
        kept: dict[str, tuple[dict[int, ModelInfo], dict[int, ndarray]]] = {}
        for i, name in enumerate(names):
            dataset, obj_id = split_object_name(name)
            info, some = kept.setdefault(dataset, ({}, {}))
            turns = tuple(ContinuousSymmetry(c[:3], c[3:]) for c in continuous[i])
            size, (lower, sides) = float(diameter[i]), bounds[i]
            info[obj_id] = ModelInfo(obj_id, size, lower, sides, _rigid(discrete[i]), turns)
            some[obj_id] = metres(points[i])
        grasps = _grasps(arrays)
        return cls({dataset: KnownModels(*parts) for dataset, parts in kept.items()}, grasps)


def with_objects(
    forecaster: Forecaster, models: Mapping[str, Models], grasps: GraspTable | None = None
) -> Forecaster:
    """Return the forecaster with what a robot needs to know of its objects.

    Parameters
    ----------
    models
        Dataset's name to its object models.
    grasps
        The grasps that the outcomes are of (:func:`graspcast.read_grasps`); None for none.
    """
    from dataclasses import replace

    known = KnownObjects.of(forecaster.card, models, grasps)
    others = tuple(replace(other, known=known) for other in forecaster.others)
    return replace(forecaster, known=known, others=others)


def spread_points(vertices: Float[ndarray, "v 3"]) -> Float[ndarray, "p 3"]:
    """Return all vertices, or :data:`MOST_POINTS` that are spread as all of them are.

    They are every so-manieth along a space-filling curve (Morton's order), so each part of the
    surface has its share.
    """
    if len(vertices) <= MOST_POINTS:
        return vertices
    low, span = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    cells = np.minimum((vertices - low) / span * _GRID, _GRID - 1).astype(np.int64)
    code = np.zeros(len(vertices), dtype=np.int64)
    for bit in range(_GRID.bit_length() - 1):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    order = np.lexsort((*vertices.T, code))
    which = (np.arange(MOST_POINTS) + 0.5) * (len(vertices) / MOST_POINTS)
    out: ndarray = vertices[order[which.astype(np.int64)]]
    return out


def _compact(points: Float[ndarray, "p 3"]) -> ndarray:
    """Return points in millimetres, in single precision where that loses nothing."""
    exact = millimetres(points)
    single = exact.astype(np.float32)
    return single if (metres(single.astype(np.float64)) == points).all() else exact


def _stacked(parts: Sequence[ndarray], shape: tuple[int, ...]) -> ndarray:
    return np.array(parts, dtype=np.float64).reshape(-1, *shape)


def _counts(parts: Sequence[Any]) -> ndarray:
    return np.array([len(part) for part in parts], dtype=np.int64)


def _floats(arrays: Mapping[str, ndarray], name: str, shape: tuple[int, ...]) -> ndarray:
    array = arrays[name]
    if array.shape != shape or array.dtype.kind != "f" or not np.isfinite(array).all():
        raise ValueError(f"{name} of the objects is not {shape} finite numbers")
    return array.astype(np.float64)


def _split(
    arrays: Mapping[str, ndarray], name: str, counts: str, n: int, shape: tuple[int, ...]
) -> list[ndarray]:
    count = arrays[counts]
    if count.shape != (n,) or count.dtype.kind != "i" or (count < 0).any():
        raise ValueError(f"{counts} of the objects is not {n} counts")
    every = _floats(arrays, name, (int(count.sum()), *shape))
    return np.split(every, np.cumsum(count)[:-1]) if n else []


def _rigid(poses: Float[ndarray, "n 4 4"]) -> Float[ndarray, "n 4 4"]:
    for pose in poses:
        if rotation_problem(pose[:3, :3]) or (pose[3] != [0, 0, 0, 1]).any():
            raise ValueError("a symmetry or grasp of an object is no rigid transform")
    return poses


def _grasps(arrays: Mapping[str, ndarray]) -> dict[str, dict[str, ndarray]]:
    objects, names = arrays["grasp_objects"].tolist(), arrays["grasp_names"].tolist()
    poses = _rigid(_floats(arrays, "obj_T_grasp", (len(objects), 4, 4)))
    out: dict[str, dict[str, ndarray]] = {}
    for of, name, pose in zip(objects, names, poses, strict=True):
        if str(name) in out.setdefault(str(of), {}):
            raise ValueError(f"two grasps of {of} are called {name}")
        out[str(of)][str(name)] = pose
    return out
