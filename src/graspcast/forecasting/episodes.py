"""Looks at all objects of a scene at run time, until each can be grasped, or not.

Nothing here reads or writes files. An episode may be asked by several threads; each look waits for
the one before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from threading import Lock
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import UnknownNameError
from graspcast.forecasting.episode_options import decision_options
from graspcast.forecasting.episode_verdict import EpisodeVerdict
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_ranking import Reachable, refuse_mask
from graspcast.forecasting.look_again import MIN_GAIN
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.verdict import VerdictRow, untrained_rows
from graspcast.forecasting.view_verdicts import FUSED
from graspcast.guarantees.certificate import Certificate
from graspcast.io.arguments import NAME, a, checked, mapping, number
from graspcast.io.wording import counted
from graspcast.pose.transforms import compose
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.fused_estimates import FusedEstimates
from graspcast.views.look import Look
from graspcast.views.looks import fuse_looks_by
from graspcast.views.tracks import Tracks

__all__ = ["Episodes"]

ONE_VIEW = "the model was trained without views: the last look alone counts"
"""Note where several looks, or a fused pose that guides, make no difference."""
_KEPT = 20
"""Looks that are remembered; a robot takes a few."""


@dataclass(frozen=True, eq=False)
class Taken:
    """A look with what is known after it."""

    verdicts: list[EpisodeVerdict]
    looks: tuple[Look, ...]
    tracks: Tracks
    count: int


@checked(results=mapping(a(Results), "estimator"))
class Episodes:
    """Looks at all objects of a static scene, each with a verdict after every look.

    ::

        episodes = Episodes(forecaster, "ycbv", models=models, threshold=0.8, guide="fused")
        for verdict in episodes.look({"epos": results_a, "gdrnpp": results_b}, world_T_cam):
            print(verdict.instance, verdict.object_name, verdict, verdict.reason)

    A new scene, or a moved object, takes new episodes, or :meth:`forget`.

    Parameters
    ----------
    forecaster
        A trained forecaster. One that was trained without views answers from the last look alone.
    dataset
        The dataset's name, as in training.
    models
        Dataset's name to its object models; those that the model file carries if None.
    threshold
        Attempt at this probability or above it; 0.5 if None and there is no certificate.
    guide
        Whose pose guides the grasp: an estimator's name, ``fused``, or ``best``, whichever has the
        highest probability; None is the forecaster's principal.
    max_looks
        Looks in all after which the advice is never to look again.
    max_views
        At most so many looks are fused, this one included.
    min_gain
        Look again only if success is expected to be more probable by this much.
    noise
        Standard deviations of the camera's motion between looks; none by default.
    ood_alpha, guarantee
        As for :meth:`Forecaster.verdicts`.
    certificate
        Of this policy: its threshold and guarantee are used.

    Raises
    ------
    InputError
        For a threshold outside [0, 1], options that are no numbers, and a threshold or guarantee
        beside a certificate.
    MismatchError
        For a certificate of another forecaster or policy; what differs is named.
    UnknownNameError
        For a guide that the forecaster does not know.
    """

    @checked(
        forecaster=a(Forecaster),
        dataset=NAME,
        models=mapping(a(Models), "dataset"),
        threshold=number(),
        guide=NAME,
        max_looks=number(1.0, 1000.0),
        max_views=number(1.0, 1000.0),
        min_gain=number(0.0, 1.0),
        noise=a(CameraNoise),
        ood_alpha=number(0.0, 1.0),
        guarantee=NAME,
        certificate=a(Certificate),
    )
    def __init__(
        self,
        forecaster: Forecaster,
        dataset: str,
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
        self.decision_options = decision_options(
            forecaster,
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
        self.forecaster, self.dataset = forecaster, dataset
        self.models = forecaster.models_or(models)
        self.max_looks, self.max_views = int(max_looks), int(max_views)
        self._noise, self._certified = noise, certificate is not None
        # Whose estimates are the instances: the guide's, or those of one that may guide.
        names = (self.decision_options["guide"], *forecaster.guides, *forecaster.card.estimators)
        self.order = tuple(n for n in dict.fromkeys(names) if n in forecaster.card.estimators)
        self._lock = Lock()
        self._looks: tuple[Look, ...] = ()
        self._tracks, self._count = Tracks(), 0

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.dataset}, {counted(self._count, 'look')})"

    @property
    def count(self) -> int:
        """How many looks there were."""
        return self._count

    def forget(self) -> None:
        """Forget all looks, as when an object was moved."""
        with self._lock:
            self._looks, self._tracks, self._count = (), Tracks(), 0

    def look(
        self,
        results: Mapping[str, Results],
        world_T_cam: Float[ndarray, "4 4"] | None = None,
        K: Float[ndarray, "3 3"] | None = None,
        *,
        time_s: float | None = None,
        reachable: Reachable | None = None,
    ) -> list[EpisodeVerdict]:
        """Take a further look at the scene.

        Parameters
        ----------
        results
            Estimator's name to all that it found in this image.
        world_T_cam
            The camera's pose in the world, metres; None if it is not known.
        K
            Intrinsics in pixels; they are checked, and may differ between looks.
        time_s
            When it was, seconds; it should increase.
        reachable
            As for :meth:`Forecaster.rank`, from here; :attr:`EpisodeVerdict.grasps` ranks them.

        Returns
        -------
        One verdict for each instance in this look, ordered by instance.

        Raises
        ------
        UnknownNameError
            For an estimator that the forecaster was not trained with, or a grasp that it does not
            know.
        InputError, MismatchError
            As :func:`~graspcast.views.looks.fuse_looks`, and for what is reachable beside a
            certificate. The look then does not count.
        """
        return self.take_look(results, world_T_cam, K, time_s, reachable=reachable).verdicts

    def take_look(
        self,
        estimates: Mapping[str, Any],
        world_T_cam: Any,
        K: Any,
        time_s: Any,
        seen: Any = None,
        reachable: Reachable | None = None,
    ) -> Taken:
        """Take a further look, as :meth:`look` does, and return all that is known after it."""
        names = self.forecaster.card.estimators
        if unknown := [name for name in estimates if name not in names]:
            raise UnknownNameError("estimator", unknown[0], names, parameters=("estimates",))
        if self._certified:
            refuse_mask(reachable)
        complete = {name: estimates.get(name, {}) for name in names}
        look = Look(complete, world_T_cam, K, time_s, seen)
        with self._lock:
            looks = (*self._looks, look)[-_KEPT:]
            fused = fuse_looks_by(
                looks,
                self.order,
                dataset=self.dataset,
                models=self.models,
                noise=self._noise,
                max_views=self.max_views,
            )
            tracks, count = self._tracks.copy(), self._count + 1
            given = look, tracks, count, reachable
            out = [v for part in fused for v in self._verdicts(part, *given)]
            self._looks, self._tracks, self._count = looks, tracks, count
        return Taken(sorted(out, key=lambda v: v.instance), looks, tracks, count)

    def _verdicts(
        self,
        fused: FusedEstimates,
        look: Look,
        tracks: Tracks,
        count: int,
        reachable: Reachable | None,
    ) -> list[EpisodeVerdict]:
        """Judge the instances of one principal, and number them."""
        world_T_cam = look.world_T_cam
        numbers, doubts = tracks.follow(fused, world_T_cam, self.models)
        left_out = fused.gathered.single_views() if count > 1 else []
        if self.forecaster.view_model is None:
            several = count > 1 or self.decision_options["guide"] == FUSED
            left_out = [ONE_VIEW] if several else []
        shared = tuple(dict.fromkeys((*fused.notes, *left_out)))
        out = []
        rows = self._rows(fused, look, count, reachable)
        for row, n, doubt in zip(rows, numbers, doubts, strict=True):
            pose = row.cam_T_obj
            verdict = EpisodeVerdict(
                instance=n,
                object_name=row.key.object,
                verdict=row.verdict,
                guide=row.principal,
                cam_T_obj=pose,
                world_T_obj=None if world_T_cam is None else compose(world_T_cam, pose),
                views=row.views,
                looks=count,
                row=row,
                notes=(*filter(None, [doubt]), *shared),
            )
            out.append(verdict)
        return out

    def _rows(
        self, fused: FusedEstimates, look: Look, count: int, reachable: Reachable | None
    ) -> list[VerdictRow]:
        keys, known = fused.instances, set(self.forecaster.card.objects)
        if not known.intersection(keys.objects.tolist()):
            own = fused.gathered.view_T_obj[:, 0, fused.estimators.index(fused.principal)]
            gripper = self.forecaster.card.gripper
            return untrained_rows(keys, own, principal=fused.principal, gripper=gripper)
        motion = None
        if look.world_T_cam is not None:
            image = int(keys.scene_id[0]), int(keys.im_id[0])
            motion = CameraMotion({image: look.world_T_cam})
        most = self.max_looks if count < self.max_looks else 1
        seen = None if look.seen is None else {name: v[0] for name, v in look.seen.items()}
        return self.forecaster.judge(
            fused,
            self.models,
            max_looks=most,
            motion=motion,
            seen=seen,
            reachable=reachable,
            **self.decision_options,
        )
