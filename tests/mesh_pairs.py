"""Gear pairs that the tests of geometry and mesh are run on."""

import tomllib
from dataclasses import replace
from math import radians
from pathlib import Path

from twin.geometry import GearPair
from twin.rig import Rig

ROOT = Path(__file__).parents[1]
UNSW_RIG = tomllib.loads((ROOT / "recordings/rigs/unsw.toml").read_text(encoding="utf-8"))
UNSW = Rig.from_mapping(UNSW_RIG).gear_pair()
UNSW_TIGHT = replace(UNSW, backlash=0.0)


def standard_pair(z1, z2, module, bore_radius, *, face_width=0.02, backlash=0.0) -> GearPair:
    """A full-depth pair of 20° with clearance 0.25 modules, of the rig's steel."""
    return GearPair(
        teeth=(z1, z2),
        module=module,
        pressure_angle=radians(20),
        face_width=face_width,
        addendum=module,
        dedendum=1.25 * module,
        bore_radius=bore_radius,
        youngs_modulus=205e9,
        poisson_ratio=0.29,
        backlash=backlash,
    )


EQUAL = standard_pair(29, 29, 3.065e-3, (0.015, 0.015))  # Dąbrowski et al.
LARGE = standard_pair(23, 46, 3e-3, (0.012, 0.02))
UNDERCUT = standard_pair(10, 40, 2e-3, (0.003, 0.01))
PAIRS = {"unsw": UNSW, "equal": EQUAL, "large": LARGE, "undercut": UNDERCUT}
