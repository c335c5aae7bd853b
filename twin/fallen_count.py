"""A revolution count that has fallen: windows of other gears or of another machine never mix with those before.

The first window below the count that was seen before is refused. Another one that follows it, and every later window
that continues the lower count, is refused too, also where that count passes the earlier one:

    0 ≤ n − n_refused ≤ s·f·(t − t_refused)

n  revolution count of the pinion   t  time of the window [s]   f  pinion speed [Hz]
s  margin for speeds that were not recorded

A single refused window, or a count that does not continue the lower one, is taken for a disturbance of the counter;
not so where the next window continues the lower count at the machine's own pace:

    |(n − n_refused) / (f·(t − t_refused)) − 1| ≤ p

A running machine whose counter was disturbed once has by then gone on from the earlier count, twice as far at least
where windows are equally far apart.

Where the data tell that the gears are the same, nothing is asked: the count is taken for one that began again, and its
revolutions go on from those seen (`count_restarted`). So it is where the transmission error goes on from that of the
windows before (`same_flanks`), and where no window has ever had another count than that of its own recording: what
turned between such recordings is not known, and they follow one another by their dates.

A window that arrives late is none of these: its time lies before that of windows already used, and its count between
the counts of the windows before and after that time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.assessment import CountEvent
from twin.errors import WindowError
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.same_flanks import turns_by_flanks
from twin.state import FallenCount, State
from twin.thresholds import deciding
from twin.updating.conditions import COUNT, refuse_falling_count


@dataclass(frozen=True, slots=True, kw_only=True)
class FallenCountThresholds:
    """When windows continue a count that has fallen."""

    refusals: int = deciding(
        2, unit="windows in a row", meaning="windows of a lower count after which it is no disturbance",
        source="not derived: a single one may be a counter's glitch",
    )  # fmt: skip
    speed_margin: float = deciding(
        1.5, of="the larger of rated and present speed", meaning="highest mean speed between two windows of one count",
        source="not derived: drives of constant speed stay within a few per cent",
    )  # fmt: skip
    pace: float = deciding(
        0.25, of="turns at the window's speed in the time since",
        meaning="how far a count may be from the lower one's own pace that goes on from it already in the next window",
        source="set between 0.87 times, seen of one second machine, and twice, which one disturbed count exceeds",
    )  # fmt: skip
    pause: float = deciding(
        1.5, unit="s", meaning="pause up to which a window goes on in the recording of the window before",
        source="the pause that ends a burst (AssemblySettings.gap), and half as much again",
    )  # fmt: skip


DEFAULT = FallenCountThresholds()
FLANKS = "the transmission error of its flanks goes on from that of the windows before"
OWN = "every recording of this machine begins its own count; they follow one another by their dates"


class CountFellError(WindowError):
    """A window of a count that has fallen; `state` remembers it.

    seen     revolutions by the latest window of the count before
    fallen   revolutions of the window refused
    ignored  whether people have said that windows of this count are not to be used
    """

    def __init__(self, message: str, state: State, seen: float) -> None:
        super().__init__(message)
        assert state.fallen is not None
        self.state, self.seen = state, seen
        self.fallen, self.ignored = state.fallen.revolutions, state.fallen.ignored


def with_count_checked(
    rig: Rig, state: State, features: WindowFeatures, limits: FallenCountThresholds = DEFAULT
) -> State:
    """The state where the window continues the count seen before; raises CountFellError where it does not."""
    revolutions, before = features.revolutions, state.fallen
    if revolutions is None or not state.memory.track.revolutions:
        return state
    seen = state.memory.track.revolutions
    try:
        refuse_falling_count(revolutions, seen)
    except WindowError as error:
        if _arrives_late(state, features, revolutions):
            return state
        refusals = 1 if before is None else before.refusals + 1
        ignored = before is not None and before.ignored and _continues(rig, before, features, revolutions, limits)
        raise CountFellError(str(error), _remembered(state, features, revolutions, refusals, ignored), seen) from None
    if before is None:
        return state
    single = before.refusals < limits.refusals and not _keeps_pace(before, features, revolutions, limits)
    if single or not _continues(rig, before, features, revolutions, limits):
        return replace(state, fallen=None)
    raise CountFellError(
        f"this window continues a revolution count that had fallen to {before.revolutions:.0f} where {seen:.0f} had "
        "been seen: other gears, a counter that was reset, or another machine? The window is not used; record it under "
        "another asset name",
        _remembered(state, features, revolutions, before.refusals + 1, before.ignored),
        seen,
    )


def count_restarted(
    state: State, features: WindowFeatures, limits: FallenCountThresholds = DEFAULT
) -> CountEvent | None:
    """How the count of the same gears goes on that has begun again; None where it has not, or the data leave it open.

    features  with the count as the encoder gives it
    """
    count, seen, history = features.revolutions, state.memory.track.revolutions, state.tracing.history
    if count is None or not seen or state.fallen is not None or state.count.pending or not history:
        return None
    before = [w.features for w in history]
    elapsed = (features.start_time_ns - before[-1].start_time_ns) * 1e-9
    if elapsed <= 0:
        return None
    most = limits.speed_margin * (features.speed_hz or 0.0) * elapsed
    turns, reason = None, FLANKS
    if count + state.count.offset < seen - COUNT.most_fall:
        turns = turns_by_flanks(before, features, (min(count, most), most))
    if turns is None and _begins(features) and (state.count.own or _each_its_own(before, limits)):
        turns, reason = min(count, most), OWN
    if turns is None:
        return None
    return CountEvent(window=state.windows_seen, seen=seen, count=count, revolutions=seen + turns, reason=reason)


def _each_its_own(before: Sequence[WindowFeatures], limits: FallenCountThresholds) -> bool:
    """Whether every count began with its recording: at a window's start, or with that of the window directly before."""
    for last, w in zip((None, *before), before, strict=False):
        pause = np.inf if last is None else (w.start_time_ns - last.start_time_ns) * 1e-9 - last.duration
        if not (_begins(w) or pause <= limits.pause):
            return False
    return True


