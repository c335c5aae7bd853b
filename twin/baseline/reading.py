"""The spectral lines of one window of a machine without a model: complex amplitudes at every order of its shafts.

    X_k = 2/Σw · Σ_n w_n·x_n·e^{−i·o_k·θ_n}/H(o_k)          o_k = k/Q,  k = 1 … K

θ    pinion angle: from an encoder, or from the mesh lines with a zero of its own
Q    pinion turns after which all shafts are back in the same position: sums of multiples of their orders are k/Q
H    what the interpolation onto even angles leaves of a line

Source   chirp-z transform: L. R. Rabiner, R. W. Schafer, C. M. Rader, IEEE Trans. Audio Electroacoust. 17 (1969) 86–92
Holds    windows of more than 4·Q turns: closer lines run into each other
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from math import lcm

import numpy as np
from scipy.ndimage import median_filter

from twin.baseline.off_lines import OffLines, off_lines
from twin.closed_forms import chirp_transform
from twin.errors import NotAvailable, TwinError, WindowError
from twin.features.angle import AngleTrack
from twin.features.extract import pinion_angle
from twin.features.mesh_speed import mesh_speed
from twin.features.resample import AngleSignal, on_angle, spline_response
from twin.features.transforms import hann
from twin.rig import Rig
from twin.thresholds import deciding
from twin.windows import Window

HIGHEST = 200.0  # order of the pinion up to which lines are read: ten mesh harmonics of 20 teeth
USABLE = 0.4  # of the sampling rate
TURNS_PER_PERIOD = 4.0  # Hann's main lobe is four bins wide
FLOOR_ORDERS = 0.8  # width over which the floor between the lines is taken


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingThresholds:
    """When a channel and an angle can be used."""

    least_valid: float = deciding(
        0.9, meaning="share of a channel's samples that must be valid",
        source="not derived: shorter gaps are bridged by a taper without moving lines by more than their scatter",
    )  # fmt: skip
    same_clock: float = deciding(
        0.003, meaning="relative difference of the speeds by encoder and by mesh lines that is tolerated",
        source="not derived: sampling clocks agree within 1e-4, a wrong tooth count differs by 1 % and more",
    )  # fmt: skip


DEFAULT = ReadingThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChannelLines:
    """One channel's lines at k/Q, k = 1 … K."""

    lines: np.ndarray  # X_k complex (K,), peak, in the channel's unit
    floor: np.ndarray  # mean |X|² that noise alone gives (K,)
    rms: float  # of the channel, its mean left out
    off: OffLines | None = None  # what lies off the lines; None for parts of a window


@dataclass(frozen=True, slots=True, kw_only=True)
class SpacingSeen:
    """A spacing of lines that no shaft makes, in one window."""

    order: float  # of the pinion's rotation
    clearness: float  # −ln of the probability that the search finds one as clear by chance


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WindowReading:
    """One window's lines."""

    name: str  # of the recording and window
    start_time_ns: int
    duration: float  # [s]
    turns: float  # of the pinion
    period: int  # Q
    speed_hz: float
    speed_std_hz: float | None
    angle_from: str
    absolute: bool  # whether the angle's zero stays the same from window to window
    torque_nm: float | None
    channels: Mapping[str, ChannelLines]
    raw: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # RMS and kurtosis of every accelerometer
    spacings: tuple[SpacingSeen, ...] = ()  # of lines that neither gear makes

    @property
    def orders(self) -> np.ndarray:
        """Of the pinion's rotation, of the channel with most lines (K,)."""
        count = max(c.lines.size for c in self.channels.values())
        return np.arange(1, count + 1) / self.period


def common_period(shafts: Sequence[Fraction]) -> int:
    """Q: pinion turns after which shafts of these orders are back in the same position."""
    return lcm(*(s.denominator for s in shafts))


def angle_of(rig: Rig, window: Window, limits: ReadingThresholds = DEFAULT) -> AngleTrack:
    """Pinion angle of a window.

    Raises NotAvailable or WindowError where it cannot be determined, or encoder and mesh lines contradict each other.
    """
    track = pinion_angle(rig, window, window.accelerations)
    if track.source.startswith("encoder"):
        _check_clocks(rig, window, track, limits)
    return track


def _check_clocks(rig: Rig, window: Window, track: AngleTrack, limits: ReadingThresholds) -> None:
    """Refuses a wrong sampling rate, edge count or tooth count, by which mesh lines and encoder disagree."""
    z1, z2 = rig.teeth
    try:
        seen = mesh_speed(window.accelerations, (int(z1), int(z2)), track.speed)
    except NotAvailable:  # no clear mesh lines to compare with
        return
    off = seen.track.speed / track.speed - 1
    if abs(off) > limits.same_clock:
        raise NotAvailable(
            f"the mesh lines lie at {z1 * seen.track.speed:.2f} Hz, but {track.source} turns {z1} teeth at "
            f"{z1 * track.speed:.2f} Hz, {100 * abs(off):.2g} % {'less' if off > 0 else 'more'}: wrong sampling rate, "
            "edges per turn or tooth count?"
        )


