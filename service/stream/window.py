"""One window from the pieces of its frames: samples and edges laid out in time, faults named and counted.

What is lost or not finite becomes NaN, so that index and time stay tied to each other. How a fault is
dealt with is its `action`: `repaired` (the rest is sound), `degraded` (something essential is missing or
not to be trusted), `refused` (nothing usable is left), `none` (noted only).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from service.stream.frames import NS, EncoderFrame, Frame, SampleFrame
from twin.windows import Edges, Fault, Samples, Window

QUALITIES = {"none": "good", "repaired": "repaired", "degraded": "degraded", "refused": "refused"}
_SEVERITY = tuple(QUALITIES)
REPAIRABLE = 0.2  # share of a channel that may be missing before its window is degraded
_TIME_SLACK_NS = 20_000  # of a frame's start, beyond one sample [ns]
_EDGE_SLACK = 0.02  # share of edges that may come out of order by noise; more, and the shaft ran backwards
_FLAT_RUN = 4  # equal extreme samples in a row that no vibration gives: clipped
_PILE = 5  # samples at the extreme level, and times as many as at the level before it, that none gives either
_MARGIN = 0.05  # [s] by which channels may start and end apart
_NOTHING_LEFT = "neither an accelerometer nor an encoder is left"
_SAME_RATE = 1e-5  # relative: a rate measured frame by frame is not a change of rate


F = TypeVar("F", SampleFrame, EncoderFrame, Frame)


@dataclass(frozen=True)
class Piece(Generic[F]):
    """Values `begin` to `end` (exclusive) of one frame, and the frames lost directly before it."""

    frame: F
    begin: int
    end: int
    lost: int = 0

    @property
    def start_ns(self) -> float:
        """Unix time of the piece's first value [ns]."""
        if isinstance(self.frame, EncoderFrame):
            return self.frame.start_time_ns
        return self.frame.start_time_ns + self.begin / self.frame.sample_rate * NS

    @property
    def size(self) -> int:
        return self.end - self.begin


def split_index(frame: Frame, time_ns: int) -> int:
    """Number of the frame's values that lie before a time."""
    ahead = time_ns - frame.start_time_ns
    if isinstance(frame, EncoderFrame):
        return int(np.searchsorted(np.maximum.accumulate(frame.edge_offsets_ns), ahead)) if ahead > 0 else 0
    return int(np.clip(np.ceil(ahead / NS * frame.sample_rate - 1e-6), 0, frame.values.size))


def build_window(
    start_ns: int,
    end_ns: int,
    pieces: Mapping[str, Sequence[Piece]],
    known: Collection[str] = (),
    counted: Mapping[str, int] | None = None,
) -> Window:
    """The window of pieces by channel label.

    known    channels that earlier windows had
    counted  edges that each encoder had counted by their end
    """
    groups: dict[str, dict] = {"accel": {}, "torque": {}, "encoder": {}}
    faults: list[Fault] = []
    for label in sorted(pieces):
        kind, name = label.split("/", 1)
        parts = sorted(pieces[label], key=lambda p: (p.start_ns, p.frame.sequence))
        build: Any = _edges if kind == "encoder" else _samples
        channel = build(label, parts, start_ns, end_ns, faults)
        if channel is None:
            continue
        groups[kind][name] = channel
        if kind == "encoder":
            _note_reset(label, channel.first_index, (counted or {}).get(label, 0), faults)
    for label in sorted(set(known) - set(pieces)):
        faults.append(
            Fault(kind="missing_channel", channel=label, count=1, action="degraded", detail="was there before")
        )
    if not groups["accel"] and not groups["encoder"]:
        still = any(f.kind == "standstill" for f in faults)
        detail = "no edge passed: the machine stands still" if still else _NOTHING_LEFT
        faults.append(Fault(kind="nothing_usable", channel="", count=1, action="refused", detail=detail))
    worst = max((_SEVERITY.index(f.action) for f in faults), default=0)
    return Window(
        start_time_ns=start_ns,
        accelerations=groups["accel"],
        torques=groups["torque"],
        encoders=groups["encoder"],
        faults=tuple(faults),
        quality=QUALITIES[_SEVERITY[worst]],
    )


