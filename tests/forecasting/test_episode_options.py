"""Episodes by a certificate: its threshold, and a policy that has to be the same."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from graspcast import CameraNoise, Certificate, Episode, Forecaster
from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.recorded_verdicts import ViewSettings, policy_of
from graspcast.forecasting.verdict import Verdict
from graspcast.guarantees.certify import certify
from looked_at import CAMERAS, NAMES, trained
from static_scenes import objects, scattered, seen

FOUND = {k: scattered(seen(CAMERAS, objects(2, 77)), 900 + i) for i, k in enumerate(NAMES)}
SETTINGS = ViewSettings(guide="fused", max_looks=3, views_from="all")


@pytest.fixture(scope="module")
def world(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Forecaster, dict[str, Models]]:
    with pytest.warns(match="not calibrated"):
        return trained(tmp_path_factory.mktemp("views"))


@pytest.fixture
def forecaster(world: tuple[Forecaster, dict[str, Models]]) -> Forecaster:
    return world[0]


def first_look(world: tuple[Forecaster, dict[str, Models]], certificate: Certificate) -> Verdict:
    forecaster, models = world
    episode = Episode(forecaster, "d-2", models=models, guide="fused", certificate=certificate)
    return episode.look({name: FOUND[name][0, 1] for name in NAMES}, CAMERAS[0]).verdict


def certificate_of(forecaster: Forecaster, settings: ViewSettings, **more: Any) -> Certificate:
    """Certified at 0.9 of trials that all succeed, for a policy."""
    found = certify(np.full(40, 0.95), np.ones(40, bool), np.arange(40), rate=0.9, confidence=0.9)
    policy = policy_of(forecaster, settings, views=more.pop("views", True))
    stated = {"model": forecaster.card.digest, "ood_alpha": 0.01, **more}
    return replace(found, policy=policy, provenance=stated)


def test_the_certified_threshold_and_its_guarantee_are_used(
    world: tuple[Forecaster, dict[str, Models]],
) -> None:
    certificate = certificate_of(world[0], SETTINGS)
    assert certificate.overall.threshold is not None
    verdict = first_look(world, certificate)
    assert verdict.threshold == certificate.overall.threshold
    assert verdict.guarantee == str(certificate.overall)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"guide": "best"}, "guide is fused, not best"),
        ({"max_looks": 2}, "max_looks is 3, not 2"),
        ({"max_views": 2}, "max_views is 3, not 2"),
        ({"min_gain": 0.1}, r"min_gain is 0\.02, not 0\.1"),
        ({"noise": CameraNoise(0.001, 0.0)}, r"translation_sd_m is 0, not 0\.001"),
        ({"max_looks": 1, "max_views": 1}, "but the verdicts are of one view"),
        ({"ood_alpha": 0.5}, "ood_alpha"),
    ],
)
def test_another_policy_is_refused(
    forecaster: Forecaster, given: dict[str, Any], message: str
) -> None:
    certificate = certificate_of(forecaster, SETTINGS)
    with pytest.raises(MismatchError, match=message):
        Episode(forecaster, "d-2", **{"guide": "fused", "certificate": certificate, **given})


def test_a_threshold_or_guarantee_beside_a_certificate_is_refused(forecaster: Forecaster) -> None:
    certificate = certificate_of(forecaster, SETTINGS)
    for given in ({"threshold": 0.5}, {"guarantee": "mine"}):
        with pytest.raises(InputError, match="has its own threshold"):
            Episode(forecaster, "d-2", guide="fused", certificate=certificate, **given)  # type: ignore[arg-type]


def test_a_certificate_of_one_view_is_for_episodes_of_one_look_each(
    forecaster: Forecaster,
) -> None:
    certificate = certificate_of(forecaster, ViewSettings(), views=False)
    Episode(forecaster, "d-2", max_looks=1, max_views=1, certificate=certificate)
    with pytest.raises(MismatchError, match="certificate is of one view, guided by the principal"):
        Episode(forecaster, "d-2", certificate=certificate)
    other = replace(certificate, provenance={"model": "0"})
    with pytest.raises(MismatchError, match="made for another model"):
        Episode(forecaster, "d-2", max_looks=1, max_views=1, certificate=other)


def test_without_a_certified_threshold_nothing_is_attempted(
    world: tuple[Forecaster, dict[str, Models]],
) -> None:
    none = certificate_of(world[0], SETTINGS)
    guarantees = (replace(none.overall, threshold=None),)
    verdict = first_look(world, replace(none, guarantees=guarantees))
    assert str(verdict) == "abstain"
    assert "no threshold could be certified" in verdict.reason
