"""Shapes of models: whether a transform leaves a mesh as it is, and symmetries that are stated."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.diagnosis.case import Case
from graspcast.diagnosis.finding import Finding
from graspcast.errors import GraspcastError
from graspcast.pose.lengths import shown
from graspcast.pose.transforms import rotation_angle
from graspcast.simulation.objects.surface import Surface
from graspcast.simulation.objects.symmetries import deviation, find_symmetries

__all__ = ["keeps_shape", "shape_deviation", "shape_findings", "surface_of"]

KEPT = 0.06
"""Distance that 90 % of the moved surface keeps to, by the diameter across the axis.

Of the symmetries that LM-O states the largest is 0.034; scans are not as symmetric as the objects.
"""
_MOST_SEARCHED = 12
_SAMPLE = 2000


@cache
def surface_of(models: Models, obj_id: int) -> Surface | None:
    """Return the surface of an object's mesh, None without a mesh that has faces."""
    try:
        mesh = models.mesh(obj_id) if obj_id in models.info else None
    except GraspcastError:
        return None
    if mesh is None or not len(mesh.faces):
        return None
    return Surface(mesh.vertices, mesh.faces)


def shape_deviation(surface: Surface, pose: Float[ndarray, "4 4"]) -> float:
    """Return how far 90 % of a moved surface is from the surface, by the diameter across the axis.

    Of a transform that moves the shape as a whole, by at least that way.
    """
    across = deviation(surface, pose[:3, :3]).across_m
    points = surface.by_area @ pose[:3, :3].T + pose[:3, 3]
    return float(np.quantile(surface.distances(points), 0.9)) / across


def keeps_shape(models: Models | None, obj_id: int, pose: Float[ndarray, "4 4"]) -> bool:
    """Return whether a transform leaves an object's shape about as it is."""
    surface = None if models is None else surface_of(models, obj_id)
    if surface is None or rotation_angle(pose[:3, :3]) < np.radians(20):
        return False
    turned = pose.copy()
    # The offset of an estimated transform is less certain than its rotation.
    middle = surface.centroid
    off = float(np.linalg.norm(pose[:3, :3] @ middle + pose[:3, 3] - middle))
    turned[:3, 3] = middle - pose[:3, :3] @ middle
    return off < 0.15 * surface.diameter_m and shape_deviation(surface, turned) < KEPT


def shape_findings(case: Case) -> Iterator[Finding]:
    """Hold stated symmetries, and other directories of models, against the meshes."""
    if case.models is None:
        return
    yield from _inside_out(case.models)
    for others in case.other_models:
        yield from _inside_out(others)
        yield from _other_meshes(case.models, others)
    yield from _contradicted(case.models)
    yield from _unstated(case.models)


def _inside_out(models: Models) -> Iterator[Finding]:
    """Say which meshes enclose a negative volume."""
    wrong: dict[int, float] = {}
    for obj_id in models.info:
        surface = surface_of(models, obj_id)
        if surface is None:
            continue
        corners = surface.triangles
        volume = float(
            np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
        )
        if volume < -0.01 * surface.diameter_m**3:
            wrong[obj_id] = volume
    if wrong:
        obj_id = min(wrong)
        yield Finding(
            "error",
            "mesh-mirrored",
            f"{models.directory}/obj_{obj_id:06d}.ply",
            f"the faces of {_objects(wrong)} point inward (its volume is "
            f"{1e6 * wrong[obj_id]:.3g} cm³), as those of a mesh whose x, y or z was negated",
            "Take the meshes of the release; if they are not mirrored, turn their faces round",
            {"objects": sorted(wrong), "volume_m3": wrong[obj_id]},
        )


def _objects(numbers: object) -> str:
    listed = sorted(numbers)  # type: ignore[call-overload]
    return f"object{'' if len(listed) == 1 else 's'} {', '.join(map(str, listed))}"


def _other_meshes(models: Models, others: Models) -> Iterator[Finding]:
    """Compare the meshes of two directories."""
    for obj_id in sorted(set(models.info) & set(others.info)):
        one, other = surface_of(models, obj_id), surface_of(others, obj_id)
        if one is None or other is None:
            continue
        points = other.samples[:: max(1, len(other.samples) // _SAMPLE)]

        def apart(sign: ndarray, one: Surface = one, points: ndarray = points) -> float:
            return float(np.quantile(one.distances(points * sign), 0.9)) / one.diameter_m

        plain = apart(np.ones(3))
        if plain < 0.03:
            continue
        signs = {name: apart(1 - 2.0 * np.eye(3)[i]) for i, name in enumerate("xyz")}
        axis = min(signs, key=lambda name: signs[name])
        path = f"{others.directory}/obj_{obj_id:06d}.ply"
        said = (
            f"90 % of the surface lies within {plain:.1%} of the diameter from the mesh of the "
            f"same object in {models.directory}"
        )
        numbers = {"apart": plain, "mirrored": signs[axis]}
        if signs[axis] < min(0.02, plain / 3):
            yield Finding(
                "error",
                "mesh-mirrored",
                path,
                f"{said}, and {signs[axis]:.1%} when it is mirrored in {axis}",
                "Keep the mesh that fits the images, and make the other from it",
                numbers,
            )
        else:
            shift = float(np.linalg.norm(one.centroid - other.centroid))
            yield Finding(
                "warning",
                "models-differ",
                path,
                f"{said}; their middles are {shown(shift)} apart",
                "Use the models that the poses are of",
                {**numbers, "middles_apart_m": shift},
            )
        return


def _contradicted(models: Models) -> Iterator[Finding]:
    """Say which stated symmetries the meshes do not have."""
    for obj_id, info in models.info.items():
        surface = surface_of(models, obj_id)
        if surface is None or not info.symmetric:
            continue
        poses = info.symmetries[1:]
        # A continuous symmetry is hundreds of rotations; the same few show it.
        poses = poses[:: max(1, len(poses) // 8)]
        far = [shape_deviation(surface, pose) for pose in poses]
        if max(far) < KEPT:
            continue
        worst = poses[int(np.argmax(far))]
        angle = np.degrees(rotation_angle(worst[:3, :3]))
        yield Finding(
            "error",
            "symmetry-contradicted",
            f"{models.directory}/models_info.json",
            f"object {obj_id}: a stated symmetry, a turn by {angle:.0f}°, moves 10 % of the "
            f"surface by {max(far):.0%} of the diameter across its axis or more; a symmetry moves "
            f"it by less than {KEPT:.0%}",
            "Leave the symmetry out, or correct its axis and offset",
            {"object": obj_id, "deviation": max(far), "turn_deg": angle},
        )


def _unstated(models: Models) -> Iterator[Finding]:
    """Note which shapes are symmetric without that being stated; colours may tell."""
    plain = [i for i, info in models.info.items() if not info.symmetric][:_MOST_SEARCHED]
    found = {}
    for obj_id in plain:
        surface = surface_of(models, obj_id)
        if surface is None:
            continue
        symmetries = find_symmetries(surface)
        if len(symmetries.discrete) or symmetries.continuous:
            found[obj_id] = str(symmetries)
    if found:
        words = "; ".join(f"{i} ({said})" for i, said in found.items())
        yield Finding(
            "note",
            "shape-symmetric",
            f"{models.directory}/models_info.json",
            f"the shapes of {len(found)} of {len(models.info)} objects are symmetric, and no "
            f"symmetry is stated: {words}",
            "State the symmetries of objects whose colours do not tell their sides",
            {"objects": sorted(found)},
        )
