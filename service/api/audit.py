"""REST: the audit log; and how routes enter what they do."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any

from fastapi import Query, Request
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from service.access.access import Access
from service.access.roles import Role, Who
from service.api.guard import Routes
from service.contract.base import AnswerModel, iso_time
from service.errors import FAULT
from service.results.audit_log import AuditLog
from service.results.job_queue import JobQueue
from service.results.jobs import Job

router = Routes("access", prefix="/v1")

LARGEST = 2**53
LONGEST_PATH = 500
NS = 1e9


class AuditEntry(AnswerModel):
    """One change, or an attempt."""

    id: int
    at: str = Field(description="ISO 8601, by the service's clock")
    kind: str = Field(description="`key`, `token`, `certificate`, `local` (its own computer) or `anonymous`")
    name: str | None = Field(description="of the key, the token's or the certificate's subject")
    role: str | None
    address: str | None = Field(description="of the client")
    action: str
    asset: str | None
    what: dict[str, Any]
    note: str | None = Field(description="why")
    outcome: str = Field(description="`done`, `queued`, or why it was refused")


class AuditQuery(BaseModel):
    """Which entries are asked for."""

    after: int | None = Field(None, ge=0, le=LARGEST, description="only those behind this id; default: the newest")
    limit: int = Field(100, ge=1, le=10_000, description="at most this many")


@router.entry("GET /audit", Role.administer, list[AuditEntry], 422)
def audit(request: Request, query: Annotated[AuditQuery, Query()]) -> Any:
    """Who changed what, when and why, oldest first; the newest entries where no cursor is given."""
    log: AuditLog = request.app.state.audit
    enter_keys(log, request.app.state.access)
    after = log.latest(query.limit) if query.after is None else query.after
    found = log.entries(after, query.limit)
    return JSONResponse([{"at": iso_time(entry.pop("at_ns")), **entry} for entry in found])


def audited(
    request: Request,
    action: str,
    asset: str | None,
    work: Callable[[], Any],
    *,
    note: str | None = None,
    what: Mapping[str, Any] | None = None,
) -> None:
    """Runs a change and enters it in the audit log, in one transaction."""
    with _entering(request) as log:
        work()
        log.enter(request.state.who, action, asset=asset, note=note, what=what)


async def submitted(
    request: Request,
    asset: str,
    own: str,
    kind: str,
    given: Mapping[str, Any],
    *,
    note: str | None = None,
    what: Mapping[str, Any] | None = None,
) -> Job:
    """Submits a job that somebody gives for an asset, and waits for it: the job, settled or queued.

    asset, own  its name, as given, and its id
    note, what  of its entry in the audit log; `what` is what is given where it is None
    """
    queue: JobQueue = request.app.state.queue

    def kept() -> int:
        with _entering(request) as log:
            number = queue.submit(own, kind, given)
            log.enter(request.state.who, kind, asset=asset, note=note, what=given if what is None else what, job=number)
        return number

    number = await run_in_threadpool(kept)
    done = await queue.wait(number, request.app.state.decision_wait)
    return await run_in_threadpool(queue.jobs.job, number) if done is None else done


def accepted(job: Job, status: int) -> int:
    """The status once a job has been carried out, or 202 while it is queued; HTTPException where it was refused."""
    if job.refused is not None:
        raise HTTPException(500 if job.refused.startswith(FAULT) else 409, job.refused)
    return status if job.settled else 202


@contextmanager
def _entering(request: Request) -> Iterator[AuditLog]:
    """The audit log, in a transaction; the keys that were changed meanwhile are entered before."""
    log: AuditLog = request.app.state.audit
    enter_keys(log, request.app.state.access)
    with log.transaction():
        yield log


def refused(request: Request, who: Who, status: int, detail: str) -> None:
    """Enters an attempt that was refused."""
    what = {"method": request.method, "path": request.url.path[:LONGEST_PATH], "status": status}
    request.app.state.audit.enter(who, "refused", what=what, outcome=detail)


def enter_keys(log: AuditLog, access: Access) -> None:
    """Enters what the command line has done to the keys since the last time."""
    if access.keys is None or not access.keys.changed(log.keys_seen):
        return
    log.keys_seen, entered = access.keys.version, log.keys_entered()
    nobody = Who(kind="local", name=None, role=Role.administer, address=None)
    for key in access.keys.all():
        for event, moment in (("made", key.created), ("revoked", key.revoked)):
            note = f"{event} {key.id}"
            if moment is not None and note not in entered:
                what = {"name": key.name, "role": key.role.value, "at": iso_time(round(moment * NS))}
                log.enter(nobody, "key", note=note, what=what)


def signer(request: Request, given: str | None) -> str | None:
    """Who signs a change: the name of the credential where there is one, whatever was given."""
    who: Who = request.state.who
    return who.name if who.name is not None else ((given or "").strip() or None)
