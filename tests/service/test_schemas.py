from __future__ import annotations

import pytest
from pydantic import ValidationError

from graspcast.service.schemas import MOST_ESTIMATES, EstimateIn, FrameIn, OutcomeIn
from stub_watcher import POSE, frame

ESTIMATE = {"object": "ycbv-5", "cam_T_obj": POSE.tolist()}


def test_examples_fit() -> None:
    for schema in (FrameIn, OutcomeIn):
        (example,) = schema.model_json_schema()["examples"]
        schema.model_validate(example)


def test_every_field_of_a_frame_is_described() -> None:
    for schema in (FrameIn, EstimateIn, OutcomeIn):
        for name, field in schema.model_json_schema()["properties"].items():
            assert field.get("description"), name


def test_numbers_of_estimates_are_bounded() -> None:
    FrameIn.model_validate(frame(estimates={"a": MOST_ESTIMATES * [ESTIMATE]}))
    with pytest.raises(ValidationError, match="at most 256"):
        FrameIn.model_validate(frame(estimates={"a": (MOST_ESTIMATES + 1) * [ESTIMATE]}))


@pytest.mark.parametrize("rows", [[], [[1.0]], POSE[:3].tolist(), [[1, 0, 0, "0"]] * 4, None])
def test_poses_are_four_by_four_numbers(rows: object) -> None:
    with pytest.raises(ValidationError):
        EstimateIn.model_validate({**ESTIMATE, "cam_T_obj": rows})


@pytest.mark.parametrize("success", [1, 0, "true", None])
def test_success_is_a_boolean(success: object) -> None:
    with pytest.raises(ValidationError):
        OutcomeIn.model_validate({"decision_id": "a", "success": success})


def test_reasons_are_short() -> None:
    OutcomeIn.model_validate({"decision_id": "a", "success": False, "reason": 500 * "x"})
    with pytest.raises(ValidationError):
        OutcomeIn.model_validate({"decision_id": "a", "success": False, "reason": 501 * "x"})
