"""One forecaster at the robot: its verdicts on first looks, and on looks at a scene so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import GraspcastError, MismatchError
from graspcast.estimates.instances import split_object_name
from graspcast.forecasting.episode_options import decision_options
from graspcast.forecasting.episode_verdict import EpisodeVerdict
from graspcast.forecasting.episodes import Episodes
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_ranking import Reachable
from graspcast.io.hashing import canonical_json, sha256
from graspcast.runtime.first_looks import Batch, Deciding
from graspcast.runtime.frame import Frame
from graspcast.runtime.rehearsal import rehearse

__all__ = ["Judge"]


class Judge:
    """One forecaster with the options by which it decides.

    Parameters
    ----------
    forecaster
        The forecaster.
    models
        Dataset's name to its object models; those that its file carries if None.
    **options
        Of :class:`~graspcast.forecasting.episodes.Episodes`. Where one look is all, and the
        certificate is of one view, each look is judged by its own view.

    Raises
    ------
    InputError, MismatchError, UnknownNameError
        If options are wrong, or the objects' sizes and points are needed and missing.
    """

    def __init__(
        self, forecaster: Forecaster, models: Mapping[str, Models] | None, **options: Any
    ) -> None:
        options = _of_one_look(options)
        known = forecaster.known
        self.forecaster, self.options = forecaster, options
        certificate = options.get("certificate")
        said = None if certificate is None else sha256(canonical_json(certificate.as_dict()))
        self.digests = forecaster.card.digest, said
        self.models = forecaster.models_or(models)
        self._grasps = {} if known is None else known.grasps
        _check_objects(forecaster, self.models)
        one = self.episodes(split_object_name(forecaster.card.objects[0])[0])
        self._deciding = Deciding(
            forecaster, self.models, one.order, one.decision_options, one.max_looks
        )

    @property
    def policy(self) -> dict[str, Any]:
        """What it decides by: guide, threshold, guarantee, most looks, and more."""
        options = decision_options(self.forecaster, guarantee=None, **self.options)
        return {**options, "max_looks": int(self.options["max_looks"])}

    def warm_up(self) -> None:
        """Load what the first looks, and the second ones, would wait for."""
        self.forecaster.warm_up(self.models)
        rehearse(self)

    def grasps_of(self, object_name: str) -> Mapping[str, Float[ndarray, "4 4"]]:
        """Return the poses of an object's grasps on it, by name, where they are known."""
        return self._grasps.get(object_name, {})

    def replayed(self, dataset: str, frames: Sequence[Frame]) -> Episodes:
        """Return the looks at the objects of a dataset so far."""
        out = self.episodes(dataset)
        for frame in frames:
            self.look(out, frame)
        return out

    def episodes(self, dataset: str) -> Episodes:
        """Return a new series of looks at the objects of a dataset."""
        return Episodes(self.forecaster, dataset, models=self.models, **self.options)

    def look(self, episodes: Episodes, frame: Frame) -> list[EpisodeVerdict]:
        """Take a further look; raise as :meth:`Episodes.look`."""
        card = self.forecaster.card
        results = frame.results(episodes.dataset, card.estimators)
        return episodes.look(
            results,
            frame.world_T_cam,
            frame.K,
            time_s=frame.time_s,
            reachable=self._reachable(frame),
        )

    def _reachable(self, frame: Frame) -> Reachable | None:
        """Return what can be reached, as forecasters take it."""
        if frame.reachable is None:
            return None
        card = self.forecaster.card
        return lambda key: frame.reachable_of(key.object, card.grasps_of(key.object))

    def first_looks(
        self, frames: Sequence[Frame], dataset: str
    ) -> list[list[EpisodeVerdict] | GraspcastError]:
        """Judge the first looks at several scenes; each has its verdicts or its error."""
        batch = Batch(self._deciding, frames, dataset)
        odd, refusals = batch.odd(), batch.refusals()
        out: list[list[EpisodeVerdict] | GraspcastError] = []
        good = ~odd
        good[list(refusals)] = False
        try:
            found = batch.verdicts(good)
        except GraspcastError:  # of which frame it is, is seen where each is alone
            odd, found = np.ones(len(frames), dtype=bool), [[] for _ in frames]
        for i, frame in enumerate(frames):
            if not odd[i]:
                out.append(refusals.get(i, found[i]))
                continue
            try:
                out.append(self.look(self.episodes(dataset), frame))
            except GraspcastError as error:
                out.append(error)
        return out


def _of_one_look(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options, with one view where that is what was certified and one look is all."""
    certificate = options.get("certificate")
    one = certificate is not None and certificate.policy is None and options["max_looks"] == 1
    return {**options, "max_views": 1} if one else options


def _check_objects(forecaster: Forecaster, models: Mapping[str, Models] | None) -> None:
    """Raise if the features need the sizes and points of objects that there are not.

    Raises
    ------
    MismatchError
        Naming the objects and the remedies.
    """
    card = forecaster.card
    if not forecaster.needs_models and forecaster.view_model is None:
        return
    lacking = []
    for name in card.objects:
        dataset, obj_id = split_object_name(name)
        if models is None or dataset not in models or obj_id not in models[dataset].info:
            lacking.append(name)
    if lacking:
        given = "the model file carries" if models is None or forecaster.known else "there are"
        raise MismatchError(
            f"verdicts of {card.principal} with {', '.join(card.supporters) or 'no supporter'} "
            f"need sizes and meshes of objects, and {given} none of {', '.join(lacking)}: give the "
            "object models, or train the model again, which puts what is needed into its file",
            parameters=("models", "bop"),
        )
