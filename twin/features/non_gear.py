"""What a window's acceleration holds beside the lines of its own shafts: tones, off-order lines, impacts.

    tones      steady in hertz (foreign.py)
    lines      peaks at orders that are no multiple of either shaft's turn, by frequency and order
    impacts    kurtosis of the most impulsive band, and the rates at which the envelope repeats there (envelope.py)
    swelling   how deep the noise between the lines comes and goes with the turns of either shaft: what rubs does so

Lines near a strong mesh line are its own skirt, where the speed wanders; they are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import pi
from typing import Any

import numpy as np
from scipy import fft
from scipy.ndimage import median_filter

from twin.errors import TwinError
from twin.features.envelope import kurtogram, modulations, without_shaft_lines
from twin.features.extract import pinion_angle, reference
from twin.features.orders import hann
from twin.features.resample import AngleSignal, on_angle
from twin.features.tones import Tone, window_tones
from twin.rig import Rig
from twin.windows import Window

TOP = 2000.0  # [Hz]
APART = 2.2  # resolution steps from any order of a shaft
SKIRT = 6.0  # resolution steps from a mesh line
STANDS_OUT = 40.0  # power over the median around
LEAST = 0.03  # amplitude of a line [m/s²]
OF_MESH = 0.03  # of the strongest mesh line within NEAR orders
NEAR = 3.0
MOST_LINES = 12
IMPULSIVE = 1.5  # kurtosis from which the envelope is looked into
NOISE_FROM = 800.0  # [Hz]: above the mesh lines that carry the load
SAME_RATE = 0.02  # relative
WIDE = 0.1  # of the rate: impacts fill a band this wide at least


@dataclass(frozen=True, slots=True, kw_only=True)
class NonGearFeatures:
    """Of one window; plain data."""

    duration: float  # [s]
    speed_hz: float
    tones: tuple[tuple[float, float, float, float, float], ...]  # Hz, its std, amplitude, its std, evidence
    lines: tuple[tuple[float, float], ...]  # order of pinion rotation, amplitude [m/s²]
    kurtosis: float  # of the most impulsive band
    rates: tuple[tuple[float, float], ...]  # order of pinion rotation, depth, of impacts that no shaft makes
    swelling: tuple[tuple[str, float], ...] = ()  # shafts with whose turn the noise swells, and how deep

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> NonGearFeatures:
        return cls(
            duration=data["duration"],
            speed_hz=data["speed_hz"],
            tones=tuple(tuple(t) for t in data["tones"]),
            lines=tuple(tuple(line) for line in data["lines"]),
            kurtosis=data["kurtosis"],
            rates=tuple(tuple(r) for r in data["rates"]),
            swelling=tuple((name, depth) for name, depth in data["swelling"]),
        )

    def as_tones(self) -> tuple[Tone, ...]:
        return tuple(
            Tone(frequency=f, frequency_std=s, amplitude=a, std=n, evidence=e, false_alarm=0.0)
            for f, s, a, n, e in self.tones
        )


def off_order_lines(signal: AngleSignal, teeth: tuple[int, int], speed_hz: float) -> list[tuple[float, float]]:
    """Peaks at orders of neither shaft: (order, amplitude), the strongest first."""
    v = signal.values
    weight = hann(v.size)
    length = fft.next_fast_len(2 * v.size, real=True)
    spectrum = fft.rfft(weight * (v - (weight @ v) / weight.sum()), length) * (2 / weight.sum())
    step = 2 * pi / (length * signal.step)
    turns = v.size * signal.step / (2 * pi)
    top = min(spectrum.size, int(TOP / speed_hz / step))
    amplitude = np.abs(spectrum[:top])
    order = step * np.arange(top)
    z1, gear = teeth[0], teeth[0] / teeth[1]
    from_shaft = np.minimum(np.abs(order - np.rint(order)), np.abs(order - gear * np.rint(order / gear)))
    from_mesh = np.abs(order - z1 * np.rint(order / z1))
    free = (from_shaft > APART / turns) & (from_mesh > SKIRT / turns) & (order > 0.5)
    index = np.flatnonzero(free)
    if index.size < 64:
        return []
    power = amplitude[index] ** 2
    around = median_filter(power, 61, mode="nearest") / np.log(2)
    mesh = np.array(
        [amplitude[max(0, round(k * z1 / step) - 3) : round(k * z1 / step) + 4].max(initial=0.0) for k in range(1, 99)]
    )
    at = np.arange(1, 99) * z1
    out = []
    for i in range(1, index.size - 1):
        a = float(np.sqrt(power[i]))
        if a < LEAST or power[i] < STANDS_OUT * around[i] or power[i] < power[max(i - 4, 0) : i + 5].max():
            continue
        near = mesh[np.abs(at - order[index[i]]) < NEAR]
        if a > OF_MESH * near.max(initial=0.0):
            out.append((float(order[index[i]]), a))
    return sorted(out, key=lambda line: -line[1])[:MOST_LINES]


def non_gear_features(rig: Rig, window: Window) -> NonGearFeatures | None:
    """What the reference accelerometer hears beside the gears; None where there is none, or no speed."""
    try:
        _, samples = reference(rig, window)
        track = pinion_angle(rig, window, window.accelerations)
        signal, _ = on_angle(samples, track)
        tones = window_tones(samples, track, rig.teeth)
        lines = off_order_lines(signal, rig.teeth, track.speed)
    except TwinError:
        return None
    kurtosis, rates, swelling = 0.0, [], []
    shafts = (("pinion", 1.0), ("gear", rig.teeth[0] / rig.teeth[1]))
    if signal.usable.all():
        try:
            rest = without_shaft_lines(signal, rig.teeth).values
            per_turn = 2 * pi / signal.step
            found = [b for b in kurtogram(rest, per_turn) if b.high - b.low > 1000.0 / track.speed]
            if found:
                band = max(found, key=lambda b: b.kurtosis)
                kurtosis = band.kurtosis
                swelling = _swelling(rest, per_turn, track.speed, shafts)
                if kurtosis > IMPULSIVE:
                    seen = modulations(rest, per_turn, (band.low, band.high), shafts, 1e-3)
                    rates = [(float(m.rate), float(m.depth)) for m in seen if m.shaft is None]
        except TwinError:
            pass
    return NonGearFeatures(
        duration=window.duration,
        speed_hz=float(track.speed),
        tones=tuple(
            (float(t.frequency), float(t.frequency_std), float(abs(t.amplitude)), float(t.std), float(t.evidence))
            for t in tones
        ),
        lines=tuple(lines),
        kurtosis=float(kurtosis),
        rates=tuple(rates),
        swelling=tuple(swelling),
    )


def _swelling(
    rest: np.ndarray, per_turn: float, speed_hz: float, shafts: Sequence[tuple[str, float]]
) -> list[tuple[str, float]]:
    """Shafts whose own order modulates the noise, and how deep: by one, it comes and goes once a turn."""
    band = (NOISE_FROM / speed_hz, 0.45 * per_turn)
    seen = modulations(rest, per_turn, band, shafts, 1e-3)
    out = []
    for name, order in shafts:
        depths = [float(m.depth) for m in seen if abs(m.rate / order - 1) < SAME_RATE]
        if depths:
            out.append((name, max(depths)))
    return out
