"""REST: the life of an asset: created, changed, renamed, retired; questions answered; the epochs of its gears."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.assets import ERRORS
from service.api.audit import audited, signer
from service.api.guard import Guarded, needs
from service.api.problems import problem, responses
from service.api.reading import asset_of, shown_of, snapshot_of
from service.contract import asset_life as models
from service.contract.base import iso_time
from service.contract.rest import AssetSummary
from service.errors import FAULT, InputError
from service.files.rig import checked_rig
from service.results.job_queue import ASSET
from service.results.jobs import Job
from service.results.snapshot import Snapshot

router = APIRouter(prefix="/v1/assets", tags=["life of an asset"], route_class=Guarded)

RIG_BODY = 2**20  # of a request with a rig file [bytes]
KEPT: dict[int | str, dict[str, Any]] = {202: {"model": models.AssetChange}}


@router.post(
    "", max_body_size=RIG_BODY, status_code=201, response_model=AssetSummary, responses=responses(400, 409, 422)
)
@needs(Role.administer)
def create(request: Request, given: models.AssetIn) -> Any:
    """Creates an asset before its first frame, with its rig file."""
    if given.rig is not None:
        try:
            checked_rig(given.rig, "rig")
        except InputError as error:
            return problem(request, 409, f"the rig file cannot be used: {error}")
    return begin_asset(request, "created", given.asset, given.rig, given.by, given.note)


def begin_asset(
    request: Request, kind: str, asset: str, rig: Mapping[str, Any] | None, by: str | None, note: str | None
) -> JSONResponse:
    """An asset is created, or an unknown one is adopted; 409 where there is one of that name."""
    table, store = request.app.state.table, request.app.state.store
    signed = signer(request, by)

    def kept() -> None:
        request.app.state.names.demand_free(asset)
        store.note(asset, [("change", {"kind": kind, "by": signed, "note": note})])
        if rig is not None:
            store.keep_rig(asset, rig)
            request.app.state.offers.end(asset)  # whoever receives another one offers it again
        table.write(Snapshot(asset=asset, rig=rig, last_event_id=store.last_event_id(asset)).with_whole())

    try:
        audited(request, f"asset {kind}", asset, kept, note=note, what={"rig": rig is not None})
    except InputError as error:
        return problem(request, 409, str(error))
    request.app.state.told(ASSET, asset)
    table.changed(asset)
    return JSONResponse(snapshot_of(request, asset).summary(), 201)


@router.get("/{asset}/changes", response_model=list[models.AssetChange], responses=ERRORS)
@needs(Role.read)
def changes(request: Request, asset: str) -> Any:
    """What people have changed on the asset, oldest first."""
    found = request.app.state.queue.jobs.changes(asset_of(request, asset))
    return JSONResponse([_answer(asset, c) for c in found if c.refused is None])


@router.post(
    "/{asset}/changes",
    status_code=201,
    response_model=models.AssetChange,
    responses=KEPT | responses(400, 404, 409, 422, 500),
)
@needs(Role.operate)
async def change(request: Request, asset: str, given: models.ChangeIn) -> Any:
    """Enters a change, or answers the open question; 202 where it is queued and applied after the current window."""
    own = (await shown_of(request, asset)).asset
    queue = request.app.state.queue
    about = {**given.kept(), "by": signer(request, given.by)}
    about = {name: value for name, value in about.items() if value is not None}

    def kept() -> int:
        submit = partial(queue.submit, own, given.kind, about)
        number = audited(request, given.kind, asset, submit, note=given.note, what=about, queued=True)
        queue.asked.set()  # the transaction is committed now
        return number

    return await answer_change(request, asset, await run_in_threadpool(kept))


def signed(request: Request, by: str | None, note: str | None) -> dict[str, str]:
    """Who makes a change, and why, where that is known."""
    return {name: value for name, value in (("by", signer(request, by)), ("note", note)) if value is not None}


async def answer_change(request: Request, asset: str, number: int) -> JSONResponse:
    """The answer once a change has been carried out or refused, or as long as it is queued."""
    queue = request.app.state.queue
    done = await queue.wait(number, request.app.state.decision_wait)
    if done is None:
        return JSONResponse(_answer(asset, await run_in_threadpool(queue.jobs.job, number)), 202)
    if done.refused is not None:
        return problem(request, 500 if done.refused.startswith(FAULT) else 409, done.refused)
    return JSONResponse(_answer(asset, done), 201)


@router.get("/{asset}/epochs", response_model=list[models.Epoch], responses=ERRORS)
@needs(Role.read)
def epochs(request: Request, asset: str) -> Any:
    """The gears that the asset has had, each with its windows; `?epoch=` of `/windows` and `/trend` reads them."""
    return JSONResponse([dict(e) for e in request.app.state.store.epochs(asset_of(request, asset))])


def _answer(asset: str, change: Job) -> dict[str, Any]:
    renamed = change.kind == "renamed" and change.done and change.refused is None
    return {
        "id": change.id,
        "asset": change.given["name"] if renamed else asset,
        "kind": change.kind,
        "received": iso_time(change.received_ns),
        **{name: change.given.get(name) for name in models.OPTIONAL},
        "done": change.done,
        "effect": change.outcome,
    }
