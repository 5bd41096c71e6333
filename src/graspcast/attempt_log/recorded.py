"""Recorded frames and outcomes of attempt logs, in the form of results files and outcome tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from numpy import ndarray

from graspcast.attempt_log.episodes import scene_of
from graspcast.attempt_log.log import AttemptLog
from graspcast.attempt_log.rows import matrix
from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates.alignment import estimate_ids
from graspcast.estimates.consistency import check_tables
from graspcast.estimates.instances import split_object_name
from graspcast.estimates.loading import Inputs
from graspcast.estimates.outcomes import TRIAL_SCHEMA
from graspcast.estimates.selection import known_objects
from graspcast.io.wording import counted
from graspcast.views.camera_motion import CameraMotion

__all__ = ["Recorded", "recorded"]

_FRAME = ("log", "frame")


@dataclass(frozen=True)
class Recorded:
    """What logs hold, as estimates, outcomes and camera motion.

    Attributes
    ----------
    inputs
        Estimates by dataset and estimator; an episode is a scene, a frame an image.
    outcomes
        Of the grasps that estimators guided, as
        :func:`graspcast.estimates.outcomes.read_outcomes` returns them.
    motions
        Dataset's name to the camera's poses, where they were logged.
    """

    inputs: Inputs
    outcomes: pl.DataFrame
    motions: Mapping[str, CameraMotion]


def recorded(
    logs: Sequence[AttemptLog],
    *,
    datasets: Mapping[str, BopDataset] | None = None,
    objects: Collection[str] = (),
) -> Recorded:
    """Return what attempt logs hold, as data to train on.

    Parameters
    ----------
    logs
        Open for reading or writing.
    datasets
        Dataset's name to its BOP directory, where there is one.
    objects
        Names of the objects that are wanted, all if empty.

    Returns
    -------
    The notes of its inputs say what was left out: outcomes of grasps that a fused pose guided, and
    those whose guide's estimate is not in the decision's frame.

    Raises
    ------
    MismatchError
        If there is no outcome of a grasp that an estimator guided.
    """
    tables = [_with_images(log, number) for number, log in enumerate(logs)]
    estimates = pl.concat([table for table, _, _ in tables])
    decisions = pl.concat([table for _, table, _ in tables]).unique("id", maintain_order=True)
    if objects:
        estimates = estimates.filter(pl.col("object_name").is_in(list(objects)))
        decisions = decisions.filter(pl.col("object_name").is_in(list(objects)))
    left: Counter[str] = Counter()
    ranked = _ranked(estimates)
    outcomes = _outcomes(decisions, ranked, left)
    names = ", ".join(str(log.path) for log in logs)
    notes = [f"left out {counted(n, 'outcome')} of the log: {why}" for why, n in left.items() if n]
    if not len(outcomes):
        raise MismatchError(
            f"{names}: holds no outcome of a grasp that an estimator guided"
            + "".join(f"; {note}" for note in notes),
            parameters=("from_log",),
        )
    results: dict[str, dict[str, Results]] = {}
    for (dataset, estimator), rows in sorted(
        ranked.group_by("dataset", "estimator", maintain_order=True), key=lambda item: item[0]
    ):
        results.setdefault(str(dataset), {})[str(estimator)] = _results(rows, names)
    used = {name: given for name, given in (datasets or {}).items() if name in results}
    for name, found in results.items():
        _check(found, used.get(name), notes)
    inputs = Inputs(used, results, notes)
    frames = pl.concat([table for _, _, table in tables])
    return Recorded(inputs, outcomes, _motions(frames, results, names))


def _check(found: dict[str, Results], dataset: BopDataset | None, notes: list[str]) -> None:
    """Check lengths, and leave out objects without a model where there is a directory of models."""
    if dataset is not None:
        for name, table in found.items():
            found[name] = known_objects(table, dataset, lenient=True)
            if left := len(table) - len(found[name]):
                notes.append(f"dropped {counted(left, 'estimate')} by {name} of other objects")
    check_tables(found, None if dataset is None else dataset.models)


def _with_images(log: AttemptLog, number: int) -> tuple[pl.DataFrame, pl.DataFrame, pl.DataFrame]:
    """Return estimates, decisions with outcomes, and frames, each with scene and image."""
    frames = log.frames()
    scenes = [scene_of(episode) for episode in frames["episode"]]
    frames = frames.select(
        pl.lit(number).alias("log"),
        pl.col("seq").alias("frame"),
        pl.Series("scene_id", scenes, dtype=pl.Int64),
        pl.col("look").alias("im_id"),
        "world_T_cam",
    )
    # A look that was logged twice, otherwise, is another image.
    again = pl.int_range(pl.len()).over("scene_id", "im_id")
    frames = frames.with_columns(im_id=pl.col("im_id") + 1_000_000 * again)
    images = frames.drop("world_T_cam")
    decisions = log.table().filter(pl.col("success").is_not_null())
    return (
        log.estimates().join(images, on="frame", maintain_order="left"),
        decisions.join(images, on="frame", maintain_order="left"),
        frames,
    )


def _ranked(estimates: pl.DataFrame) -> pl.DataFrame:
    """Return estimates with dataset, obj_id and est_id; one logged twice is one."""
    names = estimates["object_name"].unique().to_list()
    parts = {name: split_object_name(name) for name in names}
    table = estimates.with_columns(
        dataset=pl.col("object_name").replace_strict(
            {name: of for name, (of, _) in parts.items()}, return_dtype=pl.String
        ),
        obj_id=pl.col("object_name").replace_strict(
            {name: n for name, (_, n) in parts.items()}, return_dtype=pl.Int64
        ),
    ).unique(["scene_id", "im_id", "estimator", "number"], maintain_order=True)
    ranked = [
        rows.with_columns(est_id=pl.Series(estimate_ids(_results(rows, "the log"))))
        for _, rows in table.group_by("dataset", "estimator", maintain_order=True)
    ]
    return pl.concat(ranked) if ranked else table.with_columns(est_id=pl.lit(0, pl.Int64))


def _outcomes(decisions: pl.DataFrame, ranked: pl.DataFrame, left: Counter[str]) -> pl.DataFrame:
    """Return the outcomes of grasps whose guide's estimate is in the frame, by its very pose."""
    known = set(ranked["estimator"])
    fused = decisions.filter(~pl.col("guide").is_in(list(known)))
    left["a fused pose guided the grasp"] += len(fused)
    keys = [*_FRAME, "object_name", "guide"]
    mine = decisions.filter(pl.col("guide").is_in(list(known)))
    guides = ranked.select(
        *_FRAME,
        "object_name",
        pl.col("estimator").alias("guide"),
        pl.col("cam_T_obj").alias("cam_T_est"),
        "dataset",
        "obj_id",
        "est_id",
    )
    found = mine.join(guides, on=keys, how="inner", maintain_order="left_right")
    pairs = found.select("cam_T_obj", "cam_T_est").iter_rows()
    same = [obj is not None and _is_same(_pose(obj), _pose(est)) for obj, est in pairs]
    found = found.filter(pl.Series(same, dtype=pl.Boolean)).unique(
        "id", keep="first", maintain_order=True
    )
    left["the guide's estimate is not in the frame"] += len(mine) - len(found)
    table = found.select(
        pl.col("guide").alias("estimator"),
        *[name for name in TRIAL_SCHEMA if name != "estimator"],
        pl.col("success").cast(pl.Int64),
    )
    once = table.unique(list(TRIAL_SCHEMA), keep="first", maintain_order=True)
    left["a further grasp by the same estimate"] += len(table) - len(once)
    return once


