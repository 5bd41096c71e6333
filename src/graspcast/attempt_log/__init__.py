"""The attempt log: every decision and its outcome, in one append-only file."""

from graspcast.attempt_log.log import AttemptLog
from graspcast.attempt_log.records import DecisionRecord, FrameRecord, OutcomeRecord
from graspcast.attempt_log.tables import Wanted

__all__ = ["AttemptLog", "DecisionRecord", "FrameRecord", "OutcomeRecord", "Wanted"]