def _majority(
    label: str,
    parts: Sequence[Piece[F]],
    value: Callable[[Piece[F]], float],
    unit: str,
    faults: list[Fault],
) -> list[Piece[F]]:
    """The pieces that agree with the rate most values have; the others count as a rate change."""
    sizes: dict[float, int] = {}
    for part in parts:
        sizes[value(part)] = sizes.get(value(part), 0) + part.size + 1
    rate = max(sizes, key=lambda r: (sizes[r], r))
    keep = [p for p in parts if abs(value(p) - rate) <= _SAME_RATE * rate]
    if len(keep) < len(parts):
        others = ", ".join(f"{r:g}" for r in sorted(sizes) if r != rate)
        detail = f"{others} {unit} among {rate:g} {unit}: those frames were left out"
        faults.append(
            Fault(
                kind="rate_change",
                channel=label,
                count=len(parts) - len(keep),
                action="degraded",
                detail=detail,
            )
        )
    return keep


def _samples(
    label: str, parts: Sequence[Piece[SampleFrame]], start_ns: int, end_ns: int, faults: list[Fault]
) -> Samples | None:
    """One evenly sampled channel; None where nothing of it is left."""
    parts = [p for p in _majority(label, parts, lambda p: p.frame.sample_rate, "Hz", faults) if p.size]
    if not parts:
        return None
    rate, origin = parts[0].frame.sample_rate, parts[0].start_ns
    places, expected, overlap = [], 0, 0
    for part in parts:
        offset = (part.start_ns - origin) / NS * rate
        index = round(offset)
        if abs(offset - expected) <= 1 + _TIME_SLACK_NS / NS * rate:
            index = expected
        skip = min(max(expected - index, 0), part.size)
        overlap += skip
        places.append((index + skip, part, skip))
        expected = max(expected, index + part.size)
    values = np.full(expected, np.nan)
    for index, part, skip in places:
        values[index : index + part.size - skip] = part.frame.values[part.begin + skip : part.end]
    holes = expected - sum(p.size - skip for _, p, skip in places)
    values[~np.isfinite(values)] = np.nan
    bad = int(np.count_nonzero(np.isnan(values))) - holes
    if overlap:
        detail = "samples given twice by overlapping frames, the first kept"
        faults.append(Fault(kind="overlap", channel=label, count=overlap, action="repaired", detail=detail))
    if bad:
        action = _by_share(bad / expected)
        faults.append(Fault(kind="nan", channel=label, count=bad, action=action, detail="samples not finite"))
    head = (origin - start_ns) / NS
    tail = (end_ns - origin) / NS - expected / rate
    _note_gaps(label, parts, holes / rate, (head, tail), (end_ns - start_ns) / NS, faults)
    if label.startswith("accel/"):
        _note_clipping(label, values, faults)
    if bad + holes == expected:
        return None
    return Samples(rate=rate, start=head, values=values)


def _by_share(share: float) -> str:
    return "repaired" if share <= REPAIRABLE else "degraded"


def _note_gaps(
    label: str,
    parts: Sequence[Piece[Any]],
    hole: float,
    ends: tuple[float, float],
    length: float,
    faults: list[Fault],
) -> None:
    """Lost frames and stretches without samples [s], inside the record and at its ends."""
    lost = sum(p.lost for p in parts)
    missing = hole + sum(e for e in ends if e > _MARGIN)
    if missing > 0 or lost:
        action = _by_share(missing / length) if missing > 0 else "none"
        where = f"{missing:.4g} s of {length:.4g} s missing" if missing > 0 else "before this window"
        detail = f"{lost} frames lost; {where}"
        faults.append(Fault(kind="gap", channel=label, count=max(lost, 1), action=action, detail=detail))


def _note_clipping(label: str, values: np.ndarray, faults: list[Fault]) -> None:
    """Extreme values that repeat: the sensor or its converter was at its end."""
    finite = values[np.isfinite(values)]
    if finite.size < 2 * _FLAT_RUN:
        return
    low, high = finite.min(), finite.max()
    if low == high:
        detail = f"every sample is {low:g}: cable or supply?"
        faults.append(Fault(kind="stuck", channel=label, count=finite.size, action="degraded", detail=detail))
        return
    count = sum(_held(finite, sign) for sign in (-1, 1))
    if count:
        detail = f"samples held at {low:g} or {high:g}: measuring range exceeded"
        faults.append(Fault(kind="clipping", channel=label, count=count, action="degraded", detail=detail))


