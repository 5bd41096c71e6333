from __future__ import annotations

import json

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.service.judging import Judging, frame_of
from graspcast.service.metrics import Metrics
from graspcast.service.replies import RefusedError, Reply
from graspcast.service.schemas import FrameIn, OutcomeIn
from stub_watcher import POSE, StubWatcher, frame


def given(name: str = "ycbv-5", **changes: object) -> FrameIn:
    return FrameIn.model_validate(frame(name, **changes))


def test_a_request_becomes_a_frame_in_metres() -> None:
    K = [[600, 0, 320], [0, 600, 240], [0, 0, 1]]
    found = frame_of(
        given(length_unit="mm", world_T_cam=POSE.tolist(), K=K, reachable={"ycbv-5": ["side"]})
    )
    assert found.world_T_cam is not None
    np.testing.assert_allclose(found.world_T_cam[:3, 3], POSE[:3, 3] / 1000)
    np.testing.assert_allclose(found.estimates["dense"][0].cam_T_obj[:3, 3], POSE[:3, 3] / 1000)
    assert found.reachable is not None
    assert list(found.reachable["ycbv-5"]) == ["side"]
    assert found.K is not None
    assert found.K.tolist() == K


def test_the_library_refuses_what_fits_the_schema() -> None:
    with pytest.raises(InputError, match="DATASET-NUMBER"):
        frame_of(given("mug"))
    with pytest.raises(InputError, match="world_T_cam"):
        frame_of(given(world_T_cam=np.ones((4, 4)).tolist()))


def test_each_of_a_batch_has_its_answer() -> None:
    runs = Judging(StubWatcher(), Metrics()).runs  # type: ignore[arg-type]
    first, second = runs["frame"]([frame_of(given()), frame_of(given("bad-1"))])
    assert isinstance(first, Reply)
    assert json.loads(first.body)["decisions"][0]["object"] == "ycbv-5"
    assert isinstance(second, RefusedError)
    assert (second.status, second.detail) == (422, "bad")


def test_unknown_episodes_are_not_found() -> None:
    runs = Judging(StubWatcher(), Metrics()).runs  # type: ignore[arg-type]
    (started,) = runs["frame"]([frame_of(given())])
    episode = json.loads(started.body)["episode"]
    known, unknown = runs["look"]([(episode, frame_of(given())), ("no", frame_of(given()))])
    assert known.status == 200
    assert (unknown.status, "unknown episode" in unknown.detail) == (404, True)
    known, unknown = runs["forget"]([episode, "no"])
    assert (known.status, unknown.status) == (204, 404)


def test_outcomes_are_recorded_one_by_one() -> None:
    watcher = StubWatcher()
    runs = Judging(watcher, Metrics()).runs  # type: ignore[arg-type]
    outcomes = [OutcomeIn(decision_id=str(i), success=i > 0, reason="slip") for i in range(2)]
    replies = runs["outcome"](outcomes)
    assert [json.loads(r.body)["recorded"] for r in replies] == [True, True]
    assert watcher.outcomes == {"0": False, "1": True}
