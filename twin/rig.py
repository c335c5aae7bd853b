"""A rig: everything that is known of one gearbox, as frozen data, built from a mapping.

The mapping is what a rig file holds (`recordings/rigs/unsw.toml` is the reference). Missing tables
stay missing: what depends on them raises NotAvailable, with the names of what is missing. A value
that cannot be is refused with its name, value, unit, allowed range and a likely cause; a key that is
not known is refused with the nearest one that is.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from math import radians
from typing import Any

from twin.errors import NotAvailable
from twin.gear_age import GearAge
from twin.geometry.gear_pair import GearPair
from twin.rig_consistency import MEASURED, refuse_contradictions, torque_meter_nodes
from twin.rig_derived import DERIVED
from twin.rig_estimated import Estimated
from twin.rig_schema import SCHEMA, checked
from twin.rig_tolerances import Tolerances

MOST_LISTED = 4  # missing keys that an error names one by one


def _text_of(values: Mapping[str, Any]) -> str:
    """Values of a rig file as one line."""
    return json.dumps(values, sort_keys=True, default=str)


@dataclass(frozen=True, slots=True)
class Rig:
    """One gearbox. `values` is the checked mapping of the rig file, tables nested as there."""

    values: Mapping[str, Any] = field(repr=False)
    text: str = field(init=False, repr=False, compare=False)  # the same as one line, by which results are kept

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", _text_of(self.values))

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Rig:
        """Checks a rig file's mapping; raises ParameterError with name, value, unit and range."""
        rig = cls(checked(mapping, SCHEMA))
        refuse_contradictions(rig.get, rig.gear_pair)
        return rig

    @property
    def digest(self) -> str:
        """Sixteen hexadecimal digits by which files that belong to this rig file's values name it.

        The gears' age is no value of the machine, but of its gears at one time, and leaves the digest as it is.
        """
        gears = {key: value for key, value in self.values.get("gears", {}).items() if key != "age"}
        values = {**self.values, "gears": gears} if "age" in self.values.get("gears", {}) else self.values
        return sha256(_text_of(values).encode()).hexdigest()[:16]

    @property
    def name(self) -> str:
        return self.values.get("name", "unnamed")

    def get(self, path: str, default: Any = None) -> Any:
        """The value at a dotted path, or the default where the file does not give it."""
        node: Any = self.values
        try:
            for key in path.split("."):
                node = node[key]
        except (KeyError, TypeError):  # no such key, or no table
            return default
        return node

    def value(self, path: str) -> Any:
        """The value at a dotted path, else what other values of the file make of it, else None."""
        given = self.get(path)
        derive = DERIVED.get(path)
        return derive(self.get) if given is None and derive is not None else given

    def require(self, what: str, *paths: str) -> tuple[Any, ...]:
        """The values at the dotted paths; NotAvailable names what cannot be computed and what is missing."""
        values = tuple(self.value(p) for p in paths)
        missing = [p for p, value in zip(paths, values, strict=True) if value is None]
        if missing:
            raise NotAvailable(f"{what} is not available: the rig file does not give {self._listed(missing)}")
        return values

    def _listed(self, missing: list[str]) -> str:
        """Missing keys in few words: where there are many, a table that is not there at all by its name."""
        if len(missing) <= MOST_LISTED:
            return ", ".join(missing)
        tables: dict[str, list[str]] = {}
        for path in missing:
            tables.setdefault(path.split(".")[0], []).append(path)
        parts = []
        for table, paths in tables.items():
            if self.get(table) is None:
                parts.append(table)
            else:
                parts += paths[:2]
                parts += [f"{len(paths) - 2} more of {table}"] if len(paths) > 2 else []
        return ", ".join(parts)

    def has(self, *paths: str) -> bool:
        """Whether the file gives, or lets derive, all values at the dotted paths."""
        return all(self.value(p) is not None for p in paths)

    @property
    def teeth(self) -> tuple[int, int]:
        """Tooth counts of pinion and gear."""
        z1, z2 = self.require("the tooth ratio", "gears.pinion.teeth", "gears.gear.teeth")
        return int(z1), int(z2)

    @property
    def gear_age(self) -> GearAge:
        """What is known of the gears' age where the revolution count is zero."""
        return GearAge.of(self.get("gears.age"))

    @property
    def accelerometer(self) -> str | None:
        """Name of the reference accelerometer, the one that the wear update compares."""
        return self.get("sensors.accelerometer")

    def calibrated(self, channel: str) -> bool:
        """Whether the unit of a channel, such as accel/a1, is known; else its values are raw."""
        return channel not in self.get("sensors.uncalibrated", ())

    @property
    def band(self) -> tuple[float, float]:
        """The band of the RMS [Hz]; 0–2000 Hz where the file does not say (paper 3.3)."""
        low, high = self.get("sensors.band_hz", (0.0, 2000.0))
        return low, high

    @property
    def torque_meter(self) -> tuple[int, int]:
        """Nodes of the torsional spring whose twist the torque meter measures, from motor to gears."""
        return torque_meter_nodes(self.get("sensors.torque", MEASURED))

    @property
    def encoders(self) -> tuple[str, str]:
        """Coordinates that the encoders of the pinion's and of the gear's shaft measure."""
        return self.get("sensors.encoder_input", "th7"), self.get("sensors.encoder_output", "th8")

    @property
    def given_pair_stiffness(self) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Path positions [m] and stiffness of one tooth pair [N/m] where the file's table is selected, else None."""
        if self.get("mesh.stiffness_source", "energy") != "given":
            return None
        return self.get("mesh.pair_s"), self.get("mesh.pair_stiffness")

    @property
    def mesh_stiffness_source(self) -> str:
        """In words, where the stiffness of the mesh comes from."""
        return "potential-energy method" if self.given_pair_stiffness is None else "given in the rig file"

    @property
    def tolerances(self) -> Tolerances:
        """How far machine and instruments may differ from the rig file; defaults where it states nothing."""
        return Tolerances.of(self.values)

    @property
    def estimated(self) -> Estimated:
        """Which values of the rig file are estimates, and how far off they may be; nothing where it does not say so."""
        return Estimated.of(self.values)

    def sensor_range(self, kind: str, channel: str) -> float | None:
        """Full scale of a channel, `accel` [m/s²] or `torque` [N·m]; None where the rig file does not state it."""
        stated = self.get(f"sensors.ranges.{kind}")
        return stated.get(channel) if isinstance(stated, Mapping) else stated

    def gear_pair(self) -> GearPair:
        """The geometry of the pair; NotAvailable where the file lacks any of it."""
        g = "gears."
        m, α, W, ha, hf, E, ν, r1, r2 = self.require(
            "the geometry of the gear pair",
            *(
                g + k
                for k in (
                    "module", "pressure_angle_deg", "face_width", "addendum", "dedendum",
                    "youngs_modulus", "poisson_ratio", "pinion.bore_radius", "gear.bore_radius",
                )
            ),
        )  # fmt: skip
        return GearPair(
            teeth=self.teeth,
            module=m,
            pressure_angle=radians(α),
            face_width=W,
            addendum=ha,
            dedendum=hf,
            bore_radius=(r1, r2),
            youngs_modulus=E,
            poisson_ratio=ν,
            backlash=self.get("gears.backlash", 0.0),
        )
