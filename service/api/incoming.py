"""REST: what comes in from the network: unknown assets that wait for a person, and how far a stream is stored."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.asset_life import begin_asset
from service.api.audit import audited
from service.api.guard import Guarded, needs
from service.api.problems import problem, responses
from service.contract.base import AnswerModel, iso_time
from service.contract.position import PositionModel, not_connected
from service.contract.rest import AssetSummary
from service.files.rig_difference import digest_of
from service.results.rig_proposals import ProposalList, RigProposals
from service.results.unknown_assets import Unknown, UnknownAssets, UnknownList

router = APIRouter(prefix="/v1", tags=["unknown assets"], route_class=Guarded)


@dataclass(frozen=True, slots=True, kw_only=True)
class Incoming:
    """What the app knows of the network's side.

    position  how far a stream is stored, as it was published last
    propose   makes a rig file that was offered for an asset a proposal, where it is another one
    """

    unknown: UnknownList = field(default_factory=UnknownAssets)
    proposals: ProposalList = field(default_factory=RigProposals)
    position: Callable[[str], PositionModel] = not_connected
    propose: Callable[[str, Mapping[str, Any]], None] = lambda asset, rig: None


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
    assets: list[UnknownAsset] = Field(description="the busiest first; kept in memory, not over a restart")


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


@router.get("/unknown-assets", response_model=Unknowns)
@needs(Role.read)
async def unknown_assets(request: Request) -> Any:
    """The assets that are not known, and wait to be adopted."""
    unknown = _unknown(request)

    def answer() -> JSONResponse:
        found = [_shown(each) for each in unknown.listed()]
        return JSONResponse(
            {"asks": unknown.asks, "frames": unknown.frames, "forgotten": unknown.forgotten, "assets": found}
        )

    return await run_in_threadpool(answer)


@router.post(
    "/unknown-assets/{asset}/adopt",
    status_code=201,
    response_model=AssetSummary,
    responses=responses(400, 404, 409, 422),
)
@needs(Role.administer)
def adopt(request: Request, asset: str, given: Adoption) -> Any:
    """Makes an unknown asset one of this service's: its frames are used from now on."""
    found = _unknown(request).find(asset)
    if request.app.state.table.find(asset) is None and found is None:
        return _not_listed(request, asset)
    offered = None if found is None else found.rig
    if given.rig is not None and (offered is None or digest_of(offered) != given.rig):
        now = "none is" if offered is None else f"{digest_of(offered)} is now"
        return problem(request, 409, f"the rig file {given.rig} is not offered for {asset}: {now}")
    answer = begin_asset(request, "adopted", asset, offered if given.rig else None, given.by, given.note)
    if answer.status_code == 201 and offered is not None and given.rig is None:
        request.app.state.incoming.propose(asset, offered)
    return answer


@router.post("/unknown-assets/{asset}/dismiss", response_model=Dismissed, responses=responses(400, 404, 422))
@needs(Role.administer)
def dismiss(request: Request, asset: str, given: Reason) -> Any:
    """Takes an unknown asset off the list; it is not listed again for the time that the list keeps an entry."""
    unknown = _unknown(request)
    found = unknown.find(asset)
    if found is None:
        return _not_listed(request, asset)
    what = {"frames": found.frames}
    audited(request, "unknown asset dismissed", asset, lambda: unknown.dismiss(asset), note=given.note, what=what)
    return JSONResponse({"asset": asset})


@router.get("/assets/{asset}/position", response_model=PositionModel, responses=responses(404, 422))
@needs(Role.read)
def position(request: Request, asset: str) -> Any:
    """How far a stream is stored, and whether and why its frames are left out; the same JSON as on Zenoh."""
    incoming: Incoming = request.app.state.incoming
    if incoming.unknown.find(asset) is None and request.app.state.names.is_free(asset):
        return _not_listed(request, asset)
    return JSONResponse(incoming.position(asset).model_dump(mode="json"))


def _unknown(request: Request) -> UnknownList:
    unknown: UnknownList = request.app.state.incoming.unknown
    return unknown


def _not_listed(request: Request, asset: str) -> JSONResponse:
    names = [each.asset for each in _unknown(request).listed()]
    listed = ", ".join(names) or "none"
    detail = (
        f"no frame of {asset!r} has come: unknown assets are {listed}; "
        "POST /v1/assets (gear-twin assets create) makes an asset before its first frame"
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
        "rig_digest": None if each.rig is None else digest_of(each.rig),
        "rig_name": None if each.rig is None or each.rig.get("name") is None else str(each.rig["name"]),
    }
