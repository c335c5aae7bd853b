"""Changes of a window against the healthy baseline, by the orders and the angle at which they appear.

    Y_k = g(f_k)·x_k + δ_k + noise

x    the healthy machine at this operating point                     (learned.py)
g    change of the transfer path to a sensor: one smooth function of frequency for the lines of all shafts
δ    change of one shaft's excitation: lines at n·s of its order s that no other shaft makes

    evidence = Σ (|δ|²/σ² − 1)            nats against the healthy scatter σ² = E|Y − x|² of complex lines, less one nat
                                          for every free line

The kind of δ follows from its orders and from the phases of its lines:

    mesh orders                       every tooth alike
    n = 1 alone                       run-out of the shaft
    many n, in phase at one angle     something local: one tooth, struck once a turn
    many n, without common phase      teeth that have changed all round the shaft

Source   twin/effects (what each effect does to orders and angle); P. D. McFadden, J. D. Smith, Proc. IMechE 199 C4
         (1985) 287–292 (a local defect is a pulse in the average)
Holds    the same teeth in mesh as in the baseline
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from twin.baseline.learned import Baseline, ExpectedLines
from twin.baseline.operating import DEFAULT as OPERATING
from twin.baseline.reading import WindowReading
from twin.baseline.repeats import LINES, NOTHING_LEFT_OUT, Repeats
from twin.baseline.repeats import PATHS as PATHS_OF_SENSORS
from twin.baseline.shaft_orders import own_multiples
from twin.baseline.transfer_path import DEFAULT as PATHS
from twin.baseline.transfer_path import Path, band_gains, band_levels, common_level, lesser, over_usual
from twin.thresholds import deciding

MESH_LINES = 6  # harmonics of the mesh that are compared
BESIDE_MESH = np.array([-3, -2, -1, 1, 2, 3])  # orders of the pinion from a mesh line


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineThresholds:
    """When a change against the healthy baseline is believed, and what kind it is."""

    least_evidence: float = deciding(
        120.0, unit="nat", meaning="evidence that a change of a shaft's lines must have",
        source="between observed values on the seven loads of the broken-tooth set, on which it is judged, too: "
        "healthy recordings reach 17 between the learned loads and 90 beyond them",
    )  # fmt: skip
    few_recordings: float = deciding(
        2.0, of="least evidence / recordings left out",
        meaning="additional evidence where the scatter is estimated from few recordings",
        source="not derived: a variance of n recordings is uncertain by about sqrt(2/n)",
    )  # fmt: skip
    extrapolated: float = deciding(
        4.0, meaning="ratio of path scatter and evidence required far beyond the learned operating points; it grows "
        "evenly from 1 at their end", source="tuned on the seven loads of the broken-tooth set",
    )  # fmt: skip
    changed_path: float = deciding(
        2.0, meaning="ratio of evidence required in a channel whose transfer path has changed", source="not derived",
    )  # fmt: skip
    path_smoothness: float = deciding(
        0.15, of="line", meaning="error that one gain a band leaves of a changed path", source="not derived",
    )  # fmt: skip
    least_bands: int = deciding(
        3, meaning="bands with a known gain from which a path is estimated",
        source="derivation: gain and shift need two",
    )  # fmt: skip
    strong_line: float = deciding(
        4.0, unit="standard deviations", meaning="size from which a changed line is used for the kind of the change",
        source="derivation: noise exceeds it with a probability of 1e-7",
    )  # fmt: skip
    run_out_share: float = deciding(
        0.8, meaning="share of the first order in the energy of the strong lines that makes a change run-out",
        source="not derived",
    )  # fmt: skip
    local_coherence: float = deciding(
        0.75, meaning="|Σ δ·e^{inφ}| over Σ |δ| at the best angle that makes a change local",
        source="tuned on the seven loads of the broken-tooth set; one pulse has 1, random phases about 0.5",
    )  # fmt: skip
    local_lines: int = deciding(
        4, meaning="strong lines that a local change must have",
        source="derivation: three phases can be aligned by chance at one of 2048 angles",
    )  # fmt: skip
    same_teeth: float = deciding(
        0.3, meaning="correlation with the baseline's tooth pattern below which the gears are others",
        source="tuned on the seven loads of the broken-tooth set",
    )  # fmt: skip
    few_lines: int = deciding(
        4, meaning="strong lines that a change all round a shaft must have", source="as for a local change",
    )  # fmt: skip
    beside_mesh: float = deciding(
        0.1, of="energy of a changed mesh line", meaning="energy of the change of its neighbours, from which "
        "the change is not that of all teeth alike",
        source="not derived: a pulse once a turn leaves about 1, teeth that wear alike nothing",
    )  # fmt: skip
    mesh_turn: float = deciding(
        0.6, unit="rad of the mesh", meaning="error of the mesh phase that the alignment of two windows leaves",
        source="derivation: standard error of the alignment, times the tooth count",
    )  # fmt: skip


DEFAULT = BaselineThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShaftChange:
    """The change of the lines of one shaft, or of the mesh, in one channel."""

    shaft: Fraction  # order; the pinion's tooth count for the mesh
    channel: str
    multiples: np.ndarray  # n (m,)
    lines: np.ndarray  # δ_n complex (m,)
    ratio: np.ndarray  # |δ_n|/σ_n (m,)
    log_evidence: float
    zero: float  # angle of the shaft in this window at the baseline's zero [turns]
    angle: float  # of the shaft at which the lines are in phase, from there [turns]
    in_phase: float  # |Σ δ·e^{inφ}| over Σ |δ| there, of the strong lines
    width: float  # share of a turn that holds four fifths of the pulse's energy
    limits: BaselineThresholds = DEFAULT

    @property
    def strong(self) -> np.ndarray:
        return self.ratio > self.limits.strong_line

    @property
    def kind(self) -> str:
        """A shape of twin/effects/signature.py: `alike`, `run_out`, `local` or `all_round`; or `few` lines of none."""
        if self.shaft > 1 and self.shaft.denominator == 1:
            return "alike"
        energy = np.abs(self.lines) ** 2 * self.strong
        if energy[self.multiples == 1].sum() > self.limits.run_out_share * energy.sum():
            return "run_out"
        local = self.strong.sum() >= self.limits.local_lines and self.in_phase > self.limits.local_coherence
        if local:
            return "local"
        return "all_round" if self.strong.sum() >= self.limits.few_lines else "few"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BaselineComparison:
    """A window compared with the healthy machine."""

    reading: WindowReading
    expected: ExpectedLines
    paths: tuple[Path, ...]
    changes: tuple[ShaftChange, ...]  # of every shaft and channel, strongest evidence first
    repeats: Repeats = NOTHING_LEFT_OUT
    limits: BaselineThresholds = DEFAULT

    @property
    def same_teeth(self) -> bool:
        """Whether the pattern of the teeth is the baseline's, as far as healthy recordings repeat theirs."""
        found = self.expected.alignment
        return found is None or not self.repeats.pattern_compared or found.correlation > self.limits.same_teeth

    @property
    def extrapolated(self) -> float:
        """By how much more a change must show for its distance from the learned operating points: from 1 on."""
        return _extrapolated(self.expected, self.limits)

    def least_evidence(self, change: ShaftChange) -> float:
        """Evidence from which a change is believed [nat]."""
        limits = self.limits
        # a scatter that is widened for the distance already needs less additional evidence
        more = max(self.extrapolated / self.expected.wider**2, 1.0)
        more *= 1 + limits.few_recordings / self.expected.left_out
        moved = any(p.moved for p in self.paths if p.channel == change.channel)
        raised = self.repeats.factor(LINES, change.channel)
        return limits.least_evidence * more * raised * (limits.changed_path if moved else 1.0)

    @property
    def believed(self) -> tuple[ShaftChange, ...]:
        """Changes beyond what healthy recordings show."""
        return tuple(c for c in self.candidates if c.log_evidence > self.least_evidence(c))

    @property
    def candidates(self) -> tuple[ShaftChange, ...]:
        """Changes that are believed where their evidence suffices."""
        moved = {p.channel for p in self.paths if p.moved}
        if not self.same_teeth:
            return ()
        # mesh lines depend on load and transfer path: outside the known range their changes are not believed
        known = self.expected.interpolated
        return tuple(
            c
            for c in self.changes
            if c.strong.any() and (c.kind != "alike" or (known and c.channel not in moved and not self._beside_mesh(c)))
        )

    def _beside_mesh(self, mesh: ShaftChange) -> bool:
        """Whether the lines beside the changed mesh lines have changed, too: a pulse once a turn does that."""
        strong, channel = mesh.strong, mesh.channel
        x, y = self.expected.lines[channel], self.reading.channels[channel].lines
        orders = (mesh.multiples[strong, None] * int(mesh.shaft) + BESIDE_MESH) * self.reading.period - 1
        places = orders[(orders >= 0) & (orders < x.size)]
        beside = np.maximum(np.abs(y[places] - x[places]) ** 2 - self.expected.std[channel][places] ** 2, 0.0)
        own = float(np.mean(np.abs(mesh.lines[strong]) ** 2))
        return bool(np.mean(beside) > self.limits.beside_mesh * own)

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


