from __future__ import annotations

import asyncio

import httpx
from fastapi import FastAPI

from graspcast.errors import InputError
from graspcast.service.replies import RefusedError, Reply, json_reply
from graspcast.service.routes import ParsedRoute
from graspcast.service.schemas import OutcomeIn

OUTCOME = b'{"decision_id": "a", "success": true}'


def application() -> FastAPI:
    app = FastAPI()
    app.router.route_class = ParsedRoute

    @app.post("/echo/{name}", response_model=None)
    async def echo(name: str, outcome: OutcomeIn) -> Reply:
        if name == "refused":
            raise RefusedError(409, "no", headers=(("Retry-After", "3"),))
        if name == "wrong":
            raise InputError("the library's words")
        return json_reply({"name": name, **outcome.model_dump()})

    return app


def test_a_route_takes_path_and_body() -> None:
    async def ask(name: str, content: bytes = OUTCOME) -> httpx.Response:
        transport = httpx.ASGITransport(application())
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.post(f"/echo/{name}", content=content)

    taken = asyncio.run(ask("x"))
    assert taken.json() == {"name": "x", "decision_id": "a", "success": True, "reason": None}
    assert asyncio.run(ask("x", b"{")).status_code == 400
    refused = asyncio.run(ask("refused"))
    assert (refused.status_code, refused.headers["retry-after"]) == (409, "3")
    wrong = asyncio.run(ask("wrong"))
    assert (wrong.status_code, wrong.json()["detail"]) == (422, "the library's words")


def test_it_can_be_asked_without_the_framework() -> None:
    route = next(r for r in application().routes if isinstance(r, ParsedRoute))
    reply = asyncio.run(route.answer(OUTCOME, name="x"))
    assert (reply.status, b'"name":"x"' in reply.body) == (200, True)
