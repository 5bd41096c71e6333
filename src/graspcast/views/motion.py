"""Motion between images: which of them serve as views of an object, and how the camera moved."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.pose.transforms import skew

__all__ = ["Motion", "RefinedMotions", "ViewMotions", "carried_covariance"]


@dataclass(frozen=True, eq=False)
class RefinedMotions:
    """Motions that are computed for the chosen views alone.

    Attributes
    ----------
    serves
        Which of them serve after all, (b,).
    cam_T_view
        The motions, (b, 4, 4).
    covariance
        Of position (m) and rotation vector (rad), in the judged camera's axes, about the judged
        camera's centre, (b, 6, 6).
    why
        Why the others do not serve: words that follow "left out 3 views".
    """

    serves: Bool[ndarray, " b"]
    cam_T_view: Float[ndarray, "b 4 4"]
    covariance: Float[ndarray, "b 6 6"]
    why: str = ""


@dataclass(frozen=True, eq=False)
class ViewMotions:
    """The m images that serve as other views of an object in an image, and the motion to each.

    Attributes
    ----------
    im_id
        The images, (m,).
    cam_T_view
        Each one's camera in the judged image's camera frame, metres, (m, 4, 4).
    noise
        Standard deviations per axis of each motion, as those of
        :class:`~graspcast.views.camera_motion.CameraNoise`: translation (m) and rotation (rad) of
        the view's camera, (m, 2).
    left_out
        Why further images do not serve, with how many; words that follow "left out 3 views".
    why
        If no image serves for a reason other than that there is none: words that follow
        "3 instances".
    refine
        Where the motions are rough: computes those of some of the m images, by their places.
    """

    im_id: Int[ndarray, " m"]
    cam_T_view: Float[ndarray, "m 4 4"]
    noise: Float[ndarray, "m 2"]
    left_out: Mapping[str, int] = field(default_factory=dict)
    why: str = ""
    refine: Callable[[Int[ndarray, " b"]], RefinedMotions] | None = None


@runtime_checkable
class Motion(Protocol):
    """The camera's motion between images of one scene, as seen from an object.

    :class:`~graspcast.views.camera_motion.CameraMotion`, a table of camera poses, is the normal
    one; there the motion is the same for all objects.
    """

    @property
    def source(self) -> str:
        """Where it came from, for messages."""

    @property
    def scenes(self) -> set[int]:
        """The scenes with motion."""

    def views_of(
        self, scene_id: int, im_id: int, obj_id: int, others: Sequence[int]
    ) -> ViewMotions:
        """Return which of the other images serve for an object in an image.

        Parameters
        ----------
        scene_id, im_id, obj_id
            The judged image and the object.
        others
            Images of the scene with an estimate of the object, without the judged one.
        """


def carried_covariance(
    covariance: Float[ndarray, "*batch 6 6"], position: Float[ndarray, "*batch 3"]
) -> Float[ndarray, "*batch 3 3"]:
    """Return the covariance of a position that was carried by a motion, m².

    Parameters
    ----------
    covariance
        Of the motion, see :class:`RefinedMotions`.
    position
        In the judged camera's frame, metres.
    """
    K = skew(position)
    J = np.concatenate([np.broadcast_to(np.eye(3), K.shape), -K], axis=-1)
    return np.asarray(J @ covariance @ np.swapaxes(J, -1, -2))
