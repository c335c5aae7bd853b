"""Hysteresis of what speaks against a depth or a life: each limit on a quantity that scatters from window to window.

    in doubt from   |q| beyond its limit                     on, while it was not
    in doubt until  |q| is within its limit by a margin      again

The error on held-out windows is renewed by every trace, and jumps where a held-out window joins that lies deeper than
any that the twin has learned from: it is judged by the majority of the latest windows; its first value counts at once.
All others are measured by the window that they doubt, and count at once.

With other effects in the model, or a quantity that is not measured any more, what was known of it ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from twin.established import HYSTERESIS, Doubts
from twin.grounds import HELD_OUT, LEVEL_RISE, MESH_LINES, OTHER_GEARS, RATE, UNREACHABLE, Basis
from twin.tracing.unexplained import excess
from twin.updating.remaining_life import LIFE


@dataclass(frozen=True, slots=True, kw_only=True)
class Noisy:
    """A quantity that is compared with a limit at every window."""

    name: str
    value: Callable[[Basis], float | None]  # None where it is not measured
    limit: Callable[[Basis], float]
    release: float  # of the limit
    below: bool = False  # whether values below the limit are in doubt
    windows: int = 1  # of which the majority judges

    def in_doubt(self, basis: Basis, values: tuple[float, ...], before: bool) -> bool:
        """Whether the latest of some values is in doubt; before: whether the one before it was."""
        limit = self.limit(basis)
        beyond = sum(self._beyond(value, limit) for value in values)
        if not before:
            return 2 * beyond > self.windows or beyond == len(values)
        within = sum(not self._beyond(value, limit * self.release) for value in values)
        return not 2 * within > self.windows

    def _beyond(self, value: float, limit: float) -> bool:
        return value <= limit if self.below else value > limit


def _held_out(channel: str) -> Callable[[Basis], float | None]:
    return lambda basis: excess(basis.errors, channel)


def _misfit(basis: Basis) -> float | None:
    return None if basis.outcome.estimate is None else basis.outcome.estimate.misfit


def _misfit_of_unknown(basis: Basis) -> float | None:
    """The misfit of encoder lines where nothing is known of the unworn gears."""
    return _misfit(basis) if basis.outcome.memory.fit is None else None


def _rate(basis: Basis) -> float | None:
    """The wear rate in its standard deviations."""
    track = basis.outcome.memory.track
    if basis.by_level or track.windows < basis.limits.least_worn_windows or not track.rate_std > 0:
        return None
    return track.rate / track.rate_std


NOISY = (
    *(
        Noisy(
            name=HELD_OUT[channel], value=_held_out(channel), limit=lambda basis: 1.0,
            release=HYSTERESIS.release, windows=HYSTERESIS.windows,
        )
        for channel in HELD_OUT
    ),
    Noisy(
        name=MESH_LINES, value=_misfit, limit=lambda basis: basis.verdict.doubtful_misfit, release=HYSTERESIS.release
    ),
    Noisy(
        name=OTHER_GEARS, value=_misfit_of_unknown, limit=lambda basis: basis.limits.other_gears,
        release=HYSTERESIS.release,
    ),
    Noisy(
        name=UNREACHABLE, value=lambda basis: basis.level_missed, limit=lambda basis: basis.limits.unreachable,
        release=HYSTERESIS.release,
    ),
    Noisy(
        name=LEVEL_RISE, value=lambda basis: basis.level_rise, limit=lambda basis: basis.limits.level_rise,
        release=HYSTERESIS.level_release, below=True,
    ),
    Noisy(name=RATE, value=_rate, limit=lambda basis: LIFE.measurable, release=HYSTERESIS.rate_release, below=True),
)  # fmt: skip


def doubts_after(basis: Basis, before: Doubts, *, again: bool = False) -> Doubts:
    """What is in doubt at a window, with the values that say so.

    again  whether `before` holds this window already
    """
    effects = tuple(a.name for a in basis.outcome.memory.effects)
    if effects != before.effects:
        before = Doubts()
    values, raised = {}, []
    for one in NOISY:
        now = one.value(basis)
        if now is None:
            continue
        known = before.values.get(one.name, ())
        known = (*(known[:-1] if again else known), float(now))[-one.windows :]
        values[one.name] = known
        if one.in_doubt(basis, known, one.name in before.raised):
            raised.append(one.name)
    return Doubts(effects=effects, values=values, raised=tuple(raised))
