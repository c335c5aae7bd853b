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

from dataclasses import dataclass, field
from functools import lru_cache
from math import exp, log, pi, sqrt

import numpy as np

from twin.dynamics.structure import Structure
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
    rig = of.rig
    stiffness = mesh_of(rig, SAMPLES).stiffness.mesh_mean * rig.get("mesh.stiffness_scale", 1.0)
    ω = 2 * pi * rig.teeth[0] * speed_hz * np.arange(1, HARMONICS + 1)

    def lines(machine: Rig) -> np.ndarray:
        structure = Structure.from_rig(machine)
        seen = structure.pinion_motion if pinion_only else structure.transmission_error
        closed = stiffness / (1 + stiffness * structure.receptance(ω, structure.mesh, structure.mesh))
        return structure.receptance(ω, structure.mesh, seen) * closed

    own = lines(rig)
    return np.array([np.log(lines(times(rig, {key: log(1 + σ)})) / own) for key, σ in deviations(rig).items()])


def deviations(rig: Rig) -> dict[str, float]:
    """The keys of the rig file that change the lines, each with the relative standard deviation of its tolerance."""
    parts = {f"{table}.{name}": part for table, part in TABLES.items() for name in rig.values.get(table, {})}
    parts |= {key: part for key, part in KEYS.items() if rig.get(key) is not None}
    return {key: getattr(rig.tolerances, part) / sqrt(3) for key, part in parts.items()}
