"""Revolutions of the present gears from an encoder that counts on, or anew.

    n = n_encoder + offset + age      n  revolutions of the pinion since the present gears were new

The offset is 0 until somebody replaces the gears or resets the counter; the first window afterwards settles it:

    gears replaced, the counter counts on       offset = −(count at which the gears were replaced)
    gears replaced, the counter has fallen      offset = 0: the new count is that of the new gears
    counter reset, and it has fallen            offset = revolutions before − count that it began at
    counter reset, but it counts on             offset as before
    the data tell that it began again           offset = revolutions by the data − count (fallen_count.py)

The age is what the gears had made at the count's zero (twin/gear_age.py); where nobody knows it, n counts from there.
Gears that replace others are new, whatever was known of those.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.features.window_features import WindowFeatures
from twin.gear_age import SINCE_NEW, GearAge


@dataclass(frozen=True, slots=True, kw_only=True)
class CountOffset:
    """How an encoder's count becomes revolutions of the present gears."""

    offset: float = 0.0  # [turns of the pinion]
    pending: str = ""  # "gears_replaced" or "counter_reset", until the next window settles the offset
    seen: float = 0.0  # encoder's count by the latest window before the change [turns]
    at: float | None = None  # encoder's count at which gears were replaced; revolutions since new at a reset
    began: float = 0.0  # count that the counter was set to [turns]
    own: bool = False  # whether every recording begins a count of its own
    replaced: bool = False  # whether the gears whose age the rig file states have been replaced

    def awaiting(
        self, kind: str, revolutions: float, at: float | None, began: float = 0.0, stated: GearAge = SINCE_NEW
    ) -> CountOffset:
        """The count after a change that the next window settles; `revolutions` by the latest window before it.

        stated  what the rig file says of the gears' age
        """
        age = self.age(stated).revolutions
        seen = revolutions - self.offset - age
        if kind == "counter_reset":
            at = (revolutions if at is None else at) - age
        return replace(self, pending=kind, seen=seen, at=at, began=began)

    def settled(self, encoder_count: float) -> CountOffset:
        """The count once a window of the time after the change has come."""
        if not self.pending:
            return self
        fell = encoder_count < self.seen
        if self.pending == "gears_replaced":
            at = self.seen if self.at is None else self.at
            return CountOffset(offset=0.0 if fell else -min(at, encoder_count), replaced=True, own=self.own)
        before = self.at or 0.0
        return CountOffset(offset=before - self.began if fell else self.offset, replaced=self.replaced, own=self.own)

    def age(self, stated: GearAge) -> GearAge:
        """The age of the present gears, of which those that the rig file speaks of may be gone."""
        return SINCE_NEW if self.replaced else stated


def counted(
    count: CountOffset, features: WindowFeatures, stated: GearAge = SINCE_NEW
) -> tuple[CountOffset, WindowFeatures]:
    """The window with the revolutions of the present gears, and the count that it has settled.

    stated  what the rig file says of the gears' age
    """
    if features.revolutions is None:
        return count, features
    count = count.settled(features.revolutions)
    age = count.age(stated)
    revolutions = features.revolutions + count.offset + age.revolutions
    return count, replace(features, revolutions=revolutions, age_known=age.known)
