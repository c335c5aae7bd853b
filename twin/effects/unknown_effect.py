"""What no name fits: an empirical excitation at the orders and frequencies seen, where it explains all channels best.

    X_c = H_c(f)·A·(T/T0)^p·(n/n0)^q·(1 + g·(N − N0))         a line of frequency f, or of order f/n, in channel c
    H   mesh      e added along the line of action:  d = −H_gg·F, F = κ·(d + e), κ = k·(1 + iωτ)
        bearing   a force at a bearing, x or y:      d = H_gf − H_gg·F, F = κ·d
        torque    a torque at the motor or brake:    the same
        channel   that channel alone, H = 1: its sensor, cable or converter, or a path that is not in the model

A, f, n   amplitude [m], [N], [N·m] or the channel's unit; frequency and pinion speed [Hz]
p, q, g   exponents of torque and speed, growth per revolution N
κ         dynamic stiffness of the mesh; k its mean [N/m], τ its damping time [s]
H_ab      receptance of the gearbox without its mesh, of direction a to a force along b

A channel may also be wrong in itself: `modulation` m of its whole level at a frequency of its own, 1 + m·cos(2πf_m·t),
`delay` τ against the encoders, exp(−iωτ), and `polarity` −1. Noise between the lines has a level.

Order     those seen
Source    receptance coupling: D. J. Ewins, Modal Testing (2000), ch. 6; the rest is a description, not a cause
Holds     excitations small enough for the mesh to answer linearly
Ignores   the mesh's own modulation of foreign lines: their sidebands at mesh orders
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from twin.dynamics.structure import direction
from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature
from twin.errors import ParameterError
from twin.model import Condition, Model

BEARINGS = ("x4", "y4", "x6", "y6", "x9", "y9", "x11", "y11")
TORQUES = ("th1", "th13")
CHANNELS = ("acceleration", "encoder", "torque")
ENTRIES = ("mesh", *BEARINGS, *TORQUES, *CHANNELS)
CHANNEL_UNITS = {"acceleration": "m/s²", "encoder": "m", "torque": "N·m"}
UNITS = {"mesh": "m", **dict.fromkeys(BEARINGS, "N"), **dict.fromkeys(TORQUES, "N·m"), **CHANNEL_UNITS}


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownEffect:
    """Lines, one value each of the tuples, and what else a channel shows that nothing in the machine makes."""

    amplitude: tuple[float, ...] = ()  # A, of each line in its entry's unit
    frequency: tuple[float, ...] = ()  # [Hz]; 0 where the line follows the shafts
    order: tuple[float, ...] = ()  # of pinion rotation; 0 where the line follows the clock
    entry: tuple[str, ...] = ()  # of ENTRIES
    drift: tuple[float, ...] = ()  # relative spread of the frequency from window to window
    torque_exponent: tuple[float, ...] = ()  # p
    speed_exponent: tuple[float, ...] = ()  # q
    growth: tuple[float, ...] = ()  # g [1/revolution]
    since: tuple[float, ...] = ()  # revolutions from which on the line is there
    torque: float = 1.0  # T0 [N·m]
    speed: float = 1.0  # n0 [Hz]
    revolutions: float = 0.0  # N0
    modulation: float = 0.0  # m
    modulation_frequency: float = 0.0  # f_m [Hz]
    noise: float = 0.0  # RMS between the lines of the acceleration [m/s²]
    noise_before: float = 0.0  # the same without the effect [m/s²]
    delay: float = 0.0  # of the acceleration against the encoders at `start_ns` [s]
    delay_rate: float = 0.0  # how it grows [s/s]
    start_ns: int = 0  # time that the delay is stated for
    polarity: float = 1.0  # −1 where the accelerometer counts the other way
    lines_a_turn: float = 0.0  # of an encoder's disc that are counted too many, or too few where negative

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="amplitude", unit="", low=0.0, high=1e6, prior=1.0, several=True),
        *(
            Parameter(name=name, unit=unit, low=low, high=high, prior=prior, shape=True, several=True)
            for name, unit, low, high, prior in (
                ("frequency", "Hz", 0.0, 1e5, 100.0),
                ("order", "", 0.0, 1e4, 10.0),
                ("drift", "", 0.0, 1.0, 0.02),
                ("torque_exponent", "", -4.0, 4.0, 1.0),
                ("speed_exponent", "", -4.0, 4.0, 2.0),
                ("growth", "1/revolution", -1.0, 1.0, 1e-4),
                ("since", "revolutions", 0.0, 1e12, 1e4),
            )
        ),
        Parameter(name="torque", unit="N·m", low=0.0, high=1e7, prior=10.0, shape=True),
        Parameter(name="speed", unit="Hz", low=0.0, high=1e4, prior=10.0, shape=True),
        Parameter(name="revolutions", unit="revolutions", low=0.0, high=1e12, prior=1e4, shape=True),
        Parameter(name="modulation", unit="", low=0.0, high=2.0, prior=0.3),
        Parameter(name="modulation_frequency", unit="Hz", low=0.0, high=1e5, prior=100.0, shape=True),
        Parameter(name="noise", unit="m/s²", low=0.0, high=1e6, prior=1.0),
        Parameter(name="noise_before", unit="m/s²", low=0.0, high=1e6, prior=0.1, shape=True),
        Parameter(name="delay", unit="s", low=-10.0, high=10.0, prior=1e-3),
        Parameter(name="delay_rate", unit="s/s", low=-1.0, high=1.0, prior=1e-5),
        Parameter(name="polarity", unit="", low=-1.0, high=1.0, prior=1.0, neutral=1.0),
        Parameter(name="lines_a_turn", unit="", low=-10.0, high=10.0, prior=1.0),
    )
    signature: ClassVar[Signature] = Signature(shape="none", channels=("acceleration",))
    facts: ClassVar[Facts] = Facts(
        label="an effect of unknown cause",
        action="Find what shakes the machine, or disturbs its sensors, at the frequencies stated.",
        acts_on="unknown",
        periods=("mesh", "hunting"),
        detector="unknown",
        ended_by=(),
        changes_mesh_lines=False,
        synchronous=False,
    )

    def __post_init__(self) -> None:
        check(self)
        count = len(self.amplitude)
        for name in ("frequency", "order", "entry", "drift", "torque_exponent", "speed_exponent", "growth", "since"):
            if count and len(getattr(self, name)) != count:
                raise ParameterError(f"{name} has {len(getattr(self, name))} values for {count} lines")
        for entry in self.entry:
            if entry not in ENTRIES:
                raise ParameterError(f'entry = "{entry}" is none of {", ".join(ENTRIES)}')

    @property
    def period(self) -> str:
        """The record of the hunting tooth where a line enters the gearbox; channels alone need no other period."""
        inside = any(entry not in CHANNELS for entry, a in zip(self.entry, self.amplitude, strict=False) if a)
        return "hunting" if inside else "mesh"

    def frequencies(self, speed_hz: float) -> np.ndarray:
        """Frequency of every line at a pinion speed (n,) [Hz]."""
        return np.array([o * speed_hz if o else f for f, o in zip(self.frequency, self.order, strict=False)])

    def amplitudes(self, condition: Condition, revolutions: float) -> np.ndarray:
        """Amplitude of every line where it enters (n,), in its unit, never below zero."""
        A, p, q, g, since = (
            np.array(values)
            for values in (self.amplitude, self.torque_exponent, self.speed_exponent, self.growth, self.since)
        )
        grown = np.where(revolutions >= since, np.maximum(1 + g * (revolutions - self.revolutions), 0.0), 0.0)
        return A * (condition.torque / self.torque) ** p * (condition.speed_hz / self.speed) ** q * grown

    def apply(self, setup: Setup) -> Setup:
        condition = setup.condition
        if self.delay or self.polarity != 1:
            setup = setup.with_sensor(self.sensor_gain)
        if self.period == "mesh":
            return setup
        sizes = self.amplitudes(condition, max((self.revolutions, *self.since)))
        orders = self.frequencies(condition.speed_hz) / condition.speed_hz
        angle = setup.passages.pinion_angle
        for size, order, entry in zip(sizes, orders, self.entry, strict=False):
            if entry == "mesh":
                o = setup.line(order) / float(setup.turns)
                added, slope = size * np.cos(o * angle), -size * o * np.sin(o * angle)
                setup = setup.with_error(setup.drive * added, setup.drive * slope)
            elif entry not in CHANNELS:
                setup = setup.with_load(direction({entry: 1.0}), {order: size})
        return setup

    def sensor_gain(self, frequency: np.ndarray, start_ns: int | None = None) -> np.ndarray:
        """What the accelerometer's channel makes of each frequency [Hz]; (m,) → (m,) complex.

        start_ns  of the window; the time that the delay is stated for where None
        """
        late = self.delay + (0.0 if start_ns is None else self.delay_rate * (start_ns - self.start_ns) * 1e-9)
        return self.polarity * np.exp(-2j * pi * np.asarray(frequency) * late)


def transfers(model: Model, entry: str, frequencies: Sequence[float] | np.ndarray) -> dict[str, np.ndarray]:
    """What each channel shows of an excitation of amplitude 1, at some frequencies [Hz]; by channel (m,) complex.

    Units: [m/s²], [m] and [N·m] for each unit of the entry.
    """
    f = np.atleast_1d(np.asarray(frequencies, dtype=float))
    if entry in CHANNELS:
        return {c: np.full(f.size, complex(c == entry)) for c in CHANNELS}
    structure, ω = model.structure, 2 * pi * f
    seen = {
        "acceleration": (model.accelerometer, -(ω**2)),
        "encoder": (structure.transmission_error, 1.0),
        "torque": (structure.torque_meter, 1.0),
    }
    κ = mean_mesh_stiffness(model) * (1 + 1j * ω * model.calibration.damping_time)
    g = structure.mesh
    directions = [g, *(along for along, _ in seen.values())]
    by_mesh, *mesh_to = structure.receptances(ω, g, directions)
    if entry == "mesh":
        force = κ / (1 + κ * by_mesh)
        own = [np.zeros(f.size, dtype=complex)] * len(seen)
    else:
        to_mesh, *own = structure.receptances(ω, direction({entry: 1.0}), directions)
        force = κ * to_mesh / (1 + κ * by_mesh)
    return {
        name: factor * (direct - through * force)
        for (name, (_, factor)), direct, through in zip(seen.items(), own, mesh_to, strict=True)
    }


def mean_mesh_stiffness(model: Model) -> float:
    """Stiffness of all pairs in contact, mean over a mesh period [N/m]."""
    k, gap, _ = model.mesh.drive_tables
    touching = gap <= 0
    return float(model.calibration.stiffness_scale * np.where(touching, k, 0.0).sum(axis=0).mean())
