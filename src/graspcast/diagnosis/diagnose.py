"""Diagnosis of files: every check in its order, from what is read to what is compared."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from os import PathLike
from pathlib import Path

import polars as pl

from graspcast.diagnosis.agreement import (
    belonging,
    conventions,
    copies,
    refined_copies,
    renumbered,
)
from graspcast.diagnosis.boxes import box_findings
from graspcast.diagnosis.case import Case, cases_of, read_case
from graspcast.diagnosis.discovery import discover
from graspcast.diagnosis.environment import environment_findings
from graspcast.diagnosis.finding import Finding, by_severity
from graspcast.diagnosis.frames import frame_findings, symmetry_findings
from graspcast.diagnosis.images import image_findings
from graspcast.diagnosis.motions import motion_findings
from graspcast.diagnosis.pairs import pairs_of, sources_of
from graspcast.diagnosis.scores import repeated_poses, score_findings
from graspcast.diagnosis.shapes import shape_findings
from graspcast.diagnosis.single_changes import single_changes
from graspcast.diagnosis.trials import outcome_findings, shared_scenes

__all__ = ["diagnose"]

Paths = Iterable[str | PathLike[str] | tuple[str | None, str | PathLike[str]]]


def diagnose(
    paths: Paths,
    *,
    calibration: Sequence[str | PathLike[str]] = (),
    environment: bool = False,
) -> list[Finding]:
    """Find what is wrong with files before anything is run.

    Parameters
    ----------
    paths
        BOP directories, models, scene folders, results, detections, outcome tables and tables of
        camera poses, or pairs of a name and one of these; what they are is found out.
        Directories are searched.
    calibration
        Outcome tables for calibration, whose scenes nothing may be trained on.
    environment
        Look at the environment too: packages, OpenGL, directories that are written to.

    Returns
    -------
        Findings, errors first, then warnings, then notes; causes before their consequences.

    Raises
    ------
    InputError
        If a path does not exist.

    Examples
    --------
    >>> from graspcast.demo_data import demo_dataset
    >>> [f.code for f in diagnose([demo_dataset().root]) if f.severity == "error"]
    []
    """
    found, unknown = discover(paths)
    kept, strange = discover(calibration)
    out = environment_findings() if environment else []
    for path in (*unknown, *strange):
        out.append(
            Finding(
                "error",
                "unrecognised",
                str(path),
                "is none of the known files: a directory with models_info.json or scene folders, "
                "results (scene_id, im_id, obj_id, score, R, t), detections (JSON with bbox), "
                "outcomes (a column success), camera poses (world_T_cam_…)",
                "Convert it to one of these, or name its columns so",
            )
        )
    tables: dict[Path, pl.DataFrame] = {}
    for group in cases_of(found):
        case = read_case(group)
        later = list(_of_case(case))
        explained = case.blamed | {f.path for f in later if f.severity == "error"}
        out += [found for of, found in case.doubts.items() if of not in explained]
        # What readers refused comes first: much else follows from it.
        out += [*case.findings, *later]
        tables |= case.outcomes
    held = [e for e in kept if e.kind == "outcomes"]
    if held:
        case = read_case(held)
        out += case.findings
        out += shared_scenes(tables, case.outcomes)
    return by_severity(out)


def _of_case(case: Case) -> Iterator[Finding]:
    """Yield all findings of one dataset, causes before their consequences.

    A source that is found wrong as a whole is left out of the checks that follow.
    """
    yield from shape_findings(case)
    yield from box_findings(case)
    yield from belonging(case)
    sources, _ = sources_of(case)
    yield from renumbered(case, sources)
    pairs = pairs_of({n: t for n, t in sources.items() if n not in case.blamed}, case.name)
    yield from copies(case, pairs)
    yield from conventions(case, sources, pairs)
    yield from single_changes(case, sources, pairs)
    yield from symmetry_findings(case, pairs)
    yield from frame_findings(case, sources, pairs)
    yield from refined_copies(case, pairs)
    yield from motion_findings(case, {n: t for n, t in sources.items() if n not in case.blamed})
    yield from outcome_findings(case, case.outcomes)
    yield from image_findings(case)
    yield from repeated_poses(case)
    yield from score_findings(case)
