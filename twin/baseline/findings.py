"""What a window shows beyond the healthy machine, by the orders and the angle at which it shows it.

    Y_k = g(f_k)·x_k + δ_k + noise

x    the healthy machine at this operating point                     (learned.py)
g    what changed on the way to a sensor: one smooth function of frequency for the lines of all shafts alike
δ    what one shaft does more or otherwise than before: lines at n·s of its order s that no other shaft makes

    evidence = Σ (|δ|²/σ² − 1)            nats against the healthy scatter σ² = E|Y − x|² of complex lines; one nat is
                                          asked for every line that is free

What δ is follows from its orders and from the phases of its lines:

    mesh orders                       every tooth alike
    n = 1 alone                       run-out of the shaft
    many n, in phase at one angle     something local: one tooth, struck once a turn
    many n, phases anyhow             teeth that differ from before, all round

Source   twin/effects (what each effect does to orders and angle); P. D. McFadden, J. D. Smith, Proc. IMechE 199 C4
         (1985) 287–292 (a local defect is a pulse in the average)
Holds    the same teeth in mesh as in the baseline
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from twin.baseline.learned import Baseline, ExpectedLines
from twin.baseline.reading import WindowReading
from twin.baseline.transfer_path import LEAST_SENSORS, Path, band_gains, band_levels, common_level, lesser

LEAST_BANDS = 3  # that a path is told by
TURNED = 0.6  # of the mesh's phase, that the angle between two windows may be off [rad]
MESH_LINES = 6  # harmonics of the mesh that are looked at
LINES = 12  # of a shaft that are looked at, from its first
LEAST_EVIDENCE = 120.0  # nats: the scatter is of few recordings; healthy ones of the set of broken teeth reach 17
# between the loads learned and 90 beyond them, where EXTRAPOLATED asks for more
STRONG = 4.0  # |δ|/σ of a line that counts
ALONE = 0.8  # share of n = 1 in the energy that makes it run-out
LOCAL = 0.75  # |Σ δ·e^{inφ}| over Σ |δ| at the best angle, that makes it local
LOCAL_LINES = 4  # strong lines that a local fault has at least
FEW = 2.0  # over the recordings left out: how much more is asked where the scatter is of so few
EXTRAPOLATED = 4.0  # times more scatter of a path, and evidence asked, beyond what was learned
SMOOTH = 0.15  # of a line: what one gain a band leaves of a path that has changed
BESIDE_PATH = 2.0  # times more evidence in a channel whose path has changed
SAME_TEETH = 0.3  # correlation with the baseline's pattern below which these are other teeth


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShaftChange:
    """What one shaft, or the mesh, does beyond the baseline, in one channel."""

    shaft: Fraction  # order; the pinion's tooth count for the mesh
    channel: str
    multiples: np.ndarray  # n (m,)
    lines: np.ndarray  # δ_n complex (m,)
    ratio: np.ndarray  # |δ_n|/σ_n (m,)
    log_evidence: float
    zero: float  # where in the window's turn of the shaft the baseline's begins [turns]
    angle: float  # of the shaft at which the lines are in phase, from there [turns]
    in_phase: float  # |Σ δ·e^{inφ}| over Σ |δ| there, of the strong lines
    width: float  # share of a turn that holds four fifths of the pulse's energy

    @property
    def strong(self) -> np.ndarray:
        return self.ratio > STRONG

    @property
    def kind(self) -> str:
        """A shape of twin/effects/signature.py: `alike`, `run_out`, `local` or `all_round`."""
        if self.shaft > 1 and self.shaft.denominator == 1:
            return "alike"
        energy = np.abs(self.lines) ** 2 * self.strong
        if energy[self.multiples == 1].sum() > ALONE * energy.sum():
            return "run_out"
        return "local" if self.strong.sum() >= LOCAL_LINES and self.in_phase > LOCAL else "all_round"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BaselineComparison:
    """A window beside the healthy machine."""

    reading: WindowReading
    expected: ExpectedLines
    paths: tuple[Path, ...]
    changes: tuple[ShaftChange, ...]  # of every shaft and channel, strongest evidence first

    @property
    def same_teeth(self) -> bool:
        """Whether the pattern of the teeth is the baseline's."""
        found = self.expected.alignment
        return found is None or found.correlation > SAME_TEETH

    @property
    def believed(self) -> tuple[ShaftChange, ...]:
        """Changes beyond what healthy recordings show."""
        # what widens the scatter already is not asked for twice
        more = 1.0 if self.expected.interpolated else max(EXTRAPOLATED / self.expected.wider**2, 1.0)
        more *= 1 + FEW / self.expected.left_out
        moved = {p.channel for p in self.paths if p.moved}

        def least(change: ShaftChange) -> float:
            return LEAST_EVIDENCE * more * (BESIDE_PATH if change.channel in moved else 1.0)

        if not self.same_teeth:
            return ()
        # mesh lines go with the load, and with the way to the sensor: there nothing of theirs is believed
        known = self.expected.interpolated
        return tuple(
            c
            for c in self.changes
            if c.log_evidence > least(c)
            and c.strong.any()
            and (c.kind != "alike" or (known and c.channel not in moved))
        )

    def explained(self, channel: str) -> np.ndarray:
        """The lines of a channel with everything that was found (K,)."""
        x = self.expected.lines[channel].copy()
        orders = np.arange(1, x.size + 1) / self.reading.period
        for path in self.paths:
            if path.channel == channel and path.moved:
                x *= path.at(orders)
        for change in self.believed:
            if change.channel == channel:
                places = np.rint(change.multiples * float(change.shaft) * self.reading.period).astype(int) - 1
                x[places] += change.lines
        return x

    def explained_power(self, channel: str) -> np.ndarray:
        """|Y|² of the lines of a channel with everything that was found (K,)."""
        power = self.expected.power[channel].copy()
        orders = np.arange(1, power.size + 1) / self.reading.period
        for path in self.paths:
            if path.channel == channel and path.moved:
                power *= path.level_at(orders) ** 2
        with_all = self.explained(channel)
        for change in self.believed:
            if change.channel == channel:
                places = np.rint(change.multiples * float(change.shaft) * self.reading.period).astype(int) - 1
                power[places] = np.abs(with_all[places]) ** 2
        return power


