"""What the detectors have found so far: effects for the twin, and results that later detectors need.

Frozen data; a detector gives back new findings with what it adds (twin/tracing/detectors/).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from twin.effects.addition import name_of
from twin.effects.bearing_defect import BearingDefect
from twin.effects.response import Effect
from twin.features.tones import NonGearTone
from twin.tracing.attribution import AttributedEffect
from twin.tracing.mesh_search import MeshFindings
from twin.tracing.shaft_remainder import ShaftLine


@dataclass(frozen=True, slots=True, kw_only=True)
class ShaftForce:
    """A force that turns with the pinion: unbalance, torque ripple, or the load that makes the teeth rattle."""

    effect: Effect
    parameters: dict[str, tuple[float, str, float]]  # value, unit, std
    log_evidence: float
    channel: str = "torque"  # that shows it
    order: float  # of the pinion

    @property
    def name(self) -> str:
        return name_of(self.effect)

    def attributed(self) -> AttributedEffect:
        """The force as an effect of the twin."""
        return AttributedEffect.of(self.effect, parameters=dict(self.parameters), log_evidence=self.log_evidence)


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingFinding:
    """A bearing defect with what speaks for it."""

    effect: BearingDefect
    order_std: float
    slip_std: float
    onset: float  # revolutions
    log_evidence: float


OF_TEETH = "of teeth or of what turns with the shafts, not of a bearing, which slips"
IMPACTS = {  # by the shaft that they repeat with
    "pinion": "impacts once a turn of the pinion, always at the same tooth: a tooth or another part of the pinion",
    "gear": "impacts once a turn of the gear, always at the same tooth: a tooth or another part of the gear",
    "none": "impacts that repeat with no turn of pinion or gear",
    None: "impacts of which the windows do not tell whether they repeat with a shaft",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class NonGearContent:
    """Vibration that no gear makes, over all windows."""

    defect: BearingFinding | None = None
    tones: tuple[NonGearTone, ...] = ()
    orders: tuple[tuple[float, float], ...] = ()  # lines that belong to no shaft: order, amplitude [m/s²]
    impacts: bool = False  # irregular ones
    struck: str | None = None  # the shaft that they repeat with, "none" where both are excluded; None: not told
    locked: float | None = None  # order of impacts that are locked to a shaft or the mesh, though no turn makes it
    modulated_by: str | None = None  # the shaft whose turn modulates the broadband noise, though no tooth strikes
    first: float | None = None  # revolutions of the first window with any of the unknown ones
    not_available: tuple[tuple[str, int], ...] = ()  # why part of a window could not be examined, and in how many
    described: str = ""  # all of it in sentences, where it has been followed over the windows
    # lines that a force makes at orders of the pinion: order, amplitude [m/s²]; None where the accelerometer shows none
    forces: tuple[tuple[float, float | None], ...] = ()
    unnamed: str = ""  # these, a light rub, a step of the mean: what stands clear and has no name, in sentences

    @property
    def unknown(self) -> bool:
        several = (self.tones, self.orders, self.impacts, self.locked, self.modulated_by, self.described, self.unnamed)
        return any(bool(part) for part in several)

    @property
    def struck_shaft(self) -> str:
        """The shaft that impacts repeat with; empty where there are none, or with none."""
        return self.struck if self.impacts and self.struck in ("pinion", "gear") else ""

    def sentence(self) -> str:
        """What is unknown, in words."""
        if self.described:
            return "; ".join(part for part in (self.described, self.unnamed) if part)
        parts = [self.unnamed] if self.unnamed else []
        if self.locked:
            parts.append(f"impacts at order {self.locked:.3f} of the pinion, locked in phase to its angle: {OF_TEETH}")
        if self.tones:
            parts.append("tones of fixed frequency: " + ", ".join(f"{t.frequency:.2f} Hz" for t in self.tones))
        if self.orders:
            parts.append("lines at orders that belong to no shaft: " + ", ".join(f"{o:.3f}" for o, _ in self.orders))
        if self.impacts:
            parts.append(IMPACTS[self.struck])
        if self.modulated_by:
            parts.append(f"broadband noise modulated by every turn of the {self.modulated_by}, as where something rubs")
        return "; ".join(parts)


@dataclass(frozen=True, slots=True, kw_only=True)
class AccelerometerFault:
    """What is wrong with the accelerometer's channel."""

    polarity: float  # 1, or −1
    delay: float  # at the start [s]
    delay_std: float
    rate: float  # [s/s]
    start_ns: int  # of the first window
    onset: float  # revolutions
    log_evidence: float

    def gain(self, frequency: np.ndarray, start_ns: int) -> np.ndarray:
        """What the channel makes of each frequency [Hz] in a window; (m,) → (m,) complex."""
        late = self.delay + self.rate * (start_ns - self.start_ns) * 1e-9
        return self.polarity * np.exp(-2j * pi * np.asarray(frequency) * late)


QUIET = NonGearContent()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Findings:
    """What has been found, and what later detectors need to know of it."""

    effects: tuple[AttributedEffect, ...] = ()  # in the order found
    teeth_separate: bool = False  # rattle: no steady mesh, so nothing else can be sought
    forces: tuple[ShaftForce, ...] = ()  # suspected; effects once nothing else is found to explain their lines
    run_out_orders: frozenset[int] = frozenset()  # of the pinion, that an eccentricity explains
    non_gear: NonGearContent = QUIET
    mesh: MeshFindings | None = None
    other_structure: bool = False  # whether the path to the housing is not the rig file's
    accelerometer_fault: AccelerometerFault | None = None  # the windows are corrected for it

    def has(self, *names: str) -> bool:
        """Whether any of these effects has been found."""
        return any(effect.name in names for effect in self.effects)

    @property
    def tooth_errors(self) -> tuple[AttributedEffect, ...]:
        """The effects found by which teeth differ from one another: their lines are at all orders of both shafts."""
        return tuple(f for f in self.effects if f.addition.effect.facts.acts_on == "teeth")

    def forces_beside_teeth(self, lines: Sequence[ShaftLine]) -> tuple[ShaftForce, ...]:
        """The suspected forces that teeth do not imitate: all where none differ, else those whose lines teeth cannot make.

        lines  those at orders of the pinion that no displacement in the mesh makes
        """
        made = {(line.channel, line.order) for line in lines}
        return tuple(f for f in self.forces if not self.tooth_errors or (f.channel, round(f.order)) in made)

    def known_orders(self, teeth: tuple[int, int]) -> tuple[float, ...]:
        """Orders of the pinion, rising, at which effects that make one line were found: run-outs, forces on a shaft."""
        out = set()
        for effect in (item.addition.effect for item in self.effects):
            if effect.signature.shape in ("run_out", "one_order"):
                own = {teeth[0] / teeth[1] if shaft == "gear" else 1.0 for shaft in effect.signature.shafts}
                out |= {float(effect.order)} if hasattr(effect, "order") else own
        return tuple(sorted(out))

    def force(self, channel: str) -> ShaftForce | None:
        """The first suspected force that this channel shows."""
        return next((force for force in self.forces if force.channel == channel), None)

    def adding(self, *effects: AttributedEffect, rejected: Collection[str] = ()) -> Findings:
        """With more effects, except those that an engineer has ruled out."""
        return replace(self, effects=(*self.effects, *(e for e in effects if e.name not in rejected)))

    def without(self, name: str) -> Findings:
        """Without an effect, and without a suspected force, of this name."""
        return replace(
            self,
            effects=tuple(effect for effect in self.effects if effect.name != name),
            forces=tuple(force for force in self.forces if force.name != name),
        )
