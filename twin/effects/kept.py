"""Responses by what they are made from, kept within a budget of memory.

A trace asks for the responses of many windows that the trace before asked for, too: with an eccentricity or a cracked
tooth of given size, with the effects that are in the twin already. They are pure functions of model, effects, flanks
and condition. Only their lines are kept.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterable, Sequence
from threading import Lock

from twin.effects.response import Effect, ResponseLines, solve_with
from twin.model import Condition, Model
from twin.wear.profile import WornProfile

BUDGET = 64 * 2**20  # of all responses together [bytes]
SPECTRA = 5  # of a response: the mesh force, and those of the channels, made when they are first asked for


class KeptResponses:
    """Responses by key, at most `budget` bytes of them; those asked for least recently go first."""

    def __init__(self, budget: int = BUDGET) -> None:
        self.budget = budget
        self.nbytes = 0  # of all responses
        self.solved = 0  # responses that were made, kept or not
        self._kept: OrderedDict[Hashable, tuple[ResponseLines, int]] = OrderedDict()
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._kept)

    def get(
        self,
        model: Model,
        effects: Iterable[Effect],
        profile: WornProfile | Sequence[WornProfile],
        condition: Condition,
        period: str | None = None,
    ) -> ResponseLines:
        """The lines of `solve_with`; see their `converged`."""
        effects = tuple(effects)
        profiles = (profile,) if isinstance(profile, WornProfile) else tuple(profile)
        key = model, effects, tuple(p.depth.tobytes() for p in profiles), condition, period
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key][0]
        lines = solve_with(model, effects, profiles, condition, period).alone
        steady = lines.steady
        size = (SPECTRA + len(steady.action_lines) + len(steady.loads)) * steady.force_lines.nbytes
        size += 2 * steady.omega.nbytes + sum(len(depth) for depth in key[2])
        with self._lock:
            self.solved += 1
            self.nbytes += size - self._kept.get(key, (lines, 0))[1]
            self._kept[key] = lines, size
            while self.nbytes > self.budget and len(self._kept) > 1:
                self.nbytes -= self._kept.popitem(last=False)[1][1]
        return lines

    def clear(self) -> None:
        with self._lock:
            self._kept.clear()
            self.nbytes = 0


RESPONSES = KeptResponses()
