"""Windows of a simulated machine, as its instruments would have recorded them.

    θ_1(t) = ω·t + x_1(θ)/r_b1,      r_b2·θ_2 = r_b1·θ_1 − e(θ),      a(t) = Re Σ A_o·e^{ioθ}

The lines A_o of the acceleration, of the transmission error e and of the pinion's own motion x_1 come from the harmonic
balance with the machine's worn flanks and with any effects: those of a mesh period, to which one solution over a turn
of either gear adds what its teeth and its effects make between them. Instruments add white noise, the graduation errors
of the discs and jitter of the edges' times.

Limits   effects that the harmonic balance solves over a turn of one gear at most; the speed wanders slowly
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from twin.detectability.machines import HealthyMachine
from twin.effects.extended import extend
from twin.effects.pitch_error import PitchError
from twin.effects.response import Effect, Response, solve_with
from twin.errors import NotConverged, ParameterError
from twin.model import Condition
from twin.rig import Rig
from twin.rig_tolerances import Tolerances
from twin.thresholds import deciding
from twin.wear.curve import MasterCurve
from twin.wear.evolution import COARSE
from twin.windows import Edges, Samples, Window

ACCELERATION_RATE, TORQUE_RATE = 25_600.0, 1_600.0  # [Hz]
WANDER = 2e-3  # of the speed, that it swings by
WANDER_TURNS = 20.0  # of the pinion, over which the speed wanders once
POINTS = 64  # of a table of a waveform, for each line of the highest order that is kept
TOP = 2.2  # times the upper limit of the analysis band: lines above are left out
LEAD = 0.02  # computed before and after a window, for the edges [s]
START = 60.0  # revolutions at the first window's middle
FIRST_NS = 1_700_000_000_000_000_000  # time of the first window [Unix ns]


@dataclass(frozen=True, slots=True, kw_only=True)
class Instruments:
    """What records the windows; noise as standard deviation of one sample."""

    acceleration_rate: float = ACCELERATION_RATE  # [Hz]
    torque_rate: float = TORQUE_RATE  # [Hz]
    acceleration_noise: float  # [m/s²]
    torque_noise: float  # [N·m]
    edge_jitter: float = 60e-9  # [s]
    channels: tuple[str, ...] = ("torque", "encoder/pinion", "encoder/gear")  # beside the accelerometer
    seconds: float = 2.5  # of a window


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseOfFloor:
    """White noise of instruments of which the rig file states the noise floor of a line alone."""

    floor: float = deciding(
        4.0,
        of="standard deviation of a line's real part",
        meaning="noise floor of a line",
        source="definition: what is read must exceed the noise by this much",
    )

    def std(self, floor: float, rate: float, seconds: float) -> float:
        """Standard deviation of a sample; a line's real part then has sqrt(2/n) times it."""
        return floor / self.floor * float(np.sqrt(rate * seconds / 2))


