"""A view: named curves over one axis with markers, and its JSON with no more points than a screen shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from service.errors import InputError

MOST_POINTS = 20_000
DIGITS, X_DIGITS = 6, 10  # significant ones in JSON


class UnknownChannel(InputError):
    """A channel that the window does not have; `known` are those it has."""

    def __init__(self, channel: str, known: tuple[str, ...]) -> None:
        super().__init__(f"the window has no channel {channel!r}; it has {', '.join(known) or 'none'}")
        self.known = known


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions:
    """What may be chosen of a view; what does not concern one is not read by it."""

    channel: str | None = None  # label; None for the reference accelerometer
    shaft: str = "pinion"  # whose turns a synchronous average is over
    averaged: bool = False  # whether a spectrum is averaged over segments
    rms: bool = False  # whether a spectrum shows RMS instead of peak amplitudes
    band: tuple[float, float] | None = None  # of the envelope [Hz]; None for the most impulsive one
    without_lines: bool = False  # whether lines of the shafts are removed before the envelope is taken


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Axis:
    """What lies along x."""

    label: str
    unit: str
    values: np.ndarray  # (n,)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Series:
    """One curve, over the view's axis or over its own."""

    name: str  # measured, modelled, …
    unit: str
    values: np.ndarray  # (n,)
    x: np.ndarray | None = None  # (n,); None where the view's axis holds
    kind: str = "curve"  # curve, or lines: single spectral lines that are zero between


@dataclass(frozen=True, slots=True, kw_only=True)
class Marker:
    """Where something is expected."""

    kind: str  # mesh, sideband, shaft or bearing
    label: str
    x: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class View:
    """One view of one window; its figures are read-only."""

    view: str
    channel: str
    title: str
    x: Axis
    series: tuple[Series, ...]
    markers: tuple[Marker, ...] = ()
    notes: tuple[str, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)  # RMS and what else one number says
    thinned: str = "extremes"  # how points are left out: extremes, peaks, or none
    equal_axes: bool = False  # whether x and y are lengths on one scale


def as_json(view: View, points: int, low: float | None = None, high: float | None = None) -> dict[str, Any]:
    """The view as JSON data, of an excerpt of x where given, with about `points` values a curve."""
    shown = [_shown(view, s, points, low, high) for s in view.series]
    x = next((x for s, (x, _, _) in zip(view.series, shown, strict=True) if s.x is None), view.x.values[:0])
    return {
        "view": view.view,
        "channel": view.channel,
        "title": view.title,
        "x": {"label": view.x.label, "unit": view.x.unit, "values": rounded(x, X_DIGITS)},
        "series": [
            {
                "name": s.name,
                "unit": s.unit,
                "kind": s.kind,
                **({} if s.x is None else {"x": rounded(own, X_DIGITS)}),
                "values": rounded(values, DIGITS),
                "points_total": total,
            }
            for s, (own, values, total) in zip(view.series, shown, strict=True)
        ],
        "markers": [{"kind": m.kind, "label": m.label, "x": m.x} for m in view.markers],
        "figures": dict(view.figures),
        "equal_axes": view.equal_axes,
        "notes": list(view.notes),
    }


def _shown(
    view: View, series: Series, points: int, low: float | None, high: float | None
) -> tuple[np.ndarray, np.ndarray, int]:
    x, y = (view.x.values if series.x is None else series.x), series.values
    if low is not None or high is not None:
        inside = np.flatnonzero((x >= (-np.inf if low is None else low)) & (x <= (np.inf if high is None else high)))
        if inside.size:
            cut = slice(max(inside[0] - 1, 0), inside[-1] + 2)
            x, y = x[cut], y[cut]
        else:
            x, y = x[:0], y[:0]
    total = int(x.size)
    if view.thinned != "none" and series.kind == "curve" and total > points:
        keep = extremes(y, points) if view.thinned == "extremes" else peaks(y, points)
        x, y = x[keep], y[keep]
    return x, y, total


def extremes(values: np.ndarray, points: int) -> np.ndarray:
    """Indices of the least and the largest value of every stretch, about `points` of them, rising."""
    stretches = max(points // 2, 1)
    size = -(-values.size // stretches)
    whole = values.size // size * size
    finite = np.where(np.isfinite(values), values, 0.0)
    rows = finite[:whole].reshape(-1, size)
    begin = np.arange(rows.shape[0]) * size
    found = np.concatenate((begin + rows.argmin(axis=1), begin + rows.argmax(axis=1), [0, values.size - 1]))
    if whole < values.size:
        rest = finite[whole:]
        found = np.concatenate((found, [whole + rest.argmin(), whole + rest.argmax()]))
    return np.unique(found)


def peaks(values: np.ndarray, points: int) -> np.ndarray:
    """Index of the largest value of every stretch, about `points` of them, rising."""
    size = -(-values.size // max(points, 1))
    padded = np.full(-(-values.size // size) * size, -np.inf)
    padded[: values.size] = np.where(np.isfinite(values), values, -np.inf)
    rows = padded.reshape(-1, size)
    return np.minimum(np.arange(rows.shape[0]) * size + rows.argmax(axis=1), values.size - 1)


def rounded(values: np.ndarray, digits: int) -> list[float | None]:
    """Values to so many significant digits; None where not finite."""
    x = np.asarray(values, dtype=float)
    return [float(f"{v:.{digits}g}") if ok else None for v, ok in zip(x.tolist(), np.isfinite(x), strict=True)]
