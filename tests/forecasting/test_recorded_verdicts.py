"""Policies in words that a certificate can hold, and who guides under them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from graspcast import CameraNoise, Forecaster
from graspcast.errors import MismatchError, UnknownNameError
from graspcast.forecasting.recorded_verdicts import (
    ViewSettings,
    check_views,
    guides_of,
    policy_of,
)
from looked_at import CAMERAS, trained
from static_scenes import motion_of


@pytest.fixture(scope="module")
def forecaster(tmp_path_factory: pytest.TempPathFactory) -> Forecaster:
    with pytest.warns(match="not calibrated"):
        return trained(tmp_path_factory.mktemp("views"))[0]


def test_the_principals_one_view_is_no_policy(forecaster: Forecaster) -> None:
    for guide in (None, "a", "fused"):
        settings = ViewSettings(guide=guide, max_views=5)
        assert policy_of(forecaster, settings, views=False) is None
        assert policy_of(forecaster, settings, views=True) is not None
    assert guides_of(forecaster, None) == ["a"]


def test_what_decides_is_stated(forecaster: Forecaster) -> None:
    noise = CameraNoise(0.001, 0.002)
    settings = ViewSettings(guide="fused", max_views=5, noise=noise, views_from="all")
    found = policy_of(forecaster, settings, views=True)
    assert found is not None
    assert (found.guide, found.views, found.views_from) == ("fused", True, "all")
    assert (found.max_looks, found.max_views, found.min_parallax_deg) == (1, 5, 12.0)
    assert (found.translation_sd_m, found.rotation_sd_rad) == (0.001, 0.002)
    # With several looks, a verdict has as many views as looks.
    looking = policy_of(forecaster, replace(settings, max_looks=3), views=True)
    assert looking is not None and (looking.max_looks, looking.max_views) == (3, 3)


def test_without_views_their_choice_does_not_matter(forecaster: Forecaster) -> None:
    best = ViewSettings(guide="best")
    other = replace(best, views_from="all", max_views=2, min_parallax_rad=0.0)
    assert policy_of(forecaster, best, views=False) == policy_of(forecaster, other, views=False)


@pytest.mark.parametrize(
    ("guide", "looks", "views", "guides"),
    [
        ("b", 3, True, ["b"]),
        ("fused", 1, True, ["a", "fused"]),
        ("fused", 3, True, ["a", "fused", "fused2", "fused3"]),
        ("best", 2, True, ["a", "b", "c", "fused", "fused2"]),
        ("best", 1, False, ["a", "b", "c"]),
    ],
)
def test_all_names_that_guide_attempts(
    forecaster: Forecaster, guide: str, looks: int, views: bool, guides: list[str]
) -> None:
    policy = policy_of(forecaster, ViewSettings(guide=guide, max_looks=looks), views=views)
    assert guides_of(forecaster, policy) == guides


def test_what_a_forecaster_cannot_do_is_refused(forecaster: Forecaster) -> None:
    with pytest.raises(UnknownNameError, match="'z'"):
        check_views([forecaster], ViewSettings(guide="z"), {})
    single = replace(forecaster, predictor=replace(forecaster.predictor, views=None))  # type: ignore[type-var]
    check_views([single], ViewSettings(), {})
    with pytest.raises(MismatchError, match="trained without views"):
        check_views([single], ViewSettings(), {"d": motion_of(CAMERAS)})
