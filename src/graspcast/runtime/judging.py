"""One forecaster at the robot: its verdicts on first looks, and on looks at a scene so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import GraspcastError
from graspcast.estimates.instances import split_object_name
from graspcast.forecasting.episode_verdict import EpisodeVerdict
from graspcast.forecasting.episodes import Episodes
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_ranking import Reachable
from graspcast.runtime.frame import Frame

__all__ = ["Judge"]


@dataclass(frozen=True, eq=False)
class Judge:
    """One forecaster with the options by which it decides.

    Attributes
    ----------
    forecaster
        The forecaster.
    models
        Dataset's name to its object models.
    options
        Of :class:`~graspcast.forecasting.episodes.Episodes`.
    """

    forecaster: Forecaster
    models: Mapping[str, Models] | None
    options: Mapping[str, Any]

    def check(self) -> None:
        """Raise if options are wrong, or the objects' sizes and points are needed and missing."""
        card = self.forecaster.card
        dataset, _ = split_object_name(card.objects[0])
        self.episodes(dataset)

    def warm_up(self) -> None:
        """Load what the first verdict would wait for."""
        self.forecaster.warm_up(self.models)

    def grasps_of(self, object_name: str) -> Mapping[str, Float[ndarray, "4 4"]]:
        """Return the poses of an object's grasps on it, by name, where they are known."""
        return {}

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
        reached, card = frame.reachable, self.forecaster.card
        if not isinstance(reached, Mapping):
            return reached
        by_name = dict(reached)
        return lambda key: by_name.get(key.object, card.grasps_of(key.object))

    def first_looks(
        self, frames: Sequence[Frame], dataset: str
    ) -> list[list[EpisodeVerdict] | GraspcastError]:
        """Judge the first looks at several scenes; each has its verdicts or its error."""
        out: list[list[EpisodeVerdict] | GraspcastError] = []
        for frame in frames:
            try:
                out.append(self.look(self.episodes(dataset), frame))
            except GraspcastError as error:
                out.append(error)
        return out
