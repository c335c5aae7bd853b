"""What is left to be told under a name that an asset had before."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from typing import Any

from starlette.concurrency import run_in_threadpool

from service.results.asset_life import AssetLife
from service.results.store import Event, ResultStore


async def last_events(
    store: ResultStore, life: AssetLife, asset: str, after: int, page_size: int
) -> AsyncIterator[Event]:
    """The events behind `after` of an asset that had this name, up to the change that gave it another one."""
    name = await run_in_threadpool(life.present_name, asset)
    more = name is not None
    while more:
        page = await run_in_threadpool(store.events, name or asset, after, page_size)
        for event in page:
            yield event
            after = event.id
            if event.kind == "change" and _was(event.data.get("effect"), asset):
                return
        more = len(page) == page_size


def _was(effect: Mapping[str, Any] | None, asset: str) -> bool:
    """Whether a change gave the asset of this name another one."""
    return effect is not None and effect.get("was") == asset
