"""Health and metrics: what a machine watches the service by."""

from __future__ import annotations

import asyncio
from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.guard import PUBLIC, Responses, Routes, may_read
from service.api.problems import problem
from service.contract import rest as models
from service.contract.base import iso_time

READ_WAIT = 3.0  # for the database, which a service that is ready reads in milliseconds [s]

router = Routes("operation")

TEXT: Responses = {200: {"description": "Prometheus text", "content": {"text/plain": {"schema": {"type": "string"}}}}}


@router.entry("GET /healthz", PUBLIC, models.Health, 503)
async def healthz(request: Request) -> Any:
    """All loops of the process are alive; a restart is due where this is answered by 503, or not at all."""
    late = request.app.state.health.late()
    if not late:
        return JSONResponse({"status": "ok"})
    loops = [{"loop": each.name, "since": iso_time(each.since_ns)} for each in late]
    return problem(request, 503, "; ".join(map(str, late)), loops=loops)


@router.entry("GET /readyz", PUBLIC, models.Readiness, 503)
async def readyz(request: Request) -> Any:
    """The service accepts and stores frames: connected, subscribed, storage and worker processes usable.

    Assets that send nothing, or nothing usable, do not make it unready: they are listed. Nor do partitions of a fleet
    that nobody serves: other front ends would answer for them no better.
    """
    reason = request.app.state.not_ready()
    if reason:
        return problem(request, 503, reason)
    if not await may_read(request):
        return JSONResponse({"status": "ready"})
    table, unserved = request.app.state.table, request.app.state.unserved
    try:
        found = await asyncio.wait_for(run_in_threadpool(table.stale), READ_WAIT)
    except TimeoutError:
        return problem(request, 503, f"the database has not answered within {READ_WAIT:g} s")
    stale = [{"asset": asset, "since": since, "reason": reason} for asset, reason, since in found]
    fleet = {} if unserved is None else {"unserved_partitions": list(unserved())}
    return JSONResponse({"status": "ready", "stale": stale, **fleet})


@router.entry("GET /metrics", Role.read, responses=TEXT, response_class=Response)
def metrics(request: Request) -> Response:
    """All metrics as Prometheus text. Reads the store, so it runs in a thread of its own."""
    return Response(generate_latest(request.app.state.registry), media_type=CONTENT_TYPE_LATEST)
