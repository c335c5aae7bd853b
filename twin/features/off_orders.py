"""Peaks of a spectrum over orders that belong to no shaft: lines, and tones whose frequency moves within the window.

    line            P_i ≥ r·P̄_i,     P̄ the median of the bins near it
    wandering tone  P_i ≥ r·P̄'_i over most bins of a span,     A = √(ΣP_i·n/(m·s)),     P̄' the median of a wide range

P   power of a bin, scaled so that a steady line of amplitude A has A² at its peak
n   bins of the span, m of them at orders of no shaft;  s  sum of P over the bins of a steady line of amplitude 1

A tone that runs through 27 Hz of a window of 2.5 s fills 67 steps of resolution: it raises the median of the bins near
it and is no peak; against the median of a quarter of its frequency it stands out as a steady one of its power does.

Lines near a strong mesh line are its own skirt, where the speed wanders; lines beside any strong line of a shaft are
what Hann's window leaves of it. Both are left out. A mesh line beyond the band has its skirt within it, so the spectrum
goes on beyond the band by as far as a skirt and its mirror image reach; lines are sought up to the band's end.

Source   F. J. Harris, Proc. IEEE 66 (1978) 51–83 (equivalent noise bandwidth of Hann's window: s = 1.5 a step)
Limits   a tone that runs through a mesh line's skirt is seen beside it only
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter1d

from twin.features.channel_lines import LineReading
from twin.features.resample import AngleSignal
from twin.features.shaft_orders import distance_from_turns
from twin.features.transforms import hann, power_of
from twin.thresholds import deciding

TUNED = "tuned on D00–D13 and T01–T58; not derived"
MOST_LINES = 12
MOST_WANDERING = 4
LINE_REACH = 4  # bins to either side that a line is the highest of
AROUND = 61  # bins that the noise near a line is taken from
WIDE_RATIO = 1.25  # of the ends of the range that the noise round a wandering tone is taken from
WIDE_BINS = 128  # that the range has at least
MESH_HARMONICS = range(1, 99)
BANDWIDTH = 1.5  # of Hann's window, in steps of resolution


@dataclass(frozen=True, slots=True, kw_only=True)
class OffOrderThresholds:
    """Which peaks at orders of no shaft are kept."""

    from_shaft: float = deciding(
        2.2,
        unit="resolution steps",
        meaning="distance from any order of a shaft",
        source="Hann's main lobe is two steps to either side",
    )
    from_mesh: float = deciding(
        6.0, unit="resolution steps", meaning="distance from a mesh line, whose skirt the speed widens", source=TUNED
    )
    stands_out: float = deciding(40.0, of="median power around", meaning="power of a line that is kept", source=TUNED)
    least_amplitude: float = deciding(
        15.0, of="acceleration noise floor", meaning="amplitude of a line that is kept", source=TUNED
    )
    of_mesh: float = deciding(
        0.03, of="strongest mesh line near", meaning="amplitude of a line that is not a mesh line's skirt", source=TUNED
    )
    near_mesh: float = deciding(3.0, unit="order", meaning="distance of the mesh lines meant", source=TUNED)
    least_width: float = deciding(
        1.0,
        unit="resolution steps",
        meaning="standard deviation of a tone's frequency within a window above which it wanders",
        source="derivation: Hann's window alone makes 0.58 of a steady line",
    )
    least_filled: float = deciding(
        0.5,
        of="bins of the span",
        meaning="share of them that stand out where one tone wanders through all",
        source="not derived: chosen, most of them",
    )
    widest_gap: float = deciding(
        1.0,
        unit="order",
        meaning="distance within which bins that stand out are of one tone",
        source="derivation: lines of the shafts hide all between them in short windows, and leave some of every order",
    )
    least_free: float = deciding(
        0.1,
        of="power of all bins of the span",
        meaning="power of those at orders of no shaft below which the span is the foot of a shaft's line",
        source="not derived: chosen; a third of the bins is free in the shortest windows",
    )
    mirrored: float = deciding(
        0.1,
        of="power of the span",
        meaning="power at its mirror image about a mesh line from which a span is the mesh line's skirt",
        source="not derived: chosen; a speed that wanders makes both sides alike",
    )
    widest: float = deciding(
        0.12, of="frequency", meaning="widest span of a tone", source="not derived: twice the wander of followed lines"
    )


THRESHOLDS = OffOrderThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OffOrders:
    """One window's spectrum over orders, with the bins that belong to no shaft."""

    order: np.ndarray  # of every bin (n,)
    power: np.ndarray  # (n,), a line's peak has its amplitude squared
    free: np.ndarray  # bins at orders of no shaft (m,), rising
    turns: float
    padding: float  # bins a step of resolution
    speed_hz: float
    top: float  # order up to which lines are sought
    mesh_orders: np.ndarray  # (k,)
    mesh: np.ndarray  # amplitude of each mesh line (k,)
    beside: np.ndarray  # largest amplitude at an order of a shaft within `from_mesh` of every bin (n,)
    timing_error: float  # of a turn, by the pulses that the angle comes from [s]

    @classmethod
    def of(
        cls,
        signal: AngleSignal,
        teeth: tuple[int, int],
        speed_hz: float,
        top: float,
        timing_error: float = 0.0,
        limits: OffOrderThresholds = THRESHOLDS,
    ) -> OffOrders:
        """The spectrum of a signal up to a frequency [Hz]; timing_error as in the class."""
        v = signal.values
        weight = hann(v.size)
        length = fft.next_fast_len(2 * v.size, real=True)
        spectrum = fft.rfft(weight * (v - (weight @ v) / weight.sum()), length) * (2 / weight.sum())
        step = 2 * pi / (length * signal.step)
        turns = v.size * signal.step / (2 * pi)
        power = power_of(spectrum[: int((top / speed_hz + 2 * limits.near_mesh) / step)])
        order = step * np.arange(power.size)
        z1, from_shaft = teeth[0], distance_from_turns(order, teeth)
        from_mesh = np.abs(order - z1 * np.rint(order / z1))
        free = (from_shaft > limits.from_shaft / turns) & (from_mesh > limits.from_mesh / turns) & (order > 0.5)
        reach = 2 * round(limits.from_mesh * length / v.size) + 1
        at = np.array(MESH_HARMONICS) * z1
        mesh = [power[max(0, round(o / step) - 3) : round(o / step) + 4].max(initial=0.0) for o in at.tolist()]
        return cls(
            order=order,
            power=power,
            free=np.flatnonzero(free),
            turns=turns,
            padding=length / v.size,
            speed_hz=speed_hz,
            top=top / speed_hz,
            mesh_orders=at,
            mesh=np.sqrt(mesh),
            beside=np.sqrt(maximum_filter1d(np.where(free, 0.0, power), reach, mode="nearest")),
            timing_error=timing_error,
        )

    def of_shafts(self, teeth: tuple[int, int], beside_mesh: float, most: int) -> tuple[tuple[float, float], ...]:
        """The strongest lines at multiples of either shaft's turn, away from mesh lines: order, amplitude.

        beside_mesh  orders to either side of a mesh line that are left out
        """
        z1, gear = teeth[0], teeth[0] / teeth[1]
        top = min(self.top, float(self.order[-1]))
        orders = np.concatenate([np.arange(1, int(top) + 1), gear * np.arange(1, int(top / gear) + 1)])
        orders = np.unique(np.round(orders, 9))
        orders = orders[np.abs(orders - z1 * np.rint(orders / z1)) > beside_mesh]
        at = np.rint(orders / self.order[1]).astype(int)
        at = at[at < self.order.size - 1]
        power = np.max([self.power[at - 1], self.power[at], self.power[at + 1]], axis=0)
        strongest = np.argsort(-power)
        out: list[tuple[float, float]] = []
        for i in strongest.tolist():
            if all(abs(orders[i] - o) * self.turns > BANDWIDTH for o, _ in out):
                out.append((float(orders[i]), float(np.sqrt(power[i]))))
            if len(out) == most:
                break
        return tuple(out)

    def skirt(self, order: float, limits: OffOrderThresholds = THRESHOLDS) -> float:
        """Amplitude up to which a bin is the skirt of a mesh line near it, or of another line of a shaft close by."""
        close = limits.of_mesh * float(self.beside[min(round(order / self.order[1]), self.order.size - 1)])
        near = np.abs(self.mesh_orders - order) < limits.near_mesh
        blurred = 2 * pi * self.mesh_orders[near] * self.speed_hz * self.timing_error
        return float((np.maximum(limits.of_mesh, blurred) * self.mesh[near]).max(initial=close))


