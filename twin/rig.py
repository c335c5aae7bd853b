"""A rig: everything that is known of one gearbox, as frozen data, built from a mapping.

The mapping is what a rig file holds (`recordings/rigs/unsw.toml` is the reference). Missing tables
stay missing: what depends on them raises NotAvailable, with the names of what is missing. A value
that cannot be is refused with its name, value, unit, allowed range and a likely cause; a key that is
not known is refused with the nearest one that is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import cos, radians
from typing import Any

from twin.errors import NotAvailable, ParameterError
from twin.geometry.gear_pair import GearPair
from twin.rig_schema import SCHEMA, checked
from twin.rig_tolerances import Tolerances

MOST_LISTED = 4  # missing keys that an error names one by one

DEGREES_OF_FREEDOM = (
    "th1", "th2", "th3", "th5", "th7", "th8", "th10", "th12", "th13",
    "y4", "y5", "y6", "y9", "y10", "y11", "x4", "x5", "x6", "x9", "x10", "x11",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Rig:
    """One gearbox. `values` is the checked mapping of the rig file, tables nested as there."""

    values: Mapping[str, Any] = field(repr=False)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Rig:
        """Checks a rig file's mapping; raises ParameterError with name, value, unit and range."""
        rig = cls(checked(mapping, SCHEMA))
        rig._check_consistency()
        return rig

    @property
    def name(self) -> str:
        return self.values.get("name", "unnamed")

    def get(self, path: str, default: Any = None) -> Any:
        """The value at a dotted path, or the default where the file does not give it."""
        node: Any = self.values
        for key in path.split("."):
            if not isinstance(node, Mapping) or key not in node:
                return default
            node = node[key]
        return node

    def require(self, what: str, *paths: str) -> tuple[Any, ...]:
        """The values at the dotted paths; NotAvailable names what cannot be computed and what is missing."""
        missing = [p for p in paths if self.get(p) is None]
        if missing:
            raise NotAvailable(f"{what} is not available: the rig file does not give {self._listed(missing)}")
        return tuple(self.get(p) for p in paths)

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
        return all(self.get(p) is not None for p in paths)

    @property
    def teeth(self) -> tuple[int, int]:
        """Tooth counts of pinion and gear."""
        z1, z2 = self.require("the tooth ratio", "gears.pinion.teeth", "gears.gear.teeth")
        return int(z1), int(z2)

    @property
    def accelerometer(self) -> str | None:
        """Name of the reference accelerometer, the one that the wear update compares."""
        return self.get("sensors.accelerometer")

    @property
    def band(self) -> tuple[float, float]:
        """The band of the RMS [Hz]; 0–2000 Hz where the file does not say (paper 3.3)."""
        low, high = self.get("sensors.band_hz", (0.0, 2000.0))
        return low, high

    @property
    def tolerances(self) -> Tolerances:
        """How far machine and instruments may differ from the rig file; defaults where it states nothing."""
        return Tolerances.of(self.values)

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

    def _check_consistency(self) -> None:
        """Derived values that the file repeats must agree with what they derive from."""
        m, α = self.get("gears.module"), self.get("gears.pressure_angle_deg")
        for wheel in ("pinion", "gear"):
            z, r = self.get(f"gears.{wheel}.teeth"), self.get(f"gears.{wheel}.pitch_radius")
            if None not in (m, z, r) and abs(r - m * z / 2) > 1e-3 * r:
                raise ParameterError(
                    f"gears.{wheel}.pitch_radius = {r:g} m contradicts module·teeth/2 = {m * z / 2:g} m; "
                    "a diameter, or another tooth count?"
                )
            rb = self.get(f"gears.{wheel}.base_radius")
            if None not in (m, α, z, rb) and abs(rb - m * z / 2 * cos(radians(α))) > 1e-3 * rb:
                raise ParameterError(
                    f"gears.{wheel}.base_radius = {rb:g} m contradicts module·teeth/2·cos α = "
                    f"{m * z / 2 * cos(radians(α)):g} m; another pressure angle?"
                )
            bore, root = self.get(f"gears.{wheel}.bore_radius"), self.get("gears.dedendum")
            if None not in (m, z, bore, root) and bore >= m * z / 2 - root:
                raise ParameterError(
                    f"gears.{wheel}.bore_radius = {bore:g} m must be below the root radius "
                    f"{m * z / 2 - root:g} m; a diameter?"
                )
        dofs = self.get("layout.degrees_of_freedom")
        if dofs is not None and tuple(dofs) != DEGREES_OF_FREEDOM:
            raise ParameterError(
                "layout.degrees_of_freedom must be the 21 coordinates of the paper's eq. 2 in its order: "
                + ", ".join(DEGREES_OF_FREEDOM)
            )
        s, k = self.get("mesh.pair_s"), self.get("mesh.pair_stiffness")
        if s is not None and k is not None and len(s) != len(k):
            raise ParameterError(f"mesh.pair_s has {len(s)} values and mesh.pair_stiffness {len(k)}: one each")
        low, high = self.band
        if not low < high:
            raise ParameterError(f"sensors.band_hz = [{low:g}, {high:g}] Hz must rise")
