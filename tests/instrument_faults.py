"""Instruments that are at fault, as they spoil the windows of a machine; plain numpy on recorded channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from twin.windows import Samples, Window

Spoil = Callable[[Window, np.random.Generator], Window]


def _accelerometer(change: Callable[[Samples, np.random.Generator], Samples]) -> Spoil:
    def spoiled(window: Window, chance: np.random.Generator) -> Window:
        return replace(window, accelerations={n: change(s, chance) for n, s in window.accelerations.items()})

    return spoiled


def clock(ppm: float) -> Spoil:
    """An accelerometer's clock that runs fast by so much; its samples are stamped as if it did not."""

    def change(s: Samples, chance: np.random.Generator) -> Samples:
        t = s.times
        return replace(s, values=CubicSpline(t, s.values)(np.clip(t / (1 + ppm * 1e-6), t[0], t[-1])))

    return _accelerometer(change)


def lost(*blocks: int) -> Spoil:
    """Blocks of so many samples that are missing at places drawn by lot; what comes behind them moves up."""

    def change(s: Samples, chance: np.random.Generator) -> Samples:
        values, parts = s.values, len(blocks)
        for i in reversed(range(parts)):
            at = int((i + chance.uniform(0.3, 0.7)) / parts * values.size)
            values = np.delete(values, slice(at, at + blocks[i]))
        return replace(s, values=values)

    return _accelerometer(change)


def bursts(count: int, size: float) -> Spoil:
    """Interference in acceleration and torque at once, of so many times their standard deviations."""

    def spoiled(window: Window, chance: np.random.Generator) -> Window:
        at = np.sort(chance.uniform(0.05, 0.95, count)) * window.duration

        def struck(s: Samples) -> Samples:
            values = s.values.copy()
            for t in at:
                i, n = round((t - s.start) * s.rate), max(2, round(0.004 * s.rate))
                values[i : i + n] += size * np.nanstd(s.values) * chance.normal(size=values[i : i + n].size)
            return replace(s, values=values)

        return replace(
            window,
            accelerations={n: struck(s) for n, s in window.accelerations.items()},
            torques={n: struck(s) for n, s in window.torques.items()},
        )

    return spoiled


def loose_cable(rate: float, shortest: float, longest: float, digit: float = 0.0) -> Spoil:
    """A contact that opens so many times a second, by lot, for so long [s]; the last digit as a share of the RMS."""

    def change(s: Samples, chance: np.random.Generator) -> Samples:
        values = s.values.copy()
        for at in chance.integers(0, values.size, int(rate * values.size / s.rate)):
            values[at : at + int(chance.uniform(shortest, longest) * s.rate)] = 0.0
        if digit:
            q = digit * np.nanstd(s.values)
            values = q * np.rint(values / q + chance.uniform(-0.4, 0.4, values.size))
        return replace(s, values=values)

    return _accelerometer(change)


def settling(size: float, time: float) -> Spoil:
    """A sensor's zero that settles in `time` [s], from so many times its standard deviation."""
    return _accelerometer(
        lambda s, chance: replace(s, values=s.values + size * np.nanstd(s.values) * np.exp(-(s.times - s.start) / time))
    )


def saturated(share: float) -> Spoil:
    """A range that ends at a share of the largest value."""
    return _accelerometer(
        lambda s, chance: replace(
            s, values=np.clip(s.values, *(share * np.nanmax(np.abs(s.values)) * np.array([-1, 1])))
        )
    )


def reversed_polarity() -> Spoil:
    """A sensor that is wired or mounted the other way round."""
    return _accelerometer(lambda s, chance: replace(s, values=-s.values))


def mount(frequency: float, damping: float) -> Spoil:
    """A resonance of the mount [Hz] within the band."""

    def change(s: Samples, chance: np.random.Generator) -> Samples:
        f = np.fft.rfftfreq(s.values.size, 1 / s.rate) / frequency
        return replace(s, values=np.fft.irfft(np.fft.rfft(s.values) / (1 - f**2 + 2j * damping * f), s.values.size))

    return _accelerometer(change)


KINDS: Mapping[str, tuple[Spoil, ...]] = {
    "clock": (clock(60), clock(-150), clock(300), clock(-800), clock(1500)),
    "lost samples": (lost(100), lost(256), lost(1024), lost(64, 300), lost(500, 500, 500)),
    "bursts": (bursts(4, 8.0), bursts(7, 12.0), bursts(12, 20.0), bursts(5, 40.0), bursts(9, 15.0)),
    "loose cable": (
        loose_cable(40, 2e-3, 6e-3),
        loose_cable(10, 1e-3, 20e-3),
        loose_cable(40, 2e-3, 6e-3, 1e-3),
        loose_cable(4, 20e-3, 60e-3, 3e-4),
        loose_cable(80, 1e-3, 3e-3),
    ),
    "settling": (settling(3.0, 1.0), settling(8.0, 0.8), settling(-5.0, 2.0), settling(20.0, 3.0), settling(2.0, 5.0)),
    "saturated": (saturated(0.8), saturated(0.6), saturated(0.5), saturated(0.4), saturated(0.3)),
    "polarity": (reversed_polarity(),),
    "mount": (mount(2600.0, 0.02), mount(3400.0, 0.05), mount(1900.0, 0.03), mount(4500.0, 0.02)),
}
