"""Logged attempts: which outcomes in an attempt log a guarantee is about, and why others not."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from graspcast.guarantees.certificate import OVERALL, Certificate

__all__ = ["LoggedOutcome", "Scope", "attempted_instances", "outcomes_after"]

_TOLERANCE = 1e-9
_DECISION = (
    "f.episode, d.instance, d.object_name, d.action, d.probability, d.threshold, d.model, d.guide, "
    "d.gripper, d.grasp"
)


@dataclass(frozen=True)
class LoggedDecision:
    """A decision, as far as it matters to a guarantee."""

    episode: str
    instance: int
    object_name: str
    action: str
    probability: float | None
    threshold: float | None
    model: str | None
    guide: str | None
    gripper: str
    grasp: str


@dataclass(frozen=True)
class LoggedOutcome:
    """An outcome, with its decision.

    Attributes
    ----------
    seq
        The outcome's number.
    chain
        The log's chain after it.
    decisions
        The last decision that was there when it came.
    success
        Whether the grasp held.
    decision
        What was decided.
    """

    seq: int
    chain: bytes
    decisions: int
    success: bool
    decision: LoggedDecision


@dataclass(frozen=True)
class Scope:
    """What a guarantee is about.

    Attributes
    ----------
    threshold
        The certified one.
    object_name
        The one object, or None for all.
    model
        Digest of the certified model, or None if it is not stated.
    guides, grippers, grasps, datasets
        Names, or None if not stated.
    looks
        Whether the policy looks again, so that its threshold decides after which look it attempts.
    """

    threshold: float
    object_name: str | None
    model: str | None
    guides: Collection[str] | None
    grippers: Collection[str] | None
    grasps: Collection[str] | None
    datasets: Collection[str] | None
    looks: bool

    @classmethod
    def of(cls, certificate: Certificate, scope: str) -> Scope:
        """Return what one of a certificate's guarantees is about; it has a threshold."""
        threshold = certificate.of(scope).threshold
        assert threshold is not None
        policy, stated = certificate.policy, certificate.provenance
        return cls(
            threshold,
            None if scope == OVERALL else scope,
            stated.get("model"),
            _names(stated.get("guides", stated.get("principal"))),
            _names(stated.get("gripper")),
            _names(stated.get("grasp")),
            _names(stated.get("datasets")),
            policy is not None and policy.max_looks > 1,
        )

    def why_not(self, decision: LoggedDecision) -> str:
        """Say why an attempt does not belong to the guarantee; empty if it does."""
        d = decision
        if self.object_name not in (None, d.object_name):
            return "another object"
        if d.action != "attempt":
            return "tried in spite of the decision"
        if self.model not in (None, d.model):
            return "another model"
        for what, found, known in (
            ("guide", d.guide, self.guides),
            ("gripper", d.gripper, self.grippers),
            ("grasp", d.grasp, self.grasps),
            ("dataset", d.object_name.rpartition("-")[0], self.datasets),
        ):
            if known is not None and found not in known:
                return f"another {what}"
        if d.probability is None or d.threshold is None:
            return "no forecast"
        above = d.threshold > self.threshold + _TOLERANCE
        below = d.threshold < self.threshold - _TOLERANCE
        if above or (below and self.looks):
            return "another threshold"
        return "below the certified threshold" if d.probability < self.threshold else ""


def outcomes_after(connection: sqlite3.Connection, after: int) -> list[LoggedOutcome]:
    """Return the outcomes whose sequence number is larger, with their decisions, in order."""
    rows = connection.execute(
        f"SELECT o.seq, o.chain, o.decisions, o.success, {_DECISION} FROM outcome o "
        "JOIN decision d ON d.seq = o.decision JOIN frame f ON f.seq = d.frame "
        "WHERE o.seq > ? ORDER BY o.seq",
        (after,),
    )
    return [
        LoggedOutcome(seq, chain, there, bool(success), LoggedDecision(*decision))
        for seq, chain, there, success, *decision in rows
    ]


def attempted_instances(
    connection: sqlite3.Connection, scope: Scope, episode: str, until: int
) -> set[int]:
    """Return the instances of an episode that the guarantee's attempts are of.

    Parameters
    ----------
    connection
        To the log.
    scope
        Of the guarantee.
    episode
        Its id.
    until
        The last decision to consider.
    """
    rows = connection.execute(
        f"SELECT {_DECISION} FROM frame f JOIN decision d ON d.frame = f.seq "
        "WHERE f.episode = ? AND d.seq <= ?",
        (episode, until),
    )
    found = [LoggedDecision(*row) for row in rows]
    return {decision.instance for decision in found if not scope.why_not(decision)}


def _names(stated: Any) -> frozenset[str] | None:
    if stated is None:
        return None
    return frozenset([stated] if isinstance(stated, str) else stated)
