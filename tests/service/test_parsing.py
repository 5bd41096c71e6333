from __future__ import annotations

import json

import pytest

from graspcast.service.parsing import parsed
from graspcast.service.replies import RefusedError
from graspcast.service.schemas import FrameIn, OutcomeIn
from stub_watcher import frame


def refusal(body: bytes, schema: type = FrameIn) -> RefusedError:
    with pytest.raises(RefusedError) as caught:
        parsed(body, schema)
    return caught.value


def test_a_frame_is_parsed() -> None:
    found = parsed(json.dumps(frame(time_s=3)).encode(), FrameIn)
    assert found.estimates["dense"][0].cam_T_obj[2] == [0, 0, 1, 0.7]
    assert (found.time_s, found.world_T_cam, found.reachable) == (3, None, None)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"", "not JSON"),
        (b"{", "not JSON"),
        (b"\xff\xfe{}", "not UTF-8"),
        (b'\xef\xbb\xbf{"a": 1}', "not JSON"),
        (b"[" * 500_000, "nested too deeply"),
        (b'{"a":' * 200_000, "nested too deeply"),
        (b'{"length_unit": NaN}', "NaN is no number"),
        (b'{"length_unit": -Infinity}', "-Infinity is no number"),
        (b'{"length_unit": "m", "length_unit": "mm"}', "'length_unit' comes twice"),
        (b"9" * 100_000, "not JSON"),
    ],
)
def test_what_is_no_json_is_refused(body: bytes, message: str) -> None:
    found = refusal(body)
    assert found.status == 400
    assert message in found.detail


@pytest.mark.parametrize("value", ["1e999", "1" + 400 * "0", "true", '"0.5"', "[0.5]", "-1e10"])
def test_scores_are_finite_numbers(value: str) -> None:
    body = json.dumps(frame()).replace('"score": 0.9', f'"score": {value}').encode()
    found = refusal(body)
    assert found.status == 422
    assert found.errors[0][0] == "estimates.dense.0.score"


@pytest.mark.parametrize("name", ["length_unit", "camera_frame", "estimates"])
def test_units_and_frames_are_not_assumed(name: str) -> None:
    content = frame()
    del content[name]
    found = refusal(json.dumps(content).encode())
    assert (found.status, found.errors) == (422, [(name, "Field required")])


def test_unknown_fields_units_and_frames_are_refused() -> None:
    for changes, place in (
        ({"unit": "m"}, "unit"),
        ({"length_unit": "cm"}, "length_unit"),
        ({"camera_frame": "opengl"}, "camera_frame"),
        ({"K": [[1, 0, 0]]}, "K"),
        ({"world_T_cam": [[1, 0, 0, 0]] * 3}, "world_T_cam"),
        ({"estimates": {"x" * 101: []}}, "estimates." + "x" * 60 + ".[key]"),
        ({"estimates": {f"e{i}": [] for i in range(17)}}, "estimates"),
    ):
        found = refusal(json.dumps(frame(**changes)).encode())
        assert (found.status, found.errors[0][0]) == (422, place), changes


def test_many_errors_are_counted_and_not_all_told() -> None:
    found = refusal(json.dumps(frame(**{f"x{i}": 0 for i in range(1000)})).encode())
    assert len(found.errors) == 10
    assert "and 990 more" in found.detail


def test_a_lone_surrogate_is_refused() -> None:
    found = refusal(b'{"decision_id": "\\ud800", "success": true}', OutcomeIn)
    assert found.status == 422


def test_a_lone_surrogate_in_a_name_does_not_break_the_answer() -> None:
    found = refusal(b'{"decision_id": "a", "success": true, "\\ud800": 1}', OutcomeIn)
    assert found.reply().status == 422
