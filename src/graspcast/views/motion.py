"""Motion between images: which of them serve as views of an object, and how the camera moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from jaxtyping import Float, Int
from numpy import ndarray

__all__ = ["Motion", "ViewMotions"]


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
    """

    im_id: Int[ndarray, " m"]
    cam_T_view: Float[ndarray, "m 4 4"]
    noise: Float[ndarray, "m 2"]
    left_out: Mapping[str, int] = field(default_factory=dict)
    why: str = ""


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
