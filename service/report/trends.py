"""The trends of a report: wear depth with its limit and the life ahead, and the vibration level, by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from service.report.content import Report

MEASURED, MODEL, LIMIT, AHEAD = "#333333", "#1f77b4", "#c62828", "#9a6700"
REVOLUTIONS = "revolutions of the pinion"
SIZE = (7.2, 2.5)  # inches
LIMIT_SHOWN = 3.0  # times the depth: a limit above that is named, and not drawn
AHEAD_FACTOR = 2.0  # the axis reaches at most so many times the revolutions run, for the life ahead


def figure_of(report: Report, figure: Figure) -> Figure:
    """Every trend that there is something to draw of, one above the other; ValueError where there is none."""
    drawn = [
        draw for draw, points in ((_draw_depth, _depths(report)), (_draw_level, _levels(report))) if len(points) > 1
    ]
    if not drawn:
        raise ValueError(f"{report.asset}: fewer than two measurements with a depth or a level, so there is no trend")
    figure.set_size_inches(SIZE[0], SIZE[1] * len(drawn))
    for draw, axes in zip(drawn, figure.subplots(len(drawn), squeeze=False)[:, 0], strict=True):
        draw(report, axes)
    return figure


def trends(report: Report) -> list[tuple[str, Figure]]:
    """The figures that there is something to draw in, each with its text alternative."""
    figures = []
    depths, levels = _depths(report), _levels(report)
    if len(depths) > 1:
        (start, first), *_, (end, last) = depths
        text = f"Wear depth from {first:.1f} µm at {start:,.0f} revolutions to {last:.1f} µm at {end:,.0f}."
        figures.append((text, _drawn(_draw_depth, report)))
    if len(levels) > 1:
        values = [level for _, level in levels]
        text = f"Vibration level from {min(values):.3g} to {max(values):.3g} m/s²; the latest is {values[-1]:.3g} m/s²."
        figures.append((text, _drawn(_draw_level, report)))
    return figures


def _drawn(draw: Callable[[Report, Any], None], report: Report) -> Figure:
    figure = Figure(figsize=SIZE, layout="constrained")
    draw(report, figure.subplots())
    return figure


def _depths(report: Report) -> Sequence[tuple[float, float]]:
    """Revolutions and depth; where effects were found, those of the whole history evaluated again with them."""
    return report.depths or _points(report.records, "wear_depth_um")


def _levels(report: Report) -> list[tuple[float, float]]:
    return _points(report.records, "rms_measured", _along(report))


def _along(report: Report) -> str:
    """What the levels are drawn over: revolutions, or the number of the measurement where none are counted."""
    return "revolutions" if _points(report.records, "rms_measured") else "index"


def _draw_depth(report: Report, axes: Any) -> None:
    """Wear depth with its band, the limit, and the life ahead."""
    _label(axes, "wear depth [µm]")
    x, y = zip(*_depths(report), strict=True)
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


def _draw_level(report: Report, axes: Any) -> None:
    """Measured and modelled vibration level."""
    along = _along(report)
    _label(axes, "vibration level, RMS [m/s²]", REVOLUTIONS if along == "revolutions" else "measurement")
    axes.plot(*zip(*_levels(report), strict=True), color=MEASURED, marker="o", ms=3, label="measured")
    modelled = _points(report.records, "rms_after", along) or _points(report.records, "rms_predicted", along)
    if modelled:
        axes.plot(*zip(*modelled, strict=True), color=MODEL, ls="--", marker="x", ms=4, label="model, after its update")
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left", frameon=False, fontsize=8)


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


def _label(axes: Any, label: str, along: str = REVOLUTIONS) -> None:
    axes.set_xlabel(along, fontsize=9)
    axes.set_ylabel(label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def _points(records: Sequence[Mapping[str, Any]], key: str, along: str = "revolutions") -> list[tuple[float, float]]:
    """What measurements hold under a key, along their revolutions; in the order of these."""
    return sorted(
        (r[along], r[key])
        for r in records
        if r.get("kind") != "calibration" and r.get(along) is not None and r.get(key) is not None
    )
