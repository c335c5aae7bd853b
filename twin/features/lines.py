"""Which lines of a gear pair are read from a signal, and the noise between them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.errors import NotAvailable
from twin.features.gaps import runs
from twin.features.orders import order_lines
from twin.features.resample import AngleSignal
from twin.features.transforms import bins_within, hann, power_of
from twin.features.window_features import Key, MeasuredLines


def order_of(key: Key, teeth: tuple[int, int]) -> float:
    """Order of pinion rotation of the line (k, p, g): k·z1 + p + g·z1/z2."""
    (k, p, g), (z1, z2) = key, teeth
    return k * z1 + p + g * z1 / z2


def mesh_keys(harmonics: int, sidebands: int) -> list[Key]:
    """Mesh harmonics 1 … n, then ± 1 and ± 2 pinion and gear sidebands of the first of them."""
    keys: list[Key] = [(k, 0, 0) for k in range(1, harmonics + 1)]
    for k in range(1, min(harmonics, sidebands) + 1):
        keys += [(k, s, 0) for s in (-1, 1, -2, 2)] + [(k, 0, s) for s in (-1, 1, -2, 2)]
    return keys


def shaft_keys(teeth: tuple[int, int], below: float) -> list[Key]:
    """Pinion orders, then gear orders, that lie below an order of the pinion and below its mesh order."""
    z1, z2 = teeth
    limit = min(below, z1 - 3)
    keys: list[Key] = [(0, p, 0) for p in range(1, int(limit) + 1)]
    return keys + [(0, 0, g) for g in range(1, int(limit * z2 / z1) + 1)]


def read_lines(
    signal: AngleSignal, keys: list[Key], teeth: tuple[int, int], unit: str, parts: Callable
) -> MeasuredLines:
    """Lines of a signal on even angle at the orders of the keys, most wanted first.

    parts   gives, for the orders, what `order_lines` takes: the signal's parts and how each was attenuated
    """
    orders = np.array([order_of(key, teeth) for key in keys])
    found = order_lines(signal, orders, parts(orders))
    good = np.isfinite(found.std)
    return MeasuredLines(
        unit=unit,
        keys=tuple(k for k, ok in zip(keys, good, strict=True) if ok),
        orders=tuple(float(o) for o in orders[good]),
        amplitudes=tuple(complex(a) for a in found.amplitudes[good]),
        std=tuple(float(s) for s in found.std[good]),
        unresolved=tuple(k for k, ok in zip(keys, good, strict=True) if not ok),
    )


def noise_rms(signal: AngleSignal, speed: float, band: tuple[float, float]) -> float:
    """RMS in the band [Hz] of what lies between the orders: a low quantile of the spectrum, block by block.

    In a block of 64 bins the power of noise is exponentially distributed: its 10 % quantile is 0.105 of its
    mean, and lines, which do not fill all bins, hardly move it. Taken from the longest stretch without a gap.
    Where every tooth differs (pitch errors), lines fill the bins between the orders: then an upper bound.
    """
    if not signal.usable.any():
        raise NotAvailable("the noise floor is not available: no sample on the angle is usable")
    if not signal.usable.all():
        start, stop = max(runs(signal.usable), key=lambda r: r[1] - r[0])
        signal = AngleSignal(
            start=signal.start + start * signal.step,
            step=signal.step,
            values=signal.values[start:stop],
            usable=signal.usable[start:stop],
        )
    weight = hann(signal.values.size)
    within = bins_within(band, lambda k: signal.order_of_bin(k) * speed, signal.spectrum.size)
    power = 2 * power_of(signal.spectrum[within][3:]) / (signal.length * (weight @ weight))
    blocks = power[: power.size // 64 * 64].reshape(-1, 64)
    if blocks.size == 0:
        raise NotAvailable(f"the noise floor is not available: {power.size} spectral bins in the band are too few")
    floor = np.quantile(blocks, 0.1, axis=1) / -np.log(0.9)
    return float(np.sqrt(floor.mean() * power.size))
