"""How far the mesh lines of a machine may be off whose structure is estimated: by draws of the stated spreads.

Wear and tooth errors move the mesh by e; through the structure, a line k of them becomes

    x_k = T_x(ω_k)·e_k,      T_x = H_x·k̄/(1 + k̄·G)      H_x = xᵀH·g,  G = gᵀH·g

so that a machine with another structure shows every line times the same complex factor t = T_x/T_x⁰ at any depth of
wear. Every assumed value of the rig file is drawn from a log-normal distribution with the spread of its part; mean and
covariance of ln|t| over the draws say how far a line may be off, together with its neighbours. The mean of the
transmission error is quasi-static: the structure moves its zero, not its growth.

x    direction of the encoders' difference, of the pinion's encoder, or of the accelerometer
k̄    mean mesh stiffness [N/m],  H receptances of the structure without its mesh

Source   linear response of the rest of the machine to the mesh force (twin/dynamics/harmonic_balance.py); against the
         whole non-linear response, ln|t| differs by 0.02 (tests/claims/test_structure_spread.py)
Ignores  changes of the mesh stiffness within the mesh period
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import exp, log, pi
from typing import Any

import numpy as np

from twin.dynamics.structure import Structure, direction
from twin.model import compliance_outside_mesh, mesh_of
from twin.rig import Rig
from twin.rig_estimated import part_of
from twin.wear.path import LINES

DRAWS = 200  # the 5 and 95 % quantiles of a factor are then known to a tenth of their distance
SEED = 13
DRAWN = ("structure", "inertias", "bodies", "damping", "mesh")  # parts that change the response
SAME = 0.05  # relative width of speeds that share their draws
SAMPLES = 256  # of the mesh period, for the mean stiffness


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Spread:
    """ln|t| of one channel: mean (LINES,) and covariance (LINES, LINES) over the draws."""

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of ln|t| about 0, (LINES,)."""
        return np.sqrt(np.diag(self.covariance) + self.mean**2)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StructureSpread:
    """The factors of a machine with an estimated structure at one speed."""

    transmission_error: Spread
    pinion_motion: Spread
    acceleration: Spread
    compliance: Spread  # of the relative error κ of the compliance outside the mesh, (1,)


def is_estimated(rig: Rig) -> bool:
    """Whether the response of the rig's structure is an estimate."""
    return any(part in rig.estimated.parts for part in DRAWN)


def structure_spread(rig: Rig, speed_hz: float) -> StructureSpread | None:
    """How far the lines may be off at a pinion speed [Hz]; None where the structure is not estimated."""
    if not is_estimated(rig):
        return None
    return _spread(rig.text, exp(SAME * round(log(speed_hz) / SAME)))


@lru_cache(maxsize=64)
def _spread(values: str, speed_hz: float) -> StructureSpread:
    rig = Rig(json.loads(values))
    stiffness = mesh_of(rig, SAMPLES).stiffness.mesh_mean
    ω = 2 * pi * rig.teeth[0] * speed_hz * np.arange(1, LINES + 1)
    nominal = _responses(rig, stiffness, ω)
    rng = np.random.default_rng(SEED)
    machines = [drawn(rig, rng) for _ in range(DRAWS)]
    ratios = np.array([np.log(np.abs(_responses(machine, stiffness, ω) / nominal)) for machine in machines])
    lines = [Spread(mean=x.mean(axis=0), covariance=np.cov(x.T)) for x in np.moveaxis(ratios, 1, 0)]
    κ = np.array([_compliance(machine) for machine in machines]) / _compliance(rig) - 1
    return StructureSpread(
        transmission_error=lines[0],
        pinion_motion=lines[1],
        acceleration=lines[2],
        compliance=Spread(mean=np.array([κ.mean()]), covariance=np.array([[κ.var()]])),
    )


def _compliance(rig: Rig) -> float:
    """Mean transmission error per torque beyond that of the mesh [m/(N·m)]."""
    return compliance_outside_mesh(Structure.from_rig(rig), rig.gear_pair())


def drawn(rig: Rig, rng: np.random.Generator) -> Rig:
    """A machine from the distribution that the rig file states."""
    spreads = drawn_keys(rig)
    return times(
        rig, dict(zip(spreads, np.array(list(spreads.values())) * rng.standard_normal(len(spreads)), strict=True))
    )


def drawn_keys(rig: Rig) -> dict[str, float]:
    """The assumed keys that change the response, each with its spread."""
    estimated = rig.estimated
    parts = {key: part_of(key) for key in estimated.assumed}
    return {key: estimated.spread[p] for key, p in parts.items() if p in DRAWN and p in estimated.spread}


def times(rig: Rig, logarithms: Mapping[str, float]) -> Rig:
    """The rig with values times factors, given as logarithms by key."""
    values = _copied(rig.values)
    for key, logarithm in logarithms.items():
        *tables, name = key.split(".")
        node = values
        for table in tables:
            node = node[table]
        node[name] *= exp(logarithm)
    return Rig(values)


def _copied(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _copied(v) if isinstance(v, Mapping) else v for k, v in values.items()}


def _responses(rig: Rig, stiffness: float, omega: np.ndarray) -> np.ndarray:
    """T of the encoders' difference, the pinion's encoder and the accelerometer, (3, LINES)."""
    structure = Structure.from_rig(rig)
    k = stiffness * rig.get("mesh.stiffness_scale", 1.0)
    (sensor,) = rig.require("the accelerometer's place", "sensors.accelerometer")
    closed = k / (1 + k * structure.receptance(omega, structure.mesh, structure.mesh))
    directions = (structure.transmission_error, structure.pinion_motion, direction({sensor: 1.0}))
    return np.array([structure.receptance(omega, structure.mesh, x) * closed for x in directions])
