"""REST: signals to look at, as JSON, CSV or a picture; trends of the condition indicators."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np
from fastapi import Path, Query, Request
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field

from service.access.roles import Role
from service.api.assets import HistoryQuery, history
from service.api.guard import Responses, Routes
from service.api.problems import problem
from service.api.reading import asset_of
from service.contract import signals as models
from service.contract.base import iso_time
from service.errors import NotKept
from service.results.signal_thinning import KeptWindow
from service.signals import tables
from service.signals.trends import Trends, trends_of
from service.signals.view import MOST_POINTS, X_DIGITS, UnknownChannel, ViewOptions, as_json, rounded
from twin.errors import TwinError

if TYPE_CHECKING:  # they load half of the twin
    from service.signals.library import Library
    from service.signals.waterfall import Waterfall

router = Routes("signals", prefix="/v1/assets")

LARGEST = 2**53
MAP_DIGITS = 4
NOT_KEPT = "this service keeps no raw signals"
ViewName = Literal[
    "waveform", "spectrum", "order-spectrum", "envelope-spectrum", "synchronous-average", "transmission-error", "flank"
]
Theme = Literal["light", "dark"]
Format = Literal["json", "csv", "png"]
FILES: Responses = {
    200: {"content": {"text/csv": {"schema": {"type": "string"}}, "image/png": {"schema": {"type": "string"}}}}
}


class ViewQuery(BaseModel):
    """What may be chosen of a view."""

    channel: str | None = Field(None, max_length=140, description="such as `accel/y6`; the reference accelerometer")
    format: Format = Field("json", description="CSV has every point")
    shaft: Literal["pinion", "gear"] = Field("pinion", description="whose turns a synchronous average is over")
    averaged: bool = Field(False, description="a spectrum averaged over 15 segments that overlap by half")
    scale: Literal["peak", "rms"] = Field("peak", description="amplitudes of a spectrum")
    band_low_hz: float | None = Field(None, ge=0, le=1e7, description="of the envelope; the most impulsive band")
    band_high_hz: float | None = Field(None, gt=0, le=1e7)
    without_lines: bool = Field(False, description="removes lines of the shafts before the envelope is taken")
    modelled: bool = Field(True, description="whether the twin's prediction is added where there is a model")
    points: int = Field(2000, ge=10, le=MOST_POINTS, description="of a curve in JSON, about")
    x_from: float | None = Field(None, ge=-1e12, le=1e12, description="an excerpt, in the unit of x (JSON)")
    x_to: float | None = Field(None, ge=-1e12, le=1e12)
    theme: Theme = "light"
    log: bool = Field(False, description="logarithmic amplitudes in the picture")
    markers: str = Field("mesh,bearing", max_length=60, description="kinds drawn in the picture")

    def options(self) -> ViewOptions:
        given = self.band_low_hz is not None and self.band_high_hz is not None
        return ViewOptions(
            channel=self.channel,
            shaft=self.shaft,
            averaged=self.averaged,
            rms=self.scale == "rms",
            band=(float(self.band_low_hz or 0), float(self.band_high_hz or 0)) if given else None,
            without_lines=self.without_lines,
        )


class WaterfallQuery(BaseModel):
    """What may be chosen of a waterfall."""

    channel: str | None = Field(None, max_length=140, description="such as `accel/y6`; the reference accelerometer")
    view: Literal["spectrum", "order-spectrum"] = "spectrum"
    format: Format = "json"
    windows: int = Field(60, ge=1, le=200, description="rows at most, evenly chosen from the windows that are kept")
    bins: int = Field(400, ge=20, le=2000, description="columns")
    x_to: float | None = Field(None, gt=0, le=1e7, description="highest frequency or order")
    theme: Theme = "light"


class IndicatorQuery(HistoryQuery):
    """Which part of the history, and which quantities."""

    format: Format = "json"
    quantity: list[str] = Field([], max_length=40, description="names of quantities; all where none is given")
    axis: Literal["revolutions", "time", "index"] = Field("revolutions", description="of the picture")
    theme: Theme = "light"


@router.entry("GET /{asset}/signals", Role.read, models.Signals, 404, 422)
def signals(request: Request, asset: str) -> Any:
    """Which windows' raw signals are kept, and what can be looked at of the newest."""
    own, library = asset_of(request, asset), _library(request)
    kept = () if library is None else library.kept(own)
    channels: tuple[str, ...] = ()
    reason = None
    if library is None:
        reason = NOT_KEPT
    elif not kept:
        reason = "no window's raw signals are kept yet"
    else:
        try:
            channels = library.subject(own, kept[-1].number, modelled=False).channels
        except NotKept as error:
            reason = str(error)
    return JSONResponse(
        {
            "asset": asset,
            "windows": [_listed(w) for w in kept],
            "channels": list(channels),
            "views": list(get_args(ViewName)),
            "bytes": sum(w.bytes for w in kept),
            "reason": reason,
        }
    )


