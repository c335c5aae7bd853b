"""REST: the report about one asset, for people."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query, Request
from fastapi.responses import Response

from service.access.roles import Role
from service.api.guard import Responses, Routes
from service.api.headers import DOCUMENT
from service.api.reading import snapshot_of

router = Routes("assets", prefix="/v1/assets")

POINTS = 200  # of the trends, about
FILES: Responses = {
    200: {
        "description": "The report",
        "content": {"text/html": {"schema": {"type": "string"}}, "application/pdf": {"schema": {"type": "string"}}},
    }
}


@router.entry("GET /{asset}/report", Role.read, None, 404, 422, responses=FILES, response_class=Response)
def report(
    request: Request,
    asset: str,
    format: Annotated[Literal["html", "pdf"], Query(description="one HTML page, or a PDF of two pages")] = "html",
) -> Response:
    """Conclusion and action, trends with the limit, what else was found and how sure; the method in an appendix."""
    from service.report import FORMATS, rendered
    from service.report.content import report_of

    snapshot = snapshot_of(request, asset)
    history = request.app.state.store.outline(snapshot.asset, POINTS)
    latest = list(snapshot.whole["windows"])
    first = latest[0]["index"] if latest else 0
    records = [w.record for w in history if w.record["index"] < first] + latest
    content = report_of({**snapshot.whole, "windows": records}, snapshot.rig)
    name = f"{asset}-{(snapshot.latest.get('index') or 0)}.{format}"
    shown = "inline" if format == "html" else "attachment"
    headers = {"Content-Disposition": f'{shown}; filename="{name}"', "Content-Security-Policy": DOCUMENT}
    return Response(rendered(content, format), media_type=FORMATS[format], headers=headers)
