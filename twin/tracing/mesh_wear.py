"""How the flanks wear with the effects that are tried: worn profiles by depth, effects and onset.

    wear of the pair alone → from its profile at the depth of the onset, wear with the effect → …

Curves are kept, so that each is computed once: by model, effects (their numbers rounded to two digits), condition,
start and depth.

Source   twin/wear/evolution.py
Limits   one operating condition: that of the first worn window
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import ceil, log

from twin.effects.extended import extend
from twin.effects.response import Effect
from twin.model import Condition, Model
from twin.tracing.observed import Observed
from twin.wear.curve import MasterCurve
from twin.wear.profile import WornProfile

FIRST_END = 0.015  # of the module: the least depth that a curve is made to
END_STEP = 1.25  # ratio of one end of a curve to the next: curves serve later windows, too
BEYOND_DEEPEST = 1.4  # times the deepest window's depth: a fit may move it
LEAST_DEPTH = 1e-9  # [m]

Start = tuple[MasterCurve, float] | None  # an earlier curve and the depth on it [m]


@lru_cache(maxsize=12)  # of a sliced face some 10 MB each
def curve_with(
    model: Model, effects: tuple[Effect, ...], condition: Condition, start: Start, until: float
) -> MasterCurve:
    """Wear with effects to a depth [m], from new flanks or from those of an earlier curve at a depth."""
    worn = extend(model, effects)
    begin = worn.unworn if start is None else start[0].profile(start[1])
    return MasterCurve.build(worn, condition, begin, until)


def wear_condition(windows: Sequence[Observed]) -> Condition:
    """The condition that the flanks are taken to have worn under: that of the first worn window."""
    return next((w.condition for w in windows if w.worn), windows[0].condition)


def wear_until(model: Model, depth: float) -> float:
    """How deep curves are made where the deepest window has so much [m]: in steps, so that they serve later windows."""
    first = FIRST_END * model.mesh.pair.module
    steps = ceil(log(BEYOND_DEEPEST * max(depth, LEAST_DEPTH) / first, END_STEP))
    return first * END_STEP ** max(0, steps)


def plain_curve(model: Model, windows: Sequence[Observed], depth: float) -> MasterCurve:
    """The wear without effects of these windows, to a depth [m] and beyond."""
    return curve_with(model, (), wear_condition(windows), None, wear_until(model, depth))


def rounded(effect: Effect) -> Effect:
    """The effect with its numbers to two digits: flanks worn by it are the same, and are computed once."""
    values = {}
    for parameter in effect.parameters:
        v = getattr(effect, parameter.name)
        values[parameter.name] = float(f"{v:.2g}") if isinstance(v, float) else v
    return replace(effect, **values)  # type: ignore[type-var]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WearWithEffects:
    """Worn profiles for whatever effects are in the twin, as `joint_problem.Profiles`."""

    model: Model
    condition: Condition
    until: float
    with_effects: tuple[tuple[Effect, float], ...] = ()  # that shape the wear, with their onsets
    onset_depth: dict[float, float] = field(default_factory=dict)

    def __call__(
        self, depth: float, effects: tuple[Effect, ...], window: Observed
    ) -> WornProfile | Sequence[WornProfile]:
        """The flanks of a window at a depth [m], one profile for each slice across the face."""
        shaping = tuple((e, onset) for e, onset in self.with_effects if onset <= window.revolutions)
        if not window.worn:
            return self.model.unworn
        acting = tuple(e for e, onset in shaping if onset == 0)
        curve = curve_with(self.model, acting, self.condition, None, self.until)
        for effect, onset in shaping:
            if onset == 0:
                continue
            start = min(self.onset_depth.get(onset, 0.0), depth)
            acting = (*acting, effect)
            later = curve_with(self.model, acting, self.condition, (curve, float(f"{start:.2g}")), self.until)
            if depth < later.depth[0]:  # the flanks have not worn since
                break
            curve = later
        return curve.profile(max(depth, float(curve.depth[0]))).slices
