"""Sources of poses against each other: units, conventions, object ids and copies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.diagnosis.case import Case
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.pairs import TRUTH, Pair
from graspcast.diagnosis.refusals import refusal
from graspcast.errors import GraspcastError, MismatchError
from graspcast.estimates.checks import copied
from graspcast.estimates.consistency import check_pairs
from graspcast.estimates.selection import check_scenes, known_objects
from graspcast.pose.transforms import rotation_vector

__all__ = ["belonging", "conventions", "copies", "refined_copies", "renumbered"]

_COPIED = 0.3
_NEAR, _SELDOM, _MOSTLY = 0.06, 0.35, 0.6
_REFINED, _LEAST_REFINED = 0.75, 25
"""Third quartile of the difference by the larger error; of published estimators 1.0 or more."""


def belonging(case: Case) -> Iterator[Finding]:
    """Hold the ids and distances of estimates against the dataset's models and scenes."""
    without: dict[str, list[int]] = {}
    for name, table in list(case.results.items()):
        if case.truths and not _any_scene(case, table):
            yield from _refused(case, name, _check_scenes, case, table)
        if case.models is None or name in case.blamed:
            continue
        known = np.isin(table.obj_id, list(case.models.info))
        if not known.any():
            yield from _refused(case, name, _known, case, table)
            continue
        if not known.all():
            without[table.source] = np.unique(table.obj_id[~known]).tolist()
        yield from _refused(
            case, name, case.models.check_distances, table.source, table.obj_id, table.cam_T_obj
        )
    yield from _without_model(case, without)


def _refused(
    case: Case, name: str, check: Callable[..., object], *arguments: object
) -> Iterator[Finding]:
    """Yield what a check refuses of an estimator's results, which later checks leave out."""
    count = len(case.findings)
    case.attempt("results", case.results[name].source, check, *arguments, blame=name)
    yield from case.findings[count:]
    del case.findings[count:]


def _check_scenes(case: Case, table: Results) -> None:
    check_scenes(table, case.truths[0].dataset, stated=False)
    raise MismatchError(
        f"{table.source}: none of its images is in {case.truths[0].path}; are they of another "
        "dataset or split?"
    )


def _any_scene(case: Case, table: Results) -> bool:
    """Return whether any directory of scenes has one of the table's images."""
    mine = set(zip(table.scene_id.tolist(), table.im_id.tolist(), strict=True))
    known: set[tuple[int, int]] = set()
    for scenes in case.scenes:
        known |= set(scenes.images)
        if scenes.truth is not None:
            known |= set(
                zip(scenes.truth.scene_id.tolist(), scenes.truth.im_id.tolist(), strict=True)
            )
    return not known or not known.isdisjoint(mine) or not mine


def _known(case: Case, table: Results) -> Results:
    root = case.root or Path()
    dataset = case.scenes[0].dataset if case.scenes else BopDataset(root, name=case.name)
    vars(dataset)["models"] = case.models  # those that were read, wherever they are
    return known_objects(table, dataset, lenient=False)


def _without_model(case: Case, without: Mapping[str, list[int]]) -> Iterator[Finding]:
    if not without or case.models is None:
        return
    numbers = sorted({i for listed in without.values() for i in listed})
    truth = {i for s in case.truths if s.truth is not None for i in s.truth.obj_id.tolist()}
    if truth and not set(numbers) <= truth:
        strange = sorted(set(numbers) - truth)
        source = next(s for s, listed in without.items() if set(listed) - truth)
        yield Finding(
            "warning",
            "objects-unknown",
            source,
            f"objects {', '.join(map(str, strange))} are neither in the models nor in the ground "
            "truth",
            "Are the objects numbered otherwise, or the estimates of another dataset?",
            {"objects": strange},
        )


def renumbered(case: Case, sources: Mapping[str, Results]) -> Iterator[Finding]:
    """Say which estimates stand where ground truth has objects of other numbers."""
    truth = sources.get(TRUTH)
    if truth is None:
        return
    by_image: dict[tuple[int, int], list[int]] = {}
    for row, key in enumerate(zip(truth.scene_id.tolist(), truth.im_id.tolist(), strict=True)):
        by_image.setdefault(key, []).append(row)
    for name, table in sources.items():
        if name == TRUTH:
            continue
        mapping: dict[int, Counter[int]] = {}
        same = near = 0
        keys = zip(table.scene_id.tolist(), table.im_id.tolist(), strict=True)
        for row, key in enumerate(keys):
            rows = by_image.get(key, [])
            if not rows:
                continue
            apart = np.linalg.norm(
                truth.cam_T_obj[rows, :3, 3] - table.cam_T_obj[row, :3, 3], axis=1
            )
            best = int(np.argmin(apart))
            if apart[best] > _NEAR * np.linalg.norm(table.cam_T_obj[row, :3, 3]):
                continue
            near += 1
            mine, theirs = int(table.obj_id[row]), int(truth.obj_id[rows[best]])
            same += mine == theirs
            mapping.setdefault(mine, Counter())[theirs] += 1
        total = len(table)
        if near < max(8, _MOSTLY * total) or same > _SELDOM * near:
            continue
        best_of = {mine: counts.most_common(1)[0] for mine, counts in mapping.items()}
        agreeing = sum(count for _, count in best_of.values())
        if agreeing < _MOSTLY * near:
            continue
        numbers = {str(mine): theirs for mine, (theirs, _) in sorted(best_of.items())}
        said = ", ".join(f"{mine} is {theirs}" for mine, theirs in numbers.items())
        yield Finding(
            "error",
            "objects-renumbered",
            table.source,
            f"{near - same} of {total} estimates lie where ground truth has an object of another "
            f"number, always the same: {said}",
            "Write the dataset's numbers into the column obj_id",
            {"estimates": total, "misnumbered": near - same, "mapping": numbers},
            estimator=name,
        )
        case.blamed.add(name)


