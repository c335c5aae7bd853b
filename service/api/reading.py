"""What routes read of the board: at once where it is in memory, in a thread where reading it may wait."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from service.api.problems import UnknownAsset
from service.results.board import Shown, Snapshot

T = TypeVar("T")


def snapshot_of(request: Request, name: str) -> Snapshot:
    """The snapshot of the asset that is called so; a 404 that names the known assets where there is none.

    It may wait for a database.
    """
    board: Shown = request.app.state.board
    snapshot = board.find(name)
    if snapshot is None:
        raise UnknownAsset(name, board.names())
    return snapshot


def asset_of(request: Request, name: str) -> str:
    """The id of the asset that is called so, as `snapshot_of`."""
    return snapshot_of(request, name).asset


async def shown_of(request: Request, name: str) -> Snapshot:
    """As `snapshot_of`, for routes that must not wait."""
    return await in_thread(request, lambda: snapshot_of(request, name))


async def in_thread(request: Request, read: Callable[[], T]) -> T:
    """What `read` answers of the board."""
    board: Shown = request.app.state.board
    return read() if board.in_memory else await run_in_threadpool(read)
