"""The objects that estimators are trained for: meshes, sizes and the name of their dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from graspcast.bop.models import Models
from graspcast.errors import InputError
from graspcast.io.hashing import canonical_json, sha256, sha256_of_file
from graspcast.rendering.synthetic.dataset import read_models
from graspcast.rendering.synthetic.tabletop import ColouredMesh

__all__ = ["Objects"]

_FOLDERS = ("models", "models_eval")


@dataclass(frozen=True, eq=False)
class Objects:
    """The objects that estimators are trained for.

    Attributes
    ----------
    dataset
        Name of their dataset.
    meshes
        Coloured meshes by BOP id.
    models
        Sizes and symmetries.
    """

    dataset: str
    meshes: dict[int, ColouredMesh]
    models: Models

    @property
    def ids(self) -> tuple[int, ...]:
        """BOP ids, in the order of training."""
        return tuple(self.meshes)

    @classmethod
    def read(
        cls,
        directory: str | PathLike[str],
        obj_ids: Sequence[int] = (),
        dataset: str | None = None,
    ) -> Objects:
        """Read objects from a BOP directory of models.

        Parameters
        ----------
        directory
            The directory with ``models_info.json``, or that of its dataset.
        obj_ids
            Restrict to these objects; by default all.
        dataset
            Name of the dataset; by default that of the directory that holds ``models``.

        Raises
        ------
        FormatError
            If ``models_info.json`` or a mesh is missing or wrong.
        InputError
            If the name of the dataset is not given, and does not follow from the directory.
        UnknownNameError
            For an unknown object.
        """
        path = Path(directory)
        if not (path / "models_info.json").is_file():
            inside = [
                path / name for name in _FOLDERS if (path / name / "models_info.json").is_file()
            ]
            path = inside[0] if inside else path
        meshes = read_models(path, sorted(set(obj_ids)))
        if dataset is None:
            where = path.resolve()
            if where.name not in _FOLDERS:
                raise InputError(
                    f"{directory}: the name of the dataset would be that of the directory that "
                    f"holds models/, but this one is called {where.name}; give the name, so that "
                    "the weights are not used for objects of another dataset",
                    parameters=("dataset",),
                )
            dataset = where.parent.name
        return cls(dataset, meshes, Models(path))

    @property
    def digest(self) -> str:
        """SHA-256 of the meshes and of the objects' sizes and symmetries."""
        folder = self.models.directory
        meshes = [sha256_of_file(folder / f"obj_{obj_id:06d}.ply") for obj_id in self.ids]
        infos = [self.models[obj_id] for obj_id in self.ids]
        numbers = [
            [i.diameter_m, i.lower.tolist(), i.size.tolist(), i.symmetries.tolist()] for i in infos
        ]
        return sha256(canonical_json([list(self.ids), meshes, numbers]))
