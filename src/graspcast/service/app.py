"""The application: every route of the service, with its documentation."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import Depends, FastAPI, Path, Request, Response
from fastapi.security import HTTPBearer
from starlette.exceptions import HTTPException

from graspcast._version import __version__
from graspcast.service.access import Access
from graspcast.service.answers import (
    AnswerOut,
    HealthOut,
    ModelsOut,
    MonitorOut,
    ProblemOut,
    RecordedOut,
)
from graspcast.service.batching import Batcher
from graspcast.service.edge import Edge
from graspcast.service.judging import Judging, frame_of
from graspcast.service.limits import Limits
from graspcast.service.metrics import METRICS_TYPE, Metrics
from graspcast.service.models import models_of
from graspcast.service.replies import PROBLEM, RefusedError, Reply, json_reply, problem
from graspcast.service.routes import ParsedRoute
from graspcast.service.schemas import MOST_NAME, FrameIn, OutcomeIn

if TYPE_CHECKING:
    from graspcast.guarantees.log_monitor import MonitorStatus
    from graspcast.runtime.watcher import Watcher

    Monitor = Callable[[], MonitorStatus]

__all__ = ["create_app"]

_DESCRIPTION = """\
Several RGB pose estimators look at an object; the service says how likely the grasp that their
poses would guide is to succeed, and whether to attempt it, look again or abstain. Lengths in
requests are in the unit that the request states; answers are in metres. Transforms `a_T_b` are
4 x 4 and map points of frame b into frame a.
"""
_PROBLEMS = {
    400: "Not JSON.",
    401: "The token is missing or wrong.",
    404: "Not known.",
    405: "Not by this method.",
    408: "The body arrived too slowly.",
    409: "Contradicts what is recorded.",
    413: "The body is too large.",
    415: "Not said to be JSON.",
    421: "Another host's name.",
    422: "Does not fit the schema, or cannot be judged; `detail` says why.",
    500: "A fault of the service.",
    503: "Overloaded or stopping: try again after the seconds in the header Retry-After.",
}
_ALWAYS = (401, 421, 500)
_BODY = (*_ALWAYS, 400, 408, 413, 415, 422, 503)
_TOKEN = [Depends(HTTPBearer(auto_error=False))]
"""Documents that a token is needed; the edge checks it."""
_TEXT = {"content": {"text/plain": {"schema": {"type": "string"}}}}
_EpisodeId = Annotated[
    str, Path(description="From the answer to the first look.", max_length=MOST_NAME)
]


def _prepare(watcher: Watcher) -> None:
    """Warm up, and keep what will stay from Python's collector of garbage.

    It otherwise goes through all of it now and then, during which no request is answered (0.13 s).
    """
    watcher.warm_up()
    gc.collect()
    gc.freeze()


def create_app(
    watcher: Watcher,
    *,
    token: str | None = None,
    limits: Limits | None = None,
    monitor: Monitor | None = None,
) -> Edge:
    """Return the service as an ASGI application.

    Parameters
    ----------
    watcher
        Judges; where it has a log, it records.
    token
        The bearer token that clients must show; None for those on this machine alone.
    limits
        How much may be asked.
    monitor
        Reads the log, and says whether the guaranteed success rate still holds.
    """
    limits, metrics = limits or Limits(), Metrics()
    batcher = Batcher(
        Judging(watcher, metrics).runs,
        prepare=lambda: _prepare(watcher),
        batch=limits.batch,
        waiting=limits.waiting,
    )
    metrics.gauge("ready", "1 if frames are answered without delay.", lambda: batcher.ready)
    metrics.gauge("waiting", "Requests that wait.", lambda: batcher.waiting)
    metrics.gauge("episodes", "Episodes that are remembered.", lambda: watcher.episodes)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        batcher.start()
        yield
        await asyncio.to_thread(batcher.close)

    app = FastAPI(
        title="graspcast",
        version=__version__,
        description=_DESCRIPTION,
        lifespan=lifespan,
        # Their pages load programs from the network.
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        separate_input_output_schemas=False,
    )
    app.router.route_class = ParsedRoute
    app.add_exception_handler(HTTPException, _http_problem)
    _add_verdicts(app, watcher, batcher)
    _add_state(app, watcher, batcher)
    _add_watching(app, metrics, monitor)
    _name_problems(app)
    direct = {
        (method, route.path): route.answer
        for route in app.routes
        if isinstance(route, ParsedRoute) and "{" not in route.path
        for method in route.methods or ()
    }
    return Edge(app, access=Access(token), limits=limits, metrics=metrics, direct=direct)


def _add_verdicts(app: FastAPI, watcher: Watcher, batcher: Batcher) -> None:
    """Add the routes that judge, forget and record."""

    @app.post(
        "/frames",
        response_model=AnswerOut,
        responses=_problems(*_BODY),
        dependencies=_TOKEN,
        summary="Judge the first look at a scene",
        tags=["verdicts"],
    )
    async def frames(frame: FrameIn) -> Reply:
        """Start an episode, and return a decision on every instance that was found."""
        reply: Reply = await batcher.do("frame", frame_of(frame))
        return reply

    @app.post(
        "/episodes/{episode}/looks",
        response_model=AnswerOut,
        responses=_problems(*_BODY, 404),
        dependencies=_TOKEN,
        summary="Judge a further look at a scene",
        tags=["verdicts"],
    )
    async def looks(episode: _EpisodeId, frame: FrameIn) -> Reply:
        """Fuse a further look with those before, and return a decision on every instance."""
        reply: Reply = await batcher.do("look", (episode, frame_of(frame)))
        return reply

    @app.delete(
        "/episodes/{episode}",
        status_code=204,
        response_model=None,
        responses=_problems(*_ALWAYS, 404),
        dependencies=_TOKEN,
        summary="Forget an episode",
        tags=["verdicts"],
    )
    async def forget(episode: _EpisodeId) -> Reply:
        """Forget the looks at a scene, as when an object was moved. Decisions stay in the log."""
        reply: Reply = await batcher.do("forget", episode)
        return reply

    @app.post(
        "/outcomes",
        response_model=RecordedOut,
        responses=_problems(*_BODY, 404, 409),
        dependencies=_TOKEN,
        summary="Record what became of an attempt",
        tags=["outcomes"],
    )
    async def outcomes(outcome: OutcomeIn) -> Reply:
        """Record an outcome; when this is answered, it is on disk.

        The same may be sent again. What contradicts an earlier outcome is refused.
        """
        reply: Reply = await batcher.do("outcome", outcome)
        return reply


def _add_state(app: FastAPI, watcher: Watcher, batcher: Batcher) -> None:
    """Add the routes that say what judges, and whether it is ready."""
    models = json_reply(models_of(watcher))

    @app.get(
        "/models",
        response_model=ModelsOut,
        responses=_problems(*_ALWAYS),
        dependencies=_TOKEN,
        summary="What judges, and by which threshold",
        tags=["state"],
    )
    async def cards() -> Reply:
        """Return what the models were trained for, and the policy of verdicts."""
        return models

    def health() -> dict[str, Any]:
        return {"live": True, "ready": batcher.ready, "version": __version__}

    @app.get(
        "/health", response_model=HealthOut, summary="Whether the service runs", tags=["state"]
    )
    async def live() -> Reply:
        """Answer with 200 as long as the service runs; no token is needed."""
        return json_reply(health())

    @app.get(
        "/health/ready",
        response_model=HealthOut,
        responses=_problems(503),
        summary="Whether the service is ready",
        tags=["state"],
    )
    async def ready() -> Reply:
        """Answer with 503 until frames are answered without delay; no token is needed."""
        if not batcher.ready:
            raise RefusedError(503, "code is still being compiled", headers=(("Retry-After", "1"),))
        return json_reply(health())


def _add_watching(app: FastAPI, metrics: Metrics, monitor: Monitor | None) -> None:
    """Add the routes by which the service, and the success of its attempts, are watched."""
    if monitor is not None:
        alarm = "1 if the guaranteed success rate no longer holds."
        metrics.gauge("monitor_alarm", alarm, lambda: monitor().alarm)

    @app.get(
        "/monitor",
        response_model=MonitorOut,
        responses=_problems(*_ALWAYS, 404, 503),
        dependencies=_TOKEN,
        summary="Whether the guaranteed success rate still holds",
        tags=["outcomes"],
    )
    async def alarm_or_not() -> Reply:
        """Read the outcomes that are new in the log, and return the monitor's status."""
        if monitor is None:
            raise RefusedError(404, "there is no monitor: it needs a certificate and a log")
        status = await asyncio.to_thread(monitor)
        return json_reply({**status.as_dict(), "message": status.message})

    @app.get(
        "/metrics",
        response_model=None,
        responses={200: _TEXT, **_problems(*_ALWAYS)},
        dependencies=_TOKEN,
        summary="Counts and times for Prometheus",
        tags=["state"],
    )
    async def counts() -> Reply:
        """Return all metrics."""
        return Reply(200, await asyncio.to_thread(metrics.text), METRICS_TYPE)


def _problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    return {n: {"model": ProblemOut, "description": _PROBLEMS[n]} for n in sorted(statuses)}


async def _http_problem(_: Request, error: Exception) -> Response:
    """Answer what no route took, in the same shape as everything else."""
    assert isinstance(error, HTTPException)
    detail = {404: "there is no such route", 405: "this route has other methods"}
    reply = problem(error.status_code, detail.get(error.status_code, str(error.detail)))
    headers = dict(error.headers or {})
    return Response(reply.body, reply.status, headers, media_type=reply.media_type)


def _name_problems(app: FastAPI) -> None:
    """Correct what FastAPI documents of its own accord: problems of another shape and type."""
    made = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            content = made()
            for name in ("HTTPValidationError", "ValidationError"):
                content["components"]["schemas"].pop(name, None)
            for operations in content["paths"].values():
                for operation in operations.values():
                    _correct(operation["responses"])
        return app.openapi_schema or {}

    app.openapi = openapi  # type: ignore[method-assign]


def _correct(responses: dict[str, Any]) -> None:
    if "HTTPValidationError" in str(responses.get("422")):
        del responses["422"]
    for status, response in responses.items():
        if status >= "400":
            response["content"] = {PROBLEM: response["content"]["application/json"]}
