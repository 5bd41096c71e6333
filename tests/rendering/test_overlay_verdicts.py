"""Verdicts on overlays: which instance each is on, and the side from which to look again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.verdict import VerdictRow
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.rendering.drawing import LOOK
from graspcast.rendering.overlay_verdicts import (
    VerdictTable,
    draw_arrow,
    side_of,
    with_several_views,
)
from graspcast.views.next_look import NextLook
from overlays import verdict_row
from poses import results_of

RESULTS: dict[str, Results] = {name: results_of(np.eye(4)[None]) for name in "ab"}


def at(x: float, z: float = 0.8) -> np.ndarray:
    return transform(np.eye(3), np.array([x, 0.0, z]))


def key(est_id: int = 0) -> InstanceKey:
    return InstanceKey("made", 1, 3, 1, est_id)


def fused(x: float, est_id: int = 0, probability: float = 0.7) -> VerdictRow:
    row = verdict_row(1, 3, 1, est_id, probability=probability, cam_T_obj=at(x))
    return replace(row, principal="fused", views=2)


def mine(x: float, est_id: int = 0, name: str = "a") -> VerdictRow:
    row = verdict_row(1, 3, 1, est_id, probability=0.7, cam_T_obj=at(x))
    return replace(row, principal=name)


def test_verdicts_by_the_fused_pose_are_of_the_nearest_instance() -> None:
    """The rank of a fused pose is another one than that of the estimate."""
    table = VerdictTable([fused(0.11, 0), fused(0.01, 1)], RESULTS)
    keys = [{"a": key(0), "b": key(1)}, {"b": key(0)}]
    poses = [{"a": at(0.0), "b": at(0.02)}, {"b": at(0.1)}]
    near, far = table.of_instances(keys, poses)
    assert [row.cam_T_obj[0, 3] for row in near["a"]] == [0.01] and near["b"] == ()
    assert [row.cam_T_obj[0, 3] for row in far["b"]] == [0.11]


def test_an_instance_with_a_verdict_of_its_own_gets_no_other() -> None:
    table = VerdictTable([fused(0.0), mine(0.02, 1)], RESULTS)
    keys = [{"a": key(1)}, {"a": key(0)}]
    poses = [{"a": at(0.02)}, {"a": at(0.15)}]
    own, other = table.of_instances(keys, poses)
    assert [row.principal for row in own["a"]] == ["a"]
    assert [row.principal for row in other["a"]] == ["fused"]


def test_the_best_guide_may_be_another_one_but_one_there_must_be() -> None:
    keys, poses = [{"a": key(), "b": key()}], [{"a": at(0.0), "b": at(0.01)}]
    both = [replace(mine(0.01, name="b"), views=2), replace(mine(0.0, est_id=7), views=2)]
    (found,) = VerdictTable(both, RESULTS).of_instances(keys, poses)
    assert found["a"] == () and [row.principal for row in found["b"]] == ["b"]
    with pytest.raises(InputError, match="no verdict on made-1 in image 1/3, est_id 0 by a"):
        VerdictTable(both[1:], RESULTS).of_instances(keys, poses)
    # From single views every estimate of a principal has its own.
    single = [replace(row, views=1) for row in both]
    with pytest.raises(InputError, match="no verdict on made-1 in image 1/3, est_id 0 by a"):
        VerdictTable(single, RESULTS).of_instances(keys, poses)


def test_verdicts_on_other_estimates_are_refused() -> None:
    keys, poses = [{"a": key()}], [{"a": at(0.0)}]
    with pytest.raises(MismatchError, match="attempts a pose 300 mm from every estimate of it"):
        VerdictTable([fused(0.3)], RESULTS).of_instances(keys, poses)
    # Where nothing is attempted, the image's own estimate may have been a gross error.
    (found,) = VerdictTable([fused(0.3, probability=0.1)], RESULTS).of_instances(keys, poses)
    assert len(found["a"]) == 1
    with pytest.raises(MismatchError, match="on estimates by c, but the estimates are by a, b"):
        VerdictTable([mine(0.0, name="c")], RESULTS)


def look(degrees: float, about: np.ndarray, cam_T_obj: np.ndarray) -> NextLook:
    """The camera moved about the object, by a rotation about an axis of its own frame."""
    now = -cam_T_obj[:3, 3] / np.linalg.norm(cam_T_obj[:3, 3])
    direction = rotation_from_vector(np.deg2rad(degrees) * about) @ now
    return NextLook(direction, None, -now, 0.01, np.deg2rad(degrees), 0.8)


@pytest.mark.parametrize("x", [0.0, 0.2])
def test_sides_are_those_of_the_image(x: float) -> None:
    """A camera that looks along z goes to its right by turning about its y, down, backwards."""
    pose = at(x)
    ray = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    down = np.array([0.0, 1.0, 0.0])
    right = np.cross(down, ray)
    cases = {
        "right": -down, "left": down, "above": -right, "below": right,
        "above right": -(down + right) / np.sqrt(2), "below left": (down + right) / np.sqrt(2),
        "above left": (down - right) / np.sqrt(2), "below right": (right - down) / np.sqrt(2),
    }  # fmt: skip
    for word, about in cases.items():
        given = look(35.0, about, pose)
        # The camera's centre, in its own frame before it moved.
        moved = pose[:3, 3] + np.linalg.norm(pose[:3, 3]) * given.direction
        assert ("right" in word) == (moved @ right > 0.05)
        assert ("above" in word) == (moved[1] < -0.05)
        assert side_of(given, pose)[0] == word


@pytest.mark.parametrize("degrees", [0, 45, 90, 180, 250])
def test_an_arrow_is_where_it_points(degrees: int) -> None:
    plain = np.full((160, 160, 3), 90, dtype=np.uint8)
    out = draw_arrow(plain, np.deg2rad(degrees))
    changed = (out != plain).any(axis=2)
    ink = np.argwhere(np.abs(out.astype(int) - LOOK).max(axis=2) < 30)[:, ::-1] + 0.5 - 80
    assert len(ink) > 60
    towards = np.array([np.cos(np.deg2rad(degrees)), -np.sin(np.deg2rad(degrees))])
    along, across = ink @ towards, ink @ np.array([-towards[1], towards[0]])
    assert along.min() > 0.3 * 160 and along.max() < 0.5 * 160
    assert abs(across.mean()) < 1
    # The head is outside: wider than the tail, and narrowing to the tip.
    assert np.ptp(across[along < 63]) < np.ptp(across[along > 65]) - 5
    assert np.ptp(across[along > 74]) < 6
    middle = np.hypot(*(np.argwhere(changed) + 0.5 - 80).T)
    assert middle.min() > 0.28 * 160


def test_which_verdicts_are_of_several_views() -> None:
    single = verdict_row(1, 3, 1, probability=0.7)
    assert not with_several_views(single)
    assert with_several_views(replace(single, views=2))
    again = replace(single.verdict, look=look(30.0, np.eye(3)[1], at(0.0)), attempt=False)
    assert with_several_views(replace(single, verdict=again))
