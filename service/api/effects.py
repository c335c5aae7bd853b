"""REST: the effects in the twin, what they rest on, and an engineer's decisions about them."""

from __future__ import annotations

from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.audit import accepted, signer, submitted
from service.api.guard import Routes
from service.api.problems import problem
from service.api.reading import asset_of, shown_of
from service.contract import rest as models
from service.contract.parts import Effect, NotAvailable, Tracing
from service.results.jobs import DECISION, Job

router = Routes("effects", prefix="/v1/assets")


@router.entry("GET /{asset}/effects", Role.read, list[Effect] | NotAvailable, 404, 422)
async def effects(request: Request, asset: str) -> Any:
    """Effects that the model lacked and that were added, in the order found."""
    return JSONResponse((await shown_of(request, asset)).whole["effects"])


@router.entry("GET /{asset}/tracing", Role.read, Tracing | NotAvailable, 404, 422)
async def tracing(request: Request, asset: str) -> Any:
    """What the effects rest on: candidates, held-out windows, residual and depths before and after, the log."""
    return JSONResponse((await shown_of(request, asset)).whole["tracing"])


@router.entry("GET /{asset}/decisions", Role.read, list[models.DecisionAnswer], 404, 422)
def decisions(request: Request, asset: str) -> Any:
    """Decisions on the asset's effects, oldest first."""
    found = request.app.state.queue.jobs.of(asset_of(request, asset), DECISION)
    return JSONResponse([_answer(asset, d) for d in found if d.refused is None])


@router.entry("POST /{asset}/effects/{name}", Role.operate, models.DecisionAnswer, 400, 404, 409, 422, 500, queued=True)
async def decide(request: Request, asset: str, name: str, given: models.DecisionIn) -> Any:
    """Accepts, rejects, pins or releases an effect; 202 where it is queued and applied after the current window."""
    own = (await shown_of(request, asset)).asset
    known = await run_in_threadpool(_effects)
    if name not in known:
        return problem(request, 404, f"{name!r} is no effect; known are {', '.join(known)}")
    note = (given.note or "").strip() or None
    about = {"name": name, "verb": given.decision, "by": signer(request, given.by), "note": note}
    what = {"effect": name, "decision": given.decision}
    job = await submitted(request, asset, own, DECISION, about, note=note, what=what)
    return JSONResponse(_answer(asset, job), accepted(job, 200))


def _effects() -> list[str]:
    from twin.effects import EFFECTS  # loads half of the twin, which a start does without

    return [name for name in EFFECTS if name != "none"]


def _answer(asset: str, decision: Job) -> dict[str, Any]:
    return {
        "id": decision.id,
        "asset": asset,
        "name": decision.given["name"],
        "decision": decision.given["verb"],
        "received_ns": decision.received_ns,
        "by": decision.given["by"],
        "note": decision.given["note"],
        "done": decision.done,
    }
