"""The dashboard at `/` and the OpenAPI page at `/docs`, both without a network.

All addresses in them are relative, so that they work under a sub-path of a proxy.

Charts are drawn by uPlot (service/page/vendor), the OpenAPI page by Swagger UI, which is served from the installed
package that carries it (`fastapi-offline`).
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import FileResponse, HTMLResponse, Response
from starlette.exceptions import HTTPException
from starlette.staticfiles import StaticFiles

from service.api.guard import PUBLIC, Routes
from service.api.headers import policy_with_scripts

router = Routes(include_in_schema=False)

PAGE = Path(__file__).parent.parent / "page"
BORROWED = {
    "swagger-ui-bundle.js": ("fastapi_offline", "static/swagger-ui-bundle.js", "text/javascript"),
    "swagger-ui.css": ("fastapi_offline", "static/swagger-ui.css", "text/css"),
}


def borrowed(name: str) -> Path:
    """Where the installed package keeps the asset; the package is found without importing it."""
    package, path, _ = BORROWED[name]
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise FileNotFoundError(f"the package {package} is not installed: it carries {name}")
    return Path(spec.origin).parent / path


@router.entry("GET /", PUBLIC)
async def dashboard() -> FileResponse:
    return FileResponse(PAGE / "index.html", media_type="text/html", headers={"Cache-Control": "no-cache"})


@router.entry("GET /docs", PUBLIC)
async def docs(request: Request) -> HTMLResponse:
    page = get_swagger_ui_html(
        openapi_url=request.app.openapi_url.lstrip("/"),
        title="gear-twin: REST",
        swagger_js_url="assets/swagger-ui-bundle.js",
        swagger_css_url="assets/swagger-ui.css",
        swagger_favicon_url="static/favicon.svg",
    )
    page.headers["Content-Security-Policy"] = policy_with_scripts(bytes(page.body).decode())
    return page


@router.entry("GET /assets/{name}", PUBLIC)
async def asset_of_package(name: str) -> FileResponse:
    if name not in BORROWED:
        raise HTTPException(404)
    headers = {"Cache-Control": "max-age=86400"}
    return FileResponse(borrowed(name), media_type=BORROWED[name][2], headers=headers)


class Revalidated(StaticFiles):
    """Files that the browser keeps, and asks for again by their ETag: a new version is shown at once."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        response = super().file_response(*args, **kwargs)
        response.headers["Cache-Control"] = "no-cache"
        return response


def mount_static(app: FastAPI) -> None:
    app.mount("/static", Revalidated(directory=PAGE), name="static")
