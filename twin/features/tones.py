"""Lines that belong to no shaft: steady in hertz while the shaft's speed wanders (mains, neighbouring machines).

    y = F{w·[Σ_o (a_o + b_o·ν(t))·exp(i·o·θ(t)) + c·exp(2πi·f·t)]} + noise          in the bins round a peak

y    the windowed signal's spectrum, scaled so that c is a peak amplitude                   complex
F    Fourier transform, the bins round the peak only
o    all pinion orders and all gear orders in reach, with an amplitude that may follow the speed
ν    speed departure over its standard deviation: a line near a mode changes as the speed does
θ    smoothed pinion angle                                                                 [rad]
c, f the tone sought, f free                                                               [unit], [Hz]
w    Hann window

A peak of the spectrum is a non-gear tone where

    gain = (E_orders − E_tone)/(s²·n·Σw⁴/(Σw²)²)   exceeds what noise gives among all bins with probability α, and
    evidence = Σ_windows (E_order − E_tone)/s²     in nats, tone against one more line locked to the angle at any
                                                   order, is above 10

E    squared residual; s² the floor or, where higher, the residual itself, so that what the model of the order
     lines lacks raises no alarm. Both alternatives have as many free parameters, so their likelihoods compare.

Source   D. C. Rife, R. R. Boorstyn, Bell Syst. Tech. J. 55 (1976) 1389–1410 (frequency of a tone);
         P. Borghesani et al., Mech. Syst. Signal Process. 40 (2013) 38–55 (angle-locked against time-locked parts)
Holds    a speed that wanders: at a steady speed nothing tells the two kinds apart, and nothing is reported;
         tones steadier than the resolution of a window. A weaker order line that a window
         cannot tell from the tone counts into its amplitude
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import pi, sqrt

import numpy as np
from scipy import fft

from twin.errors import NotAvailable
from twin.features.angle import AngleTrack
from twin.features.gaps import filled, taper
from twin.features.noise_floor import exceedance, noise_floor, threshold
from twin.features.resample import AngleSignal, on_angle
from twin.features.transforms import fast_length_below, hann, power_of, powers
from twin.windows import Samples

LOWEST = 5.0  # frequency from which tones are sought [Hz]
FALSE_ALARM = 1e-3  # for one record, all of its bins together
LEAST_EVIDENCE = 10.0  # nats against a line locked to the angle
REACH = 8  # bins on either side of a peak that the local model explains, without what the speed's wander smears
MOST_REACH = 40
FULL = 0.5  # share of the bins that columns of order lines may take
SEEN = 8.0  # power over floor at which an order line is taken into the model
LEAKAGE = 0.02  # a tone weaker than this share of an order line in its reach is put down to that line
MOST_PEAKS = 32
FINE = 4  # times per bin on which the local model is laid out
CLOSE = 1.5  # resolution steps within which tones of two windows are one
COLLINEAR = 1e-5  # share of a column's energy that must be left beside the order lines


@dataclass(frozen=True, slots=True, kw_only=True)
class Tone:
    """A steady tone in one window."""

    frequency: float  # [Hz]
    frequency_std: float  # [Hz]
    amplitude: complex  # peak, phase at the window's clock zero, in the signal's unit
    std: float  # of the real and of the imaginary part
    evidence: float  # steady in hertz against locked to the angle [nat]
    false_alarm: float  # probability that noise alone gives as much, anywhere in the band


@dataclass(frozen=True, slots=True, kw_only=True)
class NonGearTone:
    """A tone steady in hertz over several windows."""

    frequency: float  # weighted mean [Hz]
    frequency_std: float  # of the mean [Hz]
    spread: float  # scatter over windows beyond their own uncertainty [Hz]
    amplitudes: tuple[float | None, ...]  # by window, peak; None where it was not found
    stds: tuple[float | None, ...]
    evidence: float  # over all windows [nat]
    false_alarm: float  # smallest of its windows, times their number


@dataclass(frozen=True, slots=True, kw_only=True)
class _Record:
    """A windowed record with its spectrum, its floor and the shaft's angle on a coarse grid of time."""

    spectrum: np.ndarray  # (m,) complex, no padding
    floor: np.ndarray  # (m,) mean noise power
    freedom: float
    weight: np.ndarray  # (n,)
    rate: float
    start: float
    speed: float
    angle_time: np.ndarray  # [s]
    angle: np.ndarray  # θ [rad]
    middle_angle: float  # θ half-way through the record [rad]
    wander: float  # standard deviation of the speed over its mean
    widening: float  # how much more an amplitude scatters than from uncorrelated bins: n·Σw⁴/(Σw²)²
    time_widening: float  # the same for a frequency: n·Σw⁴t²/(Σw²·Σw²t²)
    ordered: np.ndarray  # (l,) power of the spectrum against angle, scaled as that against time
    standing: np.ndarray  # (l,) that over its own noise floor
    order_step: float  # of its bins

    @property
    def duration(self) -> float:
        return self.weight.size / self.rate

    @property
    def middle(self) -> float:
        """Time half-way through the record [s]."""
        return self.start + 0.5 * (self.weight.size - 1) / self.rate


