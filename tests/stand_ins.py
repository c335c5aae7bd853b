"""Machines that a copied rig file describes badly: the laboratory rig's file with other teeth, module and speed.

The signals are made here from mesh harmonics, sidebands, a few structural resonances and noise, without any model of
the twin and without any wear: whatever depth or life the twin gives for them is wrong.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from math import cos, radians
from pathlib import Path
from typing import Any

import numpy as np

from twin.rig import Rig
from twin.windows import Edges, Samples, Window

LABORATORY = Path(__file__).parents[1] / "recordings" / "rigs" / "unsw.toml"
T0 = 1_700_000_000_000_000_000  # Unix time of the first window [ns]
SHARES = (1.0, 0.6, 0.35, 0.2, 0.12, 0.08)  # of the mesh harmonics


@dataclass(frozen=True, slots=True, kw_only=True)
class StandIn:
    """One machine without any wear, and what its rig file and its sensors make of it."""

    teeth: tuple[int, int] = (23, 57)
    module: float = 2.5e-3  # [m]
    speed: float = 24.6  # of the pinion [Hz]
    encoders: str = "tachometer"  # or "pinion", "both"
    level: float = 8.0  # RMS of the acceleration [m/s²]
    unit: float = 1.0  # factor of a wrong unit on the acceleration
    noise: float = 0.1  # share of the level
    modulation: float = 0.15  # of the mesh lines, once a turn of the pinion
    unworn_error: float = 3e-6  # transmission error of the unworn teeth at the mesh frequency [m]
    first_turn: int = 0  # count of the pinion's encoder at the first sample
    torque: float | None = None  # [N·m]; None without a torque meter
    seconds: float = 20.0
    windows: int = 2
    rate: float = 25600.0  # [Hz]
    seed: int = 1

    def __str__(self) -> str:
        z1, z2 = self.teeth
        parts = [f"{z1}/{z2} m{1e3 * self.module:g} {self.speed:g} Hz {self.encoders}", f"{self.level:g} m/s²"]
        if self.unit != 1:
            parts.append(f"unit ×{self.unit:g}")
        return " ".join((*parts, f"from turn {self.first_turn}", f"seed {self.seed}"))


@cache
def _laboratory() -> dict[str, Any]:
    return tomllib.loads(LABORATORY.read_text(encoding="utf-8"))


def copied_rig(machine: StandIn) -> Rig:
    """The laboratory's rig file with teeth, module, radii, speed and encoders changed, as somebody would who tries."""
    values = deepcopy(_laboratory())
    gears, m = values["gears"], machine.module
    gears |= {"module": m, "addendum": m, "dedendum": 1.25 * m}
    for wheel, z in zip(("pinion", "gear"), machine.teeth, strict=True):
        r = m * z / 2
        gears[wheel] |= {"teeth": z, "pitch_radius": r, "base_radius": r * cos(radians(gears["pressure_angle_deg"]))}
    for table, names in {
        "gears": ("path_of_contact",),
        "mesh": ("pair_s", "pair_stiffness", "corner_gap_start", "corner_gap_end"),
        "wear": ("pinion_share", "max_depth_at_6000"),
        "operating": ("calibration_points",),
    }.items():
        for name in names:
            values[table].pop(name)
    values["operating"]["pinion_speed_hz"] = machine.speed
    values["encoders"] = {"pinion_edges_per_rev": _edges(machine)[0]}
    if machine.encoders == "both":
        values["encoders"]["gear_edges_per_rev"] = _edges(machine)[1]
    if machine.torque is None:
        values["sensors"].pop("torque")
    else:
        values["operating"]["input_torque"] = machine.torque
    return Rig.from_mapping(values)


def _edges(machine: StandIn) -> tuple[int, int]:
    return (1, 1) if machine.encoders == "tachometer" else (1024, 2048)