def compare(baseline: Baseline, reading: WindowReading, limits: BaselineThresholds = DEFAULT) -> BaselineComparison:
    """A window compared with the baseline; NotAvailable where they have too little in common."""
    expected = baseline.expected(reading)
    ahead = 0.0 if expected.alignment is None else expected.alignment.angle
    paths = _paths(baseline, reading, expected, limits)
    changes: list[ShaftChange] = []
    for channel, x in expected.lines.items():
        y, σ = reading.channels[channel].lines[: x.size], expected.std[channel]
        orders = np.arange(1, x.size + 1) / reading.period
        g, spread = np.ones(orders.size, dtype=complex), σ
        if channel in paths and paths[channel].moved:
            g = paths[channel].at(orders)
            spread = np.abs(g) * np.hypot(σ, limits.path_smoothness * np.abs(x))
        for shaft in baseline.shafts:
            n = own_multiples(shaft, baseline.shafts, x.size / reading.period)
            if n.size:
                changes.append(_change(shaft, n, channel, y - g * x, spread, reading.period, ahead, limits))
        mesh = Fraction(int(baseline.rig.teeth[0]))
        n = np.arange(1, min(MESH_LINES, int(orders[-1] / mesh)) + 1)
        turned = _turned_mesh(y, g * x, spread, mesh, reading.period, limits)
        changes.append(_change(mesh, n, channel, turned, spread, reading.period, ahead, limits))
    changes.sort(key=lambda c: -c.log_evidence)
    return BaselineComparison(
        reading=reading, expected=expected, paths=tuple(paths.values()), changes=tuple(changes),
        repeats=baseline.repeats, limits=limits,
    )  # fmt: skip


