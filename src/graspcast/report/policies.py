"""What following the verdicts is worth, and looking again: the main result of a run."""

from __future__ import annotations

from dataclasses import dataclass

from graspcast.errors import MismatchError
from graspcast.evaluation.look_scores import LookScores, PolicyScore, Stage, score_looks
from graspcast.evaluation.verdict_scores import attempt_scores
from graspcast.io.wording import counted
from graspcast.report.content import Cell, Section, Table
from graspcast.report.decisions import Decisions
from graspcast.report.rates import DRAWS, interval_cell
from graspcast.report.text import rate, spread

__all__ = ["Summary", "policies_section", "summarise_run"]

_NUMERIC = (False, True, True, True, True)


@dataclass(frozen=True)
class Summary:
    """The main result of a run.

    Attributes
    ----------
    lead
        In one or two sentences.
    numbers
        What, value, and what it is of.
    """

    lead: str
    numbers: tuple[tuple[str, str, str], ...]


def summarise_run(decisions: Decisions) -> Summary:
    """Return the main result of a run's verdicts."""
    last, first = decisions.last, decisions.at(1)
    said = {
        word: int((last["said"] == word).sum()) for word in ("attempt", "look again", "abstain")
    }
    told = ", ".join(f"{n:,} to {word}" for word, n in said.items() if n)
    ended = " when looking ends" if decisions.most_looks > 1 else ""
    scenes = counted(last["scene"].n_unique(), "scene")
    numbers = [
        ("verdicts", f"{len(last):,}", f"in {scenes}"),
        ("attempted", rate(said["attempt"] / len(last)), f"{said['attempt']:,} grasps"),
    ]
    tried = [known for table in (first, last) if len(known := table.drop_nulls("success"))]
    always, scored = (
        (attempt_scores(t, draws=DRAWS) for t in tried) if len(tried) == 2 else 2 * (None,)
    )
    lead = f"{counted(len(last), 'verdict')}{ended}: {told}."
    if always is None or scored is None:
        return Summary(f"{lead} There are no outcomes to score them by.", tuple(numbers))
    looks = " after one look" if ended else ""
    if scored.following is not None:
        lead += (
            f" Of those that are attempted and have an outcome, {rate(scored.following.value)} "
            f"{spread(scored.following)} succeed; if all were attempted{looks}, "
            f"{rate(always.always.value)} {spread(always.always)} would."
        )
    else:
        lead += f" If all were attempted{looks}, {rate(always.always.value)} would succeed."
    following = scored.following
    numbers += [
        (
            "attempts succeed",
            rate(None if following is None else following.value),
            spread(following) or "no interval",
        ),
        (
            f"succeed if all are attempted{looks}",
            rate(always.always.value),
            spread(always.always) or "no interval",
        ),
    ]
    if ended:
        mean = float(last["looks"].mean())  # type: ignore[arg-type]
        numbers.append(("looks, on average", f"{mean:.2f}", f"of up to {decisions.most_looks}"))
    return Summary(lead, tuple(numbers))


def policies_section(decisions: Decisions) -> Section:
    """Return the section of policies, as ``score`` scores them; empty without outcomes."""
    tables, notes = [], []
    for number, looks in enumerate(decisions.looks):
        outcomes = decisions.outcomes[number]
        stages = [
            Stage(rows, table, taken)
            for rows, table, taken in zip(looks.stages, outcomes, looks.taken, strict=True)
            if table is not None
        ]
        if not stages or len(stages) < len(looks.stages):
            continue
        try:
            found = score_looks(stages, draws=DRAWS)
        except MismatchError as error:
            notes.append(f"{', '.join(path.name for path in looks.paths)}: {error}.")
            continue
        tables.append(_table(number, found, len(decisions.looks) > 1 and looks.paths[0].name))
    return Section(
        key="worth",
        title="What following the verdicts is worth",
        paragraphs=tuple(notes),
        tables=tuple(tables),
    )


def _table(number: int, found: LookScores, of: str | bool) -> Table:
    one_look = len({policy.looks for policy in found.policies}) == 1
    shown = found.policies[:2] if one_look else found.policies
    names = ["attempting always", "following the verdicts"] if one_look else [p.name for p in shown]
    about = f"{counted(found.n, 'grasp')} in {counted(found.scenes, 'scene')}"
    left_out = f"; left out: {found.untried} without an outcome" if found.untried else ""
    which = f"{of}: " if of else ""
    return Table(
        key=f"policies-{number + 1}",
        caption=f"{which}{about}{left_out}. Intervals of 95 %, over scenes.",
        columns=("policy", "success rate", "attempted", "attempts", "mean looks"),
        rows=tuple(_row(name, policy) for name, policy in zip(names, shown, strict=True)),
        numeric=_NUMERIC,
    )


def _row(name: str, policy: PolicyScore) -> tuple[Cell, ...]:
    return (
        Cell.of(name),
        interval_cell(policy.success),
        interval_cell(policy.attempt_rate),
        Cell.of(policy.attempts),
        Cell.of(policy.looks, 2),
    )
