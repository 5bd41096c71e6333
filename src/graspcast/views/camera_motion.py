"""Camera motion: the camera's pose in the world for each image, checked, and its uncertainty."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.io.arguments import NAME, a, checked, number, refuse_unless
from graspcast.io.wording import counted
from graspcast.pose.lengths import METRES
from graspcast.pose.sanity import looks_transposed, rotation_problem
from graspcast.pose.transforms import compose, invert, project_to_rotation
from graspcast.views.motion import ViewMotions

__all__ = ["CameraMotion", "CameraNoise", "noise_of_views", "rigid"]

_RADIANS = {"deg": np.pi / 180, "rad": 1.0}
_NOISE = re.compile(r"\s*([0-9.eE+-]+)\s*([a-z]+)\s*,\s*([0-9.eE+-]+)\s*([a-z]+)\s*")
_FARTHEST_M = 10_000.0
_MOST_NOISE = 100.0
"""Metres or radians: a view known worse than this says nothing; larger numbers overflow."""
_WHOLE = a(int, np.integer, words="a whole number")
_NO_POSE = "have no camera pose"


@dataclass(frozen=True)
class CameraNoise:
    """Standard deviations per axis of the motion between two images.

    Attributes
    ----------
    translation_m
        Of the camera's position, metres.
    rotation_rad
        Of its rotation about its own axes, radians.
    """

    translation_m: float = 0.0
    rotation_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in ("translation_m", "rotation_rad"):
            value = getattr(self, name)
            refuse_unless(number(), value, "CameraNoise", name)
            if not 0 <= value <= 1:
                raise InputError(
                    f"the noise of the camera motion should be 0 or more, and at most 1 m and "
                    f"1 rad, but {name} is {value:g}",
                    parameters=("camera_noise", "noise"),
                )

    @classmethod
    @checked(text=NAME)
    def parse(cls, text: str) -> CameraNoise:
        """Parse a length and an angle with their units, ``1mm,0.1deg``.

        Raises
        ------
        InputError
            If it is something else; a unit is always needed.
        """
        found = _NOISE.fullmatch(text)
        try:
            if found is None:
                raise ValueError
            length, unit, angle, angle_unit = found.groups()
            return cls(float(length) * METRES[unit], float(angle) * _RADIANS[angle_unit])
        except (ValueError, KeyError) as error:
            raise InputError(
                "noise of the camera motion is given as a length and an angle with their units, "
                f"for example 1mm,0.1deg, not {text!r}; units are mm, cm, m; deg, rad",
                parameters=("camera_noise", "noise"),
            ) from error


def noise_of_views(
    noise: CameraNoise | Float[ndarray, "n v 2"] | None, n: int, v: int
) -> Float[ndarray, "n v 2"]:
    """Return the standard deviations of translation (m) and rotation (rad) of n times v views.

    Raises
    ------
    InputError
        If the array given is of another shape, negative or not a number.
    """
    if not isinstance(noise, ndarray):
        noise = noise or CameraNoise()
        return np.broadcast_to([noise.translation_m, noise.rotation_rad], (n, v, 2))
    if noise.shape != (n, v, 2):
        raise InputError(f"noise should be {(n, v, 2)}, not {noise.shape}")
    if not (noise >= 0).all():
        raise InputError("noise should be 0 or more in every view")
    return np.minimum(noise, _MOST_NOISE)


@dataclass(frozen=True, eq=False, repr=False)
class CameraMotion:
    """The camera's pose in each image of static scenes.

    Attributes
    ----------
    world_T_cam
        (scene_id, im_id) to a pose in metres, (4, 4). Each scene has a world frame of its own.
    source
        Where they came from, for messages.

    Raises
    ------
    InputError
        Naming the image whose pose is not rigid, not finite or more than 10 km away on an axis.
    """

    world_T_cam: Mapping[tuple[int, int], Float[ndarray, "4 4"]]
    source: str = "camera poses"

    def __post_init__(self) -> None:
        if not isinstance(self.world_T_cam, Mapping):
            raise InputError(
                "CameraMotion: world_T_cam should be a mapping of (scene_id, im_id) to 4x4 "
                f"matrices, not {type(self.world_T_cam).__name__}"
            )
        checked = {}
        for key, pose in self.world_T_cam.items():
            _check_key(key, self.source)
            try:
                checked[int(key[0]), int(key[1])] = rigid(pose)
            except ValueError as error:
                raise InputError(
                    f"{self.source}, image {key[0]}/{key[1]}: the camera's pose {error}",
                    parameters=("camera_poses",),
                ) from error
        object.__setattr__(self, "world_T_cam", checked)

    @classmethod
    def of(
        cls,
        scene_id: Sequence[int] | ndarray,
        im_id: Sequence[int] | ndarray,
        world_T_cam: Any,
        *,
        source: str = "camera poses",
    ) -> CameraMotion:
        """Build from columns: m scenes, m images, and (m, 4, 4) poses in metres.

        Raises
        ------
        InputError
            If the lengths differ, an image comes twice, or a pose is not rigid.
        """
        try:
            scenes, images = np.asarray(scene_id).tolist(), np.asarray(im_id).tolist()
            keys = list(zip(scenes, images, strict=True))
            poses = list(world_T_cam)
        except Exception as error:  # tensors of other libraries raise what they like
            raise InputError(
                f"{source}: scene_id, im_id and world_T_cam should have one entry an image"
            ) from error
        if len(poses) != len(keys):
            raise InputError(f"{source}: {len(poses)} camera poses for {len(keys)} images")
        out: dict[tuple[int, int], Any] = {}
        for key, pose in zip(keys, poses, strict=True):
            _check_key(key, source)
            if key in out:
                raise InputError(
                    f"{source}: image {key[0]}/{key[1]} has more than one camera pose; keep one",
                    parameters=("camera_poses",),
                )
            out[key] = pose
        return cls(out, source)

    def __len__(self) -> int:
        return len(self.world_T_cam)

    def __repr__(self) -> str:
        of = f"{counted(len(self), 'image')} of {counted(len(self.scenes), 'scene')}"
        return f"CameraMotion({of}, {self.source})"

    @property
    def scenes(self) -> set[int]:
        """The scenes with camera poses."""
        return {scene_id for scene_id, _ in self.world_T_cam}

    @checked(scene_id=_WHOLE, to_image=_WHOLE, from_image=_WHOLE)
    def between(self, scene_id: int, to_image: int, from_image: int) -> Float[ndarray, "4 4"]:
        """Return the motion ``to_T_from`` between the cameras of two images of a scene.

        Raises
        ------
        InputError
            If one of them has no camera pose.
        """
        if missing := [i for i in (to_image, from_image) if (scene_id, i) not in self.world_T_cam]:
            raise InputError(f"{self.source}: no camera pose of image {scene_id}/{missing[0]}")
        world_T_to = self.world_T_cam[scene_id, to_image]
        return compose(invert(world_T_to), self.world_T_cam[scene_id, from_image])

    def views_of(
        self, scene_id: int, im_id: int, obj_id: int, others: Sequence[int]
    ) -> ViewMotions:
        """Return which of the other images serve: all that have a camera pose, whatever the object.

        See :meth:`graspcast.views.motion.Motion.views_of`.
        """
        known = self.world_T_cam
        there = (scene_id, im_id) in known
        some = [i for i in others if there and (scene_id, i) in known]
        poses = np.array([known[scene_id, i] for i in some]).reshape(-1, 4, 4)
        if some:
            poses = compose(invert(known[scene_id, im_id]), poses)
        why = "" if there else _NO_POSE
        ids = np.array(some, dtype=np.int64)
        return ViewMotions(ids, poses, np.zeros((len(some), 2)), why=why)


def _check_key(key: Any, source: str) -> None:
    """Raise unless this is an image: scene_id and im_id."""
    pair = isinstance(key, tuple) and len(key) == 2
    if not pair or any(isinstance(i, bool) or not isinstance(i, int | np.integer) for i in key):
        shown = repr(key)
        raise InputError(
            f"{source}: an image is a pair of whole numbers, scene_id and im_id, not "
            f"{shown if len(shown) < 80 else type(key).__name__}"
        )


def rigid(pose: Any) -> Float[ndarray, "4 4"]:
    """Return a pose with an exact rotation.

    Raises
    ------
    ValueError
        Saying what is wrong with it.
    """
    try:
        matrix = np.array(pose, dtype=np.float64)
    except Exception as error:  # tensors of other libraries raise what they like
        raise ValueError("should be a 4x4 matrix of numbers") from error
    if matrix.shape != (4, 4):
        raise ValueError(f"should be a 4x4 matrix, not of shape {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise ValueError("holds numbers that are not finite")
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-6:
        row = " ".join(f"{x:g}" for x in matrix[3])
        hint = "; it looks transposed" if looks_transposed(matrix) else ""
        raise ValueError(f"has the last row {row}, not 0 0 0 1{hint}")
    if problem := rotation_problem(matrix[:3, :3]):
        raise ValueError(problem)
    if (distance := float(np.abs(matrix[:3, 3]).max())) > _FARTHEST_M:
        raise ValueError(
            f"is {distance:g} m from the world's origin, and {_FARTHEST_M:g} m are allowed; if its "
            "unit is right, subtract one offset from all positions of the scene"
        )
    matrix[:3, :3] = project_to_rotation(matrix[:3, :3])
    matrix[3] = [0, 0, 0, 1]
    return matrix
