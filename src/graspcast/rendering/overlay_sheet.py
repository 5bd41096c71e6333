"""Sheets of estimates on their images, with errors and verdicts below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.dataset import BopDataset, GroundTruth
from graspcast.bop.results import Results
from graspcast.errors import InputError
from graspcast.estimates.alignment import estimate_ids, partners, rows_in_image
from graspcast.estimates.instances import InstanceKey
from graspcast.estimates.matching import match
from graspcast.forecasting.verdict import VerdictRow
from graspcast.forecasting.view_verdicts import FUSED
from graspcast.io.wording import counted
from graspcast.pose.metrics import rotation_error, translation_error
from graspcast.rendering.coloured_models import ColouredModels
from graspcast.rendering.drawing import (
    BAD,
    FAINT,
    GOOD,
    GUIDE,
    INK,
    LOOK,
    blank,
    width_of,
    write,
)
from graspcast.rendering.overlay import EDGE, draw_overlay
from graspcast.rendering.overlay_verdicts import (
    VerdictTable,
    draw_arrow,
    side_of,
    with_several_views,
)

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["DrawnGuide", "Overlay", "overlay_sheet", "overlays"]

_COLUMNS = 4
_SAME_POSE = 1e-6
_LEGEND = (("estimate", EDGE), ("pose that guides the grasp", GUIDE))


@dataclass(frozen=True, eq=False)
class DrawnGuide:
    """A pose that guides a grasp, drawn as an outline.

    Attributes
    ----------
    name
        Whose it is.
    cam_T_obj
        The pose, metres.
    rotation_deg, translation_mm
        How far off it is, symmetries taken into account; None without a ground truth.
    """

    name: str
    cam_T_obj: Float[ndarray, "4 4"]
    rotation_deg: float | None = None
    translation_mm: float | None = None


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
    guides
        The poses that guide grasps of the instance by verdicts with several views, and are drawn
        beside the estimate.
    """

    object: str
    scene_id: int
    im_id: int
    estimator: str
    pixels: UInt8[ndarray, "size size 3"] | None
    rotation_deg: float | None = None
    translation_mm: float | None = None
    verdicts: tuple[VerdictRow, ...] = ()
    guides: tuple[DrawnGuide, ...] = ()


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
        Each is shown with the estimate of its principal that it is about. By the fused pose, it is
        shown with the first estimate of the instance, and the pose is drawn on all of them.
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
    legend = _LEGEND if any(field.guides for field in fields) else ()
    widest = max([widest, *(width_of(text, font) + 2 * line for text, _ in legend)])
    width, height = max(size, int(widest) + 1), size + (max(map(len, told)) + 1) * line
    columns = min(estimators * max(1, _COLUMNS // estimators), len(fields))
    below = -(-len(fields) // columns) * height
    sheet, draw = blank(columns * (width + gap) - gap, below + len(legend) * line)
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
    for number, (text, colour) in enumerate(legend):
        y = below + number * line + line // 2
        draw.rectangle((2, y - font // 3, line, y + font // 3), outline=colour, width=2)
        write(draw, (line + 6, y), text, font, INK, "lm")
    return sheet


def _captions(field: Overlay) -> list[tuple[str, tuple[int, int, int]]]:
    out = [(f"{field.object} in {field.scene_id}/{field.im_id}, {field.estimator}", INK)]
    if field.rotation_deg is not None and field.translation_mm is not None:
        out.append((f"{field.rotation_deg:.1f}°, {field.translation_mm:.1f} mm off", FAINT))
    for row in field.verdicts:
        given = row.verdict.probability
        told = "" if given is None else f", probability {given:.2f}"
        look = row.verdict.look
        several = f", {counted(row.views, 'view')}"
        colour = GOOD if row.verdict.attempt else BAD if look is None else LOOK
        told += several if with_several_views(row) else ""
        out.append((f"{row.gripper}: {row.verdict}{told}", colour))
        if look is not None:
            side, _ = side_of(look, row.cam_T_obj)
            expected = look.expected_probability
            then = "" if expected is None else f", expected {expected:.2f}"
            out.append((f"look from {np.degrees(look.angle_rad):.0f}° {side}{then}", LOOK))
    out += [(_told(guide), GUIDE) for guide in field.guides if field.verdicts]
    return out


def _told(guide: DrawnGuide) -> str:
    name = "fused pose" if guide.name == FUSED else guide.name
    if guide.rotation_deg is None or guide.translation_mm is None:
        return f"guide: {name}"
    return f"guide: {name}, {guide.rotation_deg:.1f}°, {guide.translation_mm:.1f} mm off"


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
        self.verdicts = None if verdicts is None else VerdictTable(verdicts, results)
        self._models = ColouredModels(dataset)

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
                rows = list(partners(mine, anchor, tables))
                for row, told in zip(rows, self._verdicts(image, obj_id, rows), strict=True):
                    out += [
                        self._field(image, obj_id, number, chosen, told)
                        for number, chosen in enumerate(row)
                    ]
        return out

    def _verdicts(
        self, image: tuple[int, int], obj_id: int, rows: Sequence[Sequence[int | None]]
    ) -> list[dict[str, tuple[VerdictRow, ...]]]:
        """Return the verdicts on each instance of an object, by estimator."""
        if self.verdicts is None:
            return [{} for _ in rows]
        keys: list[dict[str, InstanceKey]] = []
        poses: list[dict[str, Float[ndarray, "4 4"]]] = []
        for row in rows:
            there = [(name, i) for name, i in zip(self.results, row, strict=True) if i is not None]
            ids = {name: int(self.est_ids[name][i]) for name, i in there}
            keys.append(
                {n: InstanceKey(self.dataset.name, *image, obj_id, e) for n, e in ids.items()}
            )
            poses.append({name: self.results[name].cam_T_obj[i] for name, i in there})
        return self.verdicts.of_instances(keys, poses)

    def _field(
        self,
        image: tuple[int, int],
        obj_id: int,
        number: int,
        row: int | None,
        told: Mapping[str, tuple[VerdictRow, ...]],
    ) -> Overlay:
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
        guides = self._guides(obj_id, told, cam_T_est, cam_T_true)
        pixels = draw_overlay(
            self.dataset.image(*image),
            self.dataset.camera_of(*image).K,
            *self._models[obj_id],
            cam_T_est,
            cam_T_true,
            guides=[guide.cam_T_obj for guide in guides],
            size=self.size,
        )
        verdicts = told.get(estimator, ())
        for look, pose in ((row.verdict.look, row.cam_T_obj) for row in verdicts):
            if look is not None:
                pixels = draw_arrow(pixels, side_of(look, pose)[1])
        off = (rotation_deg, translation_mm)
        return Overlay(name, *image, estimator, pixels, *off, verdicts, tuple(guides))

    def _guides(
        self,
        obj_id: int,
        told: Mapping[str, tuple[VerdictRow, ...]],
        cam_T_est: Float[ndarray, "4 4"],
        cam_T_true: Float[ndarray, "4 4"] | None,
    ) -> list[DrawnGuide]:
        """Return the poses that guide by verdicts with several views, other than the estimate."""
        found: list[DrawnGuide] = []
        for row in (row for rows in told.values() for row in rows if row.views > 1):
            drawn = [cam_T_est, *(guide.cam_T_obj for guide in found)]
            if min(np.abs(row.cam_T_obj - pose).max() for pose in drawn) > _SAME_POSE:
                off: tuple[float, float] | tuple[None, None] = (None, None)
                if cam_T_true is not None:
                    off = self._off(obj_id, row.cam_T_obj, cam_T_true)
                found.append(DrawnGuide(row.principal, row.cam_T_obj, *off))
        return found

    def _off(
        self, obj_id: int, cam_T_est: Float[ndarray, "4 4"], cam_T_true: Float[ndarray, "4 4"]
    ) -> tuple[float, float]:
        pair = cam_T_est[None], cam_T_true[None]
        rotation = rotation_error(*pair, self.dataset.models[obj_id].symmetries)
        return float(np.degrees(rotation[0])), float(1000 * translation_error(*pair)[0])


def _truth(dataset: BopDataset) -> GroundTruth | None:
    """None where the split has no ``scene_gt.json`` at all, as test images may have none."""
    return dataset.ground_truth if dataset.has_ground_truth else None
