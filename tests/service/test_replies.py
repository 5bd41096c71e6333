from __future__ import annotations

import json

from graspcast.errors import InputError
from graspcast.service.replies import PROBLEM, RefusedError, json_reply, problem, problem_of


def test_a_problem_says_what_is_wrong_and_where() -> None:
    reply = RefusedError(422, "no", errors=[("K", "odd")], headers=(("Retry-After", "1"),)).reply()
    assert json.loads(reply.body) == {
        "type": "about:blank",
        "title": "Unprocessable Entity",
        "status": 422,
        "detail": "no",
        "errors": [{"where": "K", "problem": "odd"}],
    }
    assert (b"content-type", PROBLEM.encode()) in reply.raw_headers()
    assert (b"Retry-After", b"1") in reply.raw_headers()


def test_the_librarys_message_is_kept() -> None:
    assert problem_of(InputError("this and that")).detail == "this and that"


def test_texts_are_cut_and_can_be_encoded() -> None:
    detail = json.loads(problem(400, "\ud800" + 5000 * "x").body)["detail"]
    assert detail.startswith("?x")
    assert len(detail) < 2010


def test_a_reply_states_its_length() -> None:
    reply = json_reply({"a": "é"}, told={"frames": 1})
    assert (b"content-length", b"10") in reply.raw_headers()
    assert reply.told == {"frames": 1}
