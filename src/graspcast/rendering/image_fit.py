"""Image fit: how well an object's projected model fits the image at an estimated pose.

The outline of the model at the pose is held against the image: whether the colour changes across
it, whether the image's edges run along it, and how far off the strongest edge beside it lies. A
poor fit means that the pose is wrong, or that something stands before the object; the two cannot
be told apart. Only the shape of the model is used, not its colours, and no ground truth.

References
----------
C. Harris and C. Stennett, *RAPiD: A Video Rate Object Tracker*, BMVC 1990 (edges searched along
the normals of an outline). S. Hinterstoisser et al., *Gradient Response Maps for Real-Time
Detection of Textureless Objects*, IEEE TPAMI 2012 (orientation of gradients). S. Di Zenzo, *A Note
on the Gradient of a Multi-Image*, 1986 (colour gradient).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.meshes import Mesh
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import Instances
from graspcast.forecasting.features import Features
from graspcast.io.progress import Count, Progress
from graspcast.rendering.outline import REACH, Outline, outline_of

__all__ = [
    "FIT_COLUMNS",
    "ImageFit",
    "describe_fit",
    "fit_of_instances",
    "image_fit",
    "with_image_fit",
]

_MEANING = {
    "fit_orientation": (
        "1",
        "how far the image's edges run along the outline: squared cosine between the colour "
        "gradient and the outline's normal, mean over the outline; 0.5 for random edges, 0 where "
        "there are none, 1 at best",
    ),
    "fit_weakest": (
        "1",
        "the same of the weakest of eight sectors around the outline's centre; low where a part "
        "of the outline is hidden or misplaced",
    ),
    "fit_step": (
        "1",
        "change of colour from 2 pixels inside to 2 pixels outside the outline: s / (s + 0.05), s "
        "the distance in CIELAB over 100, mean over the outline; from 0 to 1",
    ),
    "fit_sides": (
        "1",
        "distance between the median colours 4 pixels inside and 4 pixels outside the outline, "
        "CIELAB over 100: whether the object as a whole differs from what is around it",
    ),
    "fit_coherence": (
        "1",
        "how alike the changes of colour across the outline are: length of their mean over the "
        "mean of their lengths, 3 pixels to either side; 1 if all are the same",
    ),
    "fit_support": (
        "1",
        "share of the outline whose strongest edge within 6 pixels lies within 1 pixel, and is at "
        "least 0.05 (CIELAB over 100, over 2 pixels)",
    ),
    "fit_offset": (
        "px",
        "distance from the outline to the strongest edge within 6 pixels, mean over the outline; "
        "pixels of the crop",
    ),
    "fit_shift": (
        "1",
        "length of the displacement in the image that would best bring the outline to these edges "
        "(robust least squares), over the outline's radius (root mean square)",
    ),
    "fit_scale": (
        "1",
        "the same of the scale: positive if a larger outline, a nearer object, fits better",
    ),
    "fit_inside": ("1", "share of the model's vertices that project into the image"),
}

FIT_COLUMNS = tuple(_MEANING)
"""Names of the numbers, in order."""

_EDGE = 0.05
"""Change of colour over two pixels that counts as an edge, and at which a step counts half."""
_WEAK_GRADIENT = 1e-4
"""Squared gradient below which an orientation counts less than half."""
_SECTORS = 8
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class ImageFit:
    """Image fit of n instances.

    Attributes
    ----------
    values
        The numbers that :func:`describe_fit` explains, NaN where there are none, (n, 10).
    problems
        Why there are none, an empty text where there are, n of them.
    """

    values: Float[ndarray, "n f"]
    problems: tuple[str, ...]

    @property
    def features(self) -> Features:
        """The values with their names."""
        return Features(FIT_COLUMNS, self.values)


def describe_fit(name: str) -> tuple[str, str]:
    """Look up the unit and meaning of one of :data:`FIT_COLUMNS`.

    Raises
    ------
    UnknownNameError
        Listing the known names.
    """
    if name not in _MEANING:
        raise UnknownNameError("image fit", name, _MEANING)
    return _MEANING[name]


def image_fit(
    image: UInt8[ndarray, "h w *channels"],
    K: Float[ndarray, "3 3"],
    meshes: Sequence[Mesh],
    cam_T_obj: Float[ndarray, "n 4 4"],
) -> ImageFit:
    """Compute how well objects' projected models fit an image at their estimated poses.

    Parts of an outline outside the image do not count. There are no numbers for an object behind
    the camera or outside the image, whose pose is not sane, or of whose outline fewer than 12
    pixels can be judged: a tiny one, or one that fills the image. Nor are there any in an image
    that has one colour throughout, as one taken in the dark.

    Parameters
    ----------
    image
        RGB, (h, w, 3), or grey, (h, w) or (h, w, 1).
    K
        Intrinsics, pixels.
    meshes
        The mesh of each instance's object.
    cam_T_obj
        The estimated pose of each instance, metres, (n, 4, 4).

    Raises
    ------
    InputError
        If these are not an image of 8 bits per channel, intrinsics, and as many meshes as poses.
    """
    rgb = _checked_image(image)
    K = np.asarray(K, dtype=np.float64)
    if K.shape != (3, 3) or not np.isfinite(K).all() or K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError("K should be a 3x3 matrix with positive focal lengths", parameters=("K",))
    poses = np.asarray(cam_T_obj, dtype=np.float64)
    if poses.shape != (len(meshes), 4, 4):
        raise InputError(
            f"cam_T_obj should be {len(meshes)} matrices of 4x4, one for each mesh, not an array "
            f"of shape {poses.shape}",
            parameters=("cam_T_obj",),
        )
    values = np.full((len(meshes), len(FIT_COLUMNS)), np.nan)
    if (rgb == rgb[0, 0]).all():
        return ImageFit(values, ("the image has one colour throughout",) * len(meshes))
    problems = []
    for i, mesh in enumerate(meshes):
        found = outline_of(rgb, K, mesh, poses[i])
        problems.append(found if isinstance(found, str) else "")
        if isinstance(found, Outline):
            values[i] = _numbers(found)
    return ImageFit(values, tuple(problems))


def fit_of_instances(
    instances: Instances,
    cam_T_obj: Float[ndarray, "n 4 4"],
    datasets: Mapping[str, BopDataset],
    *,
    progress: Progress | None = None,
) -> ImageFit:
    """Compute the image fit of instances in the images of BOP datasets.

    Each image is read once. An instance whose image is not there has no numbers, and its problem
    says so.

    Parameters
    ----------
    instances
        Of n instances.
    cam_T_obj
        One estimator's poses of them, metres, (n, 4, 4).
    datasets
        Dataset's name to the dataset, with images, cameras and models.
    progress
        Called with the share of the images that are done.

    Raises
    ------
    MismatchError
        For an instance of a dataset that is not given.
    FormatError
        For an image, a camera or a mesh that cannot be read.
    """
    if lacking := sorted(set(instances.dataset.tolist()) - set(datasets)):
        raise MismatchError(
            f"there are no images of dataset {', '.join(lacking)}; there are those of "
            f"{', '.join(datasets) or 'none'}",
            parameters=("bop",),
        )
    values = np.full((len(instances), len(FIT_COLUMNS)), np.nan)
    problems = [""] * len(instances)
    images = {name: _images(dataset) for name, dataset in datasets.items()}
    rows_of: dict[tuple[str, int, int], list[int]] = {}
    for row, key in enumerate(instances.to_keys()):
        rows_of.setdefault((key.dataset, *key.image), []).append(row)
    for done, ((name, scene_id, im_id), rows) in enumerate(rows_of.items()):
        dataset = datasets[name]
        if (scene_id, im_id) in images[name]:
            image = dataset.image(scene_id, im_id)
            meshes = [dataset.models.mesh(int(instances.obj_id[row])) for row in rows]
            K = dataset.camera_of(scene_id, im_id).K
            found = image_fit(image, K, meshes, cam_T_obj[rows])
            values[rows] = found.values
            texts = found.problems
        else:
            texts = (f"{_NO_IMAGE} {scene_id}/{im_id}",) * len(rows)
        for row, text in zip(rows, texts, strict=True):
            problems[row] = text
        if progress is not None:
            count = Count(done + 1, len(rows_of), "images compared with estimates")
            progress(count.share, count)
    return ImageFit(values, tuple(problems))


def with_image_fit(
    estimates: Estimates,
    datasets: Mapping[str, BopDataset],
    notes: list[str] | None = None,
    *,
    progress: Progress | None = None,
) -> Estimates:
    """Add the image fit of every estimator's poses to what is known of estimates.

    Parameters
    ----------
    estimates
        Of n instances.
    datasets
        Dataset's name to the dataset; images may be missing, also all of a dataset.
    notes
        Gets how many instances have an image fit, and why others have none.
    progress
        Called with the share of the images that are done.

    Raises
    ------
    MismatchError, FormatError
        As :func:`fit_of_instances`.
    InputError
        If there is not one image of these instances.
    """
    found = []
    for name in estimates.estimators:
        fit = fit_of_instances(estimates.instances, estimates.of(name), datasets, progress=progress)
        found.append(fit.values)
        if fit.problems and all(text.startswith(_NO_IMAGE) for text in fit.problems):
            raise InputError(
                f"there is no image of any instance, for example: {fit.problems[0]}; leave images "
                "out, or give directories that hold them (SCENE/rgb/IMAGE)",
                parameters=("images", "bop"),
            )
        if notes is not None:
            notes.append(_summary(name, fit.problems))
    values = np.stack(found)
    seen = {column: values[:, :, i] for i, column in enumerate(FIT_COLUMNS)}
    return replace(estimates, seen={**estimates.seen, **seen})


_NO_IMAGE = "there is no image"


def _images(dataset: BopDataset) -> Mapping[tuple[int, int], Path]:
    """Return a dataset's images; none where its directory holds none."""
    return dataset.images if dataset.has_images else {}


