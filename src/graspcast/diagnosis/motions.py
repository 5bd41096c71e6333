"""Camera poses against objects that stand still."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from graspcast.bop.results import Results
from graspcast.diagnosis.case import Case
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.pairs import TRUTH
from graspcast.views.motion_checks import check_motion

__all__ = ["motion_findings"]


def motion_findings(case: Case, sources: Mapping[str, Results]) -> Iterator[Finding]:
    """Hold camera poses against ground truth, or else against the estimates."""
    if not sources:
        return
    shown = {TRUTH: sources[TRUTH]} if TRUTH in sources else dict(sources)
    motions = [*(s.motion for s in case.scenes if s.motion is not None), *case.motions]
    for motion in motions:
        count = len(case.findings)
        case.attempt("camera-poses", motion.source, check_motion, shown, motion)
        yield from case.findings[count:]
        del case.findings[count:]
