"""Parameters of the ROS node: names, defaults and descriptions, and what they mean together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graspcast.errors import InputError
from graspcast.ros.settings import SINGLE, Settings

__all__ = ["PARAMETERS", "NodeSettings", "Parameter", "node_settings", "pairs"]


@dataclass(frozen=True)
class Parameter:
    """A parameter of the node.

    Attributes
    ----------
    name
        As in a parameter file.
    default
        Its type is the parameter's; lists are of strings.
    description
        What it says, in one sentence.
    """

    name: str
    default: Any
    description: str


PARAMETERS = (
    Parameter("model", [""], "Model files from train; further ones serve where estimators lack."),
    Parameter("certificate", [""], "Certificates from certify, one for each model; none if empty."),
    Parameter("threshold", -1.0, "Attempt at this probability or above; below 0: not given."),
    Parameter("guide", "", "Whose pose guides: an estimator, fused or best; the model's if empty."),
    Parameter("max_looks", 3, "Looks at one scene after which looking again is never advised."),
    Parameter("estimates", [""], "NAME=TOPIC of each estimator's vision_msgs/Detection3DArray."),
    Parameter("objects", [""], "CLASS=OBJECT for classes that are not named as in the model."),
    Parameter("camera_frame", "", "The camera's optical frame: x right, y down, z forward."),
    Parameter("world_frame", "", "A frame that stands still; empty: poses in the world unused."),
    Parameter(
        "episodes", SINGLE, "single: each frame a scene; static: all are looks at one scene."
    ),
    Parameter("tolerance_s", 0.02, "Largest difference of stamps of one image, seconds."),
    Parameter("timeout_s", 0.5, "How long an image waits for estimators and transforms, seconds."),
    Parameter("attempt_log", "", "SQLite file for decisions and outcomes; none is kept if empty."),
    Parameter("diagnostics_period_s", 1.0, "Seconds between two messages on /diagnostics."),
)


@dataclass(frozen=True)
class NodeSettings:
    """What the node's parameters say.

    Attributes
    ----------
    models, certificates
        Files.
    options
        Further arguments of :meth:`graspcast.runtime.watcher.Watcher.load`.
    topics
        Estimator's name to its topic.
    settings
        How messages become frames.
    attempt_log
        None if none is kept.
    diagnostics_period_s
        Seconds.
    """

    models: tuple[Path, ...]
    certificates: tuple[Path, ...]
    options: Mapping[str, Any]
    topics: Mapping[str, str]
    settings: Settings
    attempt_log: Path | None
    diagnostics_period_s: float


def pairs(texts: Iterable[str], parameter: str, what: str = "NAME=TOPIC") -> dict[str, str]:
    """Return ``NAME=VALUE`` texts as a mapping; empty texts are left out.

    Raises
    ------
    InputError
        For other texts, and names that occur twice.
    """
    out: dict[str, str] = {}
    for text in filter(None, map(str.strip, texts)):
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value):
            raise InputError(f"{parameter} should be {what}, not {text!r}", parameters=(parameter,))
        if name in out:
            raise InputError(f"{parameter} has {name!r} twice", parameters=(parameter,))
        out[name] = value
    return out


def node_settings(values: Mapping[str, Any]) -> NodeSettings:
    """Return what parameters say together.

    Parameters
    ----------
    values
        Name to value; parameters that are left out have their defaults.

    Raises
    ------
    InputError
        For values that say nothing sensible, with the parameter's name.
    """
    given = {p.name: values.get(p.name, p.default) for p in PARAMETERS}
    models, certificates = (
        tuple(Path(text).expanduser() for text in given[name] if text)
        for name in ("model", "certificate")
    )
    topics = pairs(given["estimates"], "estimates")
    for name, value in (("model", models), ("estimates", topics)):
        if not value:
            raise InputError(f"the parameter {name} should be given", parameters=(name,))
    if given["diagnostics_period_s"] <= 0:
        raise InputError(
            f"diagnostics_period_s should be above 0, not {given['diagnostics_period_s']}",
            parameters=("diagnostics_period_s",),
        )
    settings = Settings(
        camera_frame=given["camera_frame"],
        world_frame=given["world_frame"] or None,
        objects=pairs(given["objects"], "objects", "CLASS=OBJECT"),
        tolerance_s=given["tolerance_s"],
        timeout_s=given["timeout_s"],
        episodes=given["episodes"],
    )
    return NodeSettings(
        models=models,
        certificates=certificates,
        options={
            "threshold": None if given["threshold"] < 0 else given["threshold"],
            "guide": given["guide"] or None,
            "max_looks": given["max_looks"],
        },
        topics=topics,
        settings=settings,
        attempt_log=Path(given["attempt_log"]).expanduser() if given["attempt_log"] else None,
        diagnostics_period_s=float(given["diagnostics_period_s"]),
    )
