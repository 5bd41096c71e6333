"""Looks at one object at run time, until it can be grasped, or not.

Nothing here reads or writes files. An episode may be asked by several threads; each look waits for
the one before.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.estimates.checks import no_estimate_by
from graspcast.estimates.instances import split_object_name
from graspcast.forecasting.episode_verdict import EpisodeVerdict, from_where
from graspcast.forecasting.episodes import Episodes, Taken
from graspcast.forecasting.features import Features
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.look_again import MIN_GAIN
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.verdict import Verdict
from graspcast.forecasting.visibility_features import seen_of
from graspcast.guarantees.certificate import Certificate
from graspcast.io.arguments import NAME, NAMED, a, checked
from graspcast.io.wording import counted
from graspcast.pose.sanity import is_placeholder, pose_problems
from graspcast.views.camera_motion import CameraNoise

__all__ = ["Episode"]


@checked(poses=NAMED)
class Episode:
    """Looks at one object, with a verdict after each.

    ::

        episode = Episode(forecaster, "ycbv-5", models=models, threshold=0.8, guide="fused")
        verdict = episode.look({"epos": cam_T_a, "gdrnpp": cam_T_b}, world_T_cam)
        while verdict.look:
            move_camera(verdict.look.direction_world)
            verdict = episode.look(estimate(), camera_pose())
        if verdict.attempt:
            grasp(verdict.world_T_obj)

    Parameters
    ----------
    forecaster
        A trained forecaster. One that was trained without views answers from the last look alone.
    object_name
        ``dataset-obj_id``, as in ``ycbv-5``.
    models, threshold, guarantee, certificate, ood_alpha
        As for :class:`Episodes`.
    guide, max_looks, max_views, min_gain, noise
        As for :class:`Episodes`.

    Raises
    ------
    MismatchError
        For an object that is not in training.
    InputError, UnknownNameError
        As :class:`Episodes`.
    """

    @checked(forecaster=a(Forecaster), object_name=NAME)
    def __init__(
        self,
        forecaster: Forecaster,
        object_name: str,
        *,
        models: Mapping[str, Models] | None = None,
        threshold: float | None = None,
        guide: str | None = None,
        max_looks: int = 3,
        max_views: int = 3,
        min_gain: float = MIN_GAIN,
        noise: CameraNoise | None = None,
        ood_alpha: float = OOD_ALPHA,
        guarantee: str | None = None,
        certificate: Certificate | None = None,
    ):
        dataset, _ = split_object_name(object_name)
        forecaster.card.numbers_of([object_name])
        self.object_name = object_name
        self._scene = Episodes(
            forecaster,
            dataset,
            models=models,
            threshold=threshold,
            guide=guide,
            max_looks=max_looks,
            max_views=max_views,
            min_gain=min_gain,
            noise=noise,
            ood_alpha=ood_alpha,
            guarantee=guarantee,
            certificate=certificate,
        )

    def __repr__(self) -> str:
        return f"Episode({self.object_name}, {counted(self._scene._count, 'look')})"

    def forget(self) -> None:
        """Forget all looks, as when the object was moved."""
        self._scene.forget()

    def look(
        self,
        poses: Mapping[str, Float[ndarray, "4 4"] | None],
        world_T_cam: Float[ndarray, "4 4"] | None = None,
        K: Float[ndarray, "3 3"] | None = None,
        *,
        time_s: float | None = None,
        score: float | None = None,
        image_fit: Features | None = None,
        reachable: Collection[str] | None = None,
    ) -> EpisodeVerdict:
        """Take a further look at the object.

        Parameters
        ----------
        poses
            Estimator's name to its ``cam_T_obj``, metres; None, or no entry, where it found
            nothing.
        world_T_cam, K, time_s
            As for :meth:`Episodes.look`.
        score, image_fit
            Of a single estimator's pose, as for :meth:`Forecaster.predict`.
        reachable
            Names of the grasps that the robot can reach from here; all if None.

        Raises
        ------
        UnknownNameError, InputError, MismatchError
            As :meth:`Episodes.look`. The look then does not count.
        """
        named = {name: {self.object_name: pose} for name, pose in poses.items()}
        seen = seen_of(score, image_fit)
        taken = self._scene.take_look(named, world_T_cam, K, time_s, seen, reachable)
        return taken.verdicts[0] if taken.verdicts else self._nothing(taken)

    def _nothing(self, taken: Taken) -> EpisodeVerdict:
        """Return the verdict on a look without a sane estimate."""
        look, track = taken.looks[-1], next(iter(taken.tracks.of(self.object_name)), None)
        card = self._scene.forecaster.card
        size = card.diameters_of(np.array([self.object_name]))
        said = {
            name: pose_problems(table.cam_T_obj, size)[0]
            for name, table in look.results.items()
            if len(table) and not is_placeholder(table.cam_T_obj[0])
        }
        advice = None
        if track is not None and taken.count < self._scene.max_looks:
            advice = from_where(track, taken.looks)
        reason = f"{no_estimate_by(card.estimators, said)} in this look"
        return EpisodeVerdict(
            instance=0 if track is None else track.number,
            object_name=self.object_name,
            verdict=Verdict(
                False, None, f"{reason}; look again {advice}" if advice else reason, look=advice
            ),
            guide=None,
            cam_T_obj=None,
            world_T_obj=None,
            views=0,
            looks=taken.count,
        )
