"""Schemas of requests: units are stated, numbers are finite, and unknown fields are refused."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import Len
from pydantic import BaseModel, ConfigDict, Field

__all__ = ["EstimateIn", "FrameIn", "OutcomeIn"]

MOST_ESTIMATORS = 16
MOST_ESTIMATES = 256
"""Of one estimator in one frame."""
MOST_NAME = 100
MOST_REASON = 500

Name = Annotated[str, Field(min_length=1, max_length=MOST_NAME)]
Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e9, le=1e9)]
Row4 = Annotated[list[Number], Len(4, 4)]
Pose = Annotated[list[Row4], Len(4, 4)]
Row3 = Annotated[list[Number], Len(3, 3)]
Intrinsics = Annotated[list[Row3], Len(3, 3)]

_POSE = [[1.0, 0.0, 0.0, 0.02], [0.0, 1.0, 0.0, -0.01], [0.0, 0.0, 1.0, 0.7], [0.0, 0.0, 0.0, 1.0]]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class EstimateIn(_Strict):
    """One pose that one estimator found."""

    object: Annotated[Name, Field(description="The object's name, `dataset-number`: `ycbv-5`.")]
    cam_T_obj: Annotated[
        Pose,
        Field(
            description="4 x 4 transform, row by row, that maps points of the object's frame into "
            "the camera's; the translation in `length_unit`."
        ),
    ]
    score: Annotated[Number, Field(description="The estimator's own confidence.")] = 1.0


_ESTIMATES: dict[str, Any] = {
    name: [{"object": "ycbv-5", "cam_T_obj": _POSE, "score": 0.9}]
    for name in ("dense", "direct", "keypoints")
}


class FrameIn(_Strict):
    """All that the estimators found in one image."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        json_schema_extra={
            "examples": [
                {"length_unit": "m", "camera_frame": "opencv", "estimates": _ESTIMATES},
            ]
        },
    )

    length_unit: Annotated[
        Literal["m", "mm"], Field(description="Of all translations in this request.")
    ]
    camera_frame: Annotated[
        Literal["opencv"],
        Field(description="The camera's axes; `opencv`: x right, y down, z forward."),
    ]
    estimates: Annotated[
        dict[Name, Annotated[list[EstimateIn], Len(0, MOST_ESTIMATES)]],
        Field(
            max_length=MOST_ESTIMATORS,
            description="Estimator's name to all that it found, in any order; an estimator that "
            "found nothing has an empty list or is left out.",
        ),
    ]
    world_T_cam: Annotated[
        Pose | None,
        Field(
            description="The camera's pose in the world, 4 x 4, if it is known; further looks "
            "need it."
        ),
    ] = None
    K: Annotated[
        Intrinsics | None, Field(description="The camera's intrinsics, 3 x 3, pixels.")
    ] = None
    time_s: Annotated[
        Number | None, Field(description="When the image was taken, seconds, by any clock.")
    ] = None
    reachable: Annotated[
        dict[Name, Annotated[list[Name], Len(0, MOST_ESTIMATES)]] | None,
        Field(
            description="Object's name to the names of the grasps that the robot can reach; all "
            "grasps of objects that are not named."
        ),
    ] = None


class OutcomeIn(_Strict):
    """What became of an attempted grasp."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        json_schema_extra={
            "examples": [{"decision_id": "0123456789abcdef-1", "success": False, "reason": "slip"}]
        },
    )

    decision_id: Annotated[Name, Field(description="The `id` of a decision of this service.")]
    success: Annotated[bool, Field(description="Whether the object was grasped and held.")]
    reason: Annotated[
        Annotated[str, Field(max_length=MOST_REASON)] | None,
        Field(description="Why, in words of your own."),
    ] = None
