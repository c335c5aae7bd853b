"""REST: the assets and the parts of their state, read from the board."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse

from service.api import models
from service.api.problems import UnknownAsset, responses
from service.contract.answer import not_available
from service.results.board import Snapshot
from service.results.inspections import compare

router = APIRouter(prefix="/v1/assets", tags=["assets"])

ERRORS = responses(404, 422)


def snapshot_of(request: Request, asset: str) -> Snapshot:
    """The asset's snapshot; a 404 that names the known assets where there is none."""
    board = request.app.state.board
    snapshot = board.get(asset)
    if snapshot is None:
        raise UnknownAsset(asset, board.assets())
    return snapshot


@router.get("", response_model=list[models.AssetSummary])
async def assets(request: Request) -> Any:
    """The assets seen, each with its status."""
    board = request.app.state.board
    return JSONResponse([board.get(name).summary() for name in board.assets()])


@router.get("/{asset}", response_model=models.Asset, responses=ERRORS)
async def asset(request: Request, asset: str) -> Any:
    """The whole state: the same JSON as `gear-twin assess`."""
    return JSONResponse(snapshot_of(request, asset).whole)


@router.get("/{asset}/wear", response_model=models.Wear | models.NotAvailable, responses=ERRORS)
async def wear(request: Request, asset: str) -> Any:
    """Wear now: K, depths with their bands, profile of both flanks."""
    return JSONResponse(snapshot_of(request, asset).whole["wear"])


@router.get("/{asset}/rul", response_model=models.Rul | models.NotAvailable, responses=ERRORS)
async def rul(request: Request, asset: str) -> Any:
    """Remaining useful life in revolutions and hours, with its 5–95 % band."""
    return JSONResponse(snapshot_of(request, asset).whole["rul"])


@router.get("/{asset}/residual", response_model=models.Residual | models.NotAvailable, responses=ERRORS)
async def residual(request: Request, asset: str) -> Any:
    """What the twin leaves unexplained, by gear-mesh band and order."""
    return JSONResponse(snapshot_of(request, asset).whole["residual"])


@router.get("/{asset}/rig", response_model=dict[str, Any], responses=ERRORS)
async def rig(request: Request, asset: str) -> Any:
    """The rig file in use."""
    values = snapshot_of(request, asset).rig
    return JSONResponse(not_available("no rig file is known for this asset") if values is None else values)


@router.get("/{asset}/windows", response_model=list[models.WindowRecord], responses=ERRORS)
async def windows(
    request: Request,
    asset: str,
    after: Annotated[int | None, Query(description="only windows with an index above this one")] = None,
    limit: Annotated[int, Query(ge=1, le=10_000, description="at most this many")] = 1000,
) -> Any:
    """Window records, oldest first."""
    records = snapshot_of(request, asset).records
    chosen = records if after is None else [r for r in records if r["index"] > after]
    return JSONResponse(list(chosen[:limit]))


@router.get("/{asset}/trend", response_model=list[models.TrendPoint], responses=ERRORS)
async def trend(request: Request, asset: str) -> Any:
    """Depth and remaining life with their bands as each window left them, oldest first."""
    return JSONResponse(list(snapshot_of(request, asset).trend))


@router.get("/{asset}/quality", response_model=models.Quality, responses=ERRORS)
async def quality(request: Request, asset: str) -> Any:
    """Faults found in the data, and how many windows they touched."""
    return JSONResponse(snapshot_of(request, asset).data_quality())


@router.get("/{asset}/inspections", response_model=list[models.InspectionAnswer], responses=ERRORS)
async def inspections(request: Request, asset: str) -> Any:
    """The inspections kept, each with the twin's figure at the time it was received."""
    return JSONResponse(list(snapshot_of(request, asset).inspections))


@router.post(
    "/{asset}/inspections",
    status_code=201,
    response_model=models.InspectionAnswer,
    responses=responses(400, 404, 422),
)
def add_inspection(request: Request, asset: str, inspection: models.InspectionIn) -> Any:
    """Keeps a measured wear depth, and answers with the twin's own figure beside it."""
    snapshot = snapshot_of(request, asset)
    given = inspection.model_dump()
    answer = request.app.state.store.add_inspection(asset, given, compare(given, snapshot.trend))
    request.app.state.board.add_inspection(asset, answer)
    return JSONResponse(answer, 201)
