"""Samples that lie at an end of a channel's range because the range ended there.

The tail of a signal thins out towards its extreme. The last step of a converter's range holds as many samples as the
step beside it, or up to 2.4 times as many where the signal is one tone; a rail holds all that lies beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class RailThresholds:
    """When samples lie at a rail of the channel."""

    piled: float = deciding(
        4.0, of="samples at the neighbouring value", meaning="samples at an extreme value from which it is a rail",
        source="derivation: the last step of a converter holds up to 2.4 times as many where the signal is one tone",
    )  # fmt: skip
    least: int = deciding(
        5, unit="samples", meaning="samples at an extreme value from which it is a rail",
        source="measured: of 7500 records of noise in coarse steps none has five at an extreme and four times fewer "
        "at the value next to it",
    )  # fmt: skip


RAIL = RailThresholds()


def samples_at_end_of_range(finite: np.ndarray, limits: RailThresholds = RAIL) -> int:
    """How many of the finite values (n,) lie at a rail at either extreme; 0 where the extremes were only reached."""
    if finite.size == 0 or finite.min() == finite.max():
        return 0
    ends = [finite == finite.min(), finite == finite.max()]
    between = finite[~(ends[0] | ends[1])]
    if between.size == 0:
        return finite.size
    count = 0
    for flags, beside in zip(ends, (between.min(), between.max()), strict=True):
        at = int(np.count_nonzero(flags))
        if at >= limits.least and at > limits.piled * int(np.count_nonzero(between == beside)):
            count += at
    return count
