"""Errors as `application/problem+json` (RFC 9457): one shape for every status, faults of the program included."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from contextlib import suppress
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import FAULT, StorageUnavailable, StoreError
from service.results.names import Names
from service.stream.wire.topics import NAME

MEDIA_TYPE = "application/problem+json"
log = logging.getLogger(__name__)


class UnknownAsset(Exception):
    """An asset that no frame has come from."""

    def __init__(self, asset: str, known: tuple[str, ...]) -> None:
        super().__init__(asset)
        self.asset, self.known = asset, known


def problem(
    request: Request, status: int, detail: str, headers: Mapping[str, str] | None = None, **extra: Any
) -> JSONResponse:
    """The answer for one error."""
    content = {
        "type": "about:blank",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "detail": detail,
        "instance": request.url.path,
        **extra,
    }
    return JSONResponse(content, status, dict(headers or {}), media_type=MEDIA_TYPE)


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI's description of the errors of one route."""
    schema = {"$ref": "#/components/schemas/Problem"}
    return {
        status: {"description": HTTPStatus(status).phrase, "content": {MEDIA_TYPE: {"schema": schema}}}
        for status in statuses
    }


def install(app: FastAPI) -> None:
    """Makes every error of the app a problem document."""

    @app.exception_handler(UnknownAsset)
    async def unknown_asset(request: Request, error: UnknownAsset) -> JSONResponse:
        name = None
        with suppress(StoreError):  # the answer is right without it
            if NAME.fullmatch(error.asset):  # else no asset can have had it
                name = await run_in_threadpool(_renamed, request.app.state.names, error.asset)
        known = ", ".join(error.known) or "none yet"
        if name is not None:
            detail = f"asset {error.asset!r} has another name now: {name!r}"
            return problem(request, 404, detail, known=list(error.known), renamed=name)
        detail = f"no asset {error.asset!r} has been seen; known assets: {known}"
        return problem(request, 404, detail, known=list(error.known))

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        faults = [{"at": [str(p) for p in e["loc"]], "fault": e["msg"]} for e in error.errors()]
        detail = "; ".join(f"{'.'.join(f['at'])}: {f['fault']}" for f in faults)
        return problem(request, 422, detail, errors=faults)

    @app.exception_handler(HTTPException)
    async def http_error(request: Request, error: HTTPException) -> JSONResponse:
        detail = error.detail
        if error.status_code == 404 and detail == "Not Found":
            detail = f"nothing is served at {request.url.path}; /docs lists what is"
        elif error.status_code == 405:
            allowed = (error.headers or {}).get("Allow", "another method")
            detail = f"{request.method} is not served at {request.url.path}; {allowed} is"
        return problem(request, error.status_code, detail, error.headers)

    @app.exception_handler(StorageUnavailable)
    async def storage(request: Request, error: StorageUnavailable) -> JSONResponse:
        kept = (
            "it may have been kept: look before you try again" if error.unknown else "nothing was kept, try again later"
        )
        return problem(request, 503, f"{error}; {kept}")


def _renamed(names: Names, name: str) -> str | None:
    """What the asset is called now that was called so before; None where none was."""
    asset = names.labelled(name)
    return None if asset is None else names.label(asset)


class Faults:
    """The middleware that answers a fault of the program: its details are in the log, once, and nowhere else.

    It belongs within what adds headers to every answer. An answer that has begun is cut off.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun = False

        async def noted(message: Message) -> None:
            nonlocal begun
            begun = begun or message["type"] == "http.response.start"
            await send(message)

        try:
            await self._app(scope, receive, noted)
        except Exception as error:
            log.error("%s %s failed", scope["method"], scope["path"], exc_info=error)
            if not begun:
                detail = f"{FAULT}; the log of the service has the details"
                await problem(Request(scope), 500, detail)(scope, receive, send)
