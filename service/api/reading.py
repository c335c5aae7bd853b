"""What routes read of the assets, in threads: reading waits for the database."""

from __future__ import annotations

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from service.api.problems import UnknownAsset
from service.results.asset_table import AssetTable
from service.results.snapshot import Snapshot


def snapshot_of(request: Request, name: str) -> Snapshot:
    """The snapshot of the asset that is called so; a 404 that names the known assets where there is none."""
    table: AssetTable = request.app.state.table
    snapshot = table.find(name)
    if snapshot is None:
        raise UnknownAsset(name, table.names())
    return snapshot


def asset_of(request: Request, name: str) -> str:
    """The id of the asset that is called so, as `snapshot_of`."""
    return snapshot_of(request, name).asset


async def shown_of(request: Request, name: str) -> Snapshot:
    """As `snapshot_of`, for routes that must not wait."""
    return await run_in_threadpool(snapshot_of, request, name)
