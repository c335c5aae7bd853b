"""REST: what comes in from the network: unknown assets that wait for a person, and how far a stream is stored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.asset_life import begin_asset
from service.api.audit import audited
from service.api.guard import Routes
from service.api.problems import problem
from service.contract.base import AnswerModel, iso_time
from service.contract.position import PositionModel, not_connected
from service.contract.rest import AssetSummary
from service.results.offers import Offers
from service.results.unknown_assets import Unknown
from service.steady_clock import later_time_ns

router = Routes("unknown assets", prefix="/v1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Incoming:
    """What the app knows of the network's side.

    asks      whether an unknown asset waits for a person
    position  how far a stream is stored, as it was published last
    """

    asks: bool = False
    position: Callable[[str], PositionModel] = not_connected


class UnknownAsset(AnswerModel):
    """An asset whose frames come and are left out, because nobody has adopted it."""

    asset: str
    first_seen: str = Field(description="ISO 8601, by the service's clock")
    last_seen: str
    frames: int = Field(description="that were left out")
    channels: list[str] = Field(description="that it has sent, the first 32")
    rig: bool = Field(description="whether a rig file has been offered for it")
    rig_digest: str | None = Field(description="of its contents; an adoption with it names it")
    rig_name: str | None = Field(description="that it gives the machine")


class Unknowns(AnswerModel):
    """The unknown assets."""

    asks: bool = Field(description="whether an unknown asset waits for a person; else its first frame makes it one")
    frames: int = Field(description="frames of unknown assets that were left out since the start")
    forgotten: int = Field(description="unknown assets that were not listed any more for want of room")
    assets: list[UnknownAsset] = Field(description="the busiest first")


class Reason(BaseModel):
    """Who does something, and why."""

    model_config = ConfigDict(extra="forbid", strict=True)

    by: str | None = Field(None, max_length=200, description="who does it")
    note: str | None = Field(None, max_length=2000, description="why")


class Adoption(Reason):
    """Who adopts an asset, and with which rig file."""

    rig: str | None = Field(
        None, max_length=64, description="digest of the rig file offered for it, to use that; else it is a proposal"
    )


class Dismissed(AnswerModel):
    """An asset that was taken off the list."""

    asset: str


@router.entry("GET /unknown-assets", Role.read, Unknowns)
async def unknown_assets(request: Request) -> Any:
    """The assets that are not known, and wait to be adopted."""
    offers = offers_of(request)

    def answer() -> JSONResponse:
        frames, forgotten = offers.left_out()
        found = [_shown(each) for each in offers.unknown()]
        asks = request.app.state.incoming.asks
        return JSONResponse({"asks": asks, "frames": frames, "forgotten": forgotten, "assets": found})

    return await run_in_threadpool(answer)


@router.entry("POST /unknown-assets/{asset}/adopt", Role.administer, AssetSummary, 400, 404, 409, 422, status_code=201)
def adopt(request: Request, asset: str, given: Adoption) -> Any:
    """Makes an unknown asset one of this service's: its frames are used from now on."""
    found = offers_of(request).find(asset)
    if request.app.state.table.find(asset) is None and found is None:
        return _not_listed(request, asset)
    offered = None if found is None else found.rig
    digest = None if found is None else found.digest
    if given.rig not in (None, digest):
        now = "none is" if digest is None else f"{digest} is now"
        return problem(request, 409, f"the rig file {given.rig} is not offered for {asset}: {now}")
    return begin_asset(request, "adopted", asset, offered if given.rig else None, given.by, given.note)


@router.entry("POST /unknown-assets/{asset}/dismiss", Role.administer, Dismissed, 400, 404, 422)
def dismiss(request: Request, asset: str, given: Reason) -> Any:
    """Takes an unknown asset off the list; it is not listed again for the time that the list keeps an entry."""
    offers = offers_of(request)
    found = offers.find(asset)
    if found is None:
        return _not_listed(request, asset)
    what, dismissed = {"frames": found.frames}, partial(offers.dismiss, asset, later_time_ns())
    audited(request, "unknown asset dismissed", asset, dismissed, note=given.note, what=what)
    return JSONResponse({"asset": asset})


@router.entry("GET /assets/{asset}/position", Role.read, PositionModel, 404, 422)
def position(request: Request, asset: str) -> Any:
    """How far a stream is stored, and whether and why its frames are left out; the same JSON as on Zenoh."""
    incoming: Incoming = request.app.state.incoming
    if offers_of(request).find(asset) is None and request.app.state.names.is_free(asset):
        return _not_listed(request, asset)
    return JSONResponse(incoming.position(asset).model_dump(mode="json"))


def offers_of(request: Request) -> Offers:
    """The table of what waits for people."""
    offers: Offers = request.app.state.offers
    return offers


def _not_listed(request: Request, asset: str) -> JSONResponse:
    names = [each.asset for each in offers_of(request).unknown()]
    listed = ", ".join(names) or "none"
    detail = (
        f"no frame of {asset!r} has come: unknown assets are {listed}; "
        "POST /v1/assets (gear-twin remote assets create) makes an asset before its first frame"
    )
    return problem(request, 404, detail, known=names)


def _shown(each: Unknown) -> dict[str, Any]:
    return {
        "asset": each.asset,
        "first_seen": iso_time(each.first_ns),
        "last_seen": iso_time(each.last_ns),
        "frames": each.frames,
        "channels": sorted(each.channels),
        "rig": each.rig is not None,
        "rig_digest": each.digest,
        "rig_name": None if each.rig is None or each.rig.get("name") is None else str(each.rig["name"]),
    }
