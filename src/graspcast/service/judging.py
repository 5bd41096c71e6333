"""Judging: frames to answers and outcomes to the log, in batches; errors become refusals."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import GraspcastError, MismatchError
from graspcast.runtime.frame import Estimate, Frame
from graspcast.service.answers import answer_as_dict
from graspcast.service.metrics import Metrics
from graspcast.service.replies import Reply, json_reply, problem_of
from graspcast.service.schemas import FrameIn, OutcomeIn

if TYPE_CHECKING:
    from graspcast.runtime.answer import Answer
    from graspcast.runtime.watcher import Watcher
    from graspcast.service.batching import Run

__all__ = ["Judging", "frame_of"]

_IDS = frozenset({"episode", "decision_id"})
_WRITERS = 16
_METRES = {"m": 1.0, "mm": 1e-3}


def frame_of(given: FrameIn) -> Frame:
    """Return a frame, in metres, of a request.

    Raises
    ------
    GraspcastError
        As :class:`~graspcast.runtime.frame.Frame` does.
    """
    scale = _METRES[given.length_unit]
    return Frame(
        estimates={
            name: [Estimate(e.object, _pose(e.cam_T_obj, scale), e.score) for e in found]
            for name, found in given.estimates.items()
        },
        world_T_cam=None if given.world_T_cam is None else _pose(given.world_T_cam, scale),
        K=None if given.K is None else np.array(given.K, dtype=np.float64),
        time_s=given.time_s,
        reachable=given.reachable,
    )


def _pose(rows: list[list[float]], scale: float) -> Float[ndarray, "4 4"]:
    a_T_b = np.array(rows, dtype=np.float64)
    if scale != 1.0:
        a_T_b[:3, 3] *= scale
    return a_T_b


class Judging:
    """A watcher's work in batches, as replies.

    Parameters
    ----------
    watcher
        Judges and records.
    metrics
        Where frames, decisions and outcomes are counted.
    """

    def __init__(self, watcher: Watcher, metrics: Metrics):
        self._watcher, self._metrics = watcher, metrics
        self._writers = ThreadPoolExecutor(_WRITERS, "graspcast-outcomes")

    @property
    def runs(self) -> dict[str, Run]:
        """The kinds of work, for a batcher."""
        return {
            "frame": self._frames,
            "look": self._looks,
            "forget": self._forget,
            "outcome": self._outcomes,
        }

    def _frames(self, frames: Sequence[Frame]) -> list[Reply | Exception]:
        """Judge the first looks at several scenes, and record them together."""
        answers = self._watcher.judge_all(frames)
        self._metrics.judged(len(frames))
        return [self._reply(answer) for answer in answers]

    def _looks(self, looks: Sequence[tuple[str, Frame]]) -> list[Reply | Exception]:
        """Take further looks, each after the one before."""
        return [_tried(self._look, episode, frame) for episode, frame in looks]

    def _look(self, episode: str, frame: Frame) -> Reply | Exception:
        return self._reply(self._watcher.judge(frame, episode=episode))

    def _forget(self, episodes: Sequence[str]) -> list[Reply | Exception]:
        """Forget episodes."""
        return [_tried(self._forgotten, episode) for episode in episodes]

    def _forgotten(self, episode: str) -> Reply:
        self._watcher.forget(episode)
        return Reply(204, b"")

    def _outcomes(self, outcomes: Sequence[OutcomeIn]) -> list[Reply | Exception]:
        """Record outcomes, each of which is on disk when this returns.

        They are given to the log by several threads, for it commits together what waits together.
        """
        if len(outcomes) == 1:
            return [_tried(self._recorded, outcomes[0])]
        return list(self._writers.map(partial(_tried, self._recorded), outcomes))

    def _recorded(self, outcome: OutcomeIn) -> Reply:
        self._watcher.outcome(outcome.decision_id, outcome.success, outcome.reason)
        self._metrics.recorded(outcome.success)
        return json_reply({**outcome.model_dump(), "recorded": True})

    def _reply(self, answer: Answer | GraspcastError) -> Reply | Exception:
        if isinstance(answer, GraspcastError):
            return problem_of(answer, _status(answer))
        actions = [decision.action for decision in answer.decisions]
        self._metrics.decided(actions)
        told = {"frames": 1, "decisions": len(actions), "attempts": actions.count("attempt")}
        return json_reply(answer_as_dict(answer), told=told)


def _tried(do: Callable[..., Reply | Exception], *arguments: Any) -> Reply | Exception:
    """Return what a call returns, or its refusal."""
    try:
        return do(*arguments)
    except GraspcastError as error:
        return problem_of(error, _status(error))
    except Exception as error:
        return error


def _status(error: GraspcastError) -> int:
    """Return 404 for unknown ids, 409 for contradictions, 503 where the log cannot be written."""
    if isinstance(error.__cause__, sqlite3.Error):
        # The log cannot be written: the disk is full, for example.
        return 503
    if "log" in error.parameters:
        return 409
    if not _IDS.intersection(error.parameters):
        return 422
    return 409 if isinstance(error, MismatchError) else 404
