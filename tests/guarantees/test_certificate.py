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