def read(
    rig: Rig,
    window: Window,
    shafts: Sequence[Fraction],
    name: str,
    track: AngleTrack | None = None,
    part: tuple[float, float] = (0.0, 1.0),
    limits: ReadingThresholds = DEFAULT,
) -> WindowReading:
    """The lines of every accelerometer of a window at the orders of its shafts.

    shafts  order of every shaft, of the pinion's rotation: the pinion's own 1 among them
    part    of the window's turns, from and to
    Raises NotAvailable where no channel can be used, WindowError where the window is too short.
    """
    track = angle_of(rig, window, limits) if track is None else track
    Q = common_period(shafts)
    turns = (track.stop - track.start) / (2 * np.pi) * (part[1] - part[0])
    if turns < TURNS_PER_PERIOD * Q:
        raise WindowError(
            f"{turns:.0f} pinion turns are too few to resolve lines 1/{Q} order apart: at least "
            f"{TURNS_PER_PERIOD * Q:.0f} are needed"
        )
    is_whole = part[1] - part[0] == 1.0
    channels: dict[str, ChannelLines] = {}
    reasons = []
    for sensor, samples in window.accelerations.items():
        if np.isfinite(samples.values).mean() < limits.least_valid:
            reasons.append(f"accel/{sensor}: less than {100 * limits.least_valid:g} % of its samples are valid")
            continue
        try:
            signal, per_turn = on_angle(samples, track, samples.values.size)
            lines = lines_of(part_of(signal, part), per_turn, Q)
            off = off_lines(samples, track, shafts, int(rig.teeth[0])) if is_whole else None
            channels[sensor] = replace(lines, off=off)
        except TwinError as error:
            reasons.append(f"accel/{sensor}: {error}")
    if not channels:
        raise NotAvailable("no accelerometer can be used: " + ("; ".join(reasons) or "there is none"))
    torque = [float(np.nanmean(s.values)) for s in window.torques.values() if np.isfinite(s.values).any()]
    return WindowReading(
        name=name,
        start_time_ns=window.start_time_ns,
        duration=window.duration,
        turns=float(turns),
        period=Q,
        speed_hz=float(track.speed),
        speed_std_hz=track.speed_std,
        angle_from=track.source,
        absolute=bool(window.encoders) and "mesh" not in track.source,
        torque_nm=torque[0] if torque else None,
        channels=channels,
        raw={sensor: raw_of(samples.values) for sensor, samples in window.accelerations.items()} if is_whole else {},
    )


def raw_of(values: np.ndarray) -> tuple[float, float]:
    """Root mean square about the mean, and kurtosis (3 for Gaussian noise), of a channel's valid samples (n,)."""
    x = values[np.isfinite(values)]
    x = x - (x.mean() if x.size else 0.0)
    power = float(np.mean(x**2)) if x.size else 0.0
    return float(np.sqrt(power)), float(np.mean(x**4)) / power**2 if power > 0 else 0.0


def part_of(signal: AngleSignal, part: tuple[float, float]) -> AngleSignal:
    """A stretch of a signal, from and to a share of it."""
    low, high = (round(share * signal.values.size) for share in part)
    return AngleSignal(
        start=signal.start + low * signal.step,
        step=signal.step,
        values=signal.values[low:high],
        usable=signal.usable[low:high],
    )


@lru_cache(maxsize=4)  # the channels of a window, and of its halves, mostly share one
def _transform(size: int, count: int, step: float) -> Callable[[np.ndarray], np.ndarray]:
    """Chirp-z transform of so many values to lines a step apart from the first step on [cycles a sample]."""
    return chirp_transform(size, count, 2 * np.pi * step, first=1)


def lines_of(signal: AngleSignal, per_turn: float, Q: int, highest: float = HIGHEST) -> ChannelLines:
    """Lines at k/Q of a signal on even angles, up to a highest order."""
    values = signal.values - signal.values.mean()
    weight = hann(values.size)
    weight = weight / weight.sum()
    count = int(min(highest, USABLE * per_turn) * Q)
    f = signal.step / (2 * np.pi * Q)  # cycles a sample of the order 1/Q
    X = 2 * _transform(values.size, count, f)(values * weight)
    order = np.arange(1, count + 1) / Q
    X *= np.exp(-1j * order * signal.start) / spline_response(order / per_turn)
    power = np.abs(2 * np.fft.rfft(values * weight)) ** 2
    bins = 2 * np.pi / (values.size * signal.step)  # orders a bin
    smooth = median_filter(power, size=max(9, int(FLOOR_ORDERS / bins)) | 1, mode="nearest") / np.log(2)
    floor = smooth[np.clip(np.rint(order / bins).astype(int), 0, smooth.size - 1)]
    return ChannelLines(lines=X, floor=np.maximum(floor, 1e-300), rms=float(values.std()))
