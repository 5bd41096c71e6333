"""Routes that parse their bodies themselves: documented as FastAPI's, and as fast as it gets.

FastAPI takes 0.1 ms to call a function with a parsed body; a frame is judged in little more.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Coroutine
from functools import cached_property
from typing import Any, get_type_hints

from fastapi import Request, Response
from fastapi.routing import APIRoute
from pydantic import BaseModel

from graspcast.errors import GraspcastError
from graspcast.service.parsing import parsed
from graspcast.service.replies import RefusedError, Reply, problem_of

__all__ = ["ParsedRoute"]


class ParsedRoute(APIRoute):
    """A route whose function takes a parsed body and the path's parameters, and returns a reply."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return what answers FastAPI's requests."""

        async def handle(request: Request) -> Response:
            reply = await self.answer(await request.body(), **request.path_params)
            request.scope.setdefault("state", {})["told"] = reply.told
            headers = dict(reply.headers)
            return Response(reply.body, reply.status, headers, media_type=reply.media_type)

        return handle

    async def answer(self, body: bytes, **parameters: str) -> Reply:
        """Answer a body; a refusal is a reply too."""
        try:
            bodies = {name: parsed(body, schema) for name, schema in self._schemas.items()}
            reply: Reply = await self.endpoint(**bodies, **parameters)
            return reply
        except RefusedError as refusal:
            return refusal.reply()
        except GraspcastError as error:
            return problem_of(error).reply()

    @cached_property
    def _schemas(self) -> dict[str, type[BaseModel]]:
        """The parameter that takes the body, and its schema, if there is one."""
        kinds = get_type_hints(self.endpoint).items()
        return {n: k for n, k in kinds if inspect.isclass(k) and issubclass(k, BaseModel)}