def instruments_of(rig: Rig, seconds: float = 2.5, noise: NoiseOfFloor = NoiseOfFloor()) -> Instruments:
    """Instruments with the noise floors of the rig file, and the channels that it has encoders for."""
    tolerances: Tolerances = rig.tolerances
    return Instruments(
        acceleration_noise=noise.std(tolerances.acceleration_floor, ACCELERATION_RATE, seconds),
        torque_noise=noise.std(tolerances.torque_floor, TORQUE_RATE, seconds),
        seconds=seconds,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """The windows that are simulated: one condition each, and the wear depth of the last."""

    conditions: tuple[Condition, ...]
    depth: float  # combined, at the last window [m]
    instruments: Instruments


Waveform = Callable[[np.ndarray], np.ndarray]  # of absolute pinion angles (n,) [rad] → (n,)


def simulated(
    machine: HealthyMachine, campaign: Campaign, rng: np.random.Generator, effects: Sequence[Effect] = ()
) -> list[Window]:
    """The windows of a machine with effects that are there from the start; NotConverged where one has no steady state.

    The first window is of new flanks; the depth grows evenly over the others.
    """
    count = len(campaign.conditions)
    shaping = extend(machine.model, [e for e in effects if e.facts.shapes_wear])
    curve = MasterCurve.begin(shaping, campaign.conditions[0], shaping.unworn, 2 * campaign.depth, COARSE)
    (dwell,) = machine.model.rig.require("the wear coefficient", "wear.dwell_time")
    out, ended = [], 0.0
    for i, condition in enumerate(campaign.conditions):
        depth = campaign.depth * i / max(count - 1, 1)
        worn = depth > curve.start_depth
        profile = curve.profile(depth) if worn else shaping.unworn
        work = curve.work_at(depth) if worn else 0.0
        ω = 2 * pi * campaign.conditions[0].speed_hz
        turns = max(START + work / (machine.wear_coefficient * dwell * ω), ended + 10.0)
        channels = _waveforms(machine, profile.slices, condition, effects)
        out.append(_recorded(machine, channels, condition, turns, campaign.instruments, rng, i))
        ended = turns + campaign.instruments.seconds * condition.speed_hz
    return out


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Channels:
    """Waveforms over the pinion's angle."""

    acceleration: Waveform  # [m/s²]
    transmission_error: Waveform  # [m]
    pinion_motion: Waveform  # [m]
    torque: Waveform  # [N·m]


LINES = ("acceleration", "transmission_error", "pinion_motion", "torque")


def _waveforms(machine: HealthyMachine, flanks, condition: Condition, effects: Sequence[Effect]) -> _Channels:
    model = machine.model
    mesh = tuple(e for e in effects if e.period == "mesh")
    base = _solved(model, mesh, flanks, condition, "mesh")
    top = TOP * model.rig.band[1] / condition.speed_hz
    parts: list[tuple[Response, Response | None]] = [(base, None)]
    for name in ("pinion", "gear"):
        own = [e for e in _over_one_turn(effects) if e.period == name]
        own.append(PitchError(**{name: getattr(machine.teeth, name)}))
        turn = _solved(model, (*mesh, *own), flanks, condition, name)
        alike = _solved(model, mesh, flanks, condition, "mesh", turn.setup.mesh.samples)  # its own rounding drops out
        parts.append((turn, alike))
    mean = base.mean_transmission_error
    made = {name: _sum([_waveform(r, without, name, top) for r, without in parts]) for name in LINES}
    error = made["transmission_error"]
    return _Channels(**{**made, "transmission_error": lambda angle: mean + error(angle)})


def _over_one_turn(effects: Sequence[Effect]) -> list[Effect]:
    """The effects, pitch errors of both gears as those of either; ParameterError for others that need both at once."""
    out: list[Effect] = []
    for effect in effects:
        if isinstance(effect, PitchError):
            out += [PitchError(pinion=effect.pinion), PitchError(gear=effect.gear)]
        elif effect.period == "hunting":
            raise ParameterError(f"{type(effect).__name__} repeats with no turn of one gear and is not simulated here")
        else:
            out.append(effect)
    return out


def _solved(model, effects, flanks, condition: Condition, period: str, samples: int | None = None) -> Response:
    response = solve_with(model, effects, flanks, condition, period, samples=samples)
    if not response.steady.converged:
        raise NotConverged(f"no steady state at {condition.speed_hz:g} Hz")
    return response


def _sum(waveforms: Sequence[Waveform]) -> Waveform:
    return lambda angle: sum((w(angle) for w in waveforms[1:]), waveforms[0](angle))


def _waveform(response: Response, without: Response | None, channel: str, top: float) -> Waveform:
    """x(θ) of a channel up to an order, less the mesh lines of another response; θ turned to the model's zero."""
    lines = getattr(response, f"{channel}_lines")[response.orders <= top].copy()
    if without is not None:
        own = getattr(without, f"{channel}_lines")
        n = response.mesh_periods
        at = np.arange(n - 1, lines.size, n)
        lines[at] -= own[: at.size]
    spectrum = np.concatenate(([0.0], lines))
    size = 2 ** int(np.ceil(np.log2(POINTS / 4 * spectrum.size)))
    table = np.fft.irfft(spectrum, size) * size / 2
    table = np.append(table, table[0])
    turn = 2 * pi * float(response.turns)
    return lambda angle: np.interp(angle % turn, np.linspace(0.0, turn, size + 1), table)


def _recorded(
    machine: HealthyMachine,
    channels: _Channels,
    condition: Condition,
    turns: float,
    instruments: Instruments,
    rng: np.random.Generator,
    index: int,
) -> Window:
    """One window with its middle at so many turns of the pinion."""
    rig, pair = machine.model.rig, machine.model.mesh.pair
    rate, seconds = instruments.acceleration_rate, instruments.seconds
    lead, count = round(LEAD * rate), round(seconds * rate)
    t = np.arange(-lead, count + lead) / rate
    swing = 2 * pi * condition.speed_hz / WANDER_TURNS * t + rng.uniform(0, 2 * pi)
    angle = 2 * pi * (condition.speed_hz * (t - seconds / 2) + turns) + WANDER * WANDER_TURNS * np.sin(swing)
    seen = angle + machine.phase / pair.teeth[0]  # in the model's angle
    heard = channels.acceleration(seen[lead : lead + count])
    encoders = {}
    rb1, rb2 = pair.base_radius
    pinion = angle + channels.pinion_motion(seen) / rb1
    gear = (rb1 * pinion - channels.transmission_error(seen)) / rb2
    for name, disc, θ in (("pinion", machine.discs[0], pinion), ("gear", machine.discs[1], gear)):
        if f"encoder/{name}" in instruments.channels:
            (per_rev,) = rig.require("the encoders", f"encoders.{name}_edges_per_rev")
            encoders[name] = _edges(θ + disc.error(θ), t, int(per_rev), seconds, instruments.edge_jitter, rng)
    torques = {}
    if "torque" in instruments.channels:
        at = np.arange(0.0, seconds, 1 / instruments.torque_rate)
        swing = np.interp(at, t, channels.torque(seen))
        noise = instruments.torque_noise * rng.standard_normal(at.size)
        torques["pinion"] = Samples(rate=instruments.torque_rate, start=0.0, values=condition.torque + swing + noise)
    noise = instruments.acceleration_noise * rng.standard_normal(heard.size)
    sensor = rig.accelerometer
    assert sensor is not None  # the model requires it
    return Window(
        start_time_ns=FIRST_NS + int(index * 3600e9),
        accelerations={sensor: Samples(rate=rate, start=0.0, values=heard + noise)},
        torques=torques,
        encoders=encoders,
    )


def _edges(
    angle: np.ndarray, t: np.ndarray, per_rev: int, seconds: float, jitter: float, rng: np.random.Generator
) -> Edges:
    """The edges of a disc within the window, from its angle [rad] at times t [s]."""
    place = np.maximum.accumulate(angle * per_rev / (2 * pi))
    first, last = (int(np.ceil(np.interp(end, t, place))) for end in (0.0, seconds))
    times = np.interp(np.arange(first, last), place, t) + jitter * rng.standard_normal(last - first)
    return Edges(per_rev=per_rev, first_index=first, times=np.maximum.accumulate(times))
