"""Motions of the camera for the evaluation: disturbed, of other images, or of chosen parallax."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.pose.transforms import compose, rotation_from_vector, transform
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.choice import angles, viewing_directions
from graspcast.views.motion import Motion, RefinedMotions, ViewMotions

__all__ = ["DisturbedMotion", "OtherImagesMotion", "ParallaxMotion"]


@dataclass(frozen=True, eq=False)
class _Changed:
    """A motion that is another one, changed."""

    motion: Motion

    @property
    def source(self) -> str:
        """Where it came from, for messages."""
        return self.motion.source

    @property
    def scenes(self) -> set[int]:
        """The scenes with motion."""
        return self.motion.scenes


@dataclass(frozen=True, eq=False)
class DisturbedMotion(_Changed):
    """A motion with normal errors, drawn once for each pair of images.

    Attributes
    ----------
    motion
        The true motion.
    noise
        Standard deviations of the errors. They are not stated to the fusion: give it the noise too.
    seed
        Of the errors.
    """

    noise: CameraNoise
    seed: int = 0

    def views_of(
        self, scene_id: int, im_id: int, obj_id: int, others: Sequence[int]
    ) -> ViewMotions:
        """Return the views of the true motion, displaced."""
        views = self.motion.views_of(scene_id, im_id, obj_id, others)
        if not len(views.im_id):
            return views
        error = self._errors(self.seed, scene_id, im_id, int(views.im_id.max()))[views.im_id]
        moved = compose(views.cam_T_view, error)
        return replace(views, cam_T_view=moved, refine=_then(views.refine, error))

    def _errors(self, seed: int, scene_id: int, im_id: int, last: int) -> Float[ndarray, "m 4 4"]:
        drawn = _normal(seed, scene_id, im_id, 1 << last.bit_length())
        turn = rotation_from_vector(drawn[:, 3:] * self.noise.rotation_rad)
        return transform(turn, drawn[:, :3] * self.noise.translation_m)


@lru_cache(maxsize=64)
def _normal(seed: int, scene_id: int, im_id: int, count: int) -> Float[ndarray, "m 6"]:
    """Draw the errors of the motions from all images to one; an image's do not depend on others."""
    return np.random.default_rng([seed, scene_id, im_id]).standard_normal((count, 6))


def _then(
    refine: Callable[[Int[ndarray, " b"]], RefinedMotions] | None, error: Float[ndarray, "m 4 4"]
) -> Callable[[Int[ndarray, " b"]], RefinedMotions] | None:
    """Displace refined motions too."""
    if refine is None:
        return None

    def displaced(chosen: Int[ndarray, " b"]) -> RefinedMotions:
        found = refine(chosen)
        return replace(found, cam_T_view=compose(found.cam_T_view, error[chosen]))

    return displaced


@dataclass(frozen=True, eq=False)
class OtherImagesMotion(_Changed):
    """A motion that is wrong: each view has that of another image. Nothing should come of it."""

    seed: int = 0

    def views_of(
        self, scene_id: int, im_id: int, obj_id: int, others: Sequence[int]
    ) -> ViewMotions:
        """Return the views with their motions interchanged at random."""
        views = self.motion.views_of(scene_id, im_id, obj_id, others)
        rng = np.random.default_rng([self.seed, scene_id, im_id, obj_id])
        cycle = rng.permutation(len(views.im_id))
        place = np.empty_like(cycle)
        place[cycle] = np.roll(cycle, 1)  # one cycle, so none keeps its own
        if not len(cycle):
            return views
        return _motions_at(views, place, views.im_id)


@dataclass(frozen=True, eq=False)
class ParallaxMotion(_Changed):
    """A motion to the images whose parallax to the judged one lies in a range.

    Attributes
    ----------
    motion
        To all images.
    position
        Of each (scene_id, im_id, obj_id), an estimate in the camera's frame, metres.
    low_rad, high_rad
        The range, the lower end included.
    """

    position: Mapping[tuple[int, int, int], Float[ndarray, "3"]]
    low_rad: float
    high_rad: float

    def views_of(
        self, scene_id: int, im_id: int, obj_id: int, others: Sequence[int]
    ) -> ViewMotions:
        """Return those of the views that lie in the range."""
        views = self.motion.views_of(scene_id, im_id, obj_id, others)
        at = self.position.get((scene_id, im_id, obj_id))
        if at is None or not len(views.im_id):
            return views
        centres = np.concatenate([np.zeros((1, 3)), views.cam_T_view[:, :3, 3]])
        towards = viewing_directions(at, centres)
        angle = angles(towards[1:], towards[0])
        kept = np.flatnonzero((angle >= self.low_rad) & (angle < self.high_rad))
        return _motions_at(views, kept, views.im_id[kept])


def _motions_at(
    views: ViewMotions, place: Int[ndarray, " k"], im_id: Int[ndarray, " k"]
) -> ViewMotions:
    """Return these images with the motions that stand at these places."""
    refine = views.refine

    def at(chosen: Int[ndarray, " b"]) -> RefinedMotions:
        assert refine is not None
        return refine(place[chosen])

    return replace(
        views,
        im_id=im_id,
        cam_T_view=views.cam_T_view[place],
        noise=views.noise[place],
        refine=None if refine is None else at,
    )
