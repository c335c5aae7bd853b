"""REST: the life of an asset: created, changed, renamed, retired; questions answered; the epochs of its gears."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse

from service.access.roles import Role
from service.api.audit import accepted, audited, signer, submitted
from service.api.guard import Routes
from service.api.problems import problem
from service.api.reading import asset_of, shown_of, snapshot_of
from service.contract import asset_life as models
from service.contract.base import iso_time
from service.contract.rest import AssetSummary
from service.errors import InputError
from service.files.rig import checked_rig
from service.results.jobs import Job
from service.results.snapshot import Snapshot

router = Routes("life of an asset", prefix="/v1/assets")

RIG_BODY = 2**20  # of a request with a rig file [bytes]


@router.entry("POST", Role.administer, AssetSummary, 400, 409, 422, max_body_size=RIG_BODY, status_code=201)
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
    table.changed(asset)
    return JSONResponse(snapshot_of(request, asset).summary(), 201)


@router.entry("GET /{asset}/changes", Role.read, list[models.AssetChange], 404, 422)
def changes(request: Request, asset: str) -> Any:
    """What people have changed on the asset, oldest first."""
    found = request.app.state.queue.jobs.changes(asset_of(request, asset))
    return JSONResponse([_answer(asset, c) for c in found if c.refused is None])


@router.entry(
    "POST /{asset}/changes", Role.operate, models.AssetChange, 400, 404, 409, 422, 500, queued=True, status_code=201
)
async def change(request: Request, asset: str, given: models.ChangeIn) -> Any:
    """Enters a change, or answers the open question; 202 where it is queued and applied after the current window."""
    own = (await shown_of(request, asset)).asset
    about = {**given.kept(), "by": signer(request, given.by)}
    about = {name: value for name, value in about.items() if value is not None}
    return answer_change(asset, await submitted(request, asset, own, given.kind, about, note=given.note))


def signed(request: Request, by: str | None, note: str | None) -> dict[str, str]:
    """Who makes a change, and why, where that is known."""
    return {name: value for name, value in (("by", signer(request, by)), ("note", note)) if value is not None}


def answer_change(asset: str, job: Job) -> JSONResponse:
    """The answer once a change has been carried out, or as long as it is queued."""
    return JSONResponse(_answer(asset, job), accepted(job, 201))


@router.entry("GET /{asset}/epochs", Role.read, list[models.Epoch], 404, 422)
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
