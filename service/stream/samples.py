"""An evenly sampled channel of one window, laid out in time from the pieces of its frames.

What is lost, not finite, or beyond what a sensor can measure becomes NaN, so that index and time stay tied to each
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from service.stream.channels import ChannelKind
from service.stream.frames import NS, SampleFrame
from service.stream.pieces import Piece, of_one_rate
from service.stream.quality import by_share
from twin.compiled.statistics import extremes
from twin.features.despike import spikes
from twin.features.end_of_range import RAIL, samples_at_end_of_range
from twin.rig import Rig
from twin.thresholds import deciding
from twin.windows import Fault, Samples

_TIME_SLACK_NS = 20_000  # of a frame's start, beyond one sample [ns]
_LEVELS = 16  # different values from which a load is said to vary
MOST_SAMPLES = 2**26  # of all channels of one window: 512 MiB
_MARGIN = 0.05  # [s] by which channels may start and end apart


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeThresholds:
    """How far beyond its nominal range a sensor may be believed."""

    over_range: float = deciding(
        1.1,
        of="full scale that the rig file states for the sensor",
        meaning="largest value that is taken for a measured one",
        source="not derived: chosen so that a converter whose full scale lies somewhat above the nominal range is left "
        "to the check for clipping",
    )


RANGE = RangeThresholds()


class Span(NamedTuple):
    """Start and end of a window, Unix time [ns]."""

    start_ns: int
    end_ns: int

    @property
    def length(self) -> float:
        """[s]"""
        return (self.end_ns - self.start_ns) / NS


class _Placed(NamedTuple):
    """Where the pieces of a channel lie among its samples."""

    places: list[tuple[int, Piece[SampleFrame], int]]  # index, piece, values of it that are there already
    size: int  # samples of the channel, holes included
    overlap: int  # samples that frames give twice


def lay_samples(
    label: str,
    kind: ChannelKind,
    parts: Sequence[Piece[SampleFrame]],
    span: Span,
    faults: list[Fault],
    rig: Rig | None = None,
    most: int = MOST_SAMPLES,
) -> Samples | None:
    """One evenly sampled channel, its faults added to `faults`; None where nothing of it is left.

    rig   whose sensor ranges hold in place of the kind's limits
    most  samples that it may have, gaps included
    """
    parts = [p for p in of_one_rate(label, parts, lambda p: p.frame.sample_rate, "Hz", faults) if p.size]
    if not parts:
        return None
    sampling, origin = parts[0].frame.sample_rate, parts[0].start_ns
    placed = _placed(parts, sampling, origin)
    if placed.size > most:
        came = sum(p.size for p in parts)
        detail = (
            f"{placed.size:.3g} samples at {sampling:g} Hz, of which {came} have come, exceed the {most:.3g} that this "
            "window has room for: channel left out; is sample_rate_hz right?"
        )
        faults.append(Fault(kind="too_large", channel=label, count=len(parts), action="degraded", detail=detail))
        return None
    values = _joined(placed)
    holes = placed.size - sum(p.size - skip for _, p, skip in placed.places)
    if placed.overlap:
        detail = "samples given twice by overlapping frames, the first kept"
        faults.append(Fault(kind="overlap", channel=label, count=placed.overlap, action="repaired", detail=detail))
    bad = _drop_unusable(label, values, holes, limits_of(kind, label, rig), kind.unit, faults)
    head = (origin - span.start_ns) / NS
    tail = (span.end_ns - origin) / NS - placed.size / sampling
    _note_gaps(label, parts, holes / sampling, (head, tail), span.length, faults)
    _note_dead_or_clipped(label, kind, values, faults)
    if kind.vibration:
        _take_drift_out(label, values, sampling, kind.unit, faults)
    if bad + holes == placed.size:
        return None
    return Samples(rate=sampling, start=head, values=values)


def limits_of(
    kind: ChannelKind, label: str, rig: Rig | None, thresholds: RangeThresholds = RANGE
) -> tuple[float, float]:
    """Between which values a channel can measure, in its unit: by the rig file, else by its kind."""
    low, high = kind.values
    full_scale = None if rig is None else rig.sensor_range(kind.segment, label.partition("/")[2])
    if full_scale is None:
        return low, high
    reach = thresholds.over_range * full_scale
    return max(low, -reach), min(high, reach)


def _placed(parts: Sequence[Piece[SampleFrame]], rate: float, origin: float) -> _Placed:
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
    return _Placed(places, expected, overlap)


def _joined(placed: _Placed) -> np.ndarray:
    """The samples of all pieces in one row, NaN where there are none; (n,)."""
    values, at = np.empty(placed.size), 0
    with np.errstate(invalid="ignore"):  # a signalling NaN is one like any other
        for index, part, skip in placed.places:
            values[at:index] = np.nan
            at = max(at, index + part.size - skip)
            values[index : index + part.size - skip] = part.frame.values[part.begin + skip : part.end]
    values[at:] = np.nan
    return values


def _drop_unusable(
    label: str, values: np.ndarray, holes: int, limits: tuple[float, float], unit: str, faults: list[Fault]
) -> int:
    """Makes NaN of what cannot have been measured; how many samples that concerns, beside the holes."""
    low, high = limits
    bad = beyond = 0
    if not (values.min() >= low and values.max() <= high):  # or one is not a number
        finite = np.isfinite(values)
        outside = finite & ((values < low) | (values > high))
        values[~finite | outside] = np.nan
        bad, beyond = int(np.count_nonzero(~finite)) - holes, int(np.count_nonzero(outside))
    spiked = spikes(values)
    single = int(np.count_nonzero(spiked))
    if single:
        values[spiked] = np.nan
    for kind, count, detail in (
        ("nan", bad, "samples not finite"),
        ("out_of_range", beyond, f"samples outside [{low:g}, {high:g}] {unit}, which the sensor cannot measure"),
        ("spike", single, "single samples far beyond all others, which no filtered signal has"),
    ):
        if count:
            action = by_share(count / values.size)
            faults.append(Fault(kind=kind, channel=label, count=count, action=action, detail=detail))
    return bad + beyond + single


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
        action = by_share(missing / length) if missing > 0 else "none"
        where = f"{missing:.4g} s of {length:.4g} s missing" if missing > 0 else "before this window"
        detail = f"{lost} frames lost; {where}"
        faults.append(Fault(kind="gap", channel=label, count=max(lost, 1), action=action, detail=detail))


def _take_drift_out(label: str, values: np.ndarray, rate: float, unit: str, faults: list[Fault]) -> None:
    """Takes the drift of a sensor's zero out of its values (n,)."""
    from twin.features.baseline_drift import baseline_drift  # loads scipy, which a start does without

    drift = baseline_drift(values, rate)
    if drift is None:
        return
    values -= drift
    detail = (
        f"the zero of the sensor moves by {np.ptp(drift):.3g} {unit} within the window, as one that settles or changes "
        "its temperature: taken out"
    )
    faults.append(Fault(kind="drift", channel=label, count=1, action="repaired", detail=detail))


