"""Sheets of estimates on their images, with errors and verdicts below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.dataset import BopDataset, GroundTruth
from graspcast.bop.meshes import Mesh, read_coloured_mesh
from graspcast.bop.results import Results
from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.estimates.alignment import estimate_ids, partners, rows_in_image
from graspcast.estimates.instances import InstanceKey
from graspcast.estimates.matching import match
from graspcast.forecasting.verdict import VerdictRow
from graspcast.pose.metrics import rotation_error, translation_error
from graspcast.rendering.drawing import BAD, FAINT, GOOD, INK, blank, width_of, write
from graspcast.rendering.overlay import draw_overlay

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["Overlay", "overlay_sheet", "overlays"]

_COLUMNS = 4
_SAME_POSE = 1e-6


@dataclass(frozen=True, eq=False)
class Overlay:
    """One estimate on its image.

    Attributes
    ----------
    object
        For example ``"lmo-5"``.
    scene_id, im_id
        The image.
    estimator
        Whose estimate it is.
    pixels
        The picture; None if the estimator has no estimate of the instance.
    rotation_deg, translation_mm
        How far off the estimate is, symmetries taken into account; None without a ground truth.
    verdicts
        What was decided on it, for each gripper.
    """

    object: str
    scene_id: int
    im_id: int
    estimator: str
    pixels: UInt8[ndarray, "size size 3"] | None
    rotation_deg: float | None = None
    translation_mm: float | None = None
    verdicts: tuple[VerdictRow, ...] = ()


def overlays(
    dataset: BopDataset,
    results: Mapping[str, Results],
    images: Sequence[tuple[int, int]],
    *,
    verdicts: Sequence[VerdictRow] | None = None,
    size: int = 320,
) -> list[Overlay]:
    """Draw every estimate in some images, one field for each estimator of each instance.

    The first estimator's estimates of an object, by decreasing score, are its instances; the
    others' are assigned to them as in :func:`graspcast.estimates.alignment.align`.

    Parameters
    ----------
    dataset
        Images, cameras, models, and ground truth if there is one.
    results
        Estimator's name to its results of the wanted objects.
    images
        (scene, image).
    verdicts
        Each is shown with the estimate of its principal that it is about.
    size
        Pixels on a side of a picture.

    Raises
    ------
    InputError
        For an image without an estimate, or an estimate by a principal without its verdict.
    MismatchError
        If no verdict has one of the estimators as its principal.
    FormatError
        For an image or a mesh that cannot be read.
    """
    return _Drawing(dataset, results, verdicts, size).of(images)


def overlay_sheet(fields: Sequence[Overlay], *, estimators: int = 1, size: int = 320) -> Image:
    """Overlays with their captions; those of one instance, by so many estimators, side by side."""
    from PIL import Image as Pictures

    font, gap = max(9, min(15, size // 20)), 8
    line = font + 5
    told = [_captions(field) for field in fields]
    widest = max(width_of(text, font) for captions in told for text, _ in captions)
    width, height = max(size, int(widest) + 1), size + (max(map(len, told)) + 1) * line
    columns = min(estimators * max(1, _COLUMNS // estimators), len(fields))
    sheet, draw = blank(columns * (width + gap) - gap, -(-len(fields) // columns) * height)
    for k, (field, captions) in enumerate(zip(fields, told, strict=True)):
        middle, y = k % columns * (width + gap) + width // 2, k // columns * height
        x = middle - size // 2
        if field.pixels is None:
            draw.rectangle((x, y, x + size - 1, y + size - 1), outline=(225, 226, 228))
            write(draw, (middle, y + size // 2), "no estimate", font, FAINT, "mm")
        else:
            sheet.paste(Pictures.fromarray(field.pixels), (x, y))
        for number, (text, colour) in enumerate(captions):
            at = (middle, y + size + number * line + 3 * line // 5)
            write(draw, at, text, font, colour, "mm")
    return sheet


def _captions(field: Overlay) -> list[tuple[str, tuple[int, int, int]]]:
    out = [(f"{field.object} in {field.scene_id}/{field.im_id}, {field.estimator}", INK)]
    if field.rotation_deg is not None and field.translation_mm is not None:
        out.append((f"{field.rotation_deg:.1f}°, {field.translation_mm:.1f} mm off", FAINT))
    for row in field.verdicts:
        given = row.verdict.probability
        told = "" if given is None else f", probability {given:.2f}"
        colour = GOOD if row.verdict.attempt else BAD
        out.append((f"{row.gripper}: {row.verdict}{told}", colour))
    return out


class _Drawing:
    """What all fields of a sheet have in common."""

    def __init__(
        self,
        dataset: BopDataset,
        results: Mapping[str, Results],
        verdicts: Sequence[VerdictRow] | None,
        size: int,
    ):
        self.dataset, self.results, self.size = dataset, results, size
        self.truth = _truth(dataset)
        self.matched = (
            None if self.truth is None else [match(table, self.truth) for table in results.values()]
        )
        self.est_ids = {name: estimate_ids(table) for name, table in results.items()}
        self.verdicts: dict[tuple[str, InstanceKey], list[VerdictRow]] | None = None
        if verdicts is not None:
            self.verdicts = {}
            for row in verdicts:
                self.verdicts.setdefault((row.principal, row.key), []).append(row)
            self.principals = {row.principal for row in verdicts}
            if not self.principals & set(results):
                raise MismatchError(
                    f"the verdicts are on estimates by {', '.join(sorted(self.principals))}, but "
                    f"the estimates are by {', '.join(results)}",
                    parameters=("verdicts", "estimates"),
                )
        self._meshes: dict[int, tuple[Mesh, UInt8[ndarray, "v 3"]]] = {}

    def of(self, images: Sequence[tuple[int, int]]) -> list[Overlay]:
        out: list[Overlay] = []
        tables = list(self.results.values())
        for image in images:
            found: list[list[int]] = []
            missing: InputError | None = None
            for table in tables:
                try:
                    found.append(rows_in_image(table, *image, self.dataset.name).tolist())
                except InputError as error:
                    missing = missing or error
                    found.append([])
            if missing is not None and not any(found):
                raise missing
            pairs = zip(tables, found, strict=True)
            present = {int(table.obj_id[row]) for table, rows in pairs for row in rows}
            for obj_id in sorted(present):
                mine = [
                    [row for row in rows if table.obj_id[row] == obj_id]
                    for table, rows in zip(tables, found, strict=True)
                ]
                anchor = next(k for k, rows in enumerate(mine) if rows)
                for row in partners(mine, anchor, tables):
                    out += [
                        self._field(image, obj_id, number, chosen)
                        for number, chosen in enumerate(row)
                    ]
        return out

    def _field(self, image: tuple[int, int], obj_id: int, number: int, row: int | None) -> Overlay:
        name, estimator = f"{self.dataset.name}-{obj_id}", list(self.results)[number]
        if row is None:
            return Overlay(name, *image, estimator, None)
        cam_T_est = self.results[estimator].cam_T_obj[row]
        cam_T_true = rotation_deg = translation_mm = None
        if self.truth is not None and self.matched is not None:
            true_row = self.matched[number][row]
            if true_row >= 0:
                cam_T_true = self.truth.cam_T_obj[true_row]
                rotation_deg, translation_mm = self._off(obj_id, cam_T_est, cam_T_true)
        pixels = draw_overlay(
            self.dataset.image(*image),
            self.dataset.camera_of(*image).K,
            *self._mesh(obj_id),
            cam_T_est,
            cam_T_true,
            size=self.size,
        )
        est_id = int(self.est_ids[estimator][row])
        key = InstanceKey(self.dataset.name, *image, obj_id, est_id)
        verdicts = self._verdicts(estimator, key, cam_T_est)
        return Overlay(name, *image, estimator, pixels, rotation_deg, translation_mm, verdicts)

    def _off(
        self, obj_id: int, cam_T_est: Float[ndarray, "4 4"], cam_T_true: Float[ndarray, "4 4"]
    ) -> tuple[float, float]:
        pair = cam_T_est[None], cam_T_true[None]
        rotation = rotation_error(*pair, self.dataset.models[obj_id].symmetries)
        return float(np.degrees(rotation[0])), float(1000 * translation_error(*pair)[0])

    def _verdicts(
        self, estimator: str, key: InstanceKey, cam_T_est: Float[ndarray, "4 4"]
    ) -> tuple[VerdictRow, ...]:
        if self.verdicts is None or estimator not in self.principals:
            return ()
        rows = self.verdicts.get((estimator, key))
        if not rows:
            raise InputError(
                f"no verdict on {key} by {estimator}: are the verdicts on these estimates?",
                parameters=("verdicts",),
            )
        if any(np.abs(row.cam_T_obj - cam_T_est).max() > _SAME_POSE for row in rows):
            raise MismatchError(
                f"the verdict on {key} by {estimator} was on another pose than the one in "
                f"{self.results[estimator].source}; give the estimates it is about",
                parameters=("verdicts", "estimates"),
            )
        return tuple(rows)

    def _mesh(self, obj_id: int) -> tuple[Mesh, UInt8[ndarray, "v 3"]]:
        if obj_id not in self._meshes:
            self.dataset.models[obj_id]
            file = f"obj_{obj_id:06d}.ply"
            # Models for evaluation have no colours.
            path = self.dataset.root / "models" / file
            path = path if path.is_file() else self.dataset.models.directory / file
            self._meshes[obj_id] = read_coloured_mesh(path)
            if not len(self._meshes[obj_id][0].faces):
                raise FormatError(path, "has no faces, only points, so it cannot be drawn")
        return self._meshes[obj_id]


def _truth(dataset: BopDataset) -> GroundTruth | None:
    """None where the split has no ``scene_gt.json`` at all, as test images may have none."""
    if not any(dataset.scenes.glob("*/scene_gt.json")):
        return None
    return dataset.ground_truth
