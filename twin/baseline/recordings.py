"""What counts as one healthy recording: windows of one source, day and load together, and copies once.

Windows of one file share its day, its load and its mounting: however many they are, they do not show how the machine
differs from one recording to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.baseline.reading import WindowReading
from twin.thresholds import deciding

DAY = 86_400_000_000_000  # [ns]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingThresholds:
    """When two windows are one recording, or one a copy of the other."""

    speed_apart: float = deciding(
        0.001, of="mean speed", meaning="gap between the speeds of windows from which they are of two loads",
        source="not derived: a twentieth of the usual slip of an induction motor at full load",
    )  # fmt: skip
    torque_apart: float = deciding(
        0.1, of="mean torque", meaning="gap between the torques of windows from which they are of two loads",
        source="not derived: a load setting repeats within 10 %",
    )  # fmt: skip
    copy: float = deciding(
        1e-5, of="level of the channel", meaning="difference of every line up to which a window is a copy of another",
        source="derivation: single precision keeps 6e-8, converters of 16 bits 3e-5 of the level times the root of "
        "two over the number of samples; noise of two recordings differs by more than a thousandth",
    )  # fmt: skip


DEFAULT = RecordingThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class Counted:
    """How many recordings windows are."""

    recordings: int
    windows: int
    days: int
    loads: int

    @property
    def text(self) -> str:
        """The count in words."""
        return f"{_of(self.recordings, 'recording')} ({_of(self.windows, 'window')}, {_of(self.days, 'day')}, " + (
            f"{_of(self.loads, 'load')})"
        )


def _of(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def counted(readings: Sequence[WindowReading]) -> Counted:
    """How many recordings, days and loads these windows are of."""
    return Counted(
        recordings=len(set(recording_of(readings))),
        windows=len(readings),
        days=len({r.start_time_ns // DAY for r in readings}),
        loads=len(set(_load_of(readings))),
    )


def recording_of(readings: Sequence[WindowReading]) -> list[int]:
    """Number of the recording that every window belongs to, from 0 on (n,).

    Windows are of one recording where they come from one source (`source#number`), on one day and at one load.
    """
    known: dict[tuple[object, ...], int] = {}
    out = []
    for i, (reading, load) in enumerate(zip(readings, _load_of(readings), strict=True)):
        source, mark, _ = reading.name.rpartition("#")
        key = (source, reading.start_time_ns // DAY, load) if mark else (i,)
        out.append(known.setdefault(key, len(known)))
    return out


def others_of(readings: Sequence[WindowReading]) -> list[list[int]]:
    """For every window the numbers of those of other recordings (n,); of one recording, of its other windows."""
    of = recording_of(readings)
    single = len(set(of)) == 1
    return [[j for j, part in enumerate(of) if (j != i if single else part != of[i])] for i in range(len(of))]


def _load_of(readings: Sequence[WindowReading], limits: RecordingThresholds = DEFAULT) -> list[tuple[int, int]]:
    """Number of the speed and of the torque of every window (n,)."""
    speeds = _apart(np.array([r.speed_hz for r in readings]), limits.speed_apart)
    torques = np.array([np.nan if r.torque_nm is None else r.torque_nm for r in readings])
    if not np.isfinite(torques).all():
        return [(speed, 0) for speed in speeds]
    return list(zip(speeds, _apart(torques, limits.torque_apart), strict=True))


def _apart(values: np.ndarray, gap: float) -> list[int]:
    """Number of the group of every value (n,): groups are a share of the mean or more apart."""
    if not values.size:
        return []
    order = np.argsort(values, kind="stable")
    steps = np.diff(values[order], prepend=values[order[0]]) > gap * max(abs(float(values.mean())), 1e-300)
    out = np.empty(values.size, dtype=int)
    out[order] = np.cumsum(steps)
    return [int(group) for group in out]


def without_copies(
    readings: Sequence[WindowReading], limits: RecordingThresholds = DEFAULT
) -> tuple[list[WindowReading], list[str]]:
    """Every window once, and what is said of those that are copies of another."""
    kept: list[WindowReading] = []
    said = []
    for reading in readings:
        same = next((k for k in kept if _is_copy(k, reading, limits)), None)
        if same is None:
            kept.append(reading)
        else:
            said.append(f"{reading.name} has the same samples as {same.name} and counts once")
    return kept, said


def _is_copy(one: WindowReading, other: WindowReading, limits: RecordingThresholds) -> bool:
    """Whether every accelerometer of two windows has the same samples, by their lines."""
    if set(one.channels) != set(other.channels):
        return False
    for name, a in one.channels.items():
        b = other.channels[name]
        if a.lines.size != b.lines.size or abs(a.rms - b.rms) > limits.copy * a.rms:
            return False
        if np.abs(a.lines - b.lines).max(initial=0.0) > limits.copy * max(a.rms, 1e-300):
            return False
    return bool(one.channels)
