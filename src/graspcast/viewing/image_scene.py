"""An image as a scene: truth, estimates, fused poses with their ellipsoids, and grasps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import InputError, UnknownNameError
from graspcast.estimates.alignment import estimate_ids
from graspcast.estimates.instances import InstanceKey, object_name
from graspcast.forecasting.grasp_file import Rankings
from graspcast.forecasting.verdict import VerdictRow
from graspcast.pose.transforms import compose, invert, transform
from graspcast.rendering.coloured_models import ColouredModels
from graspcast.rendering.trials.bodies import open_hand
from graspcast.simulation.grasps.table import GraspTable
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.viewing import colours
from graspcast.viewing.scene import Node, Scene, Shape
from graspcast.views.covariance_table import CovarianceTable

__all__ = ["ELLIPSOID_SD", "Grasps", "Seen", "image_scene"]

ELLIPSOID_SD = 2.0
"""Standard deviations of the position from an ellipsoid's centre to its surface, by default."""

_LEAST_M = 1e-5
_SEEN_THROUGH, _FUSED, _ABSTAIN = 0.3, 0.4, 0.4
_CAMERA = (60, 60, 60)


@dataclass(frozen=True, eq=False)
class Grasps:
    """The grasps of verdicts, and how they are drawn.

    Attributes
    ----------
    verdicts
        Each is shown as the open hand at the grasp that its pose guides.
    table
        Reference grasps of the objects.
    load
        Returns a gripper by its name.
    rankings
        Further grasps of the same instances, with their probabilities.
    """

    verdicts: Sequence[VerdictRow]
    table: GraspTable
    load: Callable[[str], Gripper]
    rankings: Rankings = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Seen:
    """What is known of the objects in images of a dataset.

    Attributes
    ----------
    results
        Estimator's name to its estimates.
    fused
        Fused poses, if any.
    covariances
        Of the fused poses.
    grasps
        Verdicts with their grasps, if any.
    ellipsoid_sd
        Standard deviations of the position from the middle of an ellipsoid to its surface.
    """

    results: Mapping[str, Results] = field(default_factory=dict)
    fused: Results | None = None
    covariances: CovarianceTable | None = None
    grasps: Grasps | None = None
    ellipsoid_sd: float = ELLIPSOID_SD


def image_scene(
    dataset: BopDataset,
    image: tuple[int, int],
    seen: Seen,
    *,
    objects: Sequence[str] = (),
) -> Scene:
    """Return what was seen in an image as a scene in the frame of its camera.

    Parameters
    ----------
    dataset
        Models and, where there is one, ground truth.
    image
        Scene and image number.
    seen
        Estimates, fused poses and grasps.
    objects
        Only these (``lmo-5``); all if empty.

    Raises
    ------
    InputError
        If nothing is known of the image, or a fused pose has no covariance.
    UnknownNameError
        For an object that the dataset does not have, or an object or gripper without the grasp of a
        verdict.
    """
    known = [object_name(dataset.name, number) for number in sorted(dataset.models.info)]
    for name in objects:
        if name not in known:
            raise UnknownNameError("object", name, known, parameters=("objects",))
    work = _Image(dataset, image, seen, frozenset(objects))
    nodes = [*work.truth(), *work.estimates(), *work.fused(), *work.grasps()]
    where = f"image {image[0]}/{image[1]} of {dataset.name}"
    if not nodes:
        raise InputError(
            f"{where}: has neither estimates, verdicts nor ground truth"
            + (f" of {', '.join(objects)}" if objects else ""),
            parameters=("image", "objects"),
        )
    return Scene(
        where,
        (*nodes, _camera()),
        "-y",
        "the camera's, as OpenCV has it: x to the right, y down, z forward",
        work.legend(nodes),
    )


