"""How far the mesh lines of a machine may be off whose structure lies within the tolerances of its rig file.

A structure that differs from the rig file's shows every mesh line times the same complex factor t_k at any depth of
wear (twin/structure_spread.py). By first order in the values p_j of the rig file, each with its own deviation,

    ln t_k = Σ_j s_jk·v_j,      s_jk = ln t_k(p_j·(1 + σ_j)),      v_j ~ N(0, 1)

σ_j  half-width of the value's tolerance over √3: what is uniform within a tolerance has this standard deviation

A line far below the natural frequencies hardly depends on the structure: 0.1 to 0.3 % for the first harmonic of most
machines. One near a natural frequency depends on it by several per cent. What several lines are off by has the same
causes, so that the rows s_j are kept rather than a standard deviation of each line.

Source   linear response of the rest of the machine to the mesh force, as twin/structure_spread.py
Holds    for deviations within a few per cent; a structure of estimates has draws of its own (twin/structure_spread.py)
Ignores  the stiffness of the mesh: a deviation of 3 % moves no line by more than 0.1 %
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from math import exp, log, pi, sqrt

import numpy as np

from twin.dynamics.structure import Structure, direction, torque_meter
from twin.model import mesh_of
from twin.rig import Rig
from twin.structure_spread import SAMPLES, times
from twin.updating.depth import HARMONICS

SAME = 0.005  # relative width of speeds that share their scatter: a tenth of the width of a lightly damped resonance
TABLES = {"torsional_stiffness": "stiffness", "bearings": "stiffness", "inertias": "mass", "masses": "mass"}
KEYS = {
    "shafts.bending_stiffness_input": "stiffness",
    "shafts.bending_stiffness_output": "stiffness",
    "damping.modal_ratio": "damping",
}


def line_scatter(rig: Rig, speed_hz: float, pinion_only: bool) -> np.ndarray:
    """s_jk of the mesh lines that the encoders see, at a pinion speed [Hz], complex (values, HARMONICS).

    pinion_only  whether they are the pinion's motion, without the gear's
    """
    return _scatter(_ByText(rig.text, rig), exp(SAME * round(log(speed_hz) / SAME)), pinion_only)


@dataclass(frozen=True, slots=True)
class _ByText:
    """A rig that is the same as another with the same text."""

    text: str
    rig: Rig = field(compare=False)


@lru_cache(maxsize=256)
def _scatter(of: _ByText, speed_hz: float, pinion_only: bool) -> np.ndarray:
    channel = "pinion_motion" if pinion_only else "transmission_error"
    frequency = of.rig.teeth[0] * speed_hz * np.arange(1, HARMONICS + 1)
    return _machines(of).scatter(channel, frequency)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DeviatingMachines:
    """The rig file's structure, and those with one value off by its deviation."""

    own: Structure
    others: tuple[Structure, ...]
    seen: Mapping[str, np.ndarray]  # by channel, the direction that it sees (21,)
    stiffness: float  # of the mesh [N/m]

    def transfer(self, channel: str, frequency: np.ndarray, structure: Structure | None = None) -> np.ndarray:
        """A channel's line per displacement of the teeth, at frequencies [Hz] (n,) → (n,) complex [unit per m]."""
        structure, ω = structure or self.own, 2 * pi * np.asarray(frequency, dtype=float)
        closed = self.stiffness / (1 + self.stiffness * structure.receptance(ω, structure.mesh, structure.mesh))
        per_motion = -(ω**2) if channel == "acceleration" else 1.0
        return per_motion * structure.receptance(ω, structure.mesh, self.seen[channel]) * closed

    def scatter(self, channel: str, frequency: np.ndarray) -> np.ndarray:
        """s_jk of a channel's lines at frequencies [Hz] (n,) → complex (values, n)."""
        own = self.transfer(channel, frequency)
        return np.array([np.log(self.transfer(channel, frequency, other) / own) for other in self.others])


def deviating_machines(rig: Rig) -> DeviatingMachines:
    """The machines of a rig file; NotAvailable where it has no structure."""
    return _machines(_ByText(rig.text, rig))


@lru_cache(maxsize=32)
def _machines(of: _ByText) -> DeviatingMachines:
    rig = of.rig
    own = Structure.from_rig(rig)
    seen = {"transmission_error": own.transmission_error, "pinion_motion": own.pinion_motion}
    seen["torque"] = torque_meter(rig)
    if rig.accelerometer is not None:
        seen["acceleration"] = direction({rig.accelerometer: 1.0})
    return DeviatingMachines(
        own=own,
        others=tuple(Structure.from_rig(times(rig, {key: log(1 + σ)})) for key, σ in deviations(rig).items()),
        seen=seen,
        stiffness=mesh_of(rig, SAMPLES).stiffness.mesh_mean * rig.get("mesh.stiffness_scale", 1.0),
    )


def deviations(rig: Rig) -> dict[str, float]:
    """The keys of the rig file that change the lines, each with the relative standard deviation of its tolerance."""
    parts = {f"{table}.{name}": part for table, part in TABLES.items() for name in rig.values.get(table, {})}
    parts |= {key: part for key, part in KEYS.items() if rig.get(key) is not None}
    return {key: getattr(rig.tolerances, part) / sqrt(3) for key, part in parts.items()}
