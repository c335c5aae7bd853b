"""REST: an asset and the parts of its state, read from the table of assets, and its history."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from fastapi import Query, Request
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.audit import submitted
from service.api.conditional import answer
from service.api.guard import Routes
from service.api.reading import asset_of, shown_of
from service.contract import rest as models
from service.contract.answer import Asset
from service.contract.base import not_available
from service.contract.inspections import refusal
from service.contract.parts import NotAvailable, Residual, Rul, Wear
from service.contract.window import WindowRecord
from service.results.inspections import compare
from service.results.jobs import INSPECTION, Job
from service.results.snapshot import TAIL, has_point, trend_point
from service.results.sql_store import SqlStore
from service.results.store import StoredWindow

router = Routes("assets", prefix="/v1/assets")

LARGEST = 2**53  # of a window's or an inspection's number
WAITS = "kept; it becomes part of the estimate after the window that is being processed"
PAGE = 500  # windows read from the store at once
FEW = 10
AROUND = 100  # windows that are read before, at and behind a number of revolutions


@router.entry("GET /{asset}", Role.read, Asset, 404, 422)
async def asset(
    request: Request,
    asset: str,
    windows: Annotated[
        int, Query(ge=0, le=TAIL, description="how many of the latest window records to include")
    ] = TAIL,
) -> Any:
    """The whole state: the same JSON as `gear-twin assess`."""
    whole = (await shown_of(request, asset)).whole
    shown = whole["windows"]
    return answer(request, {**whole, "windows": list(shown[max(len(shown) - windows, 0) :])})


@router.entry("GET /{asset}/wear", Role.read, Wear | NotAvailable, 404, 422)
async def wear(request: Request, asset: str) -> Any:
    """Wear now: K, depths with their bands, profile of both flanks."""
    return answer(request, (await shown_of(request, asset)).whole["wear"])


@router.entry("GET /{asset}/rul", Role.read, Rul | NotAvailable, 404, 422)
async def rul(request: Request, asset: str) -> Any:
    """Remaining useful life in revolutions and hours, with its 5–95 % band."""
    return answer(request, (await shown_of(request, asset)).whole["rul"])


@router.entry("GET /{asset}/residual", Role.read, Residual | NotAvailable, 404, 422)
async def residual(request: Request, asset: str) -> Any:
    """Residual: what the model does not explain, by gear-mesh band and order."""
    return answer(request, (await shown_of(request, asset)).whole["residual"])


@router.entry("GET /{asset}/rig", Role.read, dict[str, Any], 404, 422)
async def rig(request: Request, asset: str) -> Any:
    """The rig file in use."""
    values = (await shown_of(request, asset)).rig
    return answer(request, not_available("no rig file is known for this asset") if values is None else values)


class HistoryQuery(BaseModel):
    """Which part of an asset's history is asked for."""

    after: int = Field(-1, ge=-1, le=LARGEST, description="only windows with an index above this one")
    limit: int = Field(1000, ge=1, le=10_000, description="at most this many")
    every: int = Field(
        1,
        ge=1,
        le=LARGEST,
        description="only each so-many-th window, and the newest; peaks between them are left out: see `resolution`",
    )
    resolution: int | None = Field(
        None,
        ge=1,
        le=10_000,
        description="in place of `every` and `limit`: about so many windows. All where there are no more; else of each "
        "part of the history the first, those with the lowest and the highest measured RMS, and that with the highest "
        "kurtosis: no peak of these is left out; and the newest",
    )
    epoch: int | None = Field(
        None, ge=0, le=LARGEST, description="of which gears; default: the present ones (`/epochs` lists all)"
    )


@router.entry("GET /{asset}/windows", Role.read, list[WindowRecord], 404, 422)
def windows(request: Request, asset: str, query: Annotated[HistoryQuery, Query()]) -> Any:
    """Window records, oldest first: a page by cursor, or a long history thinned."""
    return answer(request, [w.record for w in history(request, asset, query)])


