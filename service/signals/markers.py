"""Where mesh, shafts and bearings of a machine show in a spectrum.

    mesh k·z1    sidebands k·z1 ± p, k·z1 ± g·z1/z2    shafts p, g·z1/z2    bearings: the orders of their geometry

All in orders of the pinion's rotation; times its speed in hertz. Bearings are marked where the rig file gives their
geometry (`[[rolling_bearings]]`).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import radians
from typing import TYPE_CHECKING

from service.signals.view import Marker
from twin.rig import Rig

if TYPE_CHECKING:
    from twin.effects.bearing_defect import BearingGeometry

PARTS = {"cage": "cage", "outer": "outer race", "inner": "inner race", "ball": "rolling element"}
MESH, SIDEBAND_MESH, SIDEBANDS, SHAFT, BEARING = 20, 5, 2, 4, 3  # harmonics that are marked of each kind


def markers_of(rig: Rig, unit: float, highest: float) -> tuple[Marker, ...]:
    """The markers up to `highest` on an axis on which the pinion's rotation is at `unit` (its speed, or order 1)."""
    found = [
        Marker(kind=kind, label=label, x=order * unit)
        for kind, label, order in _orders(rig)
        if 0 < order * unit <= highest
    ]
    return tuple(sorted(found, key=lambda m: m.x))


def _orders(rig: Rig) -> Iterator[tuple[str, str, float]]:
    known = rig.has("gears.pinion.teeth", "gears.gear.teeth")
    shafts = {"pinion": 1.0}
    if known:
        z1, z2 = rig.teeth
        shafts["gear"] = z1 / z2
        for k in range(1, MESH + 1):
            yield "mesh", f"mesh {k}×", float(k * z1)
        for k in range(1, SIDEBAND_MESH + 1):
            for shaft, order in shafts.items():
                for p in range(1, SIDEBANDS + 1):
                    yield "sideband", f"mesh {k}× − {p} {shaft}", k * z1 - p * order
                    yield "sideband", f"mesh {k}× + {p} {shaft}", k * z1 + p * order
    for shaft, order in shafts.items():
        for p in range(1, SHAFT + 1):
            yield "shaft", f"{shaft} {p}×", p * order
    for bearing in rig.get("rolling_bearings", ()):
        if bearing["shaft"] not in shafts:
            continue
        own = shafts[bearing["shaft"]]
        for part, order in geometry_of(bearing).orders().items():
            for p in range(1, BEARING + 1):
                yield "bearing", f"{bearing['name']} {PARTS[part]} {p}×", p * order * own


def geometry_of(bearing: dict) -> BearingGeometry:
    """The geometry of one of the rig file's rolling bearings."""
    from twin.effects.bearing_defect import BearingGeometry  # loads half of the twin, which a start does without

    return BearingGeometry(
        balls=int(bearing["rolling_elements"]),
        ball_diameter=bearing["element_diameter"],
        pitch_diameter=bearing["pitch_diameter"],
        contact_angle=radians(bearing.get("contact_angle_deg", 0.0)),
    )
