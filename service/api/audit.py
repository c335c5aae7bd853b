"""REST: the audit log; and how routes enter what they do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, TypeVar

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field

from service.access.access import Access
from service.access.roles import Role, Who
from service.api.guard import Guarded, needs
from service.api.problems import responses
from service.contract.base import AnswerModel, iso_time
from service.results.audit_log import AuditLog

router = APIRouter(prefix="/v1", tags=["access"], route_class=Guarded)

LARGEST = 2**53
LONGEST_PATH = 500
NS = 1e9
T = TypeVar("T")


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


@router.get("/audit", response_model=list[AuditEntry], responses=responses(422))
@needs(Role.administer)
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
    work: Callable[[], T],
    *,
    note: str | None = None,
    what: Mapping[str, Any] | None = None,
    queued: bool = False,
) -> T:
    """Runs a change and enters it in the audit log, in one transaction; answers what the change does.

    queued  whether `work` answers the number of a job, which is carried out later
    """
    log: AuditLog = request.app.state.audit
    enter_keys(log, request.app.state.access)
    with log.transaction():
        done = work()
        job = done if queued and isinstance(done, int) else None
        log.enter(request.state.who, action, asset=asset, note=note, what=what, job=job)
    return done


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
