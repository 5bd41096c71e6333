"""Dataset card of a campaign: the README.md of its directory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import polars as pl

from graspcast.estimates.outcomes import ERROR_COLUMNS
from graspcast.io.files import write_text
from graspcast.io.markdown import table

__all__ = ["card_text", "write_card"]

_MEANING = {
    "estimator": "estimator of the pose that guided the grasp; `transferred` if its error was made "
    "on other objects, or drawn (see Sources)",
    "dataset": "BOP dataset of the image",
    "scene_id": "BOP's scene number",
    "im_id": "BOP's image number in the scene",
    "obj_id": "BOP's object number",
    "est_id": "rank by score among the estimator's estimates of the object in the image, from 0",
    "gripper": "the gripper's name",
    "grasp": "the grasp's name",
    **dict.fromkeys(ERROR_COLUMNS[:3], "metres: the estimate's origin in the true object's frame"),
    **dict.fromkeys(
        ERROR_COLUMNS[3:], "radians: rotation vector from the true object to the estimate"
    ),
    "success": "whether the object stayed within the tolerance of its place in the hand",
    "reason": "`held` for a success; `dropped`, `slipped`, `missed`, `collided` (the arm stopped "
    "on the approach), `blocked` (the open hand started in the object or the table, or, by the "
    "paper's protocol, would have ended in the object), `unstable` (the simulation diverged)",
    "offset_m": "metres: distance between the object's centroid in the hand's base frame after "
    "closing and after the lift, or when the trial was stopped early; NaN if blocked, collided or "
    "unstable",
    "short_m": "metres: how far short of its goal the hand was at the end of the approach, or "
    "where it stopped; NaN by the paper's protocol and if blocked",
    "force_n": "newtons: largest net force on the hand that lasted on the approach; NaN as short_m",
    "hit": "what exerted the larger part of that force: `object` or `table`; null if nothing",
    "simulated_s": "seconds of simulated time",
    "computed_s": "computing time, seconds; the only column that differs between equal campaigns",
    "steps": "number of simulation steps",
    "object": "the object's name in the catalogue",
    "settings": "hash of object, gripper, grasp and every setting",
    "mujoco": "version of the physics engine",
}

_LICENCES = {
    "lmo": "LM-O (Hinterstoisser 2012, Brachmann 2014; BOP): used as an input, not contained here; "
    "see the BOP site for its terms",
    "ycbv": "YCB-V (Xiang 2018; BOP) with meshes of the YCB object set (Calli 2015), CC BY 4.0: "
    "used as an input, not contained here",
}

_FRAMES = """\
Metres, radians, kilograms, seconds. Transforms are 4x4 and map points of the second frame into the
first. The object stands in its reference pose `sim_T_ref` on the table z = 0, z up. The true object
is moved to that pose together with the estimate, which keeps its error:
`sim_T_est = sim_T_ref · inv(cam_T_gt) · cam_T_est`. The gripper's tool centre point goes to
`sim_T_est · obj_T_grasp`, closes, and moves up. Every transform and setting is in
`manifest.json`."""


def write_card(
    directory: str | PathLike[str],
    outcomes: pl.DataFrame,
    manifest: Mapping[str, Any],
) -> None:
    """Write the dataset card, ``README.md``, in a campaign's directory."""
    write_text(Path(directory) / "README.md", card_text(outcomes, manifest))


def card_text(
    outcomes: pl.DataFrame,
    manifest: Mapping[str, Any],
) -> str:
    """Return the dataset card as Markdown: columns, frames, success rates, settings, sources.

    Parameters
    ----------
    outcomes
        The campaign's outcomes.
    manifest
        The campaign's manifest.
    """
    versions = manifest["configuration"]
    licences = {name: _LICENCES[name] for name in _LICENCES if name in set(outcomes["dataset"])}
    lines = [
        "---",
        "configs:",
        "- config_name: default",
        "  data_files: outcomes.parquet",
        "tags: [robotics, grasping, 6D-pose]",
        "---",
        "# Simulated grasps guided by pose estimates",
        "",
        f"{len(outcomes)} grasp trials, made with graspcast {versions['graspcast']} and MuJoCo "
        f"{versions['mujoco']}; configuration `{manifest['hash'][:16]}`.",
        "",
        "```python",
        'polars.read_parquet("outcomes.parquet")',
        'pandas.read_parquet("outcomes.parquet")',
        'datasets.load_dataset(".", split="train")',
        "```",
        "",
        "## Columns",
        table(["column", "type", "meaning"], _columns(outcomes), text_columns=3),
        "",
        "## Frames and units",
        _FRAMES,
        "",
        "## Outcomes",
        table(
            ["estimator", "gripper", "trials", "success rate", "reasons"],
            _rates(outcomes),
            text_columns=2,
        ),
        "",
        "## Objects and grippers",
        table(
            ["object", "gripper", "mass (kg)", "friction", "collision pieces"],
            (
                [p["object"], p["gripper"], p["mass_kg"], p["friction"], p["pieces"]]
                for p in manifest["setups"]
            ),
            text_columns=2,
        ),
        "",
        *_settings(manifest["setups"]),
        "",
        "## Sources",
        *(f"- {text}" for text in licences.values()),
        *(f"- {name}: {text}" for name, text in manifest["sources"].items()),
        "- Simulated with graspcast (Apache-2.0) and MuJoCo (Apache-2.0).",
    ]
    return "\n".join(lines) + "\n"


def _columns(outcomes: pl.DataFrame) -> Iterable[list[object]]:
    for name, kind in outcomes.schema.items():
        yield [f"`{name}`", str(kind), _MEANING[name]]


def _rates(outcomes: pl.DataFrame) -> Iterable[list[object]]:
    for group, rows in outcomes.group_by("estimator", "gripper", maintain_order=True):
        counts = rows["reason"].value_counts(sort=True)
        reasons = ", ".join(f"{reason} {count}" for reason, count in counts.iter_rows())
        rate = float(rows["success"].cast(pl.Float64).sum()) / len(rows)
        yield [*group, len(rows), f"{rate:.3f}", reasons]


def _settings(setups: Iterable[Mapping[str, Any]]) -> Iterable[str]:
    seen: list[Mapping[str, Any]] = []
    for setup in setups:
        if setup["settings"] not in seen:
            seen.append(setup["settings"])
    for settings in seen:
        yield "## Settings of a trial"
        watched = "contact_s" in settings
        yield (
            "Protocol: robot. A trial ends as `collided` when the hand meets something on the "
            "approach."
            if watched
            else "Protocol: paper. A trial is blocked if the open hand would end its approach in "
            "the object; otherwise the arm presses on, whatever the hand meets."
        )
        yield ""
        yield table(["setting", "value"], ([f"`{k}`", v] for k, v in settings.items()))
