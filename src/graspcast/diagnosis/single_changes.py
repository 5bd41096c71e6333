"""Conventions of several objects that are each seen from one side.

Views of one object from one side prove no convention: a constant transform of its frame would
explain them as well. One change that explains several objects, each with another transform, is the
simpler reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from graspcast.bop.results import Results
from graspcast.diagnosis.case import Case
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.pairs import TRUTH, Pair
from graspcast.diagnosis.refusals import code_of
from graspcast.errors import MismatchError
from graspcast.pose.conventions import CONVENTIONS, Convention

__all__ = ["single_changes"]

_FAR, _NEAR, _BETTER = 0.25, 0.12, 3.0
_LEAST, _LEAST_OBJECTS = 12, 2


def single_changes(
    case: Case, sources: Mapping[str, Results], pairs: Mapping[tuple[str, str], Pair]
) -> Iterator[Finding]:
    """Say which source's poses of several objects agree with others only after one change."""
    found = {
        key
        for key, pair in pairs.items()
        if not case.blamed & set(key) and (_change(case, pair) or _change(case, pair.swapped()))
    }
    order = list(sources)
    while found:
        times = Counter(name for key in found for name in key)
        odd = max(times, key=lambda n: (times[n], n != TRUTH, order.index(n)))
        key = next(key for key in found if odd in key)
        pair = pairs[key] if key[0] == odd else pairs[key].swapped()
        change = _change(case, pair)
        found = {other for other in found if odd not in other}
        if change is None:
            continue
        convention, before, after = change
        code, cure = code_of(MismatchError(convention.question), "results")
        yield Finding(
            "error",
            code,
            sources[odd].source,
            f"the median distance of {len(pair)} poses of {len(np.unique(pair.obj_id))} objects "
            f"from those by {pair.other} is {before:.2f} diameters, and {after:.2f} when "
            f"{convention.change}: {convention.question}",
            cure,
            {"compared": len(pair), "apart": before, "apart_after": after, "with": pair.other},
            estimator="" if odd == TRUTH else odd,
        )
        case.blamed.add(odd)


def _change(case: Case, pair: Pair) -> tuple[Convention, float, float] | None:
    """Return the change after which the first source's poses agree, with distances."""
    if len(pair) < _LEAST or len(np.unique(pair.obj_id)) < _LEAST_OBJECTS:
        return None
    before = float(np.median(pair.apart(case)))
    if before < _FAR:
        return None
    found = [
        float(np.median(replace(pair, poses=c.undo(pair.poses)).apart(case))) for c in CONVENTIONS
    ]
    best = int(np.argmin(found))
    if found[best] > _NEAR or found[best] * _BETTER > before:
        return None
    return CONVENTIONS[best], before, found[best]
