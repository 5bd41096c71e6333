"""Answers and their decisions."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from graspcast.runtime.answer import Answer, Decision
from graspcast.views.next_look import NextLook

X = np.array([1.0, 0, 0])


def decision(**given: Any) -> Decision:
    usual: dict[str, Any] = {
        "id": "0" * 32,
        "instance": 0,
        "object_name": "ycbv-5",
        "action": "attempt",
        "probability": 0.75,
        "threshold": 0.5,
        "guarantee": None,
        "reason": "probability 0.750 >= 0.5",
        "guide": "epos",
        "cam_T_obj": np.eye(4),
        "world_T_obj": None,
        "gripper": "parallel",
        "grasp": "reference",
        "cam_T_grasp": None,
        "world_T_grasp": None,
        "next_look": None,
        "views": 1,
        "looks": 1,
    }
    return Decision(**usual | given)


def test_attempts_come_the_most_probable_first() -> None:
    some = [decision(probability=p, action=a) for p, a in ((0.6, "attempt"), (0.9, "attempt"))]
    answer = Answer("e", 1, (*some, decision(action="abstain")))
    assert [d.probability for d in answer.attempts] == [0.9, 0.6]
    assert len(answer) == 3 and not list(answer)[2].attempt
    assert repr(answer) == "Answer(3 decisions, 2 to attempt, look 1)"


def test_an_answer_is_plain_values_for_json() -> None:
    again = decision(action="look again", next_look=NextLook(X, None, X, 0.01, 0.5, None))
    content = json.loads(json.dumps(Answer("e", 2, (again,), ("a note",)).as_dict()))
    assert content["episode"] == "e" and content["look"] == 2 and content["notes"] == ["a note"]
    (only,) = content["decisions"]
    assert only["cam_T_obj"] == np.eye(4).tolist() and only["world_T_obj"] is None
    assert only["next_look"]["direction"] == [1.0, 0.0, 0.0]
    assert repr(again) == "Decision(0 ycbv-5: look again, probability 0.750)"
