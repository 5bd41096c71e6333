"""Candidates: chosen views are refined, and those that fail are replaced."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy import ndarray

from graspcast.pose.transforms import compose, invert
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.candidates import Candidates
from graspcast.views.choice import ViewRules
from graspcast.views.motion import RefinedMotions, ViewMotions
from static_scenes import objects, orbit, seen

CAMERAS = orbit(6, degrees=20)
POSE = seen(CAMERAS[:1], objects(1))[0, 0]
MOTIONS = np.asarray(compose(invert(CAMERAS[:1]), CAMERAS[1:]))
RULES = ViewRules("all", 3, 0.2, CameraNoise(0.001, 0.0))


def candidates(fails: set[int], asked: list[int], left_out: Counter[str]) -> Candidates:
    def refine(places: ndarray) -> RefinedMotions:
        asked.extend(places.tolist())
        serves = np.array([p not in fails for p in places.tolist()])
        covariance = np.tile(1e-4 * np.eye(6), (len(places), 1, 1))
        return RefinedMotions(serves, MOTIONS[places], covariance, "that fail")

    views = ViewMotions(np.arange(1, 6), MOTIONS, np.zeros((5, 2)), refine=refine)
    return Candidates(views, RULES, left_out)


def test_views_that_fail_are_replaced_and_counted() -> None:
    asked: list[int] = []
    left_out: Counter[str] = Counter()
    views = candidates({4}, asked, left_out)
    found, why = views.chosen(POSE)
    assert 4 in asked and 4 not in found and len(found) == 2 and not why
    assert left_out == {"that fail": 1}
    again = len(asked)
    assert views.chosen(POSE) == (found, "") and len(asked) == again  # each is refined once


def test_where_all_fail_there_is_no_view() -> None:
    left_out: Counter[str] = Counter()
    found, why = candidates(set(range(5)), [], left_out).chosen(POSE)
    assert found == [] and "have no other image from another direction" in why
    assert left_out == {"that fail": 5}


def test_noise_at_an_object() -> None:
    views = candidates(set(), [], Counter())
    number = views.chosen(POSE)[0][0]
    far = float(np.linalg.norm(POSE[:3, 3]))
    noise = views.noise_at(number, POSE[None])
    np.testing.assert_allclose(
        noise.translation_m, np.sqrt(1e-6 + 1e-4 + 1e-4 * far**2 * 2 / 3), rtol=1e-9
    )
    assert noise.rotation_rad == np.sqrt(1e-4)
