"""A small scene to look at, for tests of episodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspcast import Episode, Episodes, Forecaster, Results
from graspcast.bop.models import Models
from looked_at import CAMERAS, NAMES, trained
from static_scenes import estimates_of, objects, scattered, seen

POSES = seen(CAMERAS, objects(2, 77))
FOUND = {name: scattered(POSES, 900 + k) for k, name in enumerate(NAMES)}


@dataclass
class World:
    forecaster: Forecaster
    models: dict[str, Models]
    without_views: Forecaster

    def episode(self, **given: Any) -> Episode:
        given = {"models": self.models, "threshold": 0.7} | given
        return Episode(self.forecaster, "d-2", **given)

    def episodes(self, **given: Any) -> Episodes:
        given = {"models": self.models, "threshold": 0.7} | given
        return Episodes(self.forecaster, "d", **given)


def new_world(folder: Path) -> World:
    with pytest.warns(match="not calibrated"):
        forecaster, models = trained(folder / "views")
        without, _ = trained(folder / "none", views=False)
    return World(forecaster, models, without)


def poses(i: int) -> dict[str, np.ndarray]:
    return {name: FOUND[name][i, 1] for name in NAMES}


def results(i: int, found: dict[str, np.ndarray] = FOUND) -> dict[str, Results]:
    tables = {name: estimates_of(found[name]) for name in NAMES}
    return {name: t.select(t.im_id == i) for name, t in tables.items()}
