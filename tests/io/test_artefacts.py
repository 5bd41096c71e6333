"""JSON artefacts: what comes back is what was written, or an error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspcast.errors import FormatError, InputError
from graspcast.io.artefacts import read_artefact, write_artefact

CONTENT: dict[str, Any] = {
    "name": "müg",
    "numbers": [1, 2.5, -0.1, 1e-300, 1 / 3],
    "none": None,
    "flags": {"yes": True, "no": False},
    "pair": (1, 2),
    10: "ten",
    9: "nine",
}
PLAIN = json.loads(json.dumps(CONTENT))


def test_content_comes_back_however_it_is_indented(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_artefact(path, CONTENT)
    assert read_artefact(path, "make it again") == PLAIN
    path.write_text(json.dumps(json.loads(path.read_text()), indent=7, sort_keys=True))
    assert read_artefact(path, "make it again") == PLAIN


def test_a_flipped_bit_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_artefact(path, CONTENT)
    content, random = path.read_bytes(), np.random.default_rng(0)
    refused = 0
    for place in random.permutation(8 * len(content)).tolist()[:1500]:
        changed = bytearray(content)
        changed[place // 8] ^= 1 << place % 8
        path.write_bytes(changed)
        try:
            found = read_artefact(path, "make it again")
        except FormatError:
            refused += 1
        else:
            assert json.dumps(found) == json.dumps(PLAIN)
    assert refused > 1000


def test_without_a_digest_or_with_another_it_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    for stated in ({}, {"sha256": None}):
        path.write_text(json.dumps({**PLAIN, **stated}))
        with pytest.raises(
            FormatError, match=r"has no digest: .*former version.*; make it"
        ) as caught:
            read_artefact(path, "make it again", parameters=("state",))
        assert caught.value.parameters == ("state",)
    for wrong in ("0" * 64, 7, [], {}):
        path.write_text(json.dumps({**PLAIN, "sha256": wrong}))
        with pytest.raises(FormatError, match=r"damaged or was edited.*; make it again"):
            read_artefact(path, "make it again")
    with pytest.raises(InputError, match="not finite"):
        write_artefact(path, {"x": float("nan")})
