"""The window that a machine's verdict rests on, and how long its verdicts usually hold.

    u = q75(Δ₁ … Δₙ)·g,      g ← max(min(m, 3·g), (1 − 1/N)·g, 1)

u   usual time between two assessed windows                                  [s]
Δ   times between the starts of the latest n ≤ 32 windows, assessed or not   [s]
g   usual number of windows from one assessed window to the next
m   the number of windows that the latest such step took
N   windows within which a long step is forgotten, 128

A window is assessed where the capability that judges the machine has used it: the model, the comparison with a healthy
baseline, the relation of level and depth, or the pair of encoders. A machine that lowers its load as often as it lifts
it, or that ramps, has a large g, and its verdict holds as long. A single long outage raises g by no more than 3.

Ignores  pauses in which no window came: their times are few among the steps, and the 75th percentile passes over them
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

from twin.assessment.verdict import VerdictWindow
from twin.verdict_age import LIMITS, NS, VerdictAge


@dataclass(frozen=True, slots=True, kw_only=True)
class Rhythm:
    """What the verdict's window is told by; plain serialisable data."""

    index: int | None = None  # of the latest assessed window
    start_time_ns: int | None = None
    latest_ns: int | None = None  # start of the latest window
    since: int = 0  # windows after the assessed one
    reason: str = ""
    steps: tuple[float, ...] = ()  # between the starts of the latest windows [s]
    gap: float = 1.0  # g
    usual: float | None = None  # u, at the assessed window [s]; None before the second

    def with_window(self, index: int, start_time_ns: int, missing: str | None, limits: VerdictAge = LIMITS) -> Rhythm:
        """The rhythm with one more window.

        missing  why it was not assessed; None where it was
        """
        step = 0.0 if self.latest_ns is None else (start_time_ns - self.latest_ns) / NS
        steps = (*self.steps, step)[-limits.steps :] if step > 0 else self.steps
        if missing is not None:
            return replace(self, latest_ns=start_time_ns, since=self.since + 1, reason=missing, steps=steps)
        if self.index is None:
            return Rhythm(index=index, start_time_ns=start_time_ns, latest_ns=start_time_ns, steps=steps, gap=self.gap)
        gap = max(min(self.since + 1.0, limits.most * self.gap), (1 - 1 / limits.memory) * self.gap, 1.0)
        usual = sorted(steps)[ceil(limits.usual_step * len(steps)) - 1] * gap if steps else None
        return Rhythm(
            index=index, start_time_ns=start_time_ns, latest_ns=start_time_ns, steps=steps, gap=gap, usual=usual
        )  # fmt: skip

    def begun_anew(self) -> Rhythm:
        """The rhythm where no earlier verdict holds: the gears are others, or have been put together anew."""
        return replace(self, index=None, start_time_ns=None, since=0, reason="")

    def verdict_window(self) -> VerdictWindow | None:
        """The window that the verdict rests on; None before the first window."""
        if self.latest_ns is None:
            return None
        return VerdictWindow(
            index=self.index,
            start_time_ns=self.start_time_ns,
            usual=self.usual,
            latest_ns=self.latest_ns,
            since=self.since,
            reason=self.reason,
        )