def _record(samples: Samples, track: AngleTrack, signal: AngleSignal | None) -> _Record:
    """The windowed spectrum of a channel over the time that the angle covers."""
    first, last = track.ends
    low = max(0, int(np.ceil((first - samples.start) * samples.rate)))
    high = min(samples.values.size, int((last - samples.start) * samples.rate))
    if high - low < 1024 or not np.isfinite(samples.values[low:high]).any():
        raise NotAvailable(f"non-gear tones are not available: {max(high - low, 0)} samples and angles in common")
    n = fast_length_below(high - low)
    values, usable = filled(samples.values[low : low + n], 2)
    weight = hann(n) * taper(usable, round(0.02 * samples.rate))
    if (weight @ weight) < 0.3 * (hann(n) @ hann(n)):
        raise NotAvailable("non-gear tones are not available: gaps take most of the record")
    spectrum = fft.rfft(weight * (values - (weight @ values) / weight.sum()))
    floor = noise_floor(power_of(spectrum))
    grid = np.linspace(track.start, track.stop, max(64, int(64 * track.turns)))
    if signal is None:
        signal, _ = on_angle(samples, track)
    turned = signal.values * hann(signal.values.size) * taper(signal.usable, round(0.2 * 2 * pi / signal.step))
    power = power_of(fft.rfft(turned, signal.length)) * (n / turned.size) ** 2
    start = samples.start + low / samples.rate
    times = track.time(grid)
    w2, t2 = weight**2, np.linspace(-1, 1, n) ** 2
    return _Record(
        spectrum=spectrum,
        floor=floor.power,
        freedom=floor.freedom,
        weight=weight,
        rate=samples.rate,
        start=start,
        speed=track.speed,
        angle_time=times,
        angle=grid,
        middle_angle=float(np.interp(start + 0.5 * (n - 1) / samples.rate, times, grid)),
        wander=track.speed_variation,
        ordered=power,
        standing=power / noise_floor(power).power,
        widening=float(n * (w2 @ w2) / w2.sum() ** 2),
        time_widening=float(n * ((w2 * w2) @ t2) / (w2.sum() * (w2 @ t2))),
        order_step=signal.order_of_bin(1),
    )


def _energies(power, centres) -> np.ndarray:
    """Power of each bin with two on either side of it, (m,), (n,) → (n,)."""
    bins = np.asarray(centres)[:, None] + np.arange(-2, 3)
    return np.where((bins >= 0) & (bins < power.size), power[np.clip(bins, 0, power.size - 1)], 0.0).sum(axis=1)


def _peaks(record: _Record, band: tuple[float, float], false_alarm: float) -> tuple[np.ndarray, int]:
    """Bins of peaks over the floor that are not clearly sharper against angle, strongest first; bins searched."""
    power = power_of(record.spectrum)
    low, high = (int(np.ceil(f * record.duration)) for f in (band[0], min(band[1], 0.45 * record.rate)))
    low = max(low, 3)
    inner = power[low:high]
    is_peak = (inner >= power[low - 1 : high - 1]) & (inner > power[low + 1 : high + 1])
    ratio = inner / record.floor[low:high]
    over = threshold(false_alarm, high - low, record.freedom)
    found = low + np.flatnonzero(is_peak & (ratio > over))
    scale = 1 / (record.duration * record.speed * record.order_step)
    ordered = (found * scale + 0.5).astype(int)
    kept = found[_energies(record.ordered, ordered) < 1.05 * _energies(power, found)]
    return kept[np.argsort(-(power[kept] / record.floor[kept]), kind="stable")][:MOST_PEAKS], high - low


