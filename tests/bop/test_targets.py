"""Targets files of the BOP Challenge."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from graspcast.bop.targets import Target, read_targets
from graspcast.errors import FormatError


def test_targets_of_both_formats(tmp_path: Path) -> None:
    path = tmp_path / "targets.json"
    path.write_text(
        json.dumps(
            [{"scene_id": 1, "im_id": 2, "obj_id": 3, "inst_count": 4}, {"scene_id": 5, "im_id": 6}]
        )
    )
    assert read_targets(path) == [Target(1, 2, 3, 4), Target(5, 6)]
    path.write_text(json.dumps([{"scene_id": 1}]))
    with pytest.raises(FormatError, match="entry 0: no 'im_id'; found scene_id"):
        read_targets(path)
