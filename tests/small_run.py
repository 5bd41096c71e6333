"""A small run, as a report takes it: verdicts after one look and two, outcomes, and results."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from graspcast.bop.results import Results, write_results
from graspcast.estimates.instances import InstanceKey
from graspcast.estimates.outcomes import ERROR_COLUMNS
from graspcast.forecasting.verdict import Verdict, VerdictRow
from graspcast.forecasting.verdict_file import write_verdicts
from graspcast.pose.transforms import transform
from graspcast.views.next_look import NextLook

NASTY = 'r<script>alert("1")</script>\' & "ünïcode" 抓取'
"""A grasp's name that a page must show as text."""
THRESHOLD = 0.7
SCENES, IMAGES = 5, 6


def pose(number: int) -> np.ndarray:
    return transform(np.eye(3), np.array([0.001 * number, 0.0, 0.8]))


def verdicts(
    look: int, *, grasp: str = "reference", dataset: str = "d", looks: int = 2
) -> list[VerdictRow]:
    """Verdicts on objects 1 and 2: the first look asks for another where it is in doubt."""
    rows = []
    for number in range(SCENES * IMAGES):
        probability = round(0.03 + 0.94 * ((number * 7 + 3 * look) % 30) / 30, 6)
        attempt = probability >= THRESHOLD
        sign = ">=" if attempt else "<"
        unusual = number == 4
        reason = f"probability {probability:.3f} {sign} {THRESHOLD:g}"
        reason += "; out-of-distribution disagreement (p-value 0.0010)" if unusual else ""
        again = look < looks and not attempt and not unusual
        towards = NextLook(np.array([1.0, 0, 0]), None, np.array([0, 0, 1.0]), 0.01, 1.0, 0.9)
        rows.append(
            VerdictRow(
                InstanceKey(dataset, number % SCENES + 1, number, 1 + number % 2, 0),
                "a" if look == 1 else "fused",
                "parallel",
                Verdict(
                    attempt and not unusual,
                    probability,
                    reason,
                    look=towards if again else None,
                    grasp=grasp,
                ),
                pose(number + 100 * look),
                grasp=grasp,
                views=look,
            )
        )
    return rows


def outcomes(rows: list[VerdictRow], *, details: bool = True) -> pl.DataFrame:
    """Outcomes of the grasps of verdicts: the more probable, the likelier to hold."""
    out = []
    for number, row in enumerate(rows):
        given = row.verdict.probability or 0.0
        success = (number * 13 + row.views * 5) % 20 < 20 * given
        reason = "held" if success else ("dropped", "missed", "collided")[number % 3]
        error = [0.002 if success else 0.03, 0.001 * (number % 5), 0.0, 0.0, 0.05, 0.1 * given]
        more = {"reason": reason, **dict(zip(ERROR_COLUMNS, error, strict=True))}
        out.append(
            {
                "estimator": row.principal,
                **row.key._asdict(),
                "gripper": row.gripper,
                "grasp": row.grasp,
                "success": int(success),
                **(more if details else {}),
            }
        )
    return pl.DataFrame(out)


def results(rows: list[VerdictRow]) -> Results:
    """The results file whose poses guide some verdicts."""
    keys = [row.key for row in rows]
    return Results(
        scene_id=np.array([key.scene_id for key in keys]),
        im_id=np.array([key.im_id for key in keys]),
        obj_id=np.array([key.obj_id for key in keys]),
        score=np.linspace(0.5, 0.9, len(keys)),
        cam_T_obj=np.stack([row.cam_T_obj for row in rows]),
        time_s=np.full(len(keys), 0.1),
        line=np.arange(2, len(keys) + 2),
    )


def write_run(
    directory: Path, *, looks: int = 2, grasp: str = "reference", details: bool = True
) -> Path:
    """Write a run of one look or two; return its directory."""
    directory.mkdir(parents=True, exist_ok=True)
    for look in range(1, looks + 1):
        rows = verdicts(look, grasp=grasp, looks=looks)
        write_verdicts(directory / f"verdicts{look}.csv", rows)
        outcomes(rows, details=details).write_csv(directory / f"outcomes{look}.csv")
        name = "a" if look == 1 else f"fused{look}"
        write_results(directory / f"{name}_d-test.csv", results(rows))
    return directory