def _begins(w: WindowFeatures) -> bool:
    """Whether the encoder's count began with this window."""
    return w.revolutions is not None and w.turns is not None and w.revolutions - 0.5 * w.turns <= 1.0


def _arrives_late(state: State, features: WindowFeatures, revolutions: float) -> bool:
    """Whether the count belongs between those of the windows used before and after this window's time."""
    used = [(w.features.start_time_ns, w.features.revolutions) for w in state.tracing.history]
    before = [count for time, count in used if count is not None and time <= features.start_time_ns]
    after = [count for time, count in used if count is not None and time > features.start_time_ns]
    if not before or not after:
        return False
    return max(before) - COUNT.most_fall <= revolutions <= min(after)


def with_fallen_ignored(state: State) -> State:
    """The state whose windows of the fallen count are refused without asking again."""
    return state if state.fallen is None else replace(state, fallen=replace(state.fallen, ignored=True))


def with_fallen_forgotten(state: State) -> State:
    """The state without the fallen count: its windows are another machine's."""
    return replace(state, fallen=None)


def _remembered(
    state: State, features: WindowFeatures, revolutions: float, refusals: int, ignored: bool = False
) -> State:
    fallen = FallenCount(
        revolutions=revolutions, time_ns=features.start_time_ns, refusals=refusals, ignored=ignored
    )  # fmt: skip
    return replace(state, fallen=fallen)


def _continues(
    rig: Rig, before: FallenCount, features: WindowFeatures, revolutions: float, limits: FallenCountThresholds
) -> bool:
    """Whether a count can have come from the lower one in the time since."""
    elapsed = (features.start_time_ns - before.time_ns) * 1e-9
    speed = max(features.speed_hz or 0.0, rig.get("operating.pinion_speed_hz", 0.0))
    return 0 <= revolutions - before.revolutions <= limits.speed_margin * speed * max(elapsed, 0.0) + 1.0


def _keeps_pace(
    before: FallenCount, features: WindowFeatures, revolutions: float, limits: FallenCountThresholds
) -> bool:
    """Whether a count has gone on from the lower one as far as the machine's speed makes it in the time since."""
    turns = (features.speed_hz or 0.0) * (features.start_time_ns - before.time_ns) * 1e-9
    return turns > 0 and abs((revolutions - before.revolutions) / turns - 1) <= limits.pace