def conventions(
    case: Case, sources: Mapping[str, Results], pairs: Mapping[tuple[str, str], Pair]
) -> Iterator[Finding]:
    """Say which source's poses agree with others only in another unit or convention."""
    errors: dict[tuple[str, str], GraspcastError] = {}
    for (one, other), pair in pairs.items():
        error = _contradiction(sources[other].source, pair.others, sources[one].source, pair.poses)
        if error is not None:
            errors[one, other] = error
    while errors:
        times = Counter(name for pair in errors for name in pair)
        # Of two alone, ground truth is believed, then the first.
        order = list(sources)
        odd = max(times, key=lambda n: (times[n], n != TRUTH, order.index(n)))
        one, other = next(pair for pair in errors if odd in pair)
        against = one if odd == other else other
        pair = pairs[one, other] if odd == one else pairs[one, other].swapped()
        error = _contradiction(
            sources[odd].source, pair.poses, sources[against].source, pair.others
        )
        error = error or errors[one, other]
        kind = "truth" if odd == TRUTH else "results"
        found = refusal(error, kind, sources[odd].source)
        yield Finding(
            found.severity,
            found.code,
            sources[odd].source,
            found.message,
            found.cure,
            {"compared": len(pair), "with": against},
            estimator="" if odd == TRUTH else odd,
        )
        case.blamed.add(odd)
        errors = {pair: e for pair, e in errors.items() if odd not in pair}


def _contradiction(mine: str, poses: ndarray, other: str, others: ndarray) -> GraspcastError | None:
    """Return what two sources contradict each other in, None if they do not."""
    try:
        check_pairs(mine, poses, other, others)
    except GraspcastError as error:
        return error
    return None


def copies(case: Case, pairs: Mapping[tuple[str, str], Pair]) -> Iterator[Finding]:
    """Say which estimators have the same poses as others."""
    for (one, other), pair in pairs.items():
        if case.blamed & {one, other}:
            continue
        said = copied((one, other), np.stack([pair.poses, pair.others]))
        same = sum(map(bool, said))
        if same < max(3, _COPIED * len(pair)):
            continue
        truth = TRUTH in (one, other)
        mine = other if other != TRUTH else one
        theirs = one if mine == other else other
        yield Finding(
            "error",
            "estimator-is-truth" if truth else "estimator-copied",
            case.results[mine].source,
            f"{same} of {len(pair)} poses by {mine} are those of {theirs}, but for rounding",
            "Ground truth is no estimator: give its own results"
            if truth
            else "Leave one of the two out: their agreement says nothing",
            {"compared": len(pair), "same": same, "with": theirs},
            estimator=mine,
        )
        case.blamed.add(mine)


def refined_copies(case: Case, pairs: Mapping[tuple[str, str], Pair]) -> Iterator[Finding]:
    """Say which estimator is another one after a refinement: its errors are theirs, only smaller.

    The difference of two estimators' errors is compared, instance by instance, with the larger of
    them. That of independent estimators is often larger than either.
    """
    names = [n for n in case.sound if (n, TRUTH) in pairs]
    for i, other in enumerate(names):
        for one in names[:i]:
            if case.blamed & {one, other}:
                continue
            ratio = _of_errors(case, pairs[one, TRUTH], pairs[other, TRUTH])
            if ratio is None or ratio[0] > _REFINED or ratio[1] > _REFINED:
                continue
            yield Finding(
                "warning",
                "estimator-refines",
                case.results[other].source,
                f"the errors of {other} and {one} are alike: in three of four instances they "
                f"differ by at most {ratio[0]:.0%} of the larger one in position and "
                f"{ratio[1]:.0%} in rotation; those of independent estimators by 100 % or more",
                f"Leave one of the two out: does {other} start from the poses of {one}?",
                {"position_share": ratio[0], "rotation_share": ratio[1], "with": one},
                estimator=other,
            )


def _of_errors(case: Case, one: Pair, other: Pair) -> tuple[float, float] | None:
    """Return third quartiles of the differences of two estimators' errors, by the larger error."""
    where = {key: row for row, key in enumerate(_keys(one))}
    rows = [(where[key], row) for row, key in enumerate(_keys(other)) if key in where]
    if len(rows) < _LEAST_REFINED:
        return None
    first, second = np.array(rows).T
    a, b = _errors(case, one)[first], _errors(case, other)[second]
    for obj_id in np.unique(one.obj_id[first]).tolist():
        mine = one.obj_id[first] == obj_id
        # What all estimators have in common is the annotation's error.
        common = np.median(np.concatenate([a[mine], b[mine]]), axis=0)
        a[mine] -= common
        b[mine] -= common
    out = []
    for part in (slice(0, 3), slice(3, 6)):
        larger = np.maximum(np.linalg.norm(a[:, part], axis=1), np.linalg.norm(b[:, part], axis=1))
        apart = np.linalg.norm(a[:, part] - b[:, part], axis=1)
        out.append(float(np.quantile(apart / np.maximum(larger, 1e-9), 0.75)))
    return out[0], out[1]


def _keys(pair: Pair) -> list[tuple[int, ...]]:
    return [
        (*image, i) for image, i in zip(pair.images.tolist(), pair.obj_id.tolist(), strict=True)
    ]


def _errors(case: Case, pair: Pair) -> ndarray:
    turn = rotation_vector(pair.differences(case)[:, :3, :3])
    return np.concatenate([pair.others[:, :3, 3] - pair.poses[:, :3, 3], turn], axis=1)
