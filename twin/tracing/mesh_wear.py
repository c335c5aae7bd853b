"""How the flanks wear with the effects that are tried: worn profiles by depth, effects and onset.

    wear of the pair alone → from its profile at the depth of the onset, wear with the effect → …

Curves are kept by model, effects (their numbers rounded to two digits), condition and start, and grow as far as a depth
is asked for: a later window carries on the curve of the one before. Beyond what the deepest window suggests the last
wear rate is held, so that a step of a fit that goes astray does not compute the wear of years. The steps are coarser
than those of the twin's own curves: what they leave is far within what healthy machines differ by.

Source   twin/wear/evolution.py
Limits   one operating condition: that of the first worn window
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import ceil, log

import numpy as np

from twin.effects.addition import Addition
from twin.effects.extended import extend
from twin.effects.response import Effect
from twin.model import Condition, Model
from twin.tracing.observed import Observed
from twin.updating.model_cache import deepest
from twin.wear.curve import MasterCurve
from twin.wear.evolution import COARSE
from twin.wear.profile import WornProfile

FIRST_END = 0.015  # of the module: the depth to which curves are computed at least
END_STEP = 1.25  # ratio of one such depth to the next
BEYOND_DEEPEST = 1.4  # times the deepest window's depth: a fit may move it
LEAST_DEPTH = 1e-9  # [m]
RATE_STEP = 1e-6  # of depth, over which the rate that is held is taken [m]

Start = tuple[MasterCurve, float] | None  # an earlier curve and the depth on it [m]


@lru_cache(maxsize=12)  # of a sliced face some 10 MB each
def curve_with(model: Model, effects: tuple[Effect, ...], condition: Condition, start: Start = None) -> MasterCurve:
    """Wear with effects, from new flanks or from those of an earlier curve at a depth."""
    worn = extend(model, effects)
    begin = worn.unworn if start is None else start[0].profile(start[1])
    return MasterCurve.begin(worn, condition, begin, deepest(model.rig, np.inf), COARSE)


def profile_at(curve: MasterCurve, depth: float, until: float) -> WornProfile:
    """The profile of a curve at a depth [m]; beyond `until` as the last wear rate makes it."""
    depth = max(depth, curve.start_depth)
    until = max(until, curve.start_depth + RATE_STEP)
    if depth <= until:
        return curve.profile(depth)
    last, before = curve.profile(until), curve.profile(until - RATE_STEP)
    rate = (last.depth - before.depth) / RATE_STEP
    return replace(last, depth=last.depth + rate * (depth - until))


def wear_condition(windows: Sequence[Observed]) -> Condition:
    """The condition that the flanks are taken to have worn under: that of the first worn window."""
    return next((w.condition for w in windows if w.worn), windows[0].condition)


def wear_until(model: Model, depth: float) -> float:
    """How deep curves are computed where the deepest window has so much [m]: in steps, so that it seldom changes."""
    first = FIRST_END * model.mesh.pair.module
    steps = ceil(log(BEYOND_DEEPEST * max(depth, LEAST_DEPTH) / first, END_STEP))
    return first * END_STEP ** max(0, steps)


def plain_curve(model: Model, windows: Sequence[Observed]) -> MasterCurve:
    """The wear of these windows without effects."""
    return curve_with(model, (), wear_condition(windows))


def rounded(effect: Effect) -> Effect:
    """The effect with its numbers to two digits: flanks worn by it are the same, and are computed once."""
    values = {}
    for parameter in effect.parameters:
        v = getattr(effect, parameter.name)
        values[parameter.name] = float(f"{v:.2g}") if isinstance(v, float) else v
    return replace(effect, **values)  # type: ignore[type-var]


def rounded_addition(addition: Addition) -> Addition:
    """The same of an effect with onset and law, whose factors are rounded to two digits, too."""
    law = replace(addition.law, factors=tuple(float(f"{f:.2g}") for f in addition.law.factors))
    return replace(addition, effect=rounded(addition.effect), law=law)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WearWithEffects:
    """Worn profiles for whatever effects are in the twin, as `joint_problem.Profiles`."""

    model: Model
    condition: Condition
    until: float
    with_effects: tuple[Addition, ...] = ()  # that shape the wear
    onset_depth: dict[float, float] = field(default_factory=dict)

    def __call__(self, depth: float, window: Observed) -> WornProfile | Sequence[WornProfile]:
        """The flanks of a window at a depth [m], one profile for each slice across the face."""
        if not window.worn:
            return self.model.unworn
        changes = {n for a in self.with_effects for n in a.changes if 0 < n <= window.revolutions}
        curve = curve_with(self.model, self._acting(0.0), self.condition)
        for onset in sorted(changes):
            start = min(self.onset_depth.get(onset, 0.0), depth, self.until)
            acting = self._acting(onset)
            later = curve_with(self.model, acting, self.condition, (curve, float(f"{start:.2g}")))
            if depth < later.start_depth:  # the flanks have not worn since
                break
            curve = later
        return profile_at(curve, depth, self.until).slices

    def _acting(self, revolutions: float) -> tuple[Effect, ...]:
        """The effects under which the flanks wear after so many revolutions."""
        return tuple(e for a in self.with_effects if (e := a.wearing(revolutions)) is not None)
