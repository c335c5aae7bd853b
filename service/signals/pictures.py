"""Views as PNG pictures, labelled with asset, window, units and scaling; light or dark."""

from __future__ import annotations

import io
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from service.signals.view import MOST_POINTS, View, extremes, peaks

SIZE, DPI = (10.0, 5.6), 120  # inches
DRAWN = min(6000, MOST_POINTS)  # points of a curve
NAMED_MARKERS = 12
ONE_AT_A_TIME = threading.Lock()  # matplotlib's caches of fonts and ticks are not for several threads


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """Colours of one theme; told apart also without colour vision, by their brightness."""

    back: str
    ink: str
    grid: str
    curves: tuple[str, ...]
    markers: dict[str, str]
    map: str  # of a waterfall


LOOKS = {
    "light": Look(
        back="#ffffff", ink="#222222", grid="#dddddd", curves=("#1f4e9c", "#d9730d", "#2a8c55", "#7b3fa0"),
        markers={"mesh": "#777777", "sideband": "#b9b9b9", "shaft": "#2a8c55", "bearing": "#a03c7b"}, map="viridis",
    ),
    "dark": Look(
        back="#16191d", ink="#e6e6e6", grid="#3a3f45", curves=("#7fb2ff", "#ffb15c", "#6fd39b", "#cf9bf0"),
        markers={"mesh": "#9a9a9a", "sideband": "#5f5f5f", "shaft": "#6fd39b", "bearing": "#e79ac6"}, map="viridis",
    ),
}  # fmt: skip


def as_png(
    view: View, heading: str, theme: str = "light", log: bool = False, kinds: Sequence[str] = ("mesh",)
) -> bytes:
    """One view; `kinds` are the kinds of markers drawn, `log` a logarithmic scale of amplitudes."""
    look = LOOKS[theme]
    with ONE_AT_A_TIME:
        figure, axes = _canvas(look)
        for i, s in enumerate(view.series):
            x = view.x.values if s.x is None else s.x
            colour = look.curves[i % len(look.curves)]
            if s.kind == "lines":
                axes.scatter(x, s.values, s=14, facecolors="none", edgecolors=colour, label=s.name, zorder=3)
                continue
            keep = _kept(view, s.values)
            axes.plot(x[keep], s.values[keep], color=colour, linewidth=0.9, label=s.name)
        for marker in [m for m in view.markers if m.kind in kinds]:
            axes.axvline(marker.x, color=look.markers[marker.kind], linewidth=0.6, linestyle=":", zorder=0)
        named = [m for m in view.markers if m.kind in kinds and m.kind in ("mesh", "bearing")][:NAMED_MARKERS]
        for marker in named:
            axes.annotate(
                marker.label, (marker.x, 1), xycoords=("data", "axes fraction"), rotation=90, va="top", ha="right",
                fontsize=6, color=look.markers[marker.kind],
            )  # fmt: skip
        if log and any((s.values > 0).any() for s in view.series):
            axes.set_yscale("log")
        if view.equal_axes:
            axes.set_aspect("equal")
        else:
            axes.margins(x=0)
        axes.set_xlabel(_named(view.x.label, view.x.unit), color=look.ink)
        units = list(dict.fromkeys(s.unit for s in view.series))
        what = "height from the pitch circle" if view.view == "flank" else view.channel
        axes.set_ylabel(_named(what, ", ".join(u for u in units if u)), color=look.ink)
        if len(view.series) > 1:
            axes.legend(loc="upper right", fontsize=8, facecolor=look.back, edgecolor=look.grid, labelcolor=look.ink)
        _headed(figure, look, view.title, heading, view.notes)
        return _png(figure)


def heat_map(
    values: np.ndarray, x: np.ndarray, y_labels: Sequence[str], labels: tuple[str, str, str], title: str, heading: str,
    theme: str = "light", notes: Sequence[str] = (),
) -> bytes:  # fmt: skip
    """A matrix (rows, columns) over x, the first row at the bottom; labels of x, of the rows and of the values."""
    look = LOOKS[theme]
    with ONE_AT_A_TIME:
        figure, axes = _canvas(look)
        positive = values[np.isfinite(values) & (values > 0)]
        low, high = np.percentile(positive, [5, 99.9]) if positive.size else (1e-3, 1.0)
        level = 20 * np.log10(np.maximum(values, low) / high)
        drawn = axes.imshow(
            level, aspect="auto", origin="lower", cmap=look.map, vmax=0.0,
            extent=(float(x[0]), float(x[-1]), -0.5, len(y_labels) - 0.5), interpolation="nearest",
        )  # fmt: skip
        ticks = np.unique(np.linspace(0, len(y_labels) - 1, min(len(y_labels), 12)).astype(int))
        axes.set_yticks(ticks, [y_labels[i] for i in ticks])
        axes.set_xlabel(labels[0], color=look.ink)
        axes.set_ylabel(labels[1], color=look.ink)
        bar = figure.colorbar(drawn, ax=axes)
        bar.set_label(f"dB relative to {high:.3g} {labels[2]}", color=look.ink)
        bar.ax.tick_params(colors=look.ink, labelsize=8)
        axes.grid(False)
        _headed(figure, look, title, heading, notes)
        return _png(figure)


def trends(
    curves: Sequence[tuple[str, str, np.ndarray]], x: np.ndarray, x_label: str, title: str, heading: str,
    theme: str = "light",
) -> bytes:  # fmt: skip
    """Named curves with units over one x, one panel a curve."""
    look = LOOKS[theme]
    with ONE_AT_A_TIME:
        height = max(SIZE[1], 1.6 * len(curves) + 1.2)
        figure = Figure(figsize=(SIZE[0], height), dpi=DPI, facecolor=look.back, layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(len(curves), 1, sharex=True, squeeze=False)[:, 0]
        for panel, (name, unit, values) in zip(panels, curves, strict=True):
            _dressed(panel, look)
            panel.plot(x, values, color=look.curves[0], marker="o", markersize=3, linewidth=0.9)
            panel.set_title(_named(name, unit), color=look.ink, fontsize=8, loc="left")
        panels[-1].set_xlabel(x_label, color=look.ink)
        _headed(figure, look, title, heading, ())
        return _png(figure)


def _kept(view: View, values: np.ndarray) -> Any:
    if values.size <= DRAWN or view.thinned == "none":
        return slice(None)
    return extremes(values, DRAWN) if view.thinned == "extremes" else peaks(values, DRAWN)


def _named(label: str, unit: str) -> str:
    return f"{label} [{unit}]" if unit else label


def _canvas(look: Look) -> tuple[Figure, Any]:
    figure = Figure(figsize=SIZE, dpi=DPI, facecolor=look.back, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    _dressed(axes, look)
    return figure, axes


def _dressed(axes: Any, look: Look) -> None:
    axes.set_facecolor(look.back)
    axes.grid(True, color=look.grid, linewidth=0.5)
    axes.tick_params(colors=look.ink, labelsize=8)
    for side in axes.spines.values():
        side.set_color(look.grid)


def _headed(figure: Figure, look: Look, title: str, heading: str, notes: Sequence[str]) -> None:
    figure.suptitle(f"{title}\n", color=look.ink, fontsize=11, x=0.01, ha="left")
    below = 0.36 / figure.get_size_inches()[1]
    figure.text(0.01, 1 - below, heading, color=look.ink, fontsize=8, va="top")
    if notes:
        figure.supxlabel("\n".join(notes[:3]), color=look.ink, fontsize=6.5, x=0.01, ha="left")


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", facecolor=figure.get_facecolor())
    return out.getvalue()
