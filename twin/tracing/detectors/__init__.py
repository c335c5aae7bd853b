"""The questions that a trace asks of a machine, in the order in which effects hide one another.

Rattle comes first, since nothing else can be sought in it; then forces on the shafts (suspected), tooth errors and a
crack, which fill the spectrum between the mesh lines; non-gear content; eccentricity, whose sidebands need the teeth
known; the mesh, the sensor, the forces that nothing found since explains, and at last the unknown. Each detector sees
what those before it have found and gives back new findings; each also runs alone.

The order saves time and does not decide the result: a detector whose answer rests on findings of others
(`consults`) is asked again where these have changed since (twin/tracing/settling.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from twin.tracing.context import TracingContext
from twin.tracing.detectors import (
    crack,
    eccentricity,
    mesh,
    non_gear,
    rattle,
    sensor,
    shaft_forces,
    tooth_errors,
    unknown,
)
from twin.tracing.findings import Findings


@dataclass(frozen=True, slots=True, kw_only=True)
class Detector:
    """One question; `name` is that which effects declare (twin/effects/facts.py), or names a step between detectors."""

    name: str
    detect: Callable[[TracingContext], Findings]
    needs_phase: bool = True  # whether it needs the phase of the mesh against the encoder's zero
    finds: str = ""  # whose effects it reports, as effects declare it; its name where empty
    consults: tuple[str, ...] = ()  # detectors whose findings, effects or suspected forces, its answer rests on
    refines: str = ""  # detector whose effects it replaces by better ones: asked again whenever that one is

    @property
    def reports(self) -> str:
        """The detector, as effects declare it, whose effects this one reports."""
        return self.finds or self.name


TEETH = ("tooth_errors", "crack")


DETECTORS = (
    Detector(name="rattle", detect=rattle.detect),
    Detector(name="shaft_forces", detect=shaft_forces.detect),
    Detector(name="tooth_errors", detect=tooth_errors.detect, consults=("shaft_forces",)),
    Detector(name="crack", detect=crack.detect, consults=("shaft_forces", "tooth_errors")),
    Detector(
        name="non_gear", detect=non_gear.detect, needs_phase=False, consults=(*TEETH, "eccentricity", "shaft_forces")
    ),
    Detector(name="eccentricity", detect=eccentricity.detect, consults=(*TEETH, "shaft_forces")),
    Detector(name="mesh", detect=mesh.detect, consults=(*TEETH, "sensor")),
    Detector(
        name="tooth errors fitted again with the effects on the mesh",
        detect=tooth_errors.refit,
        finds="none",
        refines="tooth_errors",
        consults=("mesh", "tooth_errors"),
    ),
    Detector(name="sensor", detect=sensor.detect, consults=("mesh", "tooth_errors")),
    Detector(
        name="shaft forces that nothing else explains",
        detect=shaft_forces.confirm,
        finds="shaft_forces",
        consults=(*TEETH, "eccentricity", "shaft_forces"),
    ),
    Detector(
        name="unknown",
        detect=unknown.detect,
        needs_phase=False,
        consults=(*TEETH, "non_gear", "eccentricity", "shaft_forces", "sensor"),
    ),
)