@lru_cache(maxsize=16)
def _fourier(bins: int) -> np.ndarray:
    """Fourier matrix of FINE·bins values, about bin 0; (FINE·bins, bins) complex, read-only."""
    m = FINE * bins
    turns = np.outer(np.arange(m), np.arange(bins) - bins // 2) % m / m
    matrix = np.exp(-2j * pi * turns) / m
    matrix.flags.writeable = False
    return matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class _Local:
    """The bins round one peak and what a model of them is made of."""

    y: np.ndarray  # (k,) complex, k = 2·reach + 1
    noise: float  # mean |y|² of noise
    w: np.ndarray  # window at `time`, (m,)
    time: np.ndarray  # after the record's middle [s], (m,)
    turn: np.ndarray  # θ less what it would be at mean speed [rad], (m,)
    ν: np.ndarray  # speed departure over its standard deviation, (m,)
    centre: float  # frequency of the middle bin [Hz]
    speed: float  # [Hz]

    def bins(self, signals) -> np.ndarray:
        """Spectrum of signals (c, m) about the middle bin, under the window; (k, c)."""
        return ((self.w * signals) @ _fourier(self.y.size)).T

    def tones(self, frequencies) -> np.ndarray:
        """Steady tones of amplitude 1; (c,) → (c, m)."""
        return np.exp(2j * pi * np.outer(np.asarray(frequencies) - self.centre, self.time))

    def even(self, first: float, step: float, count: int, locked: bool) -> np.ndarray:
        """The same at evenly spaced frequencies, or lines of these frequencies at mean speed locked to the angle."""
        wander = self.turn / self.speed if locked else 0.0
        start = np.exp(1j * (first * wander + 2 * pi * (first - self.centre) * self.time))
        return start * powers(np.exp(1j * step * (wander + 2 * pi * self.time)), count)

    def orders(self, orders) -> np.ndarray:
        """Lines of amplitude 1 locked to the angle; (c,) → (c, m)."""
        o = np.asarray(orders)[:, None]
        return np.exp(1j * (o * self.turn + 2 * pi * (o * self.speed - self.centre) * self.time))


def _local(record: _Record, bin_: int) -> _Local | None:
    """The bins round one; None where the spectrum ends or the speed's wander smears order lines too far."""
    reach = REACH + int(np.ceil(3 * record.wander * bin_))
    if reach > min(MOST_REACH, bin_ - 1, record.spectrum.size - bin_ - 1):
        return None
    n, m = record.weight.size, FINE * (2 * reach + 1)
    at = np.arange(m) * (n / m)
    time = record.start + at / record.rate
    θ = np.interp(time, record.angle_time, record.angle)
    beside = np.diff(θ) / np.diff(time)
    speed = np.concatenate((beside[:1], (θ[2:] - θ[:-2]) / (time[2:] - time[:-2]), beside[-1:]))
    ν = speed - speed.mean()
    wandered = θ - record.middle_angle - 2 * pi * record.speed * (time - record.middle)
    return _Local(
        y=2 / n * record.spectrum[bin_ - reach : bin_ + reach + 1],
        noise=4 / n**2 * float(record.floor[bin_]),
        w=record.weight[at.astype(int)],
        time=time - record.middle,
        turn=wandered,
        ν=ν / max(float(ν.std()), 1e-12),
        centre=bin_ / record.duration,
        speed=record.speed,
    )


def _order_lines(record: _Record, local: _Local, teeth: tuple[int, int]) -> np.ndarray:
    """Orders of pinion and gear within reach of the peak that stand out of the spectrum against angle, (c,)."""
    z1, z2 = teeth
    centre, reach = local.centre / local.speed, (local.y.size // 2 + 2) / record.duration / local.speed
    out: list[float] = []
    for unit in (1.0, z1 / z2):
        low, high = int(np.ceil((centre - reach) / unit)), int(np.floor((centre + reach) / unit))
        out += [unit * i for i in range(max(low, 1), high + 1)]
    orders = np.unique(np.round(out, 9))
    at = np.rint(orders / record.order_step).astype(int)
    seen = [record.standing[max(i - 1, 0) : i + 2].max(initial=0.0) > SEEN for i in at]
    return orders[np.array(seen, dtype=bool)]


def _basis(columns) -> np.ndarray:
    """Orthonormal basis of columns (k, c), those that others nearly hold left out; (k, r)."""
    if columns.shape[1] == 0:
        return columns
    U, size, _ = np.linalg.svd(columns, full_matrices=False)
    return U[:, size > 1e-3 * size[0]]


def _gains(y, Q, columns) -> tuple[np.ndarray, np.ndarray]:
    """How much of |y|² each column takes that the basis Q leaves, and the amplitude it then has; (k, c) → (c,)."""
    rest = columns - Q @ (Q.conj().T @ columns)
    size = np.sum(power_of(rest), axis=0)
    whole = np.sum(power_of(columns), axis=0)
    inner = np.where(size > COLLINEAR * whole, rest.conj().T @ y, 0.0)
    size = np.maximum(size, COLLINEAR * whole)
    return power_of(inner) / size, inner / size


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fit:
    """A tone beside a basis of other columns."""

    frequency: float  # [Hz]
    amplitude: complex  # at the record's middle
    slope: float  # |∂(model)/∂f|², what the rest of the model cannot follow
    own: float  # energy of the tone's column that the basis leaves
    gained: float  # energy taken
    left: np.ndarray  # residual, (k,)
    columns: int  # of the whole model


def _refine(local: _Local, Q, frequency: float, spacing: float) -> _Fit | None:
    """Least squares for frequency and amplitude from a start within a fifth of a bin (Gauss–Newton)."""
    start = frequency
    for _ in range(5):
        tone = local.tones([frequency])
        column = local.bins(tone)
        (gained,), (a,) = _gains(local.y, Q, column)
        both = _basis(np.concatenate((Q, column), axis=1))
        left = local.y - both @ (both.conj().T @ local.y)
        slope = a * local.bins(2j * pi * local.time * tone)
        J = (slope - both @ (both.conj().T @ slope))[:, 0]
        size = float(np.vdot(J, J).real)
        if size <= 0:
            return None
        step = float(np.vdot(J, left).real) / size
        if abs(step) < 1e-5 * spacing:
            break
        frequency += float(np.clip(step, -0.3 * spacing, 0.3 * spacing))
    if abs(frequency - start) > spacing:
        return None
    rest = column - Q @ (Q.conj().T @ column)
    return _Fit(
        frequency=frequency,
        amplitude=complex(a),
        slope=size,
        own=float(np.vdot(rest, rest).real),
        gained=float(gained),
        left=left,
        columns=both.shape[1],
    )


def _best_order(local: _Local, Q, frequency: float, spacing: float) -> float:
    """The most that one line locked to the angle can take, its order free, from a start in a grid of 0.2 bins."""
    best, reach = 0.0, 0.1 * spacing
    for _ in range(3):
        trial = frequency + reach * np.array([-1.0, 0.0, 1.0])
        gain, _ = _gains(local.y, Q, local.bins(local.orders(trial / local.speed)))
        best = max(best, float(gain.max()))
        curve = gain[0] - 2 * gain[1] + gain[2]
        if curve >= 0:
            break
        frequency += reach * float(np.clip(0.5 * (gain[0] - gain[2]) / curve, -1.0, 1.0))
        reach *= 0.2
    return best


def _tone(
    record: _Record, bin_: int, teeth: tuple[int, int], known: Sequence[float], searched: int, over: float
) -> tuple[Tone, float] | None:
    """A tone near one bin beside the order lines and tones already found, and how many times it passes the noise."""
    local = _local(record, bin_)
    if local is None:
        return None
    spacing = 1 / record.duration
    reach = (local.y.size // 2 + 2) * spacing
    near = local.bins(local.tones([f for f in known if abs(f - local.centre) < reach]))
    lines = local.orders(_order_lines(record, local, teeth))
    columns = local.bins(np.concatenate((lines, lines * local.ν)))
    Q = _basis(np.concatenate((near, columns), axis=1))
    if Q.shape[1] > FULL * local.y.size:
        return None
    trial = local.centre + np.arange(-1.5, 1.51, 0.2) * spacing
    gain, other = (
        _gains(local.y, Q, local.bins(local.even(float(trial[0]), 0.2 * spacing, trial.size, locked)))[0]
        for locked in (False, True)
    )
    if gain.max() < max(over * local.noise * record.widening, 0.98 * other.max()):
        return None
    fit = _refine(local, Q, float(trial[np.argmax(gain)]), spacing)
    if fit is None:
        return None

    misfit = float(np.vdot(fit.left, fit.left).real) / max(local.y.size - fit.columns - 1, 1)
    noise = max(local.noise, misfit) * record.widening
    best = max(float(other.max()), _best_order(local, Q, float(trial[np.argmax(other)]), spacing))
    evidence = (fit.gained - best) / noise
    strength = fit.gained / noise

    alone = _refine(local, _basis(near), fit.frequency, spacing)  # without order lines, where none is needed
    if alone is not None:
        more = float(np.vdot(alone.left, alone.left).real - np.vdot(fit.left, fit.left).real) / noise
        extra = fit.columns - alone.columns
        if more < extra + 6 * sqrt(extra) + 8:
            fit = alone
    toned = local.bins(local.tones([fit.frequency]))[:, 0] * fit.amplitude
    order = np.linalg.lstsq(columns[:, : len(lines)], local.y - toned, rcond=1e-2)[0]
    if order.size and abs(fit.amplitude) < LEAKAGE * np.abs(order).max():
        return None
    turned = 2 * pi * (local.centre * (record.middle - record.start) - fit.frequency * record.middle)
    tone = Tone(
        frequency=fit.frequency,
        frequency_std=sqrt(noise / record.widening * record.time_widening / (2 * fit.slope)),
        amplitude=fit.amplitude * np.exp(1j * turned),
        std=sqrt(noise / (2 * fit.own)),
        evidence=evidence,
        false_alarm=float(-np.expm1(searched * np.log1p(-min(float(exceedance(strength, record.freedom)), 0.5)))),
    )
    return tone, strength


def _record_tones(record: _Record, teeth: tuple[int, int], band: tuple[float, float], false_alarm: float) -> list[Tone]:
    peaks, searched = _peaks(record, band, false_alarm)
    over = threshold(false_alarm, searched, record.freedom)
    found: list[Tone] = []
    for bin_ in peaks:
        known = [tone.frequency for tone in found]
        if any(abs(f - bin_ / record.duration) < CLOSE / record.duration for f in known):
            continue
        got = _tone(record, int(bin_), teeth, known, searched, over)
        if got is not None and got[1] > over and got[0].evidence > 0:
            found.append(got[0])
    return found


def window_tones(
    samples: Samples,
    track: AngleTrack,
    teeth: tuple[int, int],
    band: tuple[float, float],
    false_alarm: float = FALSE_ALARM,
    signal: AngleSignal | None = None,
) -> tuple[Tone, ...]:
    """Tones of one window that are steadier in hertz than in order, strongest evidence first.

    band         where they are sought [Hz]
    false_alarm  probability that noise alone gives one or more in the band
    signal       the samples on an even grid of pinion angle, where they are known so
    """
    tones = _record_tones(_record(samples, track, signal), teeth, band, false_alarm)
    return tuple(sorted(tones, key=lambda tone: -tone.evidence))


def non_gear_tones(windows: Sequence[tuple[Tone, ...]], durations: Sequence[float]) -> tuple[NonGearTone, ...]:
    """Tones of several windows put together by frequency, those with evidence enough, the strongest first.

    windows    what `window_tones` gave for each
    durations  of the windows [s]: tones closer than 1.5/duration are one
    """
    waiting = sorted(
        ((tone, i) for i, tones in enumerate(windows) for tone in tones), key=lambda pair: pair[0].frequency_std
    )
    out = []
    while waiting:
        lead = waiting[0][0].frequency
        group: dict[int, Tone] = {}
        for tone, i in waiting:
            if i not in group and abs(tone.frequency - lead) < CLOSE / durations[i]:
                group[i] = tone
        waiting = [(t, i) for t, i in waiting if abs(t.frequency - lead) >= CLOSE / durations[i]]
        if sum(tone.evidence for tone in group.values()) > LEAST_EVIDENCE:
            out.append(_together(group, len(windows)))
    return tuple(sorted(out, key=lambda tone: -tone.evidence))


def _together(group: dict[int, Tone], count: int) -> NonGearTone:
    f = np.array([tone.frequency for tone in group.values()])
    variance = np.array([tone.frequency_std for tone in group.values()]) ** 2
    mean = float(f @ (1 / variance) / (1 / variance).sum())
    excess = max(0.0, float(((f - mean) ** 2 - variance).mean())) if f.size > 1 else 0.0
    weight = 1 / (variance + excess)
    return NonGearTone(
        frequency=float(f @ weight / weight.sum()),
        frequency_std=float(1 / sqrt(weight.sum())),
        spread=sqrt(excess),
        amplitudes=tuple(float(abs(group[i].amplitude)) if i in group else None for i in range(count)),
        stds=tuple(group[i].std if i in group else None for i in range(count)),
        evidence=float(sum(tone.evidence for tone in group.values())),
        false_alarm=min(1.0, count * min(tone.false_alarm for tone in group.values())),
    )
