"""A sensor that loses contact: its samples rest at one value while the machine goes on.

    rest   |x_i − x_{i−1}| ≤ RESTING·q over FEWEST samples and more,   q the smallest step of the channel

    jump   the larger of the steps into a rest and out of it

Where the usual (median) step is many q, vibration does not stay within RESTING·q so long. What dies away between two
blows may, but it comes to rest by small steps; a contact that opens, or closes, makes a jump of a usual step and more.
What rests is no vibration: it becomes a gap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.features.gaps import runs
from twin.instruments.seen import Seen, with_channels
from twin.thresholds import deciding
from twin.windows import Fault, Samples, Window


@dataclass(frozen=True, slots=True, kw_only=True)
class LostContactThresholds:
    """When a sensor has lost contact for a moment."""

    resting: float = deciding(
        2.5, of="smallest step of the channel", meaning="step up to which two samples are the same",
        source="derivation: a converter's last digit moves by one to either side",
    )  # fmt: skip
    steps: float = deciding(
        30.0, of="smallest step of the channel", meaning="usual step below which the channel's samples are too coarse",
        source="derivation: twelve times `resting`: one step of noise in eighteen is a rest by chance",
    )  # fmt: skip
    fewest: int = deciding(
        12, unit="samples", meaning="samples in a row that are the same, from which the channel rests",
        source="derivation: of noise, one in 18^12; the crest of a sine of 400 samples a period has eleven",
    )  # fmt: skip
    most: float = deciding(
        0.6, of="samples", meaning="share that rests, above which the channel is another fault's", source="convention"
    )  # fmt: skip


DEFAULT = LostContactThresholds()


def without_lost_contact(seen: Seen, limits: LostContactThresholds = DEFAULT) -> Window:
    """The window with gaps where an accelerometer's samples rest at one value."""
    accelerations, faults = {}, []
    for name, samples in seen.window.accelerations.items():
        rests = _rests(samples, limits)
        if not rests:
            continue
        values = samples.values.copy()
        for start, stop in rests:
            values[start:stop] = np.nan
        accelerations[name] = replace(samples, values=values)
        share = sum(stop - start for start, stop in rests) / values.size
        detail = f"the samples rest at one value {len(rests)} times, {100 * share:.3g} % of the window"
        faults.append(
            Fault(kind="lost_contact", channel=f"accel/{name}", count=len(rests), action="repaired", detail=detail)
        )
    return with_channels(seen.window, accelerations, faults) if accelerations else seen.window


def _rests(samples: Samples, limits: LostContactThresholds) -> list[tuple[int, int]]:
    """Stretches [start, stop) that jumps lead to and from; none where the channel is too coarse to tell."""
    steps = np.abs(np.diff(samples.values))
    moving = steps[np.isfinite(steps) & (steps > 0)]
    if moving.size == 0:
        return []
    usual, smallest = float(np.median(moving)), float(moving.min())
    if usual < limits.steps * smallest:
        return []
    still = np.nan_to_num(steps, nan=np.inf) <= limits.resting * smallest
    inner = [(start, stop + 1) for start, stop in runs(still) if start > 0 and stop < still.size]
    found = [(start, stop) for start, stop in inner if stop - start >= limits.fewest]
    share = sum(stop - start for start, stop in found) / samples.values.size
    beside = np.concatenate(([0.0], np.nan_to_num(steps), [0.0]))  # [i]: the step to sample i
    jumps = [max(beside[start], beside[stop]) for start, stop in found]
    return found if found and share <= limits.most and np.median(jumps) >= usual else []
