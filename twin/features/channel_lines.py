"""One line of no gear as every channel shows it: frequency, and complex amplitudes with one zero of phase.

    b_j = w_j·[Σ_o a_o·exp(i·o·θ_j) + c·exp(i·φ_j)] + noise,     φ = 2πf·t  or  o·θ

b     values of the channel round the line, low-passed: the bins round it, transformed back           (m,) complex
a_o   lines of either shaft in reach
c     the line sought; its frequency f, or its order o, is that which takes most of the channel that shows it best
t, θ  time [s] and pinion angle [rad] of each value

Whether the line follows the clock or the angle is told by what both models leave, where the speed wanders enough.

Source   least squares of a tone: D. C. Rife, R. R. Boorstyn, Bell Syst. Tech. J. 55 (1976) 1389–1410
Holds    lines that are as narrow as the window resolves; others are read with what their mean frequency holds
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import pi

import numpy as np
from scipy import fft

from twin.features.gaps import filled, taper
from twin.features.transforms import hann

REACH = 32  # bins to either side that a line is read among, fewer near the ends of the spectrum
LEAST_REACH = 6  # three times half of Hann's main lobe
SHIFT = 3.0  # bins by which a line may lie beside where it is looked for
FINE = 25  # frequencies tried a bin, and again about the best
BESIDE = 0.7  # bins that a line lies beside any line of a shaft at least
LONGEST_GAP = 2  # samples that a straight line bridges


@dataclass(frozen=True, slots=True, kw_only=True)
class LineReading:
    """A line of no shaft in one window."""

    order: float  # of pinion rotation, at the window's mean speed
    frequency: float  # [Hz]
    std: float  # of the frequency [Hz]
    follows_angle: float  # evidence that it follows the angle rather than the clock [nat]
    channels: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    # by channel, in its unit: real and imaginary part of the peak amplitude, and the standard deviation of each

    def amplitude(self, channel: str) -> complex | None:
        """Complex peak amplitude in a channel; None where the channel was not read."""
        found = self.channels.get(channel)
        return None if found is None else complex(found[0], found[1])

    def noise(self, channel: str) -> float:
        """Standard deviation of the real and of the imaginary part in a channel that was read."""
        return self.channels[channel][2]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChannelRecord:
    """A channel over a window, evenly sampled in time or in angle."""

    spectrum: np.ndarray  # (n//2 + 1,) under the window
    weight: np.ndarray  # (n,)
    time: np.ndarray  # of some values [s] (q,), rising
    angle: np.ndarray  # of the same [rad] (q,)
    start: float  # of the first value, [s] or [rad]
    step: float  # of the values, [s] or [rad]
    by_angle: bool

    @classmethod
    def of(cls, values: np.ndarray, start: float, step: float, time, angle, by_angle: bool) -> ChannelRecord:
        """A channel of values (n,) from `start` on, [s] or [rad]; time and angle of the window on any grid (q,)."""
        whole, usable = filled(values, LONGEST_GAP)
        weight = hann(whole.size) * taper(usable, 64)
        mean = (weight @ whole) / weight.sum()
        return cls(
            spectrum=fft.rfft(weight * (whole - mean)),
            weight=weight,
            time=np.asarray(time),
            angle=np.asarray(angle),
            start=start,
            step=step,
            by_angle=by_angle,
        )

    @property
    def size(self) -> int:
        return int(self.weight.size)

    def round(self, frequency: float, speed_hz: float) -> _Round | None:
        """The channel round a frequency [Hz]; None where the spectrum ends."""
        rate = frequency / speed_hz / (2 * pi) if self.by_angle else frequency  # cycles a rad, or a second
        middle = round(rate * self.step * self.size)
        reach = min(REACH, middle - 1, self.spectrum.size - middle - 1)
        if reach < LEAST_REACH:
            return None
        m = 2 * reach + 1
        y = self.spectrum[middle - reach : middle + reach + 1]
        at = np.arange(m) * (self.size / m)
        place = self.start + self.step * at
        low, high = (self.angle, self.time) if self.by_angle else (self.time, self.angle)
        other = np.interp(place, low, high)
        time, angle = (other, place) if self.by_angle else (place, other)
        values = fft.ifft(fft.ifftshift(y)) * (
            2 / self.size
        )  # so that a line of amplitude 1 gives w·exp(i·φ) about m/n
        return _Round(
            values=values * m,
            weight=self.weight[np.minimum(np.rint(at).astype(int), self.size - 1)],
            carrier=2 * pi * middle * at / self.size,
            time=time,
            angle=angle,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Round:
    """A channel round one frequency, low-passed (m,)."""

    values: np.ndarray  # complex
    weight: np.ndarray
    carrier: np.ndarray  # phase taken off [rad]
    time: np.ndarray  # [s]
    angle: np.ndarray  # [rad]

    def column(self, phase: np.ndarray) -> np.ndarray:
        """What lines of amplitude 1 and phase (…, m) [rad] make."""
        return self.weight * np.exp(1j * (phase - self.carrier))

    def basis(self, orders: Sequence[float], known: Sequence[LineReading], speed_hz: float) -> np.ndarray:
        """Orthonormal basis of lines of the shafts, and of lines that have been read (m, c)."""
        phases = [o * self.angle for o in orders]
        phases += [_phases(self, np.array([r.frequency]), r.follows_angle > 0, speed_hz)[0] for r in known]
        if not phases:
            return np.zeros((self.values.size, 0), dtype=complex)
        U, s, _ = np.linalg.svd(self.column(np.array(phases)).T, full_matrices=False)
        return U[:, s > 1e-3 * s[0]]

    def left_by(self, basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Energy that the basis and one column more leave, for each of the columns (c, m) → (c,)."""
        y = self.values - basis @ (basis.conj().T @ self.values)
        rest = columns.T - basis @ (basis.conj().T @ columns.T)
        size = np.maximum((np.abs(rest) ** 2).sum(axis=0), 1e-9)
        return float(np.vdot(y, y).real) - np.abs(rest.conj().T @ y) ** 2 / size

    def read(self, basis: np.ndarray, column: np.ndarray) -> tuple[complex, float]:
        """Amplitude of a column (m,) beside a basis, and the standard deviation of its real and imaginary part."""
        rest = column - basis @ (basis.conj().T @ column)
        size = float(np.vdot(rest, rest).real)
        if size < 1e-6 * float(np.vdot(column, column).real):
            return 0j, float("inf")
        h = rest / size
        amplitude = complex(np.vdot(h, self.values))
        left = self.values - basis @ (basis.conj().T @ self.values) - amplitude * rest
        free = self.values.size - basis.shape[1] - 1
        power = float(np.vdot(left, left).real) / float((self.weight**2).sum()) * self.values.size / free
        return amplitude, float(np.sqrt(0.5 * power * ((np.abs(h) * self.weight) ** 2).sum()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A line that is to be read."""

    frequency: float  # where it was seen [Hz]
    channel: str  # that shows it
    tone: bool = False  # whether it is known to follow the clock, wherever the shafts' lines are


def read_channels(
    channels: Mapping[str, ChannelRecord],
    wanted: Iterable[Wanted],
    teeth: tuple[int, int],
    speed_hz: float,
    duration: float,
    most: int,
) -> tuple[LineReading, ...]:
    """Lines of no shaft near some frequencies, the first `most` of them; each is read beside those before it.

    A line that lies on a line of a shaft once its frequency is known is left out, and so is one found twice.
    """
    out: list[LineReading] = []
    for line in wanted:
        if len(out) == most:
            break
        if any(abs(line.frequency - known.frequency) * duration < 1.0 for known in out):
            continue
        found = _read(channels, line, out, teeth, speed_hz, duration)
        if found is not None and all(abs(found.frequency - known.frequency) * duration > 1.0 for known in out):
            out.append(found)
    return tuple(out)


def _shaft_orders(order: float, reach: float, teeth: tuple[int, int]) -> list[float]:
    """Orders of either shaft within a reach of an order."""
    out: set[float] = set()
    for unit in (1.0, teeth[0] / teeth[1]):
        low, high = int(np.ceil((order - reach) / unit)), int(np.floor((order + reach) / unit))
        out |= {round(unit * i, 9) for i in range(max(low, 1), high + 1)}
    return sorted(out)


def _read(
    channels: Mapping[str, ChannelRecord],
    line: Wanted,
    before: Sequence[LineReading],
    teeth: tuple[int, int],
    speed_hz: float,
    duration: float,
) -> LineReading | None:
    by, spacing = line.channel, 1 / duration
    near = channels[by].round(line.frequency, speed_hz)
    if near is None:
        return None
    shafts = _shaft_orders(line.frequency / speed_hz, 0.6 * REACH * spacing / speed_hz, teeth)
    every = shafts
    if line.tone:  # it is known not to be one of a shaft, which must not take it
        shafts = [o for o in shafts if abs(o * speed_hz - line.frequency) > BESIDE * spacing]
    known = [r for r in before if abs(r.frequency - line.frequency) < REACH * spacing]
    basis = near.basis(shafts, known, speed_hz)
    best: dict[bool, tuple[float, float]] = {}
    for locked in (False, True):
        centre, width = line.frequency, (0.3 if line.tone else SHIFT) * spacing
        for _ in range(3):
            tried = centre + np.linspace(-width, width, int(2 * SHIFT * FINE / 3) | 1)
            columns = near.column(_phases(near, tried, locked, speed_hz))
            left = near.left_by(basis, columns)
            i = int(np.argmin(left))
            centre, width = float(tried[i]), width / 12
        best[locked] = (float(left[i]), centre)
    locked = best[True][0] < best[False][0] and not line.tone
    at = best[locked][1]
    nearest = min((abs(at / speed_hz - o) for o in shafts), default=np.inf) * speed_hz * duration
    if abs(at - line.frequency) > 0.95 * SHIFT * spacing or nearest < BESIDE:
        return None
    found = {}
    for name, record in channels.items():
        own = near if name == by else record.round(at, speed_hz)
        if own is None:
            continue
        beside = basis if name == by else own.basis(every, known, speed_hz)
        amplitude, std = own.read(beside, own.column(_phases(own, np.array([at]), locked, speed_hz))[0])
        if np.isfinite(std):
            found[name] = (amplitude.real, amplitude.imag, std)
    if by not in found:
        return None
    size, std = abs(complex(*found[by][:2])), found[by][2]
    clearer = best[False][0] - best[True][0]
    noise = max(min(best[False][0], best[True][0]) / near.values.size, 1e-300)
    return LineReading(
        order=at / speed_hz,
        frequency=at,
        std=float(2 * np.sqrt(3) / pi * spacing * std / max(size, 1e-300)),  # Cramér–Rao, √3·σ/(π·T·A); Hann doubles it
        follows_angle=float((min(clearer, 0.0) if line.tone else clearer) / noise),
        channels=found,
    )


def _phases(near: _Round, frequencies: np.ndarray, locked: bool, speed_hz: float) -> np.ndarray:
    """Phase of lines at frequencies (c,) [Hz] that follow the clock, or the angle at the mean speed (c, m)."""
    if locked:
        return np.outer(frequencies / speed_hz, near.angle)
    return np.outer(2 * pi * frequencies, near.time)