class _Image:
    """Makes the nodes of one image."""

    def __init__(
        self, dataset: BopDataset, image: tuple[int, int], seen: Seen, wanted: frozenset[str]
    ):
        self._dataset, self._image, self._seen, self._wanted = dataset, image, seen, wanted
        self._models = ColouredModels(dataset)
        self._hands: dict[str, tuple[Gripper, ndarray, ndarray]] = {}

    def truth(self) -> Iterator[Node]:
        if not self._dataset.has_ground_truth:
            return
        truth = self._dataset.ground_truth
        for row in self._rows(truth.scene_id, truth.im_id, truth.obj_id):
            obj_id, gt_id = int(truth.obj_id[row]), int(truth.gt_id[row])
            mesh, rgb = self._models[obj_id]
            name = object_name(self._dataset.name, obj_id)
            shape = Shape(mesh.vertices, mesh.faces, rgb)
            about = {"object": name, "gt_id": gt_id}
            yield Node(f"truth/{name} gt {gt_id}", shape, truth.cam_T_obj[row], about)

    def estimates(self) -> Iterator[Node]:
        for number, (estimator, table) in enumerate(self._seen.results.items()):
            rgb = colours.ESTIMATORS[number % len(colours.ESTIMATORS)]
            for key, row in self._keyed(table):
                about = {"estimator": estimator, "object": key.object, "est_id": key.est_id}
                score = {"score": float(table.score[row])}
                name = f"estimates/{estimator}/{key.object} est {key.est_id}"
                shape = self._tinted(key.obj_id, rgb, _SEEN_THROUGH)
                yield Node(name, shape, table.cam_T_obj[row], about | score)

    def fused(self) -> Iterator[Node]:
        if self._seen.fused is None:
            return
        for key, row in self._keyed(self._seen.fused):
            pose = self._seen.fused.cam_T_obj[row]
            name = f"{key.object} est {key.est_id}"
            about = {"object": key.object, "est_id": key.est_id}
            shape = self._tinted(key.obj_id, colours.FUSED, _FUSED)
            yield Node(f"fused/{name}", shape, pose, about)
            if self._seen.covariances is not None:
                yield _ellipsoid(
                    name, pose, self._seen.covariances.at(key), self._seen.ellipsoid_sd
                )

    def grasps(self) -> Iterator[Node]:
        grasps = self._seen.grasps
        if grasps is None:
            return
        rows = [row for row in grasps.verdicts if self._is_wanted(row.key)]
        shown = {(row.key, row.principal, row.gripper, row.grasp) for row in rows}
        for row in rows:
            yield self._hand(grasps, row, row.grasp, row.verdict.probability, chosen=True)
        for row in rows:
            of = (row.key, row.principal, row.gripper)
            for name, probability in grasps.rankings.get(of, ()):
                if (*of, name) not in shown:
                    shown.add((*of, name))
                    yield self._hand(grasps, row, name, probability, chosen=False)

    def legend(self, nodes: Sequence[Node]) -> tuple[tuple[str, colours.RGB], ...]:
        groups = {node.group for node in nodes}
        names = [name for name, table in self._seen.results.items() if any(self._keyed(table))]
        palette = colours.ESTIMATORS
        every = list(self._seen.results)
        out = [(f"estimate by {n}", palette[every.index(n) % len(palette)]) for n in names]
        if "fused" in groups:
            out.append(("fused pose", colours.FUSED))
        if "ellipsoids" in groups:
            out.append(
                (
                    f"position within {self._seen.ellipsoid_sd:g} standard deviations",
                    colours.ELLIPSOID,
                )
            )
        return (*out, *(colours.probability_legend() if "grasps" in groups else ()))

    def _is_wanted(self, key: InstanceKey) -> bool:
        here = (key.dataset, *key.image) == self._at
        return here and (not self._wanted or key.object in self._wanted)

    @property
    def _at(self) -> tuple[str, int, int]:
        return (self._dataset.name, *self._image)

    def _rows(self, scene_id: ndarray, im_id: ndarray, obj_id: ndarray) -> list[int]:
        rows = np.flatnonzero((scene_id == self._image[0]) & (im_id == self._image[1]))
        name = self._dataset.name
        return [
            int(row)
            for row in rows
            if not self._wanted or object_name(name, int(obj_id[row])) in self._wanted
        ]

    def _keyed(self, table: Results) -> Iterator[tuple[InstanceKey, int]]:
        """Yield key and row of each estimate in the image."""
        est_id = estimate_ids(table)
        for row in self._rows(table.scene_id, table.im_id, table.obj_id):
            yield InstanceKey(*self._at, int(table.obj_id[row]), int(est_id[row])), row

    def _tinted(self, obj_id: int, rgb: colours.RGB, opacity: float) -> Shape:
        mesh, _ = self._models[obj_id]
        return Shape(mesh.vertices, mesh.faces, np.array(rgb, dtype=np.uint8), opacity)

    def _hand(
        self, grasps: Grasps, row: VerdictRow, name: str, probability: float | None, *, chosen: bool
    ) -> Node:
        if row.gripper not in self._hands:
            gripper = grasps.load(row.gripper)
            body = open_hand(gripper)
            self._hands[row.gripper] = gripper, body.vertices, body.faces
        gripper, vertices, faces = self._hands[row.gripper]
        try:
            grasp = grasps.table(row.key.object, row.gripper, name).grasp
        except UnknownNameError as error:
            error.parameters = (*error.parameters, "grasps")
            raise
        pose = compose(row.cam_T_obj, grasp.obj_T_grasp, invert(gripper.base_T_tcp))
        told = "unknown" if probability is None else f"{probability:.2f}"
        rgb = np.array(colours.of_probability(probability), dtype=np.uint8)
        opacity = 1.0 if chosen and row.verdict.attempt else _ABSTAIN
        about: dict[str, Any] = {
            "object": row.key.object,
            "est_id": row.key.est_id,
            "principal": row.principal,
            "gripper": row.gripper,
            "grasp": name,
            "chosen": chosen,
        }
        if probability is not None:
            about["probability"] = probability
        if chosen:
            about |= {"verdict": str(row.verdict), "reason": row.verdict.reason}
        what = f"{row.key.object} est {row.key.est_id} by {row.principal}"
        label = f"grasps/{what}/{row.gripper} {name} P {told}"
        return Node(label, Shape(vertices, faces, rgb, opacity), pose, about)


