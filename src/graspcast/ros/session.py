"""Session of the node: models, log and judging by its parameters, and what it says of itself."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.log_monitor import LogMonitor
from graspcast.io.wording import counted
from graspcast.ros.diagnostics import Status, diagnostic_array, judging_status, monitor_status
from graspcast.ros.judging import StreamJudge
from graspcast.ros.outgoing import Maker
from graspcast.ros.parameters import NodeSettings
from graspcast.ros.poses import Stamp
from graspcast.runtime.watcher import Watcher

__all__ = ["Session"]


class Session:
    """What the node holds between its configuration and its clean-up.

    Parameters
    ----------
    given
        What the node's parameters say.

    Attributes
    ----------
    judge
        Judges messages.

    Raises
    ------
    GraspcastError
        For models, certificates, estimators, objects or a log that do not serve; the message says
        which and why.
    """

    def __init__(self, given: NodeSettings):
        self._given = given
        self._counts: dict[str, int] = {}
        with ExitStack() as stack:
            log = None
            if given.attempt_log is not None:
                from graspcast.attempt_log.log import AttemptLog

                log = stack.enter_context(AttemptLog.open(given.attempt_log))
            certificates = [Certificate.load(path) for path in given.certificates]
            self._watcher = Watcher.load(
                *given.models,
                certificate=certificates or None,
                log=log,
                source="node",
                **given.options,
            )
            self._watcher.warm_up()
            self.judge = StreamJudge(self._watcher, given.settings, tuple(given.topics))
            followed = certificates if log is not None else []
            self._log, self._monitors = log, [LogMonitor.of(each) for each in followed]
            self._open = stack.pop_all()

    def close(self) -> None:
        """Close the log."""
        self._open.close()

    def summary(self) -> str:
        """Say in one line what is judged, in which frame, and who sends."""
        settings = self.judge.settings
        world = f", world frame {settings.world_frame}" if settings.world_frame else ""
        topics = ", ".join(f"{name} on {topic}" for name, topic in self._given.topics.items())
        objects = counted(len(self.judge.objects), "object")
        return f"{topics}: {objects}, camera frame {settings.camera_frame}{world}"

    def outcome(self, message: Any) -> None:
        """Log a ``graspcast_msgs/Outcome``.

        Raises
        ------
        GraspcastError
            For a decision that the log does not have, a contradiction, or no log.
        """
        self._watcher.outcome(message.decision, bool(message.success), message.reason or None)

    def diagnostics(self, make: Maker, now: Stamp, node: str) -> Any:
        """Return a ``diagnostic_msgs/DiagnosticArray`` of what happened since the last one."""
        return diagnostic_array(make, self.statuses(), now, node)

    def statuses(self) -> list[Status]:
        """Return the states of the parts, of what happened since they were last asked for."""
        status = judging_status(self.judge, self._counts)
        self._counts = self.judge.problems.counts()
        return [status, *self._monitored()]

    def _monitored(self) -> list[Status]:
        """Return what the monitors of the log say, after the outcomes that came since."""
        if self._log is None:
            return []
        found = [monitor.update(self._log) for monitor in self._monitors]
        return [monitor_status(status.alarm, status.message) for status in found]
