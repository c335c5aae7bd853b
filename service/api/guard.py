"""Every route declares the role that it needs, and nothing of it runs before that is checked.

    router = Routes("things", prefix="/v1")

    @router.entry("POST /something", Role.operate, Answer, 404, 422)
    async def something(request: Request) -> Any: ...

A route that declares none cannot be made. Writes are accepted from the page's own origin only, whoever sends them.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar
from urllib.parse import urlsplit

from fastapi import APIRouter, FastAPI, Request
from fastapi.routing import APIRoute, iter_route_contexts
from starlette.concurrency import run_in_threadpool
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount

from service.access.access import Access, Refused
from service.access.keys import PREFIX
from service.access.roles import Role, Who
from service.api.limits import BODY
from service.api.problems import problem
from service.api.problems import responses as problems

Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])
Handler = Callable[[Request], Coroutine[Any, Any, Response]]
Responses = dict[int | str, dict[str, Any]]

COOKIE = "gear-twin-key"
HEADER = "x-api-key"
SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
PUBLIC = "public"
REFUSALS = {  # that each operation may be answered with, whoever asks
    "403": "Forbidden",
    "413": "Content Too Large",
    "414": "URI Too Long",
    "415": "Unsupported Media Type",
    "421": "Misdirected Request",
    "429": "Too Many Requests",
    "431": "Request Header Fields Too Large",
}
_AT_ONCE = 4  # threads that wait for an issuer's keys: other requests have the others


class Guarded(APIRoute):
    """A route that is entered with the role it declares alone; checked before the request's body is read.

    The body of a route that names no limit may have the size of most bodies.
    """

    def __init__(self, path: str, endpoint: Callable[..., Any], **given: Any) -> None:
        self.needs: Role | str | None = getattr(endpoint, "needs", None)
        if self.needs is None:
            raise TypeError(f"{path}: {endpoint.__name__} declares no role; make it by Routes.entry")
        super().__init__(path, endpoint, **{**given, "max_body_size": given.get("max_body_size") or BODY})

    def get_route_handler(self) -> Handler:
        handler, role = super().get_route_handler(), self.needs

        async def guarded(request: Request) -> Response:
            if request.method not in SAFE:
                _demand_own_origin(request)
            if isinstance(role, Role):
                access: Access = request.app.state.access
                request.state.who = who = await who_asks(request)
                access.demand(who, role)
            return await handler(request)

        return guarded


class Routes(APIRouter):
    """Routes about one subject, each declared in one line."""

    def __init__(self, *tags: str, **given: Any) -> None:
        super().__init__(tags=list(tags), route_class=Guarded, **given)

    def entry(
        self,
        where: str,
        role: Role | str,
        model: Any = None,
        *refusals: int,
        queued: bool = False,
        responses: Responses | None = None,
        **given: Any,
    ) -> Callable[[Endpoint], Endpoint]:
        """Declares a route.

        where      method and path
        role       that it needs; PUBLIC: it is for everybody, and can ask `who_asks` what more to say
        model      of its answer; None where the answer is not JSON
        refusals   statuses of the problems that it may answer
        queued     whether it may answer with 202 and the same model
        responses  what else is described of its answers
        """
        method, _, path = where.partition(" ")
        described = ({202: {"model": model}} if queued else {}) | (responses or {}) | problems(*refusals)

        def declared(endpoint: Endpoint) -> Endpoint:
            endpoint.needs = role  # type: ignore[attr-defined]
            self.add_api_route(path, endpoint, methods=[method], response_model=model, responses=described, **given)
            return endpoint

        return declared


async def who_asks(request: Request) -> Who:
    """Whom a request comes from; Refused where its credential is wrong."""
    access: Access = request.app.state.access
    credential, address = credential_of(request), address_of(request)
    if credential is None or credential.startswith(PREFIX) or access.tokens is None:
        return access.who(credential, address, getattr(request.state, "certificate", None))
    async with request.app.state.waiting_for_issuer:
        return await run_in_threadpool(access.who, credential, address)


async def may_read(request: Request) -> bool:
    """Whether a public route may say more than that the service runs."""
    try:
        return (await who_asks(request)).may(Role.read)
    except Refused:
        return False


def credential_of(request: Request) -> str | None:
    """The key or token of a request: of its headers, else of the page's cookie."""
    scheme, _, given = request.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and given.strip():
        return given.strip()
    return request.headers.get(HEADER) or request.cookies.get(COOKIE) or None