def _summary(estimator: str, problems: Sequence[str]) -> str:
    """Say how many instances have an image fit, and why others have none."""
    lacking = [text for text in problems if text]
    out = f"image fit of {len(problems) - len(lacking)} of {len(problems)} instances"
    kinds: dict[str, list[str]] = {}
    for text in lacking:
        kinds.setdefault(re.sub(r"[-+.\d]*\d(/\d+)?", "N", text), []).append(text)
    for texts in kinds.values():
        more = ", …" if len(set(texts)) > 1 else ""
        out += f"; none of {len(texts)}: {texts[0]}{more}"
    return f"{estimator}: {out}"


def _checked_image(image: Any) -> UInt8[ndarray, "h w 3"]:
    """Return an image as RGB; a grey one has three equal channels."""
    given = np.asarray(image)
    grey = given[..., None] if given.ndim == 2 else given
    if given.dtype != np.uint8 or grey.ndim != 3 or grey.shape[2] not in (1, 3) or not given.size:
        raise InputError(
            "the image should be an array of 8-bit integers (uint8) of shape (height, width, 3), "
            f"RGB, or (height, width), grey; it is {given.dtype} of shape {given.shape}",
            parameters=("image",),
        )
    return np.ascontiguousarray(np.broadcast_to(grey, (*grey.shape[:2], 3)))