def _extrapolated(expected: ExpectedLines, limits: BaselineThresholds) -> float:
    return 1 + (limits.extrapolated - 1) * min(expected.beyond / OPERATING.far, 1.0)


def _paths(
    baseline: Baseline, reading: WindowReading, expected: ExpectedLines, limits: BaselineThresholds
) -> dict[str, Path]:
    """The transfer path of every channel whose bands determine it, and what all of them share."""
    more = max(expected.wider, _extrapolated(expected, limits))
    gains: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    levels: dict[str, np.ndarray] = {}
    for channel, x in expected.lines.items():
        y, σ = reading.channels[channel].lines[: x.size], expected.std[channel]
        orders = np.arange(1, x.size + 1) / reading.period
        middles, gain = band_gains(x, y, σ, orders)
        if middles.size >= limits.least_bands:
            gains[channel] = middles, gain
            levels[channel] = band_levels(expected.power[channel], y, orders, middles)
    both = {channel: lesser(gain, levels[channel]) for channel, (_, gain) in gains.items()}
    common, common_power = 0.0, 0.0
    if len(gains) == len(expected.lines):
        common_power = common_level(list(both.values()))
        # two sensors cannot separate a phase that the lines lost between recordings from a change of one sensor
        common = common_level([g for _, g in gains.values()]) if len(both) > PATHS.least_sensors else common_power
    return {
        channel: Path(
            channel=channel,
            orders=middles,
            gain=gain,
            level=levels[channel],
            common=common,
            common_power=common_power,
            change=float(np.sqrt(np.mean((np.log(both[channel]) - common_power) ** 2))),
            usual=more * baseline.path_scatter.get(channel, 0.0),
            over_usual=over_usual(middles.size, baseline.counted.recordings, len(gains)),
            raised=baseline.repeats.factor(PATHS_OF_SENSORS, channel),
        )
        for channel, (middles, gain) in gains.items()
    }


def _turned_mesh(
    y: np.ndarray, x: np.ndarray, σ: np.ndarray, mesh: Fraction, period: int, limits: BaselineThresholds
) -> np.ndarray:
    """y − x with the mesh lines turned together to the nearest phase that the alignment of the windows leaves open."""
    n = np.arange(1, min(MESH_LINES, y.size // (int(mesh) * period)) + 1)
    places = n * int(mesh) * period - 1
    if places.size == 0:
        return y - x
    turned = np.exp(1j * np.outer(np.linspace(-limits.mesh_turn, limits.mesh_turn, 121), n)) * y[places]
    off = (np.abs(turned - x[places]) ** 2 / σ[places] ** 2).sum(axis=1)
    left = y - x
    left[places] = turned[int(np.argmin(off))] - x[places]
    return left


def _change(
    shaft: Fraction,
    n: np.ndarray,
    channel: str,
    left: np.ndarray,
    σ: np.ndarray,
    period: int,
    ahead: float,
    limits: BaselineThresholds,
) -> ShaftChange:
    """The remainder at multiples n of an order.

    ahead  angle of the pinion by which the window is ahead of the baseline [rad]
    """
    places = np.array([int(m * shaft * period) for m in n.tolist()]) - 1
    δ, ratio = left[places], np.abs(left[places]) / σ[places]
    strong = ratio > limits.strong_line
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
        limits=limits,
    )