def compare(baseline: Baseline, reading: WindowReading) -> BaselineComparison:
    """A window beside the baseline; NotAvailable where they cannot be compared."""
    expected = baseline.expected(reading)
    more = expected.wider if expected.interpolated else max(expected.wider, EXTRAPOLATED)
    ahead = 0.0 if expected.alignment is None else expected.alignment.angle
    found = {}
    for channel, x in expected.lines.items():
        y, σ = reading.channels[channel].lines[: x.size], expected.std[channel]
        found[channel] = band_gains(x, y, σ, np.arange(1, x.size + 1) / reading.period)
    told = {channel: (middles, gain) for channel, (middles, gain) in found.items() if middles.size >= LEAST_BANDS}
    levels = {
        channel: band_levels(
            expected.power[channel],
            reading.channels[channel].lines[: expected.lines[channel].size],
            np.arange(1, expected.lines[channel].size + 1) / reading.period,
            middles,
        )
        for channel, (middles, _) in told.items()
    }
    both = {channel: lesser(gain, levels[channel]) for channel, (_, gain) in told.items()}
    common, common_power = 0.0, 0.0
    if len(told) == len(found):
        common_power = common_level(list(both.values()))
        # two sensors are too few to tell what lines lose in phase between the recordings from what one sensor does
        common = common_level([gain for _, gain in told.values()]) if len(both) > LEAST_SENSORS else common_power
    paths, changes = [], []
    for channel, x in expected.lines.items():
        y, σ = reading.channels[channel].lines[: x.size], expected.std[channel]
        orders = np.arange(1, x.size + 1) / reading.period
        g, spread = np.ones(orders.size, dtype=complex), σ
        if channel in told:
            middles, gain = told[channel]
            path = Path(
                channel=channel,
                orders=middles,
                gain=gain,
                level=levels[channel],
                common=common,
                common_power=common_power,
                change=float(np.sqrt(np.mean((np.log(both[channel]) - common_power) ** 2))),
                usual=more * baseline.path_scatter.get(channel, 0.0),
            )
            paths.append(path)
            if path.moved:
                g = path.at(orders)
                spread = np.abs(g) * np.hypot(σ, SMOOTH * np.abs(x))
        for shaft in baseline.shafts:
            n = own_multiples(shaft, baseline.shafts, x.size / reading.period)
            if n.size:
                changes.append(_change(shaft, n, channel, y - g * x, spread, reading.period, ahead))
        mesh = Fraction(int(baseline.rig.teeth[0]))
        n = np.arange(1, min(MESH_LINES, int(orders[-1] / mesh)) + 1)
        changes.append(
            _change(
                mesh, n, channel, _turned_mesh(y, g * x, spread, mesh, reading.period), spread, reading.period, ahead
            )
        )
    changes.sort(key=lambda c: -c.log_evidence)
    return BaselineComparison(reading=reading, expected=expected, paths=tuple(paths), changes=tuple(changes))


