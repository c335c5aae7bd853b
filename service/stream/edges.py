"""A shaft encoder of one window: its edges in order, what is missing as NaN."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from service.stream.frames import NS, EncoderFrame
from service.stream.pieces import Piece, of_one_rate
from service.stream.quality import by_share
from twin.windows import Edges, Fault

_EDGE_SLACK = 0.02  # share of edges that may come out of order by noise; more, and the shaft ran backwards
_LARGEST_HOLE = 2  # times the edges that came: more are not missing, the count has jumped ...
_HOLE_SLACK = 1000  # ... beyond so many edges


class _Joined(NamedTuple):
    """The edges of all pieces in one row."""

    times: np.ndarray  # (n,) [s], NaN where missing
    missing: int
    overlap: int


def lay_edges(label: str, parts: Sequence[Piece[EncoderFrame]], start_ns: int, faults: list[Fault]) -> Edges | None:
    """One encoder, its faults added to `faults`; None where its edges cannot be trusted."""
    parts = [p for p in of_one_rate(label, parts, lambda p: p.frame.edges_per_rev, "edges/rev", faults) if p.size]
    if not parts:
        detail = "no edge passed: the shaft stands still"
        faults.append(Fault(kind="standstill", channel=label, count=1, action="none", detail=detail))
        return None
    first = parts[0].frame.first_edge_index + parts[0].begin
    joined = _joined(parts, start_ns, first)
    if isinstance(joined, str):
        _note_reversed(label, 1, joined, faults)
        return None
    times = joined.times
    falling = _falling(times)
    count = int(np.count_nonzero(falling))
    if count > max(1, _EDGE_SLACK * sum(p.size for p in parts)):
        _note_reversed(label, count, "edge times do not rise", faults)
        return None
    if count:
        times[falling] = np.nan
        faults.append(
            Fault(kind="edge_order", channel=label, count=count, action="repaired", detail="edges not rising")
        )
    if joined.overlap:
        faults.append(
            Fault(kind="overlap", channel=label, count=joined.overlap, action="repaired", detail="edges given twice")
        )
    lost = sum(p.lost for p in parts)
    if joined.missing or lost:
        action = by_share(joined.missing / max(times.size, 1)) if joined.missing else "none"
        where = f"{joined.missing} edges missing" if joined.missing else "before this window"
        detail = f"{lost} frames lost; {where}"
        faults.append(Fault(kind="gap", channel=label, count=max(lost, 1), action=action, detail=detail))
    return Edges(per_rev=parts[0].frame.edges_per_rev, first_index=first, times=times)


def _joined(parts: Sequence[Piece[EncoderFrame]], start_ns: int, first: int) -> _Joined | str:
    """The edges of all pieces, by their numbers; why not where the count falls or jumps."""
    total = sum(p.size for p in parts)
    times, expected, missing, overlap = [], first, 0, 0
    for part in parts:
        index = part.frame.first_edge_index + part.begin
        hole, skip = index - expected, 0
        if (hole < 0 and index + part.size <= expected) or missing + hole > _LARGEST_HOLE * total + _HOLE_SLACK:
            return f"count goes from {expected} to {index}"
        if hole > 0:
            times.append(np.full(hole, np.nan))
            missing += hole
        elif hole < 0:
            skip = -hole
            overlap += skip
        offset = (part.frame.start_time_ns - start_ns) / NS
        times.append(offset + part.frame.edge_offsets_ns[part.begin + skip : part.end] / NS)
        expected = index + part.size
    return _Joined(np.concatenate(times), missing, overlap)


def _falling(times: np.ndarray) -> np.ndarray:
    """Which edges do not pass after all before them, (n,)."""
    if np.all(times[1:] > times[:-1]):  # not of NaN
        return np.zeros(times.size, dtype=bool)
    known = np.where(np.isnan(times), -np.inf, times)
    before = np.maximum.accumulate(np.concatenate(([-np.inf], known[:-1])))
    return np.isfinite(known) & (known <= before)


def _note_reversed(label: str, count: int, why: str, faults: list[Fault]) -> None:
    detail = f"encoder runs backwards ({why}); channels swapped, or turning the wrong way?"
    faults.append(Fault(kind="reversed", channel=label, count=count, action="degraded", detail=detail))


def note_reset(label: str, first: int, counted: int, faults: list[Fault]) -> None:
    """A count that has fallen since the window before; whether it is that of the same gears is the twin's to say."""
    if first < counted:
        detail = f"edge count falls from {counted} to {first} between windows"
        detail += "; it begins with this recording" if first == 0 else "; counter reset?"
        faults.append(Fault(kind="counter_reset", channel=label, count=1, action="none", detail=detail))
