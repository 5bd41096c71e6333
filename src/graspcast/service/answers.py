"""Answers: verdicts as JSON, and the schemas of all that the service answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from pydantic import BaseModel, ConfigDict, Field

from graspcast.pose.transforms import quaternion

if TYPE_CHECKING:
    from graspcast.runtime.answer import Answer, Decision
    from graspcast.views.next_look import NextLook

__all__ = [
    "AnswerOut",
    "DecisionOut",
    "HealthOut",
    "ModelsOut",
    "MonitorOut",
    "NextLookOut",
    "PoseOut",
    "ProblemOut",
    "RecordedOut",
    "answer_as_dict",
]

Matrix = list[list[float]]
Vector = list[float]


class _Out(BaseModel):
    model_config = ConfigDict(extra="forbid")


class PoseOut(_Out):
    """A pose, in metres, as a matrix and as translation and quaternion."""

    matrix: Annotated[Matrix, Field(description="4 x 4, row by row.")]
    translation_m: Vector
    quaternion_wxyz: Annotated[Vector, Field(description="Of unit length, w >= 0.")]


class NextLookOut(_Out):
    """From where to look next."""

    direction: Annotated[
        Vector,
        Field(description="From the object to the camera, a unit vector in the camera's frame."),
    ]
    direction_world: Annotated[
        Vector | None, Field(description="The same in the world's frame, if that is known.")
    ]
    axis: Annotated[
        Vector, Field(description="Where the position is known worst; the camera's frame.")
    ]
    axis_sd_m: Annotated[float, Field(description="Standard deviation along that axis, metres.")]
    angle_rad: Annotated[float, Field(description="From the present viewing direction.")]
    expected_probability: Annotated[
        float | None, Field(description="Of success after that look, if it is forecast.")
    ]
    advice: Annotated[str, Field(description="The same in words.")]


class DecisionOut(_Out):
    """The decision on one instance."""

    id: Annotated[str, Field(description="By which the outcome is reported.")]
    instance: Annotated[int, Field(description="The same from look to look of an episode.")]
    object: str
    action: Literal["attempt", "look again", "abstain"]
    probability: Annotated[
        float | None, Field(description="Of success; null where there is no forecast.")
    ]
    threshold: Annotated[float | None, Field(description="Attempts are made at this or above.")]
    guarantee: Annotated[str | None, Field(description="What the threshold was certified for.")]
    reason: str
    guide: Annotated[str | None, Field(description="Whose pose guides the grasp.")]
    cam_T_obj: PoseOut | None
    world_T_obj: PoseOut | None
    gripper: str | None
    grasp: Annotated[str | None, Field(description="The grasp's name.")]
    cam_T_grasp: Annotated[PoseOut | None, Field(description="The gripper's pose.")]
    world_T_grasp: PoseOut | None
    next_look: NextLookOut | None
    views: Annotated[int, Field(description="Looks that entered.")]
    looks: Annotated[int, Field(description="Looks so far.")]
    notes: list[str]


class AnswerOut(_Out):
    """The decisions on all instances after a look."""

    episode: Annotated[str, Field(description="Further looks at the same scene name it.")]
    look: Annotated[int, Field(description="Number of this look, from 1.")]
    length_unit: Annotated[Literal["m"], Field(description="Of all lengths in this answer.")]
    camera_frame: Literal["opencv"]
    decisions: list[DecisionOut]
    notes: list[str]


class RecordedOut(_Out):
    """An outcome that is on disk."""

    decision_id: str
    success: bool
    reason: str | None
    recorded: Literal[True]


class HealthOut(_Out):
    """Whether the service runs, and whether it answers without delay."""

    live: Literal[True]
    ready: Annotated[
        bool, Field(description="False while code is compiled: frames are answered, but later.")
    ]
    version: str


class ErrorOut(_Out):
    """A place in the request, and what is wrong there."""

    where: str
    problem: str


class ProblemOut(_Out):
    """What is wrong with a request (RFC 9457)."""

    type: str
    title: str
    status: int
    detail: Annotated[str, Field(description="What is wrong, and what to do.")]
    errors: list[ErrorOut]


class ModelOut(_Out):
    """A model that judges, and by which policy."""

    digest: Annotated[str, Field(description="By which certificates and the log name it.")]
    principal: Annotated[str, Field(description="The estimator that guides by default.")]
    supporters: list[str]
    gripper: str
    objects: Annotated[dict[str, list[str]], Field(description="Names of each object's grasps.")]
    method: str
    views: Annotated[bool, Field(description="Whether it was trained on several views.")]
    samples: Annotated[int, Field(description="Outcomes that it was trained on.")]
    success_rate: Annotated[float, Field(description="Of these.")]
    warnings: Annotated[list[str], Field(description="What limits its use.")]
    threshold: Annotated[
        float | None, Field(description="Attempts are made at this or above; null: never.")
    ]
    guarantee: Annotated[str | None, Field(description="What a certificate guarantees.")]
    guide: Annotated[str, Field(description="An estimator, `fused` or `best`.")]
    max_looks: int


class ModelsOut(_Out):
    """What judges: further models serve where the one before lacks an estimator."""

    models: list[ModelOut]
    estimators: Annotated[list[str], Field(description="That frames may name.")]
    records: Annotated[bool, Field(description="Whether there is a log, which takes outcomes.")]


class MonitorOut(_Out):
    """Whether the guaranteed success rate still holds."""

    scope: str
    alarm: Annotated[bool, Field(description="It no longer holds.")]
    alarm_at: Annotated[int | None, Field(description="The attempt after which it was raised.")]
    e_value: Annotated[float, Field(description="Evidence against the rate.")]
    max_e_value: Annotated[float, Field(description="The alarm is raised at 1 / alpha.")]
    attempts: int
    successes: int
    waiting: Annotated[int, Field(description="Outcomes of episodes that are not complete.")]
    rate: Annotated[float, Field(description="That is guaranteed.")]
    alpha: Annotated[float, Field(description="Probability of ever raising a false alarm.")]
    outcomes_read: int
    left_out: Annotated[dict[str, int], Field(description="Why outcomes did not count.")]
    message: Annotated[str, Field(description="The same in words.")]


def answer_as_dict(answer: Answer) -> dict[str, Any]:
    """Return an answer as plain values, as :class:`AnswerOut` describes them."""
    return {
        "episode": answer.episode,
        "look": answer.look,
        "length_unit": "m",
        "camera_frame": "opencv",
        "decisions": [_decision(decision) for decision in answer.decisions],
        "notes": list(answer.notes),
    }


def _decision(decision: Decision) -> dict[str, Any]:
    cam_T_obj, world_T_obj, cam_T_grasp, world_T_grasp = _poses(
        decision.cam_T_obj, decision.world_T_obj, decision.cam_T_grasp, decision.world_T_grasp
    )
    return {
        "id": decision.id,
        "instance": decision.instance,
        "object": decision.object_name,
        "action": decision.action,
        "probability": _number(decision.probability),
        "threshold": _number(decision.threshold),
        "guarantee": decision.guarantee,
        "reason": decision.reason,
        "guide": decision.guide,
        "cam_T_obj": cam_T_obj,
        "world_T_obj": world_T_obj,
        "gripper": decision.gripper,
        "grasp": decision.grasp,
        "cam_T_grasp": cam_T_grasp,
        "world_T_grasp": world_T_grasp,
        "next_look": _next_look(decision.next_look),
        "views": decision.views,
        "looks": decision.looks,
        "notes": list(decision.notes),
    }


def _number(value: float | None) -> float | None:
    return None if value is None else float(value)


def _poses(*poses: Float[ndarray, "4 4"] | None) -> list[dict[str, Any] | None]:
    """Return each pose as :class:`PoseOut` describes it, None where it is not known."""
    known = [a_T_b for a_T_b in poses if a_T_b is not None]
    if not known:
        return [None for _ in poses]
    stacked = np.array(known)
    matrices, turned = stacked.tolist(), quaternion(stacked[:, :3, :3]).tolist()
    told = iter(
        {"matrix": m, "translation_m": [row[3] for row in m[:3]], "quaternion_wxyz": q}
        for m, q in zip(matrices, turned, strict=True)
    )
    return [None if a_T_b is None else next(told) for a_T_b in poses]


def _next_look(look: NextLook | None) -> dict[str, Any] | None:
    if look is None:
        return None
    world = look.direction_world
    return {
        "direction": look.direction.tolist(),
        "direction_world": None if world is None else world.tolist(),
        "axis": look.axis.tolist(),
        "axis_sd_m": float(look.axis_sd_m),
        "angle_rad": float(look.angle_rad),
        "expected_probability": _number(look.expected_probability),
        "advice": str(look),
    }
