"""Quantities of one machine that deciding numbers are shares of (twin/thresholds.py).

    F = T/r_b1        δ = F/k_m        e = 2π·r_b/N        e_j = j/(2·sin α)

T     rated torque on the pinion                     [N·m]
r_b1  base radius of the pinion                      [m]
F     rated mesh force                               [N]
k_m   mean stiffness of the mesh over a base pitch   [N/m]
δ     static mesh deflection at the rated torque     [m]

Source   definition of the mesh stiffness: ISO 6336-1:2019, clause 9; k_m by the energy method (twin/mesh/stiffness.py)
Limits   a rig file without a rated torque or speed: the condition of the first window stands for it where one is given
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import pi, sin
from typing import Any

from twin.errors import NotAvailable
from twin.geometry import GearPair
from twin.mesh.stiffness import PairStiffness
from twin.model import Condition
from twin.rig import Rig
from twin.thresholds import rows_of

UNITS = {
    "rated torque": "N·m",
    "rated speed": "Hz",
    "rated mesh force": "N",
    "rated mesh force over squared speed": "kg·m",
    "static mesh deflection": "m",
    "base pitch": "m",
    "backlash": "m",
    "run-out that takes up the backlash": "m",
    "upper limit of the analysis band": "Hz",
    "acceleration noise floor": "m/s²",
    "torque noise floor": "N·m",
    "pinion once-per-turn error": "m",
    "gear once-per-turn error": "m",
    "pinion graduation error": "m",
    "gear graduation error": "m",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """The quantities that can be computed for one machine, by the names that thresholds use (keys of UNITS), in SI."""

    values: Mapping[str, float]

    @classmethod
    def of(cls, rig: Rig, condition: Condition | None = None) -> Scales:
        """Those of a rig file; a condition stands for the rated one where the file states none."""
        torque = rig.get("operating.input_torque", None if condition is None else condition.torque)
        speed = rig.get("operating.pinion_speed_hz", None if condition is None else condition.speed_hz)
        tolerances = rig.tolerances
        values: dict[str, float | None] = {
            "rated torque": torque,
            "rated speed": speed,
            "upper limit of the analysis band": rig.band[1],
            "acceleration noise floor": tolerances.acceleration_floor,
            "torque noise floor": tolerances.torque_floor,
            "pinion once-per-turn error": tolerances.pinion_once_per_turn,
            "gear once-per-turn error": tolerances.gear_once_per_turn,
            "pinion graduation error": tolerances.pinion_graduation,
            "gear graduation error": tolerances.gear_graduation,
        }
        try:
            pair = rig.gear_pair()
        except NotAvailable:
            pair = None
        if pair is not None:
            values["base pitch"] = pair.base_pitch
            if pair.backlash > 0:
                values["backlash"] = pair.backlash
                values["run-out that takes up the backlash"] = pair.backlash / (2 * sin(pair.pressure_angle))
            if torque:
                force = abs(torque) / pair.base_radius[0]
                scale = rig.get("mesh.stiffness_scale", 1.0)
                values["rated mesh force"] = force
                if speed:
                    values["rated mesh force over squared speed"] = force / (2 * pi * speed) ** 2
                values["static mesh deflection"] = force / (scale * _mean_stiffness(pair))
        return cls(values={name: float(value) for name, value in values.items() if value is not None})

    def __getitem__(self, name: str) -> float:
        """One quantity; NotAvailable where the rig file does not suffice for it."""
        if name not in UNITS:
            raise KeyError(f"{name!r} is no scale: {', '.join(UNITS)}")
        if name not in self.values:
            raise NotAvailable(f"the {name} cannot be computed from the rig file")
        return self.values[name]

    def get(self, name: str) -> float | None:
        """One quantity; None where it cannot be computed, or where the name is that of no scale."""
        return self.values.get(name)

    def sized(self, thresholds: Any, name: str) -> float:
        """A deciding number of a set in SI: times the quantity that it is a share of, where that is one of UNITS."""
        (row,) = (row for row in rows_of(thresholds) if row.name == name)
        return float(row.value * self[row.about.of]) if row.about.of in UNITS else float(row.value)

    @property
    def torque(self) -> float:
        """Rated torque [N·m]."""
        return self["rated torque"]

    @property
    def speed(self) -> float:
        """Rated speed of the pinion [Hz]."""
        return self["rated speed"]

    @property
    def force(self) -> float:
        """Rated mesh force [N]."""
        return self["rated mesh force"]

    @property
    def deflection(self) -> float:
        """Static mesh deflection at the rated torque [m]."""
        return self["static mesh deflection"]

    @property
    def base_pitch(self) -> float:
        """Base pitch [m]."""
        return self["base pitch"]

    @property
    def acceleration(self) -> float:
        """Noise floor of an acceleration line [m/s²]."""
        return self["acceleration noise floor"]

    @property
    def torque_noise(self) -> float:
        """Noise floor of a line of the torque meter [N·m]."""
        return self["torque noise floor"]

    @property
    def once_per_turn(self) -> tuple[float, float]:
        """Standard deviation of the discs' errors at one cycle a turn, pinion and gear [m]."""
        return self["pinion once-per-turn error"], self["gear once-per-turn error"]

    @property
    def graduation(self) -> tuple[float, float]:
        """Standard deviation of the discs' errors at the next few cycles a turn, pinion and gear [m]."""
        return self["pinion graduation error"], self["gear graduation error"]


@lru_cache(maxsize=16)
def _mean_stiffness(pair: GearPair) -> float:
    """Mean stiffness of the mesh of nominal flanks [N/m]."""
    return PairStiffness.of(pair).mesh_mean
