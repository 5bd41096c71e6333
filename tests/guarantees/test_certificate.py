"""Certificates as files: read as they were written, and refused when damaged."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from graspcast.errors import FormatError, MismatchError, UnknownNameError
from graspcast.guarantees.certificate import OVERALL, Certificate, Guarantee
from graspcast.guarantees.certify import certify
from graspcast.guarantees.look_policy import LookPolicy
from graspcast.guarantees.promises import Promise
from graspcast.io.artefacts import write_artefact
from worlds import ASKED, World, drawn


@pytest.fixture
def certificate() -> Certificate:
    probability, success, units = drawn(World(300, 2), 0)
    objects = np.array(["d-1", "d-2"])[units % 2]
    return certify(
        probability, success, units, objects=objects, provenance={"gripper": "parallel"}, **ASKED
    )


def test_certificates_are_read_as_they_were_written(
    certificate: Certificate, tmp_path: Path
) -> None:
    certificate.save(tmp_path / "p.json")
    assert Certificate.load(tmp_path / "p.json") == certificate
    assert certificate.overall.scope == OVERALL
    assert certificate.of("d-2").units == 150
    assert isinstance(certificate.overall, Guarantee)
    with pytest.raises(UnknownNameError, match=r"'d-7'.*d-1, d-2"):
        certificate.of("d-7")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["format"], 1, "format 1, not 4; certify again"),
        (["weight"], "moon", "unknown weight 'moon'"),
        (["rate"], "x", "certify again"),
        (["guarantees"], [], "overall guarantee is not the first"),
        (["guarantees", 0, "threshold"], 1.5, "not between 0 and 1"),
        (["guarantees", 0, "units"], -1, "not a whole number"),
        (["guarantees", 0, "scope"], "d-1", "overall guarantee is not the first"),
        (["sequence", "thresholds"], [0.1], "one weight for each"),
        (["sequence"], None, "certify again"),
    ],
)
def test_damaged_certificates_are_refused(
    certificate: Certificate, tmp_path: Path, path: list[str | int], value: object, message: str
) -> None:
    content = json.loads(json.dumps(certificate.as_dict()))
    place = content
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    file = tmp_path / "p.json"
    write_artefact(file, content)
    with pytest.raises(FormatError, match=message):
        Certificate.load(file)


def test_every_entry_of_a_certificate_is_needed(certificate: Certificate, tmp_path: Path) -> None:
    file = tmp_path / "p.json"
    whole = json.loads(json.dumps(certificate.as_dict()))
    for key in whole:
        write_artefact(file, {k: v for k, v in whole.items() if k != key})
        with pytest.raises(FormatError, match=key):
            Certificate.load(file)
    for key in whole["guarantees"][0]:
        one = {k: v for k, v in whole["guarantees"][0].items() if k != key}
        write_artefact(file, {**whole, "guarantees": [one]})
        with pytest.raises(FormatError, match=key):
            Certificate.load(file)


def test_it_belongs_to_one_model_and_one_ood_alpha(certificate: Certificate) -> None:
    with pytest.raises(MismatchError, match="made for another model"):
        certificate.check_belongs_to("0", 0.01)
    mine = dataclasses.replace(certificate, provenance={"model": "0", "ood_alpha": 0.01})
    mine.check_belongs_to("0", 0.01)
    with pytest.raises(MismatchError, match=r"with ood_alpha 0\.01, not 0\.05") as caught:
        mine.check_belongs_to("0", 0.05)
    assert caught.value.parameters == ("ood_alpha",)


def test_it_keeps_the_policy_and_reads_files_that_had_none(
    certificate: Certificate, tmp_path: Path
) -> None:
    policy = LookPolicy("fused", True, 3, 3, "earlier", 12.0, 0.001, 0.0017, 0.02)
    mine = dataclasses.replace(certificate, policy=policy, provenance={"model": "0"})
    mine.save(tmp_path / "p.json")
    assert Certificate.load(tmp_path / "p.json") == mine
    mine.check_belongs_to("0", 0.01, policy)
    with pytest.raises(MismatchError, match="guide fused, up to 3 looks, but the verdicts are of"):
        mine.check_belongs_to("0", 0.01)
    former = {k: v for k, v in certificate.as_dict().items() if k != "policy"}
    write_artefact(tmp_path / "former.json", {**former, "format": 2})
    assert Certificate.load(tmp_path / "former.json") == certificate
    write_artefact(tmp_path / "broken.json", {**mine.as_dict(), "policy": {"guide": "fused"}})
    with pytest.raises(FormatError, match="not a complete certificate"):
        Certificate.load(tmp_path / "broken.json")


def test_a_guarantee_is_lower_only_than_what_was_asked(certificate: Certificate) -> None:
    one = dataclasses.replace(certificate.overall, threshold=0.8, rate=0.9, best=None)
    for asked, lower in ((None, False), (0.9, False), (0.95, True), (0.8, False)):
        mine = dataclasses.replace(one, asked_rate=asked)
        assert mine.is_lower is lower
        assert ("the rate asked for was" in str(mine)) == lower
    assert one.lower is None


def test_what_is_not_guaranteed_is_told_with_what_would_be(certificate: Certificate) -> None:
    none = dataclasses.replace(
        certificate.overall,
        threshold=None,
        rate=0.9,
        confidence=0.8,
        units=7,
        trials=20,
        reported_threshold=0.85,
        needed_units=22,
        best=Promise(0.75, 0.6549, 5, 4),
    )
    assert none.needed_trials == 63  # 22 units of 20 / 7 trials, rounded up
    assert dataclasses.replace(none, needed_units=21).needed_trials == 60
    assert none.limit == pytest.approx(0.2 ** (1 / 7))
    assert str(none) == (
        "all objects: no threshold can be certified for a rate of 0.9 with confidence 0.8 from 7 "
        "units; about 22 new units (63 trials) would suffice if testing starts at 0.85 and the "
        "success rate seen there continues. A rate of at least 0.654 at probability >= 0.75 can "
        "be, if that is accepted"
    )
    hopeless = dataclasses.replace(none, needed_units=None, best=None)
    assert hopeless.needed_trials is None
    assert str(hopeless).endswith("at no threshold is the success rate clearly above it")


@pytest.mark.parametrize("rate", [0.9, 0.123, 0.999, 0.58])
def test_rates_are_rounded_down(certificate: Certificate, rate: float) -> None:
    for given, shown in ((rate, rate), (rate + 9e-4, rate), (rate - 1e-4, rate - 1e-3)):
        one = dataclasses.replace(certificate.overall, threshold=0.5, rate=given)
        assert f"at a rate of at least {shown:g} (confidence" in str(one)


@pytest.mark.parametrize(
    ("name", "value", "fits"),
    [
        ("rate", 0.0, True),
        ("rate", 1.0, True),
        ("rate", -0.1, False),
        ("rate", True, False),
        ("units", 0, True),
        ("units", 2.0, False),
        ("needed_units", None, True),
        ("needed_units", -3, False),
        ("attempt_rate_interval", [0.0, 1.0], True),
        ("attempt_rate_interval", [0.0, 1.1], False),
        ("attempt_rate_interval", [-0.1, 1.0], False),
        ("attempt_rate_interval", [0.5], False),
        ("attempt_rate_interval", [0.1, 0.2, 0.3], False),
        ("attempt_rate_interval", None, False),
        ("possible_confidence", None, True),
        ("possible_confidence", 1.5, False),
        ("best", None, True),
        ("best", {}, False),
    ],
)
def test_the_entries_of_a_guarantee_are_what_they_should_be(
    certificate: Certificate, tmp_path: Path, name: str, value: object, fits: bool
) -> None:
    content = json.loads(json.dumps(certificate.as_dict()))
    content["guarantees"][1][name] = value
    write_artefact(tmp_path / "p.json", content)
    if fits:
        read = getattr(Certificate.load(tmp_path / "p.json").guarantees[1], name)
        assert (list(read) if isinstance(value, list) else read) == value
    else:
        with pytest.raises(FormatError, match="is not a complete certificate"):
            Certificate.load(tmp_path / "p.json")


def test_files_of_this_format_state_what_former_ones_did_not(
    certificate: Certificate, tmp_path: Path
) -> None:
    content = json.loads(json.dumps(certificate.as_dict()))
    for guarantee in content["guarantees"]:
        del guarantee["asked_rate"], guarantee["best"], guarantee["possible_confidence"]
    write_artefact(tmp_path / "p.json", content)
    with pytest.raises(FormatError, match="asked_rate"):
        Certificate.load(tmp_path / "p.json")
    write_artefact(tmp_path / "p.json", {**content, "format": 3})
    assert Certificate.load(tmp_path / "p.json").overall.best is None


def test_what_is_guaranteed_is_told(certificate: Certificate) -> None:
    one = dataclasses.replace(
        certificate.overall, threshold=0.85, rate=0.9, confidence=0.95, attempt_rate=0.624
    )
    said = (
        "all objects: at probability >= 0.85 attempts succeed at a rate of at least 0.9 "
        "(confidence 0.95); 62% are attempted"
    )
    assert str(one) == said
    lower = dataclasses.replace(one, asked_rate=0.95)
    assert str(lower) == f"{said}; the rate asked for was 0.95"
    assert repr(dataclasses.replace(certificate, guarantees=(one,))) == f"Certificate({said})"