Index = Annotated[int, Path(ge=0, le=LARGEST)]


@router.entry(
    "GET /{asset}/windows/{index}/signals/{view}", Role.read, models.SignalView, 404, 409, 422, responses=FILES
)
def view(request: Request, asset: str, index: Index, view: ViewName, query: Annotated[ViewQuery, Query()]) -> Any:
    """One view of a window's signals, measured and, where there is a model, modelled."""
    own, library = asset_of(request, asset), _library(request)
    if library is None:
        return problem(request, 404, NOT_KEPT)
    if (query.band_low_hz is None) is not (query.band_high_hz is None):
        return problem(request, 422, "band_low_hz and band_high_hz must both be given, or neither")
    try:
        found = library.view(own, index, view, query.options(), query.modelled)
    except UnknownChannel as error:
        return problem(request, 404, str(error), channels=list(error.known))
    except NotKept as error:
        return problem(request, 404, str(error), kept=[w.number for w in library.kept(own)])
    except TwinError as error:
        return problem(request, 409, str(error))
    start = next((w.start_ns for w in library.kept(own) if w.number == index), None)
    started = None if start is None else iso_time(start)
    name = f"{asset}-{index}-{found.view}"
    if query.format == "csv":
        return _csv(tables.as_csv(found), name)
    if query.format == "png":
        kinds = tuple(query.markers.split(","))
        heading = f"{asset}, window {index}, {started}"
        from service.signals import pictures  # matplotlib, which few services ever draw with

        return _png(pictures.as_png(found, heading, query.theme, query.log, kinds), name)
    content = as_json(found, query.points, query.x_from, query.x_to)
    return JSONResponse({"asset": asset, "window": index, "start_time": started, **content})


@router.entry("GET /{asset}/waterfall", Role.read, models.Waterfall, 404, 409, 422, responses=FILES)
def waterfall(request: Request, asset: str, query: Annotated[WaterfallQuery, Query()]) -> Any:
    """Spectra of all windows that are kept over one another."""
    own, library = asset_of(request, asset), _library(request)
    if library is None:
        return problem(request, 404, NOT_KEPT)
    try:
        found = library.waterfall(own, query.channel, query.view, rows=query.windows, bins=query.bins, high=query.x_to)
    except TwinError as error:
        return problem(request, 409, str(error))
    name = f"{asset}-waterfall-{query.view}"
    if query.format == "csv":
        heads = [tables.named(found.x_label, found.x_unit)]
        heads += [tables.named(f"window {w.number}", found.unit) for w in found.windows]
        return _csv(tables.table(heads, [found.x, *found.values]), name)
    if query.format == "png":
        labels = (tables.named(found.x_label, found.x_unit), "revolutions", found.unit)
        rows = [f"{w.number}" if w.revolutions is None else f"{w.revolutions:.0f}" for w in found.windows]
        if all(w.revolutions is None for w in found.windows):
            labels = (labels[0], "window", labels[2])
        title = f"Waterfall of {found.channel}"
        from service.signals import pictures  # matplotlib, which few services ever draw with

        return _png(
            pictures.heat_map(found.values, found.x, rows, labels, title, asset, query.theme, found.notes), name
        )
    return JSONResponse({"asset": asset, **_waterfall(found)})


