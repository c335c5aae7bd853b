"""REST: rig files that came on the stream and wait for a person: shown with what differs, accepted or rejected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from fastapi import Request
from fastapi.responses import JSONResponse
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.asset_life import answer_change, signed
from service.api.audit import submitted
from service.api.guard import Routes
from service.api.incoming import Reason, offers_of
from service.api.problems import problem
from service.api.reading import shown_of
from service.contract.asset_life import AssetChange
from service.contract.base import AnswerModel, iso_time
from service.files.rig_difference import differences
from service.results.jobs import RIG_ACCEPTED, RIG_REJECTED
from service.results.offers import Proposal

router = Routes("rig files", prefix="/v1")


class RigDifference(AnswerModel):
    """One value that the proposed rig file states otherwise."""

    key: str
    present: str | None = Field(description="in the rig file in use; null where it is absent")
    proposed: str | None


class RigProposal(AnswerModel):
    """A rig file that came on the stream and waits for a person."""

    asset: str
    digest: str = Field(description="of its contents; a decision names it")
    received: str = Field(description="ISO 8601, by the service's clock")
    name: str | None = Field(description="that the rig file gives the machine")
    differences: list[RigDifference] = Field(description="from the rig file in use; all values where there is none")


class RigDecision(Reason):
    """What becomes of a proposed rig file."""

    decision: Literal["accept", "reject"]
    digest: str = Field(max_length=64, description="of the proposal that was seen")


@router.entry("GET /rig-proposals", Role.read, list[RigProposal])
async def rig_proposals(request: Request) -> Any:
    """The rig files that came on the stream and wait for a person, of all assets."""
    offers = offers_of(request)
    return await run_in_threadpool(lambda: JSONResponse([_shown(request, each) for each in offers.proposals()]))


@router.entry(
    "POST /assets/{asset}/rig-proposal",
    Role.administer,
    AssetChange,
    404,
    422,
    400,
    409,
    500,
    queued=True,
    status_code=201,
)
async def decide_on_rig(request: Request, asset: str, given: RigDecision) -> Any:
    """Accepts the proposed rig file, or rejects it; one of other gears opens the question whose they are."""
    own = (await shown_of(request, asset)).asset
    proposal = await run_in_threadpool(offers_of(request).proposal, own)
    if proposal is None or proposal.digest != given.digest:
        now = "no rig file is proposed" if proposal is None else f"another one is proposed now: {proposal.digest}"
        return problem(request, 409, f"{asset}: the rig file {given.digest} is not proposed; {now}")
    kind = RIG_ACCEPTED if given.decision == "accept" else RIG_REJECTED
    about: dict[str, Any] = {"digest": proposal.digest, **signed(request, given.by, given.note)}
    if kind == RIG_ACCEPTED:
        about["rig"] = dict(proposal.rig)
    differing = len(await run_in_threadpool(_differences, request, proposal))
    what = {"digest": proposal.digest, "differences": differing}
    return answer_change(asset, await submitted(request, asset, own, kind, about, note=given.note, what=what))


def _differences(request: Request, proposal: Proposal) -> list[dict[str, str | None]]:
    snapshot = request.app.state.table.get(proposal.asset)
    present: Mapping[str, Any] = {} if snapshot is None else snapshot.rig or {}
    return [{"key": d.key, "present": d.before, "proposed": d.now} for d in differences(present, proposal.rig)]


def _shown(request: Request, proposal: Proposal) -> dict[str, Any]:
    snapshot = request.app.state.table.get(proposal.asset)
    return {
        "asset": proposal.asset if snapshot is None else snapshot.name,
        "digest": proposal.digest,
        "received": iso_time(proposal.received_ns),
        "name": None if proposal.rig.get("name") is None else str(proposal.rig["name"]),
        "differences": _differences(request, proposal),
    }
