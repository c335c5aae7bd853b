"""Server-sent events of one asset: read from the store by id, so that a reader that was away misses none.

A reader that has begun under a name that the asset has no longer is told the rest all the same.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from typing import Annotated

from fastapi import Header, Query, Request
from sse_starlette import EventSourceResponse, ServerSentEvent
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.guard import Responses, Routes, credential_of
from service.api.reading import shown_of
from service.results.asset_table import AssetTable
from service.results.sql_store import SqlStore
from service.results.store import Event

router = Routes("assets", prefix="/v1/assets")

# what happens to an asset; service/page/machine.js listens to all of them
KINDS = ("window", "update", "effect", "rul", "data_fault", "status", "alarm", "change", "question", "inspection")
PAGE = 100  # events read from the store at once: the first come as soon after a long history as after a short one
PING_S = 15
RETRY_MS = 1000
LARGEST_ID = 2**63 - 1

STREAM: Responses = {
    200: {
        "description": f"{', '.join(f'`{kind}`' for kind in KINDS[:-1])} and `{KINDS[-1]}`, each with an id",
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
    }
}


@router.entry("GET /{asset}/events", Role.read, None, 404, 422, responses=STREAM, response_class=EventSourceResponse)
async def events(
    request: Request,
    asset: str,
    after: Annotated[
        int | None, Query(ge=0, le=LARGEST_ID, description="start behind this event; 0 for all there were")
    ] = None,
    last_event_id: Annotated[int | None, Header(ge=0, le=LARGEST_ID)] = None,
) -> EventSourceResponse:
    """What happens, as it happens: from now on, or from behind `Last-Event-ID`."""
    snapshot = await shown_of(request, asset)
    start = last_event_id if last_event_id is not None else after
    access, who, credential = request.app.state.access, request.state.who, credential_of(request)
    stream = _stream(
        request.app.state.table,
        request.app.state.store,
        snapshot.asset,
        asset,
        snapshot.last_event_id if start is None else start,
        lambda: access.still(who, credential),
    )
    return EventSourceResponse(stream, ping=PING_S, headers={"Cache-Control": "no-store"})


async def _stream(
    table: AssetTable, store: SqlStore, asset: str, name: str, after: int, admitted: Callable[[], bool]
) -> AsyncIterator[ServerSentEvent]:
    """Events until the service ends, or the credential has expired or been revoked."""
    with table.changes(asset) as changed:
        yield ServerSentEvent(comment=f"events of {name} after {after}", retry=RETRY_MS)
        while not table.closed and admitted():
            changed.clear()  # before reading: what comes while reading sets it again
            page = await run_in_threadpool(store.events, asset, after, PAGE)
            for event in page:
                yield _sent(event)
                after = event.id
                await asyncio.sleep(0)  # the loop learns here that a reader has gone, and cancels this stream
            if len(page) < PAGE and not table.closed:
                with suppress(TimeoutError):
                    await asyncio.wait_for(changed.wait(), PING_S)


def _sent(event: Event) -> ServerSentEvent:
    return ServerSentEvent(json.dumps(event.data), event=event.kind, id=str(event.id))