@router.entry("GET /{asset}/indicators", Role.read, models.Indicators, 404, 409, 422, responses=FILES)
def indicators(request: Request, asset: str, query: Annotated[IndicatorQuery, Query()]) -> Any:
    """Condition indicators, levels, speed, torque and temperatures of the windows, oldest first."""
    found = trends_of(history(request, asset, query))
    known = [t.name for t in found.quantities]
    unknown = [name for name in query.quantity if name not in known]
    if unknown:
        detail = f"no window has {', '.join(unknown)}; known are {', '.join(known) or 'none yet'}"
        return problem(request, 404, detail, quantities=known)
    shown = [t for t in found.quantities if not query.quantity or t.name in query.quantity]
    columns = [np.array([np.nan if v is None else v for v in t.values], dtype=float) for t in shown]
    name = f"{asset}-indicators"
    if query.format == "csv":
        heads = ["index", "start_time", "revolutions", *(tables.named(t.label, t.unit) for t in shown)]
        return _csv(_trend_table(found, heads, columns), name)
    if query.format == "png":
        if not shown:
            return problem(request, 409, "no window has a figure to draw")
        curves = [(t.label, t.unit, c) for t, c in zip(shown[:12], columns, strict=False)]
        x, label = _axis(found, query.axis)
        from service.signals import pictures  # matplotlib, which few services ever draw with

        return _png(pictures.trends(curves, x, label, "Condition indicators", asset, query.theme), name)
    return JSONResponse(
        {
            "asset": asset,
            "index": list(found.index),
            "start_time": list(found.start_time),
            "revolutions": list(found.revolutions),
            "quality": list(found.quality),
            "quantities": [
                {"name": t.name, "label": t.label, "unit": t.unit, "group": t.group, "values": rounded(c, 6)}
                for t, c in zip(shown, columns, strict=True)
            ],
        }
    )


def _library(request: Request) -> Library | None:
    opened: Callable[[], Library] | None = request.app.state.library
    return None if opened is None else opened()


def _listed(window: KeptWindow) -> dict[str, Any]:
    return {
        "index": window.number,
        "start_time": iso_time(window.start_ns),
        "revolutions": window.revolutions,
        "bytes": window.bytes,
        "found": window.found,
        "refused": window.refused,
    }


def _waterfall(found: Waterfall) -> dict[str, Any]:
    return {
        "view": found.view,
        "channel": found.channel,
        "unit": found.unit,
        "x": {"label": found.x_label, "unit": found.x_unit, "values": rounded(found.x, X_DIGITS)},
        "windows": [_listed(w) for w in found.windows],
        "values": [rounded(row, MAP_DIGITS) for row in found.values],
        "markers": [{"kind": m.kind, "label": m.label, "x": m.x} for m in found.markers],
        "left_out": [{"index": index, "reason": reason} for index, reason in found.left_out],
        "notes": list(found.notes),
    }


def _axis(found: Trends, axis: str) -> tuple[np.ndarray, str]:
    if axis == "time":
        return np.array([_utc(t) for t in found.start_time], dtype="datetime64[us]"), "time (UTC)"
    if axis == "revolutions" and any(r is not None for r in found.revolutions):
        return np.array([np.nan if r is None else r for r in found.revolutions]), "revolutions of the pinion"
    return np.array(found.index, dtype=float), "window"


def _utc(text: str) -> datetime:
    return datetime.fromisoformat(text).astimezone(UTC).replace(tzinfo=None)


def _trend_table(found: Trends, heads: list[str], columns: list[np.ndarray]) -> str:
    body = tables.table(heads[2:], [np.array([np.nan if r is None else r for r in found.revolutions]), *columns])
    first, *rows = body.splitlines()
    named = [",".join(("index", "start_time", first))]
    named += [f"{i},{t},{row}" for i, t, row in zip(found.index, found.start_time, rows, strict=True)]
    return "\n".join(named) + "\n"


def _csv(text: str, name: str) -> Response:
    head = {"Content-Disposition": f'attachment; filename="{name}.csv"'}
    return Response(text, media_type="text/csv; charset=utf-8", headers=head)


def _png(content: bytes, name: str) -> Response:
    return Response(content, media_type="image/png", headers={"Content-Disposition": f'inline; filename="{name}.png"'})