def _turned_mesh(y: np.ndarray, x: np.ndarray, σ: np.ndarray, mesh: Fraction, period: int) -> np.ndarray:
    """y − x, the mesh lines turned together to where they are nearest: the teeth's pattern leaves so much open."""
    n = np.arange(1, min(MESH_LINES, y.size // (int(mesh) * period)) + 1)
    places = n * int(mesh) * period - 1
    if places.size == 0:
        return y - x
    turned = np.exp(1j * np.outer(np.linspace(-TURNED, TURNED, 121), n)) * y[places]
    off = (np.abs(turned - x[places]) ** 2 / σ[places] ** 2).sum(axis=1)
    left = y - x
    left[places] = turned[int(np.argmin(off))] - x[places]
    return left


def own_multiples(shaft: Fraction, shafts: Sequence[Fraction], highest: float, most: int = LINES) -> np.ndarray:
    """n of a shaft's lines n·s that no other shaft makes by itself, the lowest first."""
    others = [s for s in shafts if s != shaft]
    n = range(1, int(highest / float(shaft)) + 1)
    own = [m for m in n if not any((m * shaft / s).denominator == 1 for s in others)]
    return np.array(own[:most], dtype=int)


def _change(
    shaft: Fraction, n: np.ndarray, channel: str, left: np.ndarray, σ: np.ndarray, period: int, ahead: float
) -> ShaftChange:
    """What is left at multiples n of an order; `ahead`, by which the baseline is, of the pinion [rad]."""
    places = np.array([int(m * shaft * period) for m in n.tolist()]) - 1
    δ, ratio = left[places], np.abs(left[places]) / σ[places]
    strong = ratio > STRONG
    φ = np.linspace(0, 1, 2048, endpoint=False)
    turned = np.exp(2j * np.pi * np.outer(φ, n.astype(float)))
    together = np.abs(turned[:, strong] @ δ[strong]) if strong.any() else np.zeros(φ.size)
    best = int(np.argmax(together))
    pulse = np.abs(turned[:, strong] @ δ[strong]) ** 2 if strong.any() else np.ones(φ.size)
    zero = float(shaft) * ahead / (2 * np.pi) % 1
    widest = np.sort(pulse)[::-1].cumsum()
    return ShaftChange(
        shaft=shaft,
        channel=channel,
        multiples=n,
        lines=δ,
        ratio=ratio,
        log_evidence=float(np.sum(ratio**2 - 1)),
        zero=zero,
        angle=float((φ[best] - zero) % 1),
        in_phase=float(together[best] / max(np.abs(δ[strong]).sum(), 1e-300)),
        width=float((np.searchsorted(widest, 0.8 * widest[-1]) + 1) / φ.size),
    )