def _numbers(found: Outline) -> Float[ndarray, " f"]:
    """Compute the numbers of an outline, in the order of :data:`FIT_COLUMNS`."""
    orientation = found.along / (found.total + _WEAK_GRADIENT)
    colours = found.profiles
    step = np.linalg.norm(colours[:, REACH + 2] - colours[:, REACH - 2], axis=1)
    change = colours[:, REACH + 3] - colours[:, REACH - 3]
    length = float(np.linalg.norm(change, axis=1).mean())
    beyond = np.median(colours[:, REACH + 4], axis=0) - np.median(colours[:, REACH - 4], axis=0)
    edges = np.linalg.norm(colours[:, 2:] - colours[:, :-2], axis=2)
    offset = edges.argmax(axis=1) - (REACH - 1)
    strength = edges.max(axis=1)
    there = strength >= _EDGE
    moved, grown = _registration(found, np.where(there, strength, 0.0), offset)
    return np.array(
        [
            orientation.mean(),
            _weakest_sector(found.points, orientation),
            (step / (step + _EDGE)).mean(),
            np.linalg.norm(beyond),
            np.linalg.norm(change.mean(axis=0)) / length if length > 0 else 0.0,
            (there & (np.abs(offset) <= 1)).mean(),
            np.abs(offset).mean(),
            moved,
            grown,
            found.inside,
        ]
    )


def _weakest_sector(points: Float[ndarray, "m 2"], values: Float[ndarray, " m"]) -> float:
    """Return the lowest mean of values in eight sectors around the points' centre."""
    x, y = (points - points.mean(axis=0)).T
    sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * _SECTORS).astype(np.int64)
    sector = np.minimum(sector, _SECTORS - 1)
    count = np.bincount(sector, minlength=_SECTORS)
    total = np.bincount(sector, weights=values, minlength=_SECTORS)
    enough = count >= max(1.0, len(points) / (4 * _SECTORS))
    return float((total[enough] / count[enough]).min())


def _registration(
    found: Outline, weight: Float[ndarray, " m"], offset: ndarray
) -> tuple[float, float]:
    """Fit a displacement and a scale that bring the outline to the edges beside it.

    Least squares with Cauchy weights, and a weak pull to zero, so that outlines with few edges, or
    round ones, have a solution.

    Returns
    -------
    Length of the displacement and change of scale, both over the outline's radius.
    """
    around = found.points - found.points.mean(axis=0)
    radius = float(np.sqrt((around**2).sum(axis=1).mean()))
    outward = (found.normals * around).sum(axis=1, keepdims=True) / radius
    design = np.concatenate([found.normals, outward], axis=1)
    solution = np.zeros(3)
    for _ in range(_ROUNDS):
        trust = weight / (1 + (offset - design @ solution) ** 2)
        normal = design.T @ (design * trust[:, None]) + 0.5 * np.eye(3)
        solution = np.linalg.solve(normal, design.T @ (trust * offset))
    return float(np.hypot(*solution[:2]) / radius), float(solution[2] / radius)
