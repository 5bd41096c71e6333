from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from graspcast.service.answers import AnswerOut, answer_as_dict
from graspcast.service.replies import json_reply
from graspcast.views.next_look import NextLook
from stub_watcher import POSE, StubWatcher


def answer(**changes: object) -> SimpleNamespace:
    given = StubWatcher()._answer(["ycbv-5"])
    vars(given.decisions[0]).update(changes)
    return given


def through_json(given: SimpleNamespace) -> AnswerOut:
    content = json_reply(answer_as_dict(given)).body  # type: ignore[arg-type]
    return AnswerOut.model_validate_json(content, strict=True)


def test_a_decision_is_told_whole() -> None:
    turned = POSE.copy()
    turned[:3, :3] = np.diag([1, -1, -1])
    (decision,) = through_json(answer(world_T_obj=turned, notes=("a",))).decisions
    assert decision.world_T_obj is not None
    assert decision.world_T_obj.matrix == turned.tolist()
    assert decision.world_T_obj.quaternion_wxyz == [0, 1, 0, 0]
    assert (decision.object, decision.probability, decision.notes) == ("ycbv-5", 0.9, ["a"])


def test_what_is_not_known_is_null() -> None:
    nothing = dict.fromkeys(
        ("probability", "threshold", "guide", "cam_T_obj", "world_T_obj", "cam_T_grasp")
    )
    (decision,) = through_json(answer(action="abstain", **nothing)).decisions
    assert decision.probability is decision.cam_T_obj is decision.next_look is None


def test_the_next_look_is_told() -> None:
    x, y = np.eye(3)[:2]
    look = NextLook(x, None, y, 0.01, 0.5, np.float64(0.7))
    (decision,) = through_json(answer(action="look again", next_look=look)).decisions
    assert decision.next_look is not None
    assert decision.next_look.direction == [1, 0, 0]
    assert decision.next_look.direction_world is None
    assert decision.next_look.expected_probability == 0.7
    assert "degrees to the side" in decision.next_look.advice
