"""A scene as data: named nodes with a mesh, a pose and a colour, and how they move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["Motion", "Node", "Scene", "Shape", "Up"]

Up = Literal["z", "-y"]
"""Which axis of the scene's frame points up: z of a table, -y of an OpenCV camera."""

_Y_UP: dict[Up, ndarray] = {
    "z": np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
    "-y": np.diag([1.0, -1.0, -1.0, 1.0]),
}


@dataclass(frozen=True, eq=False)
class Shape:
    """A triangle mesh and its colour.

    Attributes
    ----------
    vertices, faces
        The mesh in the node's frame, metres.
    colours
        RGB of each vertex, or of all.
    opacity
        From 0, which cannot be seen, to 1.
    """

    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]
    colours: UInt8[ndarray, "v 3"] | UInt8[ndarray, " 3"]
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Node:
    """A shape at a pose.

    Attributes
    ----------
    name
        Its path, such as ``estimates/epos/lmo-5 0``: the first part is its group.
    shape
        What is seen.
    scene_T_node
        Its pose in the scene's frame, metres.
    about
        What it is, by key, as JSON has values; a key names its unit (``translation_mm``).
    """

    name: str
    shape: Shape
    scene_T_node: Float[ndarray, "4 4"]
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def group(self) -> str:
        """The first part of the name."""
        return self.name.partition("/")[0]


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of some nodes over time.

    Attributes
    ----------
    times_s
        Seconds from 0, increasing.
    scene_T_node
        Of each node that moves, by name, (t, 4, 4).
    captions
        What happens at each time.
    """

    times_s: Float[ndarray, " t"]
    scene_T_node: Mapping[str, Float[ndarray, "t 4 4"]]
    captions: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Scene:
    """What can be looked at.

    Attributes
    ----------
    title
        What it shows.
    nodes
        Its nodes, whose names differ.
    up
        Which axis of its frame points up.
    frame
        What its frame is, in words.
    legend
        Meanings and the RGB colours that stand for them.
    motion
        How nodes move; None if nothing does.

    Raises
    ------
    InputError
        If there is no node, two have one name, or a pose is not finite.
    """

    title: str
    nodes: tuple[Node, ...]
    up: Up
    frame: str
    legend: tuple[tuple[str, tuple[int, int, int]], ...] = ()
    motion: Motion | None = None

    def __post_init__(self) -> None:
        names = [node.name for node in self.nodes]
        if not names:
            raise InputError(f"{self.title}: there is nothing to show")
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(f"{self.title}: two nodes are called {twice[0]!r}")
        for node in self.nodes:
            if not (
                np.isfinite(node.scene_T_node).all() and np.isfinite(node.shape.vertices).all()
            ):
                raise InputError(f"{self.title}: the pose or mesh of {node.name!r} is not finite")

    @property
    def y_up_T_scene(self) -> Float[ndarray, "4 4"]:
        """The scene's frame in one whose y points up, which glTF prescribes."""
        return _Y_UP[self.up]

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of its nodes, in their order."""
        return tuple(dict.fromkeys(node.group for node in self.nodes))
