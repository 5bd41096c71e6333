"""Camera poses against objects that stand still."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from graspcast.bop.results import Results
from graspcast.diagnosis.case import Case
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.pairs import TRUTH, as_results
from graspcast.views.camera_motion import CameraMotion
from graspcast.views.motion_checks import check_motion

__all__ = ["motion_findings"]


def motion_findings(case: Case, sources: Mapping[str, Results]) -> Iterator[Finding]:
    """Hold camera poses against ground truth, or else against the estimates."""
    shown = {TRUTH: sources[TRUTH]} if TRUTH in sources else dict(sources)
    for scenes in case.scenes:
        if scenes.motion is None:
            continue
        own = shown
        if scenes.truth is not None and len(scenes.truth):
            own = {TRUTH: as_results(scenes.truth)}
        yield from _checked(case, own, scenes.motion)
    for motion in case.motions:
        yield from _checked(case, shown, motion)


def _checked(case: Case, shown: Mapping[str, Results], motion: CameraMotion) -> Iterator[Finding]:
    if not shown:
        return
    count = len(case.findings)
    case.attempt("camera-poses", motion.source, check_motion, shown, motion)
    yield from case.findings[count:]
    del case.findings[count:]
