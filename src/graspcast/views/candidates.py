"""Candidates: the images that may serve for an object in an image, of which views are chosen."""

from __future__ import annotations

from collections import Counter

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.views.camera_motion import CameraNoise
from graspcast.views.choice import ViewRules, choose_views, viewing_directions
from graspcast.views.motion import ViewMotions, carried_covariance

__all__ = ["Candidates"]

_NO_IMAGE = "have no {} image with an estimate of the object"
_NO_PARALLAX = "have no {} image from another direction (parallax too small)"
_MOST_NOISE = 1.0


class Candidates:
    """The images that may serve, with their motions, of which the chosen ones are refined.

    Parameters
    ----------
    views
        The images and their motions.
    rules
        Which of them serve.
    left_out
        Counts why further images are left out.

    Attributes
    ----------
    im_id
        The images, (m,).
    cam_T_view
        Each one's camera in the judged camera's frame, (m, 4, 4).
    noise
        Standard deviations of the motions' translation (m) and rotation (rad): their own, and those
        that are stated for all, (m, 2).
    covariance
        What their uncertainty has beyond that, see
        :class:`~graspcast.views.motion.RefinedMotions`, (m, 6, 6).
    """

    def __init__(self, views: ViewMotions, rules: ViewRules, left_out: Counter[str]):
        self._views, self._rules, self._left_out = views, rules, left_out
        self.im_id, self.cam_T_view = views.im_id, views.cam_T_view.copy()
        stated = [rules.noise.translation_m, rules.noise.rotation_rad]
        self.noise = np.hypot(views.noise, stated)
        self.covariance = np.zeros((len(self.im_id), 6, 6))
        self._serves = np.ones(len(self.im_id), dtype=bool)
        self._refined = np.full(len(self.im_id), views.refine is None)

    def chosen(self, pose: Float[ndarray, "4 4"]) -> tuple[list[int], str]:
        """Return the numbers of the views that serve for an instance, and why there is none.

        Parameters
        ----------
        pose
            The instance's, in the judged image.
        """
        kind = "earlier" if self._rules.views_from == "earlier" else "other"
        if not len(self.im_id):
            return [], self._views.why or _NO_IMAGE.format(kind)
        while True:
            usable = np.flatnonzero(self._serves)
            centres = np.concatenate([np.zeros((1, 3)), self.cam_T_view[usable, :3, 3]])
            towards = viewing_directions(pose[:3, 3], centres)
            most = self._rules.max_views - 1
            found = choose_views(towards[0], towards[1:], most, self._rules.min_parallax_rad)
            numbers = usable[found]
            if self._refined[numbers].all():
                return numbers.tolist(), "" if len(found) else _NO_PARALLAX.format(kind)
            self._refine(numbers[~self._refined[numbers]])

    def _refine(self, numbers: ndarray) -> None:
        assert self._views.refine is not None
        found = self._views.refine(numbers)
        self.cam_T_view[numbers], self.covariance[numbers] = found.cam_T_view, found.covariance
        self._serves[numbers], self._refined[numbers] = found.serves, True
        if not found.serves.all():
            self._left_out[found.why] += int((~found.serves).sum())

    def noise_at(self, number: int, poses: Float[ndarray, "a 4 4"]) -> CameraNoise:
        """Return the noise of the motion to a view as it acts on poses in the judged image."""
        at = carried_covariance(self.covariance[number], poses[:, :3, 3].mean(axis=0))
        turn = self.covariance[number, 3:, 3:]
        more = np.sqrt([np.trace(at) / 3, np.trace(turn) / 3])
        return CameraNoise(*np.minimum(np.hypot(self.noise[number], more), _MOST_NOISE).tolist())
