"""Answers: what to do about every instance in a frame, and by which pose to grasp it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from jaxtyping import Float
from numpy import ndarray

from graspcast.io.wording import counted
from graspcast.views.next_look import NextLook

__all__ = ["ABSTAIN", "ATTEMPT", "LOOK_AGAIN", "Action", "Answer", "Decision"]

Action = Literal["attempt", "look again", "abstain"]
ATTEMPT: Action = "attempt"
LOOK_AGAIN: Action = "look again"
ABSTAIN: Action = "abstain"


@dataclass(frozen=True, eq=False)
class Decision:
    """What to do about one instance.

    Attributes
    ----------
    id
        Unique among all decisions, 32 hexadecimal digits, in the order of time; outcomes name it.
    instance
        A number that stays the same from look to look of an episode; -1 where no estimator has a
        pose of the object that can be.
    object_name
        ``dataset-obj_id``.
    action
        ``attempt``, ``look again`` or ``abstain``.
    probability
        Of success; None where there is no forecast.
    threshold
        The least probability that is attempted; None where there is no forecast.
    guarantee
        What the threshold was certified to keep, in words; None if it was not.
    reason
        Why, in a few words.
    guide
        Whose pose guides the grasp: an estimator, or ``fused``; None without a pose.
    cam_T_obj, world_T_obj
        The object's pose by the guide, in the camera's frame and in the world, metres, (4, 4). None
        without a pose, or where the camera's pose is not known.
    gripper, grasp
        Names of the gripper and of the grasp that was judged.
    cam_T_grasp, world_T_grasp
        Where the gripper goes: the pose of its tool centre point for that grasp, z in the direction
        of approach, x in the direction in which the fingers close, metres, (4, 4). None where the
        grasp's pose on the object is not known.
    next_look
        From where to look again; None unless the action is ``look again``.
    views
        How many looks entered the forecast; 0 without a pose.
    looks
        How many looks the episode has.
    notes
        What was left out or is in doubt, in words.
    """

    id: str
    instance: int
    object_name: str
    action: Action
    probability: float | None
    threshold: float | None
    guarantee: str | None
    reason: str
    guide: str | None
    cam_T_obj: Float[ndarray, "4 4"] | None
    world_T_obj: Float[ndarray, "4 4"] | None
    gripper: str
    grasp: str
    cam_T_grasp: Float[ndarray, "4 4"] | None
    world_T_grasp: Float[ndarray, "4 4"] | None
    next_look: NextLook | None
    views: int
    looks: int
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        known = "" if self.probability is None else f", probability {self.probability:.3f}"
        return f"Decision({self.instance} {self.object_name}: {self.action}{known})"

    @property
    def attempt(self) -> bool:
        """Whether to attempt the grasp."""
        return self.action == ATTEMPT

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON: matrices as lists of rows, None where unknown."""
        out = {name: _plain(value) for name, value in vars(self).items()}
        if (look := self.next_look) is not None:
            out["next_look"] = {name: _plain(value) for name, value in vars(look).items()}
        return out


@dataclass(frozen=True, eq=False)
class Answer:
    """The decisions on one frame.

    Attributes
    ----------
    episode
        The episode's id; a further look at the scene names it.
    look
        Which look of the episode it is, from 1.
    decisions
        One for each instance, ordered by instance.
    notes
        What was left out or could not be checked, in words.
    """

    episode: str
    look: int
    decisions: tuple[Decision, ...]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.decisions)

    def __iter__(self) -> Iterator[Decision]:
        return iter(self.decisions)

    def __repr__(self) -> str:
        said = counted(len(self), "decision")
        return f"Answer({said}, {len(self.attempts)} to attempt, look {self.look})"

    @property
    def attempts(self) -> tuple[Decision, ...]:
        """The decisions to attempt, the most probable first."""
        some = [decision for decision in self.decisions if decision.attempt]
        return tuple(sorted(some, key=lambda d: -(d.probability or 0.0)))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "episode": self.episode,
            "look": self.look,
            "decisions": [decision.as_dict() for decision in self.decisions],
            "notes": list(self.notes),
        }


def _plain(value: Any) -> Any:
    if isinstance(value, ndarray):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value
