"""The models of a dataset with their colours, each read once."""

from __future__ import annotations

from jaxtyping import UInt8
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.meshes import Mesh, read_coloured_mesh
from graspcast.bop.models import mesh_name
from graspcast.errors import FormatError

__all__ = ["ColouredModels"]


class ColouredModels:
    """Models with the RGB colour of each vertex, by number of the object.

    Parameters
    ----------
    dataset
        Whose models they are.
    """

    def __init__(self, dataset: BopDataset):
        self._dataset = dataset
        self._meshes: dict[int, tuple[Mesh, UInt8[ndarray, "v 3"]]] = {}

    def __getitem__(self, obj_id: int) -> tuple[Mesh, UInt8[ndarray, "v 3"]]:
        """Return mesh (metres) and colours of an object.

        Raises
        ------
        UnknownNameError
            If the dataset has no such object.
        FormatError
            If the file cannot be read, or has no faces.
        """
        if obj_id not in self._meshes:
            models = self._dataset.models
            models[obj_id]
            # Models for evaluation have no colours.
            path = self._dataset.root / "models" / mesh_name(obj_id)
            path = path if path.is_file() else models.directory / mesh_name(obj_id)
            found = read_coloured_mesh(path)
            if not len(found[0].faces):
                raise FormatError(path, "has no faces, only points, so it cannot be drawn")
            self._meshes[obj_id] = found
        return self._meshes[obj_id]
