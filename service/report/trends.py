"""The trends of a report: wear depth with its limit and the life ahead, and the vibration level, by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from service.report.content import Report

MEASURED, MODEL, LIMIT, AHEAD = "#333333", "#1f77b4", "#c62828", "#9a6700"
SIZE = (7.2, 2.5)  # inches
LIMIT_SHOWN = 3.0  # times the depth: a limit above that is named, and not drawn
AHEAD_FACTOR = 2.0  # the axis reaches at most so many times the revolutions run, for the life ahead


def depth_trend(report: Report) -> Figure | None:
    """Wear depth with its band over the revolutions, the limit, and the life ahead; None without two depths.

    Where effects were found, the depth is that of the whole history evaluated again with them.
    """
    points = report.depths or _points(report.records, "wear_depth_um")
    if len(points) < 2:
        return None
    figure, axes = _axes("wear depth [µm]")
    x, y = zip(*points, strict=True)
    if report.depths:
        axes.plot(x, y, color=MODEL, marker="o", ms=3, label="wear depth, evaluated again with the effects found")
    else:
        low, high = (dict(_points(report.records, f"wear_depth_{p}_um")) for p in ("p05", "p95"))
        banded = [n for n in x if n in low and n in high]
        if banded:
            axes.fill_between(banded, [low[n] for n in banded], [high[n] for n in banded], color=MODEL, alpha=0.2, lw=0)
        axes.plot(x, y, color=MODEL, marker="o", ms=3, label="wear depth" + (", 5–95 % band" if banded else ""))
    end = _ahead(report, axes, x[-1], y[-1])
    if report.limit_um is not None and (report.limit_um < LIMIT_SHOWN * max(y) or end):
        axes.axhline(report.limit_um, color=LIMIT, ls="--", lw=1.2, label=f"limit {report.limit_um:.0f} µm")
    elif report.limit_um is not None:
        axes.plot([], [], color=LIMIT, ls="--", lw=1.2, label=f"limit {report.limit_um:.0f} µm, above the scale")
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left", frameon=False, fontsize=8)
    return figure


def _ahead(report: Report, axes: Any, now: float, depth: float) -> bool:
    """The path to the limit where it is near enough to be drawn; whether it is."""
    life, limit = report.life_revolutions, report.limit_um
    if life is None or limit is None or life.get("median") is None or not 0 < life["median"] <= AHEAD_FACTOR * now:
        return False
    ends = [now + life[key] for key in ("p05", "p95") if life.get(key) is not None]
    axes.plot([now, now + life["median"]], [depth, limit], color=AHEAD, ls=":", lw=1.4, label="expected, present load")
    axes.plot(
        ends, [limit] * len(ends), color=AHEAD, lw=4, alpha=0.5, solid_capstyle="butt", label="end of life, 5–95 %"
    )
    return True


def level_trend(report: Report) -> Figure | None:
    """Measured and modelled vibration level over the revolutions; over the measurements where none are counted."""
    key = "revolutions" if _points(report.records, "rms_measured") else "index"
    measured = _points(report.records, "rms_measured", key)
    if len(measured) < 2:
        return None
    figure, axes = _axes(
        "vibration level, RMS [m/s²]", "revolutions of the pinion" if key == "revolutions" else "measurement"
    )
    axes.plot(*zip(*measured, strict=True), color=MEASURED, marker="o", ms=3, label="measured")
    modelled = _points(report.records, "rms_after", key) or _points(report.records, "rms_predicted", key)
    if modelled:
        axes.plot(*zip(*modelled, strict=True), color=MODEL, ls="--", marker="x", ms=4, label="model, after its update")
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left", frameon=False, fontsize=8)
    return figure


def trends(report: Report) -> list[tuple[str, Figure]]:
    """The figures that there is something to draw in, each with its text alternative."""
    figures = []
    depth, level = depth_trend(report), level_trend(report)
    if depth is not None:
        (start, first), *_, (end, last) = report.depths or _points(report.records, "wear_depth_um")
        text = f"Wear depth from {first:.1f} µm at {start:,.0f} revolutions to {last:.1f} µm at {end:,.0f}."
        figures.append((text, depth))
    if level is not None:
        values = [r["rms_measured"] for r in report.records if r.get("rms_measured") is not None]
        text = f"Vibration level from {min(values):.3g} to {max(values):.3g} m/s²; the latest is {values[-1]:.3g} m/s²."
        figures.append((text, level))
    return figures


def as_svg(figure: Figure) -> str:
    """A figure as an SVG element, without the head of a file."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    drawn = text.getvalue()
    return drawn[drawn.index("<svg") :]


def as_png(figure: Figure, dpi: int = 220) -> io.BytesIO:
    """A figure as a PNG file in memory."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=dpi)
    out.seek(0)
    return out


def _axes(label: str, along: str = "revolutions of the pinion") -> tuple[Figure, Any]:
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel(along, fontsize=9)
    axes.set_ylabel(label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _points(records: Sequence[Mapping[str, Any]], key: str, along: str = "revolutions") -> list[tuple[float, float]]:
    """What measurements hold under a key, along their revolutions; in the order of these."""
    return sorted(
        (r[along], r[key])
        for r in records
        if r.get("kind") != "calibration" and r.get(along) is not None and r.get(key) is not None
    )
