"""REST: signing in and out of the page, and who asks."""

from __future__ import annotations

from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from service.access.access import Access, Refused
from service.access.roles import Role, Who
from service.api.guard import COOKIE, PUBLIC, Routes, address_of, who_asks
from service.contract.base import AnswerModel

router = Routes("access", prefix="/v1")

SIGNED_IN = 12 * 3600  # how long the page's cookie is kept [s]
LONGEST = 8192  # characters of a key or token


class SignIn(BaseModel):
    """A key or token."""

    model_config = ConfigDict(extra="forbid", strict=True)

    key: str = Field(min_length=1, max_length=LONGEST, pattern=r"^[\x21-\x7e]+$", description="API key, or token")


class Session(AnswerModel):
    """Who asks, and what he may do."""

    signed_in: bool
    name: str | None = Field(description="of the key, or of the token's subject")
    role: Role | None = Field(description="null where a credential is needed first")
    credentials: bool = Field(description="false where the service has none: then its own computer may do everything")


@router.entry("GET /session", PUBLIC, Session, 429)
async def session(request: Request) -> Any:
    """Who asks, and what he may do."""
    access: Access = request.app.state.access
    try:
        who = await who_asks(request)
    except Refused:
        return await sign_out(request)
    return _answer(who, access)


@router.entry("POST /session", PUBLIC, Session, 400, 401, 422, 429)
async def sign_in(request: Request, given: SignIn) -> Any:
    """Keeps a key or token in a cookie that scripts cannot read; it is sent to this service's own page alone."""
    access: Access = request.app.state.access
    who = await run_in_threadpool(access.who, given.key, address_of(request))
    answer = _answer(who, access)
    answer.set_cookie(
        COOKIE,
        given.key,
        max_age=SIGNED_IN,
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
        path="/",
    )
    return answer


@router.entry("DELETE /session", PUBLIC, Session)
async def sign_out(request: Request) -> Any:
    """Removes the cookie."""
    access: Access = request.app.state.access
    answer = _answer(access.who(None, address_of(request)), access)
    answer.delete_cookie(COOKIE, httponly=True, samesite="strict", path="/")
    return answer


def _answer(who: Who, access: Access) -> JSONResponse:
    return JSONResponse(
        {
            "signed_in": who.kind not in ("local", "anonymous"),
            "name": who.name,
            "role": who.role,
            "credentials": access.configured,
        },
        headers={"Cache-Control": "no-store"},
    )