def _held(finite: np.ndarray, sign: int) -> int:
    """How many samples lie at one extreme because the range ended there; 0 where it was only reached.

    The tail of a vibration thins out towards its extreme. A clipped one ends in a level that holds far more samples
    than the level before it, or stays there for several samples in a row.
    """
    signed = sign * finite
    extreme = signed.max()
    at = signed == extreme
    count = int(at.sum())
    before = signed[~at].max(initial=-np.inf)
    piled = count >= _PILE and count > _PILE * int((signed == before).sum())
    return count if piled or _in_runs(at) else 0


def _in_runs(flags: np.ndarray) -> int:
    """How many of the flags lie in runs of at least _FLAT_RUN."""
    places = np.flatnonzero(flags)
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    return sum(run.size for run in runs if run.size >= _FLAT_RUN)


def _edges(
    label: str, parts: Sequence[Piece[EncoderFrame]], start_ns: int, end_ns: int, faults: list[Fault]
) -> Edges | None:
    """One encoder; None where its edges cannot be trusted."""
    parts = [p for p in _majority(label, parts, lambda p: p.frame.edges_per_rev, "edges/rev", faults) if p.size]
    if not parts:
        detail = "no edge passed: the shaft stands still"
        faults.append(Fault(kind="standstill", channel=label, count=1, action="none", detail=detail))
        return None
    first = parts[0].frame.first_edge_index + parts[0].begin
    total = sum(p.size for p in parts)
    times, expected, missing, overlap = [], first, 0, 0
    for part in parts:
        index = part.frame.first_edge_index + part.begin
        hole, skip = index - expected, 0
        if (hole < 0 and index + part.size <= expected) or hole > 2 * total + 1000:
            _note_reversed(label, 1, f"count goes from {expected} to {index}", faults)
            return None
        if hole > 0:
            times.append(np.full(hole, np.nan))
            missing += hole
        elif hole < 0:
            skip = -hole
            overlap += skip
        offset = (part.frame.start_time_ns - start_ns) / NS
        times.append(offset + part.frame.edge_offsets_ns[part.begin + skip : part.end] / NS)
        expected = index + part.size
    joined = np.concatenate(times)
    known = np.where(np.isnan(joined), -np.inf, joined)
    before = np.maximum.accumulate(np.concatenate(([-np.inf], known[:-1])))
    falling = np.isfinite(known) & (known <= before)
    if np.count_nonzero(falling) > max(1, _EDGE_SLACK * total):
        _note_reversed(label, int(np.count_nonzero(falling)), "edge times do not rise", faults)
        return None
    if falling.any():
        joined[falling] = np.nan
        count = int(np.count_nonzero(falling))
        faults.append(
            Fault(kind="edge_order", channel=label, count=count, action="repaired", detail="edges not rising")
        )
    if overlap:
        faults.append(
            Fault(kind="overlap", channel=label, count=overlap, action="repaired", detail="edges given twice")
        )
    lost = sum(p.lost for p in parts)
    if missing or lost:
        share = missing / max(expected - first, 1)
        action = _by_share(share) if missing else "none"
        where = f"{missing} edges missing" if missing else "before this window"
        detail = f"{lost} frames lost; {where}"
        faults.append(Fault(kind="gap", channel=label, count=max(lost, 1), action=action, detail=detail))
    return Edges(per_rev=parts[0].frame.edges_per_rev, first_index=first, times=joined)


def _note_reversed(label: str, count: int, why: str, faults: list[Fault]) -> None:
    detail = f"encoder runs backwards ({why}); channels swapped, or turning the wrong way?"
    faults.append(Fault(kind="reversed", channel=label, count=count, action="degraded", detail=detail))


def _note_reset(label: str, first: int, counted: int, faults: list[Fault]) -> None:
    """A count that has fallen since the window before: revolutions can no longer be told from it."""
    if first < counted:
        detail = f"edge count falls from {counted} to {first} between windows; counter reset?"
        faults.append(Fault(kind="counter_reset", channel=label, count=1, action="degraded", detail=detail))


def totals(faults: Iterable[Fault]) -> dict[tuple[str, str], int]:
    """Counts by (channel, kind)."""
    out: dict[tuple[str, str], int] = {}
    for fault in faults:
        out[fault.channel, fault.kind] = out.get((fault.channel, fault.kind), 0) + fault.count
    return out
