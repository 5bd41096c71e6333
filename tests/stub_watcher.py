"""A watcher that knows nothing, for tests of what lies around it."""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Sequence
from itertools import count
from threading import Lock
from types import SimpleNamespace
from typing import Any

import numpy as np

from graspcast.errors import GraspcastError, InputError, UnknownNameError

logger = logging.getLogger("graspcast.service.stub")
POSE = np.eye(4)
POSE[:3, 3] = 0.1, -0.2, 0.7


class StubWatcher:
    """Attempts everything; what it is asked can be made slow, or fail, by the object's name."""

    def __init__(self, *, seconds: float = 0.0, outcomes_to: str | None = None):
        self.seconds, self.outcomes_to = seconds, outcomes_to
        self.batches: list[int] = []
        self.outcomes: dict[str, bool] = {}
        self.known: list[str] = []
        self.warm = False
        self._numbers, self._lock = count(1), Lock()

    episodes = 0
    records = True
    forecasters: tuple[Any, ...] = ()
    policies: tuple[Any, ...] = ()
    estimators = "dense", "direct", "keypoints"

    def warm_up(self) -> None:
        self.warm = True

    def judge_all(self, frames: Sequence[Any]) -> list[Any]:
        logger.info("batch", extra={"fields": {"frames": len(frames)}})
        time.sleep(self.seconds)
        self.batches.append(len(frames))
        names = [[e.object_name for found in f.estimates.values() for e in found] for f in frames]
        if any("bug-1" in found for found in names):
            raise RuntimeError("a fault")
        return [InputError("bad") if "bad-1" in n else self._answer(n) for n in names]

    def judge(self, frame: Any, episode: str | None = None) -> Any:
        self.forget(episode)
        answer = self.judge_all([frame])[0]
        if isinstance(answer, GraspcastError):
            raise answer
        return answer

    def forget(self, episode: str | None) -> None:
        if episode not in self.known:
            raise UnknownNameError("episode", episode, self.known, parameters=("episode",))

    def outcome(self, decision_id: str, success: bool, reason: str | None = None) -> None:
        time.sleep(self.seconds)
        with self._lock:
            self.outcomes[decision_id] = success

    def _answer(self, names: Sequence[str]) -> Any:
        number = next(self._numbers)
        self.known.append(str(number))
        decisions = [
            SimpleNamespace(
                id=f"{number}-{i}", instance=i, object_name=name, action="attempt",
                probability=0.9, threshold=0.8, guarantee=None, reason="probable", guide="dense",
                cam_T_obj=POSE, world_T_obj=None, gripper="parallel", grasp="reference",
                cam_T_grasp=POSE, world_T_grasp=None, next_look=None, views=1, looks=1, notes=(),
            )
            for i, name in enumerate(sorted(set(names)))
        ]  # fmt: skip
        return SimpleNamespace(episode=str(number), look=1, decisions=decisions, notes=())


def frame(name: str = "ycbv-5", **changes: Any) -> dict[str, Any]:
    """Return a request for verdicts, of one object seen by three estimators."""
    found = [{"object": name, "cam_T_obj": POSE.tolist(), "score": 0.9}]
    estimates = dict.fromkeys(("dense", "direct", "keypoints"), found)
    return {"length_unit": "m", "camera_frame": "opencv", "estimates": estimates} | changes


def main(seconds: str, **limits: float) -> None:
    """Serve on a free port, which is printed in the log: for tests that need a process."""
    from graspcast.service.access import token_from
    from graspcast.service.limits import Limits
    from graspcast.service.logs import log_to
    from graspcast.service.server import listen, serve

    log_to()
    token = token_from()
    with listen("127.0.0.1", 0, token) as listener:
        watcher: Any = StubWatcher(seconds=float(seconds))
        serve(watcher, listener, token=token, limits=Limits(**limits))  # type: ignore[arg-type]


if __name__ == "__main__":
    pairs = [text.split("=") for text in sys.argv[2:]]
    main(sys.argv[1], **{name: json.loads(value) for name, value in pairs})
