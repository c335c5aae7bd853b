"""Which spacings of lines without a shaft healthy recordings show, too.

A spacing is that of a healthy recording where both are the same, or one is twice the other, in orders (it turns with
the shafts) or in hertz (it does not).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from twin.baseline.learned import Baseline
from twin.baseline.reading import SpacingSeen, WindowReading
from twin.baseline.repeats import SPACINGS, share_of
from twin.baseline.shaft_names import belonging

RELATED = (0.5, 1.0, 2.0)
REACH = 3.0  # spectral lines, up to which two spacings are one: as in the search itself


def showing(spacing: SpacingSeen, reading: WindowReading, healthy: Iterable[WindowReading]) -> tuple[str, ...]:
    """Names of the healthy recordings that show a spacing of a window, too."""
    return tuple(r.name for r in healthy if any(_same(spacing, reading, other, r) for other in r.spacings))


def _same(one: SpacingSeen, here: WindowReading, other: SpacingSeen, there: WindowReading) -> bool:
    reach = REACH / min(here.turns, there.turns)
    in_orders = min(abs(one.order - q * other.order) for q in RELATED)
    in_hertz = min(abs(one.order * here.speed_hz - q * other.order * there.speed_hz) for q in RELATED)
    return in_orders < reach or in_hertz < reach * here.speed_hz


def least_clear() -> float:
    """Clearness of a spacing that is new: as rare by chance as its share of the false alarms [nat]."""
    return -float(np.log(share_of(1)))


def is_new(spacing: SpacingSeen, reading: WindowReading, baseline: Baseline) -> bool:
    """Whether a spacing of a window is none of the healthy recordings' and clearer than what they have of their own."""
    clear = spacing.clearness > least_clear() * baseline.repeats.factor(SPACINGS)
    return clear and not showing(spacing, reading, baseline.readings)


def new_spacings(baseline: Baseline, windows: Sequence[WindowReading]) -> str:
    """The spacings of most windows that are new, in words; empty where there are none."""
    found = [[s for s in r.spacings if is_new(s, r, baseline)] for r in windows]
    if 2 * sum(bool(own) for own in found) <= len(windows):
        return ""
    first = [(r, own[0]) for r, own in zip(windows, found, strict=True) if own]
    places = {f"{s.order * r.speed_hz:.3f} Hz" for r, s in first}
    r, s = first[0]
    whose = belonging(s.order, baseline.rig.teeth, REACH / r.turns)
    return f"lines spaced by {', '.join(sorted(places))} {whose}, and no healthy recording shows them"


def clearest_over(reading: WindowReading, healthy: Iterable[WindowReading]) -> float:
    """Clearness of the clearest spacing that no healthy recording shows, over that from which it is found."""
    known = list(healthy)
    new = [s.clearness for s in reading.spacings if not showing(s, reading, known)]
    return max(new, default=0.0) / least_clear()
