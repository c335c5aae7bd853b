"""Which kept windows are given up where an asset's raw signals take more room than they may.

Kept as long as there is room for anything else to give up: the newest windows, the first windows, and those at which
something was found. The rest is thinned evenly in revolutions, one window at a time: the one whose neighbours are
closest together goes, so that what remains covers the whole history. Of refused windows only the newest few are kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

NEWEST = 16
FIRST = 8  # usually of the healthy machine: what a baseline is learned from
REFUSED = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptWindow:
    """One window whose raw signals are kept."""

    number: int  # the window's index
    start_ns: int
    revolutions: float | None  # of the pinion; None where they are not counted
    bytes: int
    found: bool = False  # whether something was found at this window
    refused: bool = False


def given_up(kept: Sequence[KeptWindow], limit: int) -> list[KeptWindow]:
    """The windows to delete so that the rest fits `limit` bytes; the newest one never, however large it is."""
    ordered = sorted(kept, key=lambda w: w.number)
    refused = [w for w in ordered if w.refused]
    out = refused[:-REFUSED]
    rest = [w for w in ordered if w not in out]
    room = limit - sum(w.bytes for w in rest)
    while room < 0 and len(rest) > 1:
        least = _least_missed(rest)
        rest.remove(least)
        out.append(least)
        room += least.bytes
    return out


def _least_missed(windows: Sequence[KeptWindow]) -> KeptWindow:
    refused = [w for w in windows if w.refused and w is not windows[-1]]
    used = [w for w in windows if not w.refused]
    middle = used[FIRST:-NEWEST]
    plain = [w for w in middle if not w.found]
    if plain:
        return _closest(used, plain)
    if refused:
        return refused[0]
    if middle:
        return _closest(used, middle)
    return (used[FIRST - 1 : FIRST] if len(used) > NEWEST else used[:1])[0] if used else windows[0]


def _closest(used: Sequence[KeptWindow], candidates: Sequence[KeptWindow]) -> KeptWindow:
    """The candidate whose neighbours are closest together; the earliest of several."""
    place = dict(zip((w.number for w in used), _places(used), strict=True))
    between = {w.number: place[b.number] - place[a.number] for a, w, b in zip(used, used[1:], used[2:], strict=False)}
    return min(candidates, key=lambda w: (between[w.number], w.number))


def _places(used: Sequence[KeptWindow]) -> Iterator[float]:
    """Where each window lies in the history: revolutions that only rise, or numbers where they are not counted."""
    turns = [w.revolutions for w in used if w.revolutions is not None]
    if len(turns) < len(used):
        yield from (float(w.number) for w in used)
        return
    place, before = 0.0, turns[0]
    for now in turns:
        place, before = place + max(now - before, 0.0), now
        yield place
