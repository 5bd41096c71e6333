"""What can be reached has names that are known."""

from __future__ import annotations

from pathlib import Path

import pytest

from episode_world import new_world
from graspcast.errors import UnknownNameError
from graspcast.runtime.reach import check_reachable


def test_unknown_objects_and_grasps_are_refused(tmp_path: Path) -> None:
    cards = [new_world(tmp_path).forecaster.card]
    check_reachable(("reference",), cards)
    check_reachable({"d-1": (), "d-2": ("reference",)}, cards)
    with pytest.raises(UnknownNameError, match=r"unknown reachable grasp 'side'.*known: reference"):
        check_reachable(("side",), cards)
    with pytest.raises(UnknownNameError, match=r"unknown reachable object 'd-3'.*known: d-1, d-2"):
        check_reachable({"d-3": ()}, cards)
    with pytest.raises(UnknownNameError, match="unknown reachable grasp of d-1 'refrence'"):
        check_reachable({"d-1": ("refrence",)}, cards)
