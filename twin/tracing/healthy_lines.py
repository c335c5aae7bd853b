"""How far the lines of a healthy machine lie from what its twin predicts: the variance of every line of a window.

    v = 2·σ² + (κ_k² + s²)·(|m₀|² + |m − m₀|²) + (P·e·u)² + δ² + c²

σ    noise of the real and of the imaginary part
m    predicted line, m₀ that of unworn flanks, with the factors that the twin has learned of path and mesh: where wear
     nearly cancels a line, it is as uncertain as both its parts
κ_k  departure from window to window of the k-th mesh harmonic, which grows with the depth worn since the windows that
     taught the factors (scatter.py)
s    what the structure may be off at the line's frequency by the rig file's tolerances, as far as the twin has not
     learned the factor there
P    the channel's line per displacement of the teeth (updating/line_scatter.py), 1 for the encoders
e    form of real teeth that no model has, φ and β at mesh orders (scatter.py); u as far as no learned factor holds it
δ    of the encoders: a disc's once-per-turn error at the order of its shaft, its graduation at the others
c    floor of the channel; of the acceleration away from mesh orders its noise floor

A machine whose learned factors lie further from one than its tolerances allow has a structure of its own; s then grows
by the ratio (R. T. Birge, Phys. Rev. 40 (1932) 207–227), up to what healthy machines reach: beyond it the path is
another than the rig file's, and hides nothing. The energy that several lines together leave is up to
M·χ²_n(q)/n with M = Σv and n = 2·M²/Σv² (F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110–114).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from twin.rig import Rig
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.scatter import HealthyScatter
from twin.tracing.tooth_patterns import PATTERNS
from twin.updating.line_scatter import DeviatingMachines, deviating_machines
from twin.updating.memory import Line, Memory
from twin.updating.prediction import MESH, PATH

ENCODERS = ("transmission_error", "pinion_motion")


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthyLimits:
    """When the error of a channel is beyond that of a healthy machine."""

    quantile: float = deciding(
        0.99,
        meaning="share of healthy machines whose held-out error of a channel is at most the limit",
        source="derivation: with three figures (acceleration, transmission error, level), one healthy machine in 33",
    )
    foreign: float = deciding(
        0.1,
        of="measured line",
        meaning="scatter of the level of a line that follows no shaft",
        source="not derived: chosen",
    )
    foreign_floor: float = deciding(
        1e-3,
        of="largest line of the channel",
        meaning="the same of a line that a window does not show",
        source="not derived: chosen; 60 dB below what the channel carries",
    )
    most_departure: float = deciding(
        5.0,
        of="what the rig file's tolerances allow",
        meaning="distance of the learned factors from one by which the scatter of a structure of its own grows at most",
        source="between observed values: machines at twice the tolerances reach 5.1 with a torque meter; "
        "paths that are not linear 19 and more",
    )
    graduation: float = deciding(
        0.05,
        of="graduation error of the disc",
        meaning="scatter of a line of the encoders away from the shafts' lowest orders",
        source="measured: 0.03 µm on the reference rig, as for tooth errors",
    )


LIMITS = HealthyLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedFactors:
    """Factors of path and mesh as the windows that were fitted taught them."""

    path: tuple[Line, ...]
    mesh: tuple[Line, ...]
    depths: tuple[float, ...] = ()  # of wear in the windows that taught them [m]

    @classmethod
    def of(cls, memory: Memory, held_out: Collection[int], depths: Mapping[int, float]) -> LearnedFactors:
        """Those of a memory, without what windows that are held out have taught.

        depths  of each window by index [m]
        """
        path, mesh = (
            tuple(line for line in lines if int(line[0]) not in held_out) for lines in (memory.path, memory.mesh)
        )
        taught = sorted({int(line[0]) for line in (*path, *mesh)})
        return cls(path=path, mesh=mesh, depths=tuple(depths.get(i, 0.0) for i in taught))

    def apart(self, depth: float) -> float:
        """How far a depth is from the nearest of the windows that taught the factors [m]; itself where none did."""
        return min((abs(depth - d) for d in self.depths), default=depth)

    def at(self, frequency: np.ndarray, window: int) -> tuple[np.ndarray, np.ndarray]:
        """Factors of path and mesh at frequencies [Hz] in a window; complex (n,) each."""
        return PATH.predict(self.path, frequency, window), MESH.predict(self.mesh, frequency, window)

    def unknown(self, channel: str, frequency: np.ndarray) -> np.ndarray:
        """u = √(1 − r²), r the correlation with the nearest line that was learned, at frequencies [Hz] (n,)."""
        lines = self.path if channel == "acceleration" else self.mesh
        if not lines:
            return np.ones(frequency.size)
        f = np.array([line[1] for line in lines])
        near = np.exp(-0.5 * (np.log(frequency[:, None] / f[None, :]) / PATH.reach) ** 2).max(axis=1)
        return np.sqrt(1 - near**2)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HealthyLines:
    """What the lines of the healthy machines of one rig file differ by."""

    teeth: tuple[int, int]
    scales: Scales
    sizes: HealthyScatter
    machines: DeviatingMachines

    @classmethod
    def of(cls, rig: Rig) -> HealthyLines:
        """NotAvailable where the rig file does not suffice for a model."""
        scales = Scales.of(rig)
        return cls(
            teeth=rig.teeth,
            scales=scales,
            sizes=HealthyScatter.of_rig(rig, scales),
            machines=deviating_machines(rig),
        )

    def variance(
        self,
        channel: str,
        orders: np.ndarray,
        speed_hz: float,
        parts: np.ndarray,
        std: np.ndarray,
        depth: float,
        learned: LearnedFactors,
    ) -> np.ndarray:
        """v of a channel's lines in one window (n,), in the square of the channel's unit.

        orders     of pinion rotation (n,)
        parts      √(|m₀|² + |m − m₀|²) (n,)
        std        σ (n,)
        depth      of wear [m]
        """
        frequency = np.maximum(orders * speed_hz, 1.0)
        apart = depth if channel == "torque" else learned.apart(depth)
        structure = self._structure(channel, frequency, learned)
        relative = np.hypot(self._between_windows(channel, orders, apart), structure)
        disc = self._disc(orders) if channel in ENCODERS else 0.0
        mesh = self._of_mesh(orders)
        v = 2 * std**2 + (relative * parts) ** 2 + disc**2 + self._floor(channel, mesh) ** 2
        form = np.where(mesh, np.hypot(self.sizes.each, self.sizes.common), 0.0)
        if channel not in ENCODERS:
            form = form * np.abs(self.machines.transfer(channel, frequency))
        if channel != "torque":
            form = form * learned.unknown(channel, frequency)
        return np.maximum(v + form**2, np.finfo(float).tiny)

    def _floor(self, channel: str, mesh: np.ndarray) -> np.ndarray:
        """c (n,), of lines that are the mesh's and of others."""
        if channel in ENCODERS:
            return np.zeros(mesh.size)
        at_mesh = self.sizes.channels[channel].floor
        return np.where(mesh, at_mesh, self.scales.acceleration if channel == "acceleration" else at_mesh)

    def _of_mesh(self, orders: np.ndarray) -> np.ndarray:
        return np.abs(orders / self.teeth[0] - np.rint(orders / self.teeth[0])) < 1e-6

    def _between_windows(self, channel: str, orders: np.ndarray, apart: float) -> np.ndarray:
        """κ (n,), that of the nearest mesh harmonic, so far in depth from what taught the factors [m]."""
        scatter = self.sizes.channels["encoder" if channel in ENCODERS else channel]
        k = np.maximum(np.rint(orders / self.teeth[0]).astype(int), 1)
        return scatter.sizes(int(k.max(initial=1)))[1][k - 1] + scatter.per_depth * k * apart

    def _structure(self, channel: str, frequency: np.ndarray, learned: LearnedFactors) -> np.ndarray:
        """s (n,)."""
        tolerance = np.sqrt(np.sum(np.abs(self.machines.scatter(channel, frequency)) ** 2, axis=0))
        if channel == "torque":
            return tolerance  # no factor is learned of its path
        return tolerance * self._departure(channel, learned) * learned.unknown(channel, frequency)

    def _departure(self, channel: str, learned: LearnedFactors) -> float:
        """By how many times the learned factors lie further from one than the tolerances allow; 1 to the most."""
        lines = learned.path if channel == "acceleration" else learned.mesh
        if not lines:
            return 1.0
        _, f, factor, std = (np.array(column) for column in zip(*lines, strict=True))
        tolerance = np.sqrt(np.sum(np.abs(self.machines.scatter(channel, f.real)) ** 2, axis=0))
        allowed = tolerance**2 + 2 * std.real**2
        departure = float(np.sqrt(np.mean(np.abs(factor - 1) ** 2 / allowed)))
        return min(max(1.0, departure), LIMITS.most_departure)

    def _disc(self, orders: np.ndarray) -> np.ndarray:
        """δ (n,) [m]."""
        mesh, whole_turn = self._of_mesh(orders), (1.0, self.teeth[1] / self.teeth[0])
        disc = np.full(orders.size, LIMITS.graduation * max(self.scales.graduation))
        for gear, ratio in enumerate(whole_turn):
            turn = np.rint(orders * ratio)
            whole = (np.abs(orders * ratio - turn) < 1e-6) & ~mesh
            graduation, lowest = self.scales.graduation[gear], PATTERNS.lowest_order[gear]
            count = len(PATTERNS.orders(gear, self.teeth))
            disc = np.where(
                whole, np.hypot(disc, PATTERNS.healthy_pattern[gear] * graduation * np.sqrt(2 / count)), disc
            )
            disc = np.where(whole & (turn < lowest), np.hypot(disc, graduation / np.sqrt(max(lowest - 2, 1))), disc)
            disc = np.where(whole & (turn == 1), np.hypot(disc, self.scales.once_per_turn[gear]), disc)
        return disc


def largest_healthy(variances: Sequence[np.ndarray], limits: HealthyLimits = LIMITS) -> float:
    """The energy that the lines of several windows leave of a healthy machine at most: Σ|y − m|².

    variances  v of each window (n,); their lines are taken to be off alike in all windows
    """
    whole = [float(v.sum()) for v in variances]
    most = variances[int(np.argmax(whole))] if whole else np.zeros(0)
    if not np.any(most > 0):
        return 0.0
    count = 2 * float(most.sum()) ** 2 / float(np.sum(most**2))
    return sum(whole) * float(2 * gammaincinv(count / 2, limits.quantile)) / count