def _note_dead_or_clipped(label: str, kind: ChannelKind, values: np.ndarray, faults: list[Fault]) -> None:
    """A record without any variation, and extreme values that repeat: the sensor or its converter was at its end."""
    ends = extremes(values)
    low, high = ends.low, ends.high
    if ends.finite < 2 * RAIL.least:
        return
    if low == high:
        detail = f"every sample is {low:g}: cable or supply?"
        faults.append(Fault(kind="stuck", channel=label, count=ends.finite, action="degraded", detail=detail))
        return
    if ends.lowest + ends.highest < RAIL.least:  # far too few for any of what follows
        return
    finite = values if ends.finite == values.size else values[np.isfinite(values)]
    count, where = 0, f"{low:g} or {high:g}"
    if kind.vibration:
        count = samples_at_end_of_range(finite)
    elif kind.loads:
        count, where = samples_of_load_at_limit(finite), f"{max(low, high, key=abs):g}"
    if count:
        detail = f"samples held at {where}: measuring range exceeded"
        faults.append(Fault(kind="clipping", channel=label, count=count, action="degraded", detail=detail))


def samples_of_load_at_limit(finite: np.ndarray) -> int:
    """How many samples of a load lie at its largest value because the range ended there; 0 where they do not.

    A load may hold a level, and its steps may be coarse: it is clipped where it varies over many levels and reaches the
    largest again and again, far more often than the level before it.
    """
    size = np.abs(finite)
    extreme = size.max()
    at = size == extreme
    before = size[~at].max(initial=0.0)
    visits = int(at[0]) + int(np.count_nonzero(np.diff(at.astype(int)) == 1))
    piled = int(at.sum()) > RAIL.piled * int((size == before).sum())
    varied = np.unique(finite).size >= _LEVELS
    return int(at.sum()) if piled and varied and visits >= RAIL.least else 0
