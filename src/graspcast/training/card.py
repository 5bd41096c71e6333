"""The model card of trained estimator weights: objects, training and validation errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from graspcast.io import markdown
from graspcast.io.wording import counted
from graspcast.perception.network import Network
from graspcast.pose.lengths import shown
from graspcast.training.validation import in_words

__all__ = ["HEADER", "card"]

HEADER = (
    "object",
    "poses",
    "rot. deg 50 %",
    "rot. deg 90 %",
    "transl. mm 50 %",
    "transl. mm 90 %",
)
"""Columns of a table of validation errors."""


def card(network: Network, name: str) -> str:
    """Return the model card of a network, as Markdown, from what its file holds.

    Parameters
    ----------
    network
        The network.
    name
        Its estimator.
    """
    trained, made, validation = network.trained, network.made, network.validation
    dataset = trained.dataset or "an unnamed dataset"
    parts = [
        f"# Weights of the estimator {name} for {dataset}",
        "They are for these objects, in the frames of these models, and are refused for an object "
        "of another dataset, size or frame with the same number:",
        markdown.table(
            ["object", "diameter", "box"],
            [
                [f"{dataset}-{one.obj_id}", shown(one.diameter_m), _box(one.size.tolist())]
                for one in trained.by_id.values()
            ],
        ),
        f"Trained for {counted(int(made['steps']), 'step')} of {made.get('batch', '?')} crops"
        f"{_images(made)} (seed {made.get('seed', 'unknown')}, augmentation of strength "
        f"{made.get('strength', 'unknown')}), with {_versions(made)}.",
    ]
    if validation:
        parts += [
            f"Errors on {validation['images']}, symmetries taken into account: median and 90 % "
            "quantile of the poses found.",
            markdown.table(HEADER, in_words(validation["errors"], dataset)),
        ]
    return "\n\n".join(parts) + "\n"


def _images(made: Mapping[str, Any]) -> str:
    return f" from {counted(int(made['images']), 'rendered image')}" if "images" in made else ""


def _box(size: list[float]) -> str:
    return " x ".join(f"{1000 * side:.0f}" for side in size) + " mm"


def _versions(made: Mapping[str, Any]) -> str:
    return ", ".join(f"{k} {made[k]}" for k in ("graspcast", "torch", "mujoco") if k in made)