@router.entry("GET /{asset}/trend", Role.read, list[models.TrendPoint], 404, 422)
def trend(request: Request, asset: str, query: Annotated[HistoryQuery, Query()]) -> Any:
    """Level, depth and remaining life with their bands as each window left them; refused windows left out."""
    return answer(request, [trend_point(w) for w in history(request, asset, query) if has_point(w)])


def history(request: Request, asset: str, query: HistoryQuery) -> tuple[StoredWindow, ...]:
    """Windows from the store."""
    own, store = asset_of(request, asset), request.app.state.store
    if query.resolution is not None:
        return store.outline(own, query.resolution, query.after, query.epoch)
    return store.windows(own, query.after, query.limit, query.every, query.epoch)


@router.entry("GET /{asset}/quality", Role.read, models.Quality, 404, 422)
async def quality(request: Request, asset: str) -> Any:
    """Faults found in the data, and how many windows they touched."""
    return answer(request, (await shown_of(request, asset)).data_quality())


@router.entry("GET /{asset}/inspections", Role.read, list[models.InspectionAnswer], 404, 422)
def inspections(
    request: Request,
    asset: str,
    after: Annotated[int, Query(ge=0, le=LARGEST, description="only inspections with an id above this one")] = 0,
    limit: Annotated[int, Query(ge=1, le=10_000, description="at most this many")] = 1000,
) -> Any:
    """The inspections kept, each with the twin's figure at the time it was received."""
    found = request.app.state.queue.jobs.of(asset_of(request, asset), INSPECTION, after, limit)
    return JSONResponse([_inspection(job) for job in found])


@router.entry("POST /{asset}/inspections", Role.operate, models.InspectionAnswer, 400, 404, 422, status_code=201)
async def add_inspection(request: Request, asset: str, inspection: models.InspectionIn) -> Any:
    """A measured wear depth becomes part of the estimate; answers with the twin's own figure and what it changed."""
    own = (await shown_of(request, asset)).asset
    store, given = request.app.state.store, inspection.model_dump()
    twin = compare(given, await run_in_threadpool(trend_around, store, own, inspection.revolutions))
    about = {"inspection": given, "answer": {**twin, **refusal(WAITS)}}
    return JSONResponse(_inspection(await submitted(request, asset, own, INSPECTION, about, what=given)), 201)


def _inspection(job: Job) -> dict[str, Any]:
    """An inspection with its id and time, the twin's own figure, and what it changed once it is used."""
    inspection = {"id": job.id, "received_ns": job.received_ns, **job.given["inspection"]}
    return {"inspection": inspection, **(job.outcome or job.given["answer"])}


def trend_around(store: SqlStore, asset: str, revolutions: float) -> list[dict[str, Any]]:
    """The points of an asset's trend that say its depth at a number of revolutions: its first, its newest, and those on
    both sides. Windows follow each other in revolutions, so that a long history is not read whole.
    """
    newest = _points(store.latest_windows(asset, AROUND))
    if not newest:
        return newest
    first: list[dict[str, Any]] = []
    after = -1
    while not any("depth_um" in p for p in first) and (page := store.windows(asset, after, PAGE)):
        first, after = [*first, *_points(page)], page[-1].record["index"]
    low, high = first[0]["index"] - 1 if first else -1, newest[-1]["index"]  # what is behind `low` comes before
    while high - low > AROUND:
        middle = (low + high) // 2
        reached = _next_revolutions(store, asset, middle)
        low, high = (low, middle) if reached is None or reached > revolutions else (middle, high)
    between = _points(store.windows(asset, max(low - AROUND, -1), 3 * AROUND))
    return [*{p["index"]: p for p in (*first, *between, *newest)}.values()]


def _next_revolutions(store: SqlStore, asset: str, after: int) -> float | None:
    """Revolutions of the first window above an index that has them."""
    while page := store.windows(asset, after, FEW):
        found = next((p["revolutions"] for p in _points(page) if p.get("revolutions") is not None), None)
        if found is not None:
            return found
        after = page[-1].record["index"]
    return None


def _points(windows: Iterable[StoredWindow]) -> list[dict[str, Any]]:
    return [trend_point(window) for window in windows if has_point(window)]
