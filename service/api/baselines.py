"""REST: the healthy baseline of one asset: shown, learned from windows of its own, given as a file, removed."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Query, Request
from fastapi.responses import JSONResponse
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.assets import LARGEST
from service.api.audit import accepted, signer, submitted
from service.api.guard import Responses, Routes
from service.api.limits import LONGEST_TARGET
from service.api.problems import problem
from service.api.reading import asset_of, shown_of
from service.contract.parts import AssetBaseline, Baseline
from service.errors import InputError
from service.results.baseline_store import BaselineStore

router = Routes("life of an asset", prefix="/v1/assets")

LARGEST_FILE = 256 * 2**20  # of a baseline that is given as a file [bytes]
REFUSALS = (404, 409, 422, 500)  # of what changes a baseline
NOT_KEPT = "this service keeps no baselines of single assets"
FILE = {"requestBody": {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}}


def _whole(value: Any) -> Any:
    """A JSON number without a fraction, such as 3.0, as an integer."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


class LearnIn(BaseModel):
    """Which windows of the healthy machine a baseline is learned from."""

    model_config = ConfigDict(extra="forbid", strict=True)

    windows: list[Annotated[int, Field(ge=0, le=LARGEST), BeforeValidator(_whole)]] = Field(
        min_length=1,
        max_length=1000,
        description="indices of windows whose raw signals are kept (`/signals` lists them)",
    )
    add: bool = Field(False, description="whether the recordings of the asset's baseline so far take part, too")
    by: str | None = Field(None, max_length=200)
    note: str | None = Field(None, max_length=2000)


QUEUED: Responses = {
    202: {
        "model": AssetBaseline,
        "description": "queued: it is used after the current window; the earlier one is shown",
    }
}


@router.entry("GET /{asset}/baseline", Role.read, AssetBaseline, 404, 422)
def baseline(request: Request, asset: str) -> Any:
    """The asset's own healthy baseline, and what it suffices for."""
    return JSONResponse(_shown(request, asset_of(request, asset)))


@router.entry(
    "PUT /{asset}/baseline",
    Role.administer,
    AssetBaseline,
    *REFUSALS,
    responses=QUEUED,
    openapi_extra=FILE,
    max_body_size=LARGEST_FILE,
)
async def put(
    request: Request,
    asset: str,
    by: Annotated[str | None, Query(max_length=200)] = None,
    note: Annotated[
        str | None, Query(max_length=2000, description=f"the whole address holds at most {LONGEST_TARGET} characters")
    ] = None,
) -> Any:
    """Gives the asset a baseline as a file, as `gear-twin baseline` writes it."""
    own = (await shown_of(request, asset)).asset
    store = _store(request)
    if store is None:
        return problem(request, 409, NOT_KEPT)
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > LARGEST_FILE:
            return problem(request, 409, f"the file is larger than {LARGEST_FILE} bytes")

    def taken() -> str:
        from service.files.baseline import read_baseline
        from service.results.baseline_learning import demand_same_teeth

        path = store.new_path()
        path.write_bytes(data)
        try:
            demand_same_teeth(read_baseline(path), own, request.app.state.store)
        except InputError as error:
            path.unlink(missing_ok=True)
            raise InputError(str(error).replace(str(path), "the file")) from None
        return path.name

    try:
        file = await run_in_threadpool(taken)
    except InputError as error:
        return problem(request, 409, str(error))
    return await _submitted(request, asset, own, "baseline_given", {"file": file, "by": by, "note": note})


@router.entry(
    "POST /{asset}/baseline/learn", Role.administer, AssetBaseline, 400, *REFUSALS, responses=QUEUED, status_code=201
)
async def learn(request: Request, asset: str, given: LearnIn) -> Any:
    """Learns the asset's baseline from chosen windows of its own, in place of the earlier one or added to it."""
    own = (await shown_of(request, asset)).asset
    state, store = request.app.state, _store(request)
    if store is None or state.signals is None:
        return problem(request, 409, NOT_KEPT)

    def learned() -> str:
        from service.results.baseline_learning import learn_from_windows, written

        before = store.path(own) if given.add else None
        found = learn_from_windows(own, given.windows, state.store, state.signals, state.queue.jobs, before)
        return written(found, store.new_path()).name

    try:
        file = await run_in_threadpool(learned)
    except InputError as error:
        return problem(request, 409, str(error))
    about = {
        "file": file,
        "windows": sorted(set(given.windows)),
        "added": given.add,
        "by": given.by,
        "note": given.note,
    }
    return await _submitted(request, asset, own, "baseline_given", about, 201)


@router.entry("DELETE /{asset}/baseline", Role.administer, AssetBaseline, *REFUSALS, responses=QUEUED)
async def remove(request: Request, asset: str, by: Annotated[str | None, Query(max_length=200)] = None) -> Any:
    """Leaves the asset without a baseline of its own."""
    own = (await shown_of(request, asset)).asset
    if _store(request) is None:
        return problem(request, 409, NOT_KEPT)
    return await _submitted(request, asset, own, "baseline_removed", {"by": by})


async def _submitted(
    request: Request, asset: str, own: str, kind: str, about: dict[str, Any], status: int = 200
) -> Any:
    """The answer after a baseline has come into use, between two windows; 202 with the earlier one while it waits."""
    about = {**about, "by": signer(request, about.get("by"))}
    given = {name: value for name, value in about.items() if value is not None}
    status = accepted(await submitted(request, asset, own, kind, given, note=given.get("note")), status)
    return JSONResponse(await run_in_threadpool(_shown, request, own), status)


def _store(request: Request) -> BaselineStore | None:
    """Where baselines of assets are kept."""
    store: BaselineStore | None = request.app.state.baselines
    return store


def _shown(request: Request, asset: str) -> dict[str, Any]:
    store = _store(request)
    path = None if store is None else store.path(asset)
    if store is None or path is None:
        return {"own": False}
    from service.files.baseline import read_baseline
    from twin.baseline.comparison import described

    about = {name: value for name, value in (store.about(asset) or {}).items() if name in AssetBaseline.model_fields}
    try:
        shown = Baseline.of(described(read_baseline(path))).as_json()
    except InputError:
        shown = None
    return {"own": True, **about, "baseline": shown}