def _around(power: np.ndarray, bins: np.ndarray) -> np.ndarray:
    """Mean power of noise near bins, from the median of AROUND, at the ends of the nearest; (n,), (m,) → (m,)."""
    first = np.clip(bins - AROUND // 2, 0, power.size - AROUND)
    near = first[:, None] + np.arange(AROUND)
    return np.sort(power[near], axis=1)[:, AROUND // 2] / np.log(2)


def lines_of(seen: OffOrders, noise_floor: float, limits: OffOrderThresholds = THRESHOLDS) -> list[tuple[float, float]]:
    """Peaks at orders of neither shaft: (order, amplitude), the strongest first.

    noise_floor  amplitude of a line below which nothing is read, over `least_amplitude`, in the signal's unit
    """
    if seen.free.size < 64:
        return []
    power = seen.power[seen.free]
    highest = power >= maximum_filter1d(power, 2 * LINE_REACH + 1, mode="nearest")
    peaks = 1 + np.flatnonzero((highest & (np.sqrt(power) >= limits.least_amplitude * noise_floor))[1:-1])
    peaks = peaks[power[peaks] >= limits.stands_out * _around(power, peaks)]
    out = []
    for i in peaks.tolist():
        order, a = float(seen.order[seen.free[i]]), float(np.sqrt(power[i]))
        if order <= seen.top and a > seen.skirt(order, limits):
            out.append((order, a))
    return sorted(out, key=lambda line: -line[1])[:MOST_LINES]


@dataclass(frozen=True, slots=True, kw_only=True)
class WanderingTone:
    """A tone of no shaft whose frequency moves within the window."""

    low: float  # ends of its span [order of the pinion]
    high: float
    order: float  # mean, weighted with the power
    width: float  # standard deviation about it
    amplitude: float
    std: float  # of the amplitude, by noise alone

    def reading(self, speed_hz: float) -> LineReading:
        """As a line of the acceleration; its phase means nothing."""
        return LineReading(
            order=self.order,
            frequency=self.order * speed_hz,
            std=self.width * speed_hz,
            follows_angle=0.0,
            channels={"acceleration": (self.amplitude, 0.0, self.std)},
        )

    def holds(self, order: float) -> bool:
        """Whether an order lies within the span."""
        return self.low <= order <= self.high


def wandering_tones(
    seen: OffOrders, noise_floor: float, limits: OffOrderThresholds = THRESHOLDS
) -> list[WanderingTone]:
    """Tones that wander within the window, the strongest first."""
    if seen.free.size < WIDE_BINS:
        return []
    power = seen.power[seen.free]
    background = _wide(seen.order[seen.free], power)
    out_of = np.flatnonzero(power >= limits.stands_out * background)
    clear = [i for i in out_of.tolist() if power[i] > seen.skirt(float(seen.order[seen.free[i]]), limits) ** 2]
    if not clear:
        return []
    orders = seen.order[seen.free[clear]]
    parts = np.split(np.array(clear), 1 + np.flatnonzero(np.diff(orders) > limits.widest_gap))
    found = [_tone(seen, power, background, part, limits) for part in parts]
    loud = limits.least_amplitude * noise_floor
    kept = [t for t in found if t is not None and t.order <= seen.top and t.amplitude > loud]
    return sorted(kept, key=lambda t: -t.amplitude)[:MOST_WANDERING]


def _wide(order: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Mean power of noise round each bin, from the median of a wide range of orders; (m,)."""
    out, start = np.empty(power.size), 0
    while start < power.size:
        stop = max(start + WIDE_BINS, int(np.searchsorted(order, WIDE_RATIO * order[start])))
        if power.size - stop < WIDE_BINS:
            stop = power.size
        out[start:stop] = np.median(power[start:stop]) / np.log(2)
        start = stop
    return out


def _is_skirt(seen: OffOrders, orders: np.ndarray, own: float, limits: OffOrderThresholds) -> bool:
    """Whether a span of orders has its mirror image on the other side of a mesh line, as the skirt of one has.

    own  sum of the power of its bins
    """
    nearest = float(seen.mesh_orders[np.argmin(np.abs(seen.mesh_orders - orders.mean()))])
    if abs(nearest - orders.mean()) > limits.near_mesh:
        return False
    free = seen.order[seen.free]
    mirrored = (free >= 2 * nearest - orders[-1]) & (free <= 2 * nearest - orders[0])
    return float(seen.power[seen.free[mirrored]].sum()) > limits.mirrored * own


def _tone(
    seen: OffOrders, power: np.ndarray, background: np.ndarray, part: np.ndarray, limits: OffOrderThresholds
) -> WanderingTone | None:
    """What stands out in one span as a tone; None where it is narrow, broad, or lines apart."""
    first, last = int(part[0]), int(part[-1])
    own, orders = power[first : last + 1], seen.order[seen.free[first : last + 1]]
    mean = float(np.average(orders, weights=own))
    width = float(np.sqrt(np.average((orders - mean) ** 2, weights=own)))
    span = float(orders[-1] - orders[0])
    narrow = width * seen.turns < limits.least_width
    if narrow or span > limits.widest * mean or part.size < limits.least_filled * own.size:
        return None
    every = seen.power[seen.free[first] : seen.free[last] + 1]
    of_a_shaft = own.sum() < limits.least_free * every.sum()
    if of_a_shaft or _is_skirt(seen, orders, float(own.sum()), limits):
        return None
    hidden = (seen.free[last] - seen.free[first] + 1) / own.size  # bins of the span, over those of no shaft
    line = BANDWIDTH * seen.padding
    noise = float(np.sqrt(background[first] * hidden * own.size / line / 2))
    return WanderingTone(
        low=float(orders[0]),
        high=float(orders[-1]),
        order=mean,
        width=width,
        amplitude=float(np.sqrt(hidden * own.sum() / line)),
        std=noise,
    )