def _ellipsoid(
    name: str, cam_T_obj: Float[ndarray, "4 4"], covariance: ndarray, size: float
) -> Node:
    """Return the ellipsoid of a position, whose covariance is in the object's axes."""
    from trimesh import creation

    variance, axes = np.linalg.eigh(covariance[:3, :3])
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    sd = np.sqrt(np.maximum(variance, 0.0))
    ball = creation.icosphere(subdivisions=3, radius=1.0)
    vertices = np.array(ball.vertices) * np.maximum(size * sd, _LEAST_M)
    turned = np.sqrt(np.maximum(np.diag(covariance)[3:], 0.0))
    about = {
        "standard_deviations": size,
        "sd_position_mm": [round(float(1000 * x), 4) for x in sd],
        "sd_rotation_deg": [round(float(np.degrees(x)), 4) for x in turned],
    }
    rgb = np.array(colours.ELLIPSOID, dtype=np.uint8)
    pose = transform(cam_T_obj[:3, :3] @ axes, cam_T_obj[:3, 3].copy())
    return Node(f"ellipsoids/{name}", Shape(vertices, np.array(ball.faces), rgb), pose, about)


def _camera() -> Node:
    """Return a pyramid that stands for the camera, its tip in the origin."""
    tip, x, y, z = (0.0, 0.0, 0.0), 0.024, 0.018, 0.04
    corners = np.array([tip, (-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)])
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]])
    # Each face has its own corners, so that edges are sharp.
    apart = np.arange(faces.size).reshape(-1, 3)
    shape = Shape(corners[faces].reshape(-1, 3), apart, np.array(_CAMERA, dtype=np.uint8))
    return Node("camera", shape, np.eye(4))