def _is_same(one: ndarray, other: ndarray) -> bool:
    """Return whether a guide's pose is an estimate's, perhaps made a rotation to the last digit."""
    return bool(np.allclose(one, other, rtol=0.0, atol=1e-5))


def _results(rows: pl.DataFrame, source: str) -> Results:
    n = len(rows)
    return Results(
        scene_id=rows["scene_id"].to_numpy(),
        im_id=rows["im_id"].to_numpy(),
        obj_id=rows["obj_id"].to_numpy(),
        score=rows["score"].to_numpy(),
        cam_T_obj=np.stack([_pose(blob) for blob in rows["cam_T_obj"]]),
        time_s=np.full(n, -1.0),
        line=np.zeros(n, dtype=np.int64),
        source=source,
    )


def _pose(blob: Any) -> ndarray:
    pose = matrix(blob)
    assert pose is not None
    return pose


def _motions(
    frames: pl.DataFrame, results: Mapping[str, Any], source: str
) -> dict[str, CameraMotion]:
    known = frames.filter(pl.col("world_T_cam").is_not_null())
    if not len(known):
        return {}
    poses = {
        (scene, image): _pose(blob)
        for scene, image, blob in known.select("scene_id", "im_id", "world_T_cam").iter_rows()
    }
    return dict.fromkeys(results, CameraMotion(poses, source))
