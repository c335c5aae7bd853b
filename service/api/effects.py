"""REST: the effects in the twin, what they rest on, and an engineer's decisions about them."""

from __future__ import annotations

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
from service.api.reading import asset_of, shown_of
from service.contract import rest as models
from service.contract.parts import Effect, NotAvailable, Tracing
from service.errors import FAULT
from service.results.jobs import DECISION, Job

router = APIRouter(prefix="/v1/assets", tags=["effects"], route_class=Guarded)

KEPT: dict[int | str, dict[str, Any]] = {202: {"model": models.DecisionAnswer}}


@router.get("/{asset}/effects", response_model=list[Effect] | NotAvailable, responses=ERRORS)
@needs(Role.read)
async def effects(request: Request, asset: str) -> Any:
    """Effects that the model lacked and that were added, in the order found."""
    return JSONResponse((await shown_of(request, asset)).whole["effects"])


@router.get("/{asset}/tracing", response_model=Tracing | NotAvailable, responses=ERRORS)
@needs(Role.read)
async def tracing(request: Request, asset: str) -> Any:
    """What the effects rest on: candidates, held-out windows, residual and depths before and after, the log."""
    return JSONResponse((await shown_of(request, asset)).whole["tracing"])


@router.get("/{asset}/decisions", response_model=list[models.DecisionAnswer], responses=ERRORS)
@needs(Role.read)
def decisions(request: Request, asset: str) -> Any:
    """Decisions on the asset's effects, oldest first."""
    found = request.app.state.queue.jobs.of(asset_of(request, asset), DECISION)
    return JSONResponse([_answer(asset, d) for d in found if d.refused is None])


@router.post(
    "/{asset}/effects/{name}",
    response_model=models.DecisionAnswer,
    responses=KEPT | responses(400, 404, 409, 422, 500),
)
@needs(Role.operate)
async def decide(request: Request, asset: str, name: str, given: models.DecisionIn) -> Any:
    """Accepts, rejects, pins or releases an effect; 202 where it is queued and applied after the current window."""
    own = (await shown_of(request, asset)).asset
    from twin.effects import EFFECTS  # loads half of the twin, which a start does without

    if name not in EFFECTS or name == "none":
        known = ", ".join(n for n in EFFECTS if n != "none")
        return problem(request, 404, f"{name!r} is no effect; known are {known}")
    queue = request.app.state.queue
    _, note = given.signed()
    by = signer(request, given.by)

    def kept() -> int:
        submit = partial(queue.submit, own, DECISION, {"name": name, "verb": given.decision, "by": by, "note": note})
        what = {"effect": name, "decision": given.decision}
        number = audited(request, "decision", asset, submit, note=note, what=what, queued=True)
        queue.asked.set()  # the transaction is committed now
        return number

    number = await run_in_threadpool(kept)
    done = await queue.wait(number, request.app.state.decision_wait)
    if done is None:
        return JSONResponse(_answer(asset, await run_in_threadpool(queue.jobs.job, number)), 202)
    if done.refused is not None:
        return problem(request, 500 if done.refused.startswith(FAULT) else 409, done.refused)
    return JSONResponse(_answer(asset, done))


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