def address_of(request: Request) -> str | None:
    return request.client.host if request.client else None


def roles(app: FastAPI) -> dict[str, Role | str | None]:
    """The role that each route of the app needs, by `METHOD path`; None where none is declared."""
    found: dict[str, Role | str | None] = {}
    for context in iter_route_contexts(app.routes):
        route = context.original_route
        if isinstance(route, Mount):
            found[f"MOUNT {context.path}"] = PUBLIC if route.name == "static" else None
            continue
        for method in sorted(context.methods or {"?"}):
            found[f"{method} {context.path}"] = getattr(route, "needs", None)
    return found


def install(app: FastAPI, enter: Callable[[Request, Who, int, str], None] | None = None) -> None:
    """Answers refusals as problems that say what is needed; RuntimeError where a route declares no role.

    enter  enters an attempt that was refused in the audit log: a write, or one with a credential; a few a minute
    """
    app.state.waiting_for_issuer = asyncio.Semaphore(_AT_ONCE)
    # the description of the interface is FastAPI's own route
    open_routes = {f"{method} {app.openapi_url}" for method in SAFE}
    undeclared = [name for name, role in roles(app).items() if role is None and name not in open_routes]
    if undeclared:
        raise RuntimeError(f"routes without a role: {', '.join(undeclared)}")

    @app.exception_handler(Refused)
    async def refused(request: Request, error: Refused) -> JSONResponse:
        headers = {"Cache-Control": "no-store"}
        if error.status == 401:
            headers["WWW-Authenticate"] = 'Bearer realm="gear-twin"'
        if error.retry_after is not None:
            headers["Retry-After"] = str(error.retry_after)
        extra = {} if error.needs is None else {"needs": error.needs.value}
        access: Access = request.app.state.access
        if enter is not None and (request.method not in SAFE or credential_of(request)) and access.enters_refusal():
            who = getattr(request.state, "who", None) or Who(
                kind="anonymous", name=None, role=None, address=address_of(request)
            )
            await run_in_threadpool(enter, request, who, error.status, error.detail)
        return problem(request, error.status, error.detail, headers, **extra)


def described(schema: dict[str, Any], app: FastAPI) -> None:
    """Adds credentials, roles and refusals to the description of the interface."""
    schemes = schema.setdefault("components", {}).setdefault("securitySchemes", {})
    schemes["bearer"] = {"type": "http", "scheme": "bearer", "description": "an API key, or a token of the issuer"}
    schemes["key"] = {"type": "apiKey", "in": "header", "name": "X-API-Key"}
    answer = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
    for name, role in roles(app).items():
        method, _, path = name.partition(" ")
        operation = schema["paths"].get(path, {}).get(method.lower())
        if operation is None:
            continue
        refusals = REFUSALS
        if isinstance(role, Role):
            operation["security"] = [
                {"bearer": []},
                {"key": []},
                {},
            ]  # none: this computer's clients, where there are no credentials
            operation["x-role"] = role.value
            refusals = {"401": "Unauthorized", **REFUSALS}
        for status, said in refusals.items():
            operation["responses"].setdefault(status, {"description": said, "content": answer})


def _demand_own_origin(request: Request) -> None:
    """Refused where a page of another origin makes a browser write."""
    origin = request.headers.get("origin", request.headers.get("referer"))  # older browsers send that alone
    if origin is None:
        if request.headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none"):
            return
        raise _foreign(request, "another site")
    if origin == "null" or urlsplit(origin).netloc.lower() != request.headers.get("host", "").lower():
        raise _foreign(request, origin)


def _foreign(request: Request, origin: str) -> Refused:
    access: Access = request.app.state.access
    access.refused += 1
    detail = f"a page of {origin[:100]} may not change anything here; only this service's own page may"
    access.note(address_of(request), detail)
    return Refused(403, detail)