def windows_of(machine: StandIn) -> Iterator[Window]:
    """The record of the machine, cut into windows."""
    random = np.random.default_rng(machine.seed)
    z1 = machine.teeth[0]
    each = machine.seconds / machine.windows
    phases = random.uniform(0, 2 * np.pi, (3, len(SHARES)))
    wander, at = 0.002 * random.normal(size=2), random.uniform(0, 2 * np.pi, 4)
    strengths = np.array(SHARES) * np.exp(0.4 * random.normal(size=len(SHARES)))

    def turns(t: np.ndarray) -> np.ndarray:
        """Angle of the pinion in turns: the speed wanders by a few tenths of a per cent."""
        slow = 0.05 + 0.1 * np.arange(2)
        return machine.speed * (
            t + (wander / (2 * np.pi * slow) * np.sin(2 * np.pi * np.outer(t, slow) + at[:2])).sum(1)
        )

    def acceleration(t: np.ndarray) -> np.ndarray:
        θ = 2 * np.pi * turns(t)
        y = np.zeros_like(t)
        for k, (a, φ) in enumerate(zip(strengths, phases[0], strict=True), 1):
            y += a * (1 + machine.modulation * np.cos(θ + at[2])) * np.cos(k * z1 * θ + φ)
        y *= machine.level / np.sqrt(np.mean(y**2))
        return machine.unit * (y + machine.noise * machine.level * random.normal(size=t.size))

    def error(θ: np.ndarray) -> np.ndarray:
        """Transmission error [m] of the unworn pair: mesh lines, run-out of both wheels."""
        e = sum(machine.unworn_error / k**1.5 * np.cos(k * z1 * θ + φ) for k, φ in enumerate(phases[1], 1))
        ratio = machine.teeth[0] / machine.teeth[1]
        return e + 4e-6 * np.cos(θ + at[2]) + 6e-6 * np.cos(ratio * θ + at[3])

    for i in range(machine.windows):
        start = i * each
        t = start + np.arange(round(each * machine.rate)) / machine.rate
        encoders = {"pinion": _passings(machine, turns, start, each, _edges(machine)[0], random)}
        if machine.encoders == "both":
            rb = machine.module * machine.teeth[1] / 2 * cos(radians(20))
            ratio = machine.teeth[0] / machine.teeth[1]

            def gear(t: np.ndarray, ratio: float = ratio, rb: float = rb) -> np.ndarray:
                n = turns(t)
                return ratio * n - error(2 * np.pi * n) / (2 * np.pi * rb)

            encoders["gear"] = _passings(machine, gear, start, each, _edges(machine)[1], random)
        torques = {}
        if machine.torque is not None:
            n = round(each * 1000)
            torques["pinion"] = Samples(
                rate=1000.0, start=0.0, values=machine.torque * (1 + 0.01 * random.normal(size=n))
            )
        yield Window(
            start_time_ns=T0 + round(start * 1e9),
            accelerations={"y6": Samples(rate=machine.rate, start=0.0, values=acceleration(t))},
            torques=torques,
            encoders=encoders,
        )


def _passings(machine: StandIn, turns, start: float, length: float, per_rev: int, random) -> Edges:
    """Times at which the edges of an encoder pass, with its jitter."""
    t = start + np.linspace(0, length, max(round(length * 2000), 2))
    n = turns(t) * per_rev
    first = int(np.ceil(n[0]))
    edges = np.arange(first, int(np.floor(n[-1])) + 1)
    times = np.interp(edges, n, t)
    rate = (n[-1] - n[0]) / length
    for _ in range(4):  # Newton's method: interpolation of the angle is not fine enough for the mesh lines
        times = times - (turns(times) * per_rev - edges) / rate
    jitter = 2e-8 if per_rev > 1 else 1e-6
    shift = machine.first_turn * per_rev
    if per_rev != _edges(machine)[0]:
        shift = round(machine.first_turn * per_rev * machine.teeth[0] / machine.teeth[1])
    return Edges(
        per_rev=per_rev,
        first_index=first + shift,
        times=np.sort(times - start + jitter * random.normal(size=times.size)),
    )
