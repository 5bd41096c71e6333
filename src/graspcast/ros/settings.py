"""Settings of the judging of ROS messages: frames, classes, tolerances, and what shares a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from graspcast.errors import InputError, UnknownNameError
from graspcast.ros.poses import frame_name

__all__ = ["SINGLE", "STATIC", "Settings"]

SINGLE, STATIC = "single", "static"


@dataclass(frozen=True)
class Settings:
    """How messages become frames.

    Attributes
    ----------
    camera_frame
        The camera's optical frame (x right, y down, z forward). Detections in another frame are
        transformed into it by tf.
    world_frame
        A frame that stands still, in which the camera's pose is looked up; None if poses in the
        world are not used.
    objects
        Class of the detections to object (``{"mustard": "ycbv-5"}``). Objects' own names are
        understood without an entry.
    tolerance_s, timeout_s
        As for :class:`~graspcast.ros.synchroniser.Synchroniser`.
    episodes
        ``single``: every frame is a scene of its own, judged by itself. ``static``: all frames are
        looks at one scene that stands still, until it is said to be a new one.

    Raises
    ------
    InputError
        For no camera frame, and for ``static`` without a world frame.
    """

    camera_frame: str
    world_frame: str | None = None
    objects: Mapping[str, str] = field(default_factory=dict)
    tolerance_s: float = 0.02
    timeout_s: float = 0.5
    episodes: str = SINGLE

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera_frame", frame_name(self.camera_frame))
        object.__setattr__(self, "world_frame", frame_name(self.world_frame or "") or None)
        if not self.camera_frame:
            raise InputError(
                "the camera's optical frame should be named; it is not guessed from the detections",
                parameters=("camera_frame",),
            )
        if self.episodes not in (SINGLE, STATIC):
            raise UnknownNameError(
                "kind of episodes", self.episodes, (SINGLE, STATIC), parameters=("episodes",)
            )
        if self.episodes == STATIC and self.world_frame is None:
            raise InputError(
                "several looks at one scene need the camera's pose in the world: name a frame that "
                "stands still",
                parameters=("world_frame", "episodes"),
            )

    def object_of(self, class_id: str, known: frozenset[str]) -> str | None:
        """Return the object of a class, or None where there is none."""
        if class_id in self.objects:
            return self.objects[class_id]
        return class_id if class_id in known else None

    def class_of(self, object_name: str) -> str:
        """Return the class of an object, as detections name it."""
        return next((c for c, name in self.objects.items() if name == object_name), object_name)

    def check_objects(self, known: frozenset[str]) -> None:
        """Raise if a class stands for an object that is not known.

        Raises
        ------
        UnknownNameError
            Naming the known objects.
        """
        for name in self.objects.values():
            if name not in known:
                raise UnknownNameError("object", name, sorted(known), parameters=("objects",))
