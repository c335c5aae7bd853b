"""Bearing defect: a short blow on a bearing whenever a rolling element passes the flaw, with slip.

    f(t) = Σ_j A_j·p(t − t_j),     p(t) = P·sin(πt/D),  0 < t < D,     t_{j+1} − t_j = (1 + σ·ξ_j)/(o·f_1)
    A_j = 1 + m·cos(o_m·θ1(t_j) + φ)

    cage ½(1 − γ)    outer race n·½(1 − γ)    inner race n·½(1 + γ)    ball (1 − γ²)·d_p/d_b    γ = (d_b/d_p)·cos β

P, D      height and length of a blow                                          [N], [s]
o, σ      order of the pinion's rotation, and slip: relative spread of the intervals, independent, so it adds up
m, o_m    depth and order of the load's modulation: the shaft's for the inner race, the cage's for a ball
n, d_b, d_p, β   balls, ball and pitch diameter [m], contact angle [rad]       (orders of the bearing's own shaft)

Without slip the blows are lines at o and its multiples; with it they broaden and only the envelope stays periodic
(cyclostationary). `apply` lays one realisation over the record, from a seed, so that it stays a function;
`power_spectrum` is the expectation, of a renewal process,

    S(f) = 2λ·|p̂(f)|²·Re (1 + ψ)/(1 − ψ),     λ = o·f_1,   ψ(f) = exp(−2πif/λ − ½(2πfσ/λ)²)

Order    o and its multiples, ± o_m where modulated; transmission error hardly
Source   orders and slip: R. B. Randall, J. Antoni, Mech. Syst. Signal Process. 25 (2011) 485–520; spectrum of the
         renewal process: D. R. Cox, P. A. W. Lewis, The Statistical Analysis of Series of Events, 1966, ch. 4
Holds    small flaws: blows shorter than their interval
Ignores  entry and exit of the flaw as two events; the order is moved to the nearest 1/turns of the record
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi
from typing import ClassVar

import numpy as np

from twin.dynamics.structure import direction
from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature
from twin.errors import ParameterError

PLACES = ("x4", "y4", "x6", "y6", "x9", "y9", "x11", "y11")


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingGeometry:
    """A rolling bearing whose outer race stands still."""

    balls: int  # n
    ball_diameter: float  # d_b [m]
    pitch_diameter: float  # d_p [m]
    contact_angle: float = 0.0  # β [rad]

    def __post_init__(self) -> None:
        if not 0 < self.ball_diameter < self.pitch_diameter:
            raise ParameterError(
                f"ball_diameter = {self.ball_diameter:g} m must be between 0 and the pitch diameter "
                f"{self.pitch_diameter:g} m"
            )

    def orders(self) -> dict[str, float]:
        """Impact orders of the bearing's own shaft, by the place of the flaw."""
        γ = self.ball_diameter / self.pitch_diameter * cos(self.contact_angle)
        return {
            "cage": (1 - γ) / 2,
            "outer": self.balls * (1 - γ) / 2,
            "inner": self.balls * (1 + γ) / 2,
            "ball": (1 - γ**2) * self.pitch_diameter / self.ball_diameter,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingDefect:
    """Blows on one bearing."""

    blow: float  # P [N]
    order: float = 3.6  # o
    slip: float = 0.0  # σ
    duration: float = 2e-4  # D [s]
    modulation: float = 0.0  # m
    modulation_order: float = 1.0  # o_m
    phase: float = 0.0  # φ [rad]
    place: str = "y6"
    seed: int = 0

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="blow", unit="N", low=0.0, high=1e4, prior=50.0),
        Parameter(name="order", unit="", low=0.1, high=50.0, prior=3.0, shape=True),
        Parameter(name="slip", unit="", low=0.0, high=0.1, prior=0.01, shape=True),
        Parameter(name="duration", unit="s", low=1e-5, high=5e-3, prior=2e-4, shape=True),
        Parameter(name="modulation", unit="", low=0.0, high=1.0, prior=0.5, shape=True),
        Parameter(name="modulation_order", unit="", low=0.02, high=5.0, prior=1.0, shape=True),
        Parameter(name="phase", unit="rad", low=-4 * pi, high=4 * pi, prior=2 * pi, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="own", channels=("acceleration",))
    facts: ClassVar[Facts] = Facts(
        label="a bearing defect",
        action="Prepare the replacement of the bearing and inspect it at the first opportunity.",
        stated=("order",),
        acts_on="bearing",
        periods=("hunting",),
        detector="non_gear",
        ended_by=(),
        alarm_class="alarm",
        changes_mesh_lines=False,
        synchronous=False,
        claims="envelope",
    )
    period: ClassVar[str] = "hunting"

    def __post_init__(self) -> None:
        check(self)
        if self.place not in PLACES:
            raise ParameterError(f'place = "{self.place}" is no bearing coordinate: {", ".join(PLACES)}')

    def blow_lines(self, frequency: np.ndarray) -> np.ndarray:
        """Fourier transform of one blow [N·s] at each frequency [Hz]; (m,) → (m,) complex.

        p̂ = P·D/2·[sinc(fD − ½) + sinc(fD + ½)]·e^{−iπfD}, a half sine
        """
        x = np.asarray(frequency) * self.duration
        return self.blow * self.duration / 2 * (np.sinc(x - 0.5) + np.sinc(x + 0.5)) * np.exp(-1j * pi * x)

    def power_spectrum(self, frequency: np.ndarray, speed_hz: float) -> np.ndarray:
        """Expected one-sided spectral density of the force with slip, unmodulated [N²/Hz]; (m,) → (m,)."""
        if not self.slip > 0:
            raise ParameterError("slip = 0: blows at even intervals have lines, not a spectral density")
        λ = self.order * speed_hz
        x = 2 * pi * np.asarray(frequency) / λ
        ψ = np.exp(-1j * x - (self.slip * x) ** 2 / 2)
        return 2 * λ * np.abs(self.blow_lines(frequency)) ** 2 * ((1 + ψ) / (1 - ψ)).real

    def times(self, count: int) -> np.ndarray:
        """When the blows fall, of the record's length (count,), 0 ≤ t < 1."""
        gaps = 1 + self.slip * np.random.default_rng(self.seed).standard_normal(count)
        return (np.cumsum(gaps) - gaps[0]) / gaps.sum()

    def apply(self, setup: Setup) -> Setup:
        if self.blow == 0:
            return setup
        t = self.times(setup.line(self.order))
        turns = float(setup.turns)
        heights = 1 + self.modulation * np.cos(2 * pi * self.modulation_order * turns * t + self.phase)
        k = np.arange(setup.samples // 2 + 1)
        sums = np.zeros(k.size, dtype=complex)
        for height, at in zip(heights, t, strict=True):
            sums += height * np.exp(-2j * pi * at * k)
        length = turns / setup.condition.speed_hz  # of the record [s]
        lines = sums * self.blow_lines(k / length) / length
        lines[0] = 0
        return setup.with_load_lines(direction({self.place: 1.0}), lines)
