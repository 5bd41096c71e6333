"""Cases to look at: a gallery of outcomes, and the worst of each way in which a decision errs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import polars as pl

from graspcast.report.decisions import Decisions

__all__ = ["GALLERY", "ChosenMode", "choose_cases"]

GALLERY = "gallery"
_OUTCOMES = ("held", "dropped", "slipped", "missed", "collided", "blocked", "unstable")
_ORDER = ("dataset", "scene_id", "im_id", "obj_id", "est_id", "gripper", "grasp", "look")


@dataclass(frozen=True, eq=False)
class ChosenMode:
    """Cases of one kind.

    Attributes
    ----------
    key, title, text
        Of the kind, and what its cases have in common.
    rows
        Of the decisions' table, the most telling first.
    of
        How many there are in all.
    """

    key: str
    title: str
    text: str
    rows: pl.DataFrame
    of: int


def choose_cases(decisions: Decisions, most: int) -> list[ChosenMode]:
    """Choose cases: no grasp twice, and at most so many of each kind.

    Parameters
    ----------
    decisions
        Of a run, with outcomes.
    most
        Cases of each kind; the gallery has one of each outcome.
    """
    used: set[int] = set()
    out = []
    for mode in _modes(decisions):
        free = mode.rows.filter(~pl.col("instance").is_in(list(used)))
        rows = free.head(1 if mode.key.startswith(GALLERY) else most)
        used |= set(rows["instance"].to_list())
        if len(rows):
            out.append(ChosenMode(mode.key, mode.title, mode.text, rows, mode.of))
    return _with_gallery(out)


def _with_gallery(modes: list[ChosenMode]) -> list[ChosenMode]:
    """Return the modes with those of the gallery put together, first."""
    gallery = [mode for mode in modes if mode.key.startswith(GALLERY)]
    rest = [mode for mode in modes if not mode.key.startswith(GALLERY)]
    if not gallery:
        return rest
    rows = pl.concat([mode.rows for mode in gallery])
    together = ChosenMode(
        GALLERY,
        "One grasp of each outcome",
        "Of the grasps with that outcome, the one whose pose error is in the middle.",
        rows,
        0,
    )
    return [together, *rest]


def _modes(decisions: Decisions) -> Iterator[ChosenMode]:
    """Yield all candidates of each kind; those that are rarer, or worse, choose first."""
    last = decisions.last.drop_nulls("success")
    failed = last.filter(attempt=True, success=0)
    ended = " when looking had ended" if decisions.most_looks > 1 else ""
    reasons = [name for name in _OUTCOMES if name in set(failed["outcome"].drop_nulls())]
    for reason in reasons:
        mine = failed.filter(outcome=reason)
        title = f"Attempted, and {reason}"
        yield _mode(f"attempted-{reason}", title, mine, [("probability", True)],
                    f"Attempted{ended}, the highest probability first.")  # fmt: skip
    unnamed = failed.filter(pl.col("outcome").is_null())
    yield _mode("attempted-failed", "Attempted, and failed", unnamed, [("probability", True)],
                f"Attempted{ended}, the highest probability first.")  # fmt: skip
    unusual = last.filter(unusual=True)
    yield _mode("unusual", "Out of distribution", unusual,
                [("success", True), ("probability", True)],
                "The estimators disagree unlike in training, so it is not attempted; those that "
                "would have held first.")  # fmt: skip
    timid = last.filter(attempt=False, success=1, unusual=False)
    yield _mode("abstained-held", "Not attempted, though it would have held", timid,
                [("probability", False)],
                f"Not attempted{ended}, the lowest probability first.")  # fmt: skip
    yield _again(decisions, last)
    yield _mode("near", "Failed, though the pose was nearly right",
                last.filter(success=0).drop_nulls("error_m"), [("error_m", False)],
                "Attempted or not, the smallest distance from the true pose first.")  # fmt: skip
    yield _mode("far", "Held, though the pose was far off",
                last.filter(success=1).drop_nulls("error_m"), [("error_m", True)],
                "Attempted or not, the largest distance from the true pose first.")  # fmt: skip
    yield from _gallery(decisions)


def _again(decisions: Decisions, last: pl.DataFrame) -> ChosenMode:
    """Return the grasps that fail after one look, and are attempted and hold after more."""
    first = decisions.at(1).filter(attempt=False, success=0)
    first = first.select("instance", first_probability=pl.col("probability"))
    mine = last.filter((pl.col("look") > 1) & pl.col("attempt"), success=1)
    mine = mine.join(first, on="instance", how="inner", maintain_order="left")
    return _mode("looked-again", "Failed after one look, held after looking again", mine,
                 [("first_probability", True)],
                 "After one look it is not attempted and would fail; after more it is attempted "
                 "and holds. The highest probability after one look first.",
                 drop=["first_probability"])  # fmt: skip


def _gallery(decisions: Decisions) -> Iterator[ChosenMode]:
    """Yield the grasps of each outcome, those first whose error is near the middle."""
    table = decisions.table.drop_nulls("outcome")
    for reason in _OUTCOMES:
        mine = table.filter(outcome=reason)
        # What was decided in the end, if it has that outcome.
        mine = mine.filter("ended") if mine["ended"].any() else mine
        if not len(mine):
            continue
        middle = mine["error_m"].median()
        off = (pl.col("error_m") - middle).abs() if middle is not None else pl.lit(0.0)
        mine = mine.with_columns(off=off)
        yield _mode(f"{GALLERY}-{reason}", reason, mine, [("off", False)], "", drop=["off"])


def _mode(
    key: str,
    title: str,
    rows: pl.DataFrame,
    order: list[tuple[str, bool]],
    text: str,
    drop: list[str] | None = None,
) -> ChosenMode:
    names = [name for name, _ in order]
    falling = [down for _, down in order]
    ordered = rows.sort(
        [*names, *_ORDER], descending=[*falling, *(False for _ in _ORDER)], nulls_last=True
    )
    return ChosenMode(key, title, text, ordered.drop(drop or []), len(rows))
