"""The models that judge together: where one lacks a supporter, the next that does without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from graspcast.errors import GraspcastError
from graspcast.forecasting.episode_verdict import EpisodeVerdict
from graspcast.runtime.frame import Frame
from graspcast.runtime.judging import Judge
from graspcast.runtime.scenes import Scene

__all__ = ["Judged", "Panel"]


class Judged(NamedTuple):
    """A verdict, of which dataset's object it is, and who judged."""

    dataset: str
    verdict: EpisodeVerdict
    judge: Judge


Found = list[Judged] | GraspcastError


class Panel:
    """Judges, the one with the most supporters first.

    An instance has the verdict of the first one that has a forecast, and otherwise of the first.
    """

    def __init__(self, judges: Sequence[Judge]) -> None:
        self.judges = tuple(judges)

    def first_looks(self, frames: Sequence[Frame]) -> list[Found]:
        """Judge first looks at several scenes; each has its verdicts or its error."""
        out: list[Found] = [[] for _ in frames]
        for dataset in sorted({name for frame in frames for name in frame.datasets}):
            rows = [i for i, frame in enumerate(frames) if dataset in frame.datasets]
            found: list[Found] = [[] for _ in rows]
            for m, judge in enumerate(self.judges):
                some = [j for j, each in enumerate(found) if not m or _lacks(each, judge)]
                given = judge.first_looks([frames[rows[j]] for j in some], dataset)
                for j, verdicts in zip(some, given, strict=True):
                    mine = _judged(dataset, verdicts, judge, self._says_who)
                    found[j] = _better(found[j], mine) if m else mine
            for i, each in zip(rows, found, strict=True):
                kept = out[i]
                if isinstance(kept, GraspcastError) or isinstance(each, GraspcastError):
                    out[i] = kept if isinstance(kept, GraspcastError) else each
                else:
                    kept += each
        return out

    def further_look(self, scene: Scene, frame: Frame) -> list[Judged]:
        """Judge a further look at a scene; raise as :meth:`Episodes.look`."""
        datasets = sorted({name for each in (*scene.frames, frame) for name in each.datasets})
        out = []
        for dataset in datasets:
            found: Found = []
            for m, judge in enumerate(self.judges):
                if m and not _lacks(found, judge):
                    continue
                episodes = scene.running.get((m, dataset))
                if episodes is None or episodes.count < scene.count:
                    episodes = scene.running[m, dataset] = judge.replayed(dataset, scene.frames)
                mine = _judged(dataset, judge.look(episodes, frame), judge, self._says_who)
                found = _better(found, mine) if m else mine
            assert isinstance(found, list)
            out += found
        return out

    @property
    def _says_who(self) -> bool:
        return len(self.judges) > 1


def _judged(
    dataset: str, verdicts: list[EpisodeVerdict] | GraspcastError, judge: Judge, says_who: bool
) -> Found:
    if isinstance(verdicts, GraspcastError):
        return verdicts
    if says_who:
        names = ", ".join(judge.forecaster.card.supporters) or "no supporter"
        said = [
            replace(v, verdict=replace(v.verdict, reason=f"{v.verdict.reason}; with {names}"))
            for v in verdicts
        ]
        verdicts = said
    return [Judged(dataset, verdict, judge) for verdict in verdicts]


def _lacks(found: Found, judge: Judge) -> bool:
    """Return whether a further judge may forecast what those before it did not."""
    if isinstance(found, GraspcastError):
        return False
    known = judge.forecaster.card.objects
    return any(
        each.verdict.probability is None and each.verdict.object_name in known for each in found
    )


def _better(found: Found, other: Found) -> Found:
    """Return the verdicts with those of a further judge where only that one has a forecast."""
    if isinstance(found, GraspcastError) or isinstance(other, GraspcastError):
        return found
    # All are of one frame, so object and rank by score are enough.
    forecast = {
        each.verdict.row.key[3:]: each
        for each in other
        if each.verdict.row is not None and each.verdict.probability is not None
    }
    out = []
    for each in found:
        row = each.verdict.row
        better = None if row is None else forecast.get(row.key[3:])
        if better is None or each.verdict.probability is not None:
            out.append(each)
        else:
            number = each.verdict.instance
            out.append(better._replace(verdict=replace(better.verdict, instance=number)))
    return out
