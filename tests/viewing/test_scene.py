"""Scenes as data: what is refused, and where up is."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.viewing.scene import Node, Scene, Shape, Up


def node(name: str, x: float = 0.0) -> Node:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    pose = np.eye(4)
    pose[0, 3] = x
    red = np.array([255, 0, 0], dtype=np.uint8)
    return Node(name, Shape(corners, np.array([[0, 1, 2]]), red), pose)


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        ((), "nothing to show"),
        ((node("a"), node("a")), "two nodes are called 'a'"),
        ((node("a", np.nan),), "'a' is not finite"),
    ],
)
def test_what_cannot_be_shown_is_refused(nodes: tuple[Node, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Scene("t", nodes, "z", "a test's")


@pytest.mark.parametrize(("up", "point"), [("z", (0.0, 0.0, 2.0)), ("-y", (0.0, -2.0, 0.0))])
def test_up_becomes_y(up: Up, point: tuple[float, float, float]) -> None:
    turned = Scene("t", (node("a"),), up, "a test's").y_up_T_scene
    np.testing.assert_allclose(turned[:3, :3] @ point, (0, 2, 0))
    assert np.linalg.det(turned) == pytest.approx(1)


def test_groups_are_the_first_parts_of_names() -> None:
    nodes = (node("estimates/a/x"), node("estimates/b/x"), node("camera"))
    assert Scene("t", nodes, "z", "a test's").groups == ("estimates", "camera")
