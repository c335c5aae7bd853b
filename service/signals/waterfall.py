"""Spectra of many windows over one another: the largest amplitude of every bin, window by window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from service.errors import NotKept
from service.results.signal_thinning import KeptWindow
from service.signals.markers import markers_of
from service.signals.subject import Subject
from service.signals.view import Marker, UnknownChannel, ViewOptions
from service.signals.views import VIEWS
from twin.errors import NotAvailable, TwinError
from twin.rig import Rig

FINE = 8192  # bins that a row is kept with


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Row:
    """One window's spectrum, the largest amplitude of FINE even bins from zero to `top`."""

    channel: str
    unit: str
    x_label: str
    x_unit: str
    top: float
    speed: float | None  # of the pinion [Hz]
    values: np.ndarray  # (FINE,) float32


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Waterfall:
    """Amplitudes of windows over frequency or order."""

    view: str
    channel: str
    unit: str
    x_label: str
    x_unit: str
    x: np.ndarray  # middle of every bin (bins,)
    windows: tuple[KeptWindow, ...]
    values: np.ndarray  # (windows, bins), as far as all windows reach
    markers: tuple[Marker, ...]
    left_out: tuple[tuple[int, str], ...]  # windows without this spectrum, and why
    notes: tuple[str, ...]


def row_of(subject: Subject, channel: str | None, view: str) -> Row | str:
    """A window's row, or why it has none."""
    try:
        found = VIEWS[view](subject, ViewOptions(channel=channel))
    except (TwinError, UnknownChannel) as error:
        return str(error)
    x, top = found.x.values, float(found.x.values[-1])
    return Row(
        channel=found.channel,
        unit=found.series[0].unit,
        x_label=found.x.label,
        x_unit=found.x.unit,
        top=top,
        speed=found.figures.get("speed_hz"),
        values=binned(x, found.series[0].values, top, FINE).astype(np.float32),
    )


def binned(x: np.ndarray, values: np.ndarray, top: float, bins: int) -> np.ndarray:
    """The largest value of every bin, the nearest one where a bin has none; (n,), (n,) → (bins,)."""
    place = np.minimum((x / top * bins).astype(int), bins - 1)
    out = np.full(bins, -np.inf)
    np.maximum.at(out, place, values)
    empty = ~np.isfinite(out)
    if empty.any():
        out[empty] = np.interp(np.flatnonzero(empty), np.flatnonzero(~empty), out[~empty])
    return out


def waterfall(
    kept: Sequence[KeptWindow],
    row: Callable[[KeptWindow], Row | str],
    view: str,
    *,
    rows: int,
    bins: int,
    high: float | None,
    rig: Rig,
) -> Waterfall:
    """The rows of at most so many windows, evenly chosen; NotAvailable where not one has a spectrum."""
    chosen = [kept[i] for i in np.unique(np.linspace(0, len(kept) - 1, min(rows, len(kept))).round().astype(int))]
    shown: list[tuple[KeptWindow, Row]] = []
    left_out: list[tuple[int, str]] = []
    for window in chosen:
        try:
            found = row(window)
        except NotKept as error:  # given up since the list was made
            found = str(error)
        if isinstance(found, str):
            left_out.append((window.number, found))
        else:
            shown.append((window, found))
    if not shown:
        raise NotAvailable(
            f"no window that is kept has this spectrum: {left_out[0][1]}" if left_out else "no window is kept"
        )
    first = shown[0][1]
    top = min(high or np.inf, min(r.top for _, r in shown))
    x = (np.arange(bins) + 0.5) * top / bins
    values = np.array([_spread(r, top, bins) for _, r in shown])
    speeds = [r.speed for _, r in shown if r.speed]
    in_orders = view == "order-spectrum"
    same = bool(speeds) and max(speeds) <= 1.02 * min(speeds)
    notes = [f"{len(shown)} of {len(kept)} windows that are kept", "Largest peak amplitude of every bin"]
    if not in_orders and not same:
        notes.append("The speed differs from window to window: nothing is marked; the order spectrum lines them up")
    markers = markers_of(rig, 1.0 if in_orders else speeds[-1] if same else 0.0, top)
    return Waterfall(
        view=view,
        channel=first.channel,
        unit=first.unit,
        x_label=first.x_label,
        x_unit=first.x_unit,
        x=x,
        windows=tuple(w for w, _ in shown),
        values=values,
        markers=markers,
        left_out=tuple(left_out),
        notes=tuple(notes),
    )


def _spread(row: Row, top: float, bins: int) -> np.ndarray:
    """A row on other bins: the largest of its own in each."""
    edges = np.linspace(0, top, bins + 1) / row.top * FINE
    begin = np.minimum(edges[:-1].astype(int), FINE - 1)
    end = np.maximum(np.ceil(edges[1:]).astype(int), begin + 1)
    return np.array([row.values[a:b].max() for a, b in zip(begin, end, strict=True)], dtype=float)
