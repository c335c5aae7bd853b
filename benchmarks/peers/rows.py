"""The table of a comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from benchmarks.peers.asking import Answer

WHAT, PEER = 55, 15  # widths of the first columns
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One piece of work done by both."""

    what: str
    peer: str  # name and version
    own: float  # processor time of gear-twin [s]
    theirs: float | None  # of the peer [s]; None where it could not be had
    check: str  # how far both results agree, or why there is nothing to compare

    @property
    def ratio(self) -> float | None:
        return None if self.theirs is None else self.theirs / self.own

    @property
    def line(self) -> str:
        theirs = "–" if self.theirs is None else duration(self.theirs)
        ratio = "–" if self.ratio is None else f"{self.ratio:.3g}"
        return (
            f"{self.what:<{WHAT}}{self.peer:<{PEER}}{duration(self.own):>9}{theirs:>9}{ratio:>9}  {self.check}".rstrip()
        )

    def plain(self) -> dict[str, Any]:
        return {
            "what": self.what, "peer": self.peer, "gear_twin_s": self.own, "peer_s": self.theirs, "ratio": self.ratio,
            "check": self.check,
        }  # fmt: skip


def duration(seconds: float) -> str:
    """Three digits and a unit."""
    size, unit = next(((s, u) for s, u in UNITS if seconds >= s), UNITS[-1])
    return f"{seconds / size:.3g} {unit}"


def off(theirs: float, own: float) -> str:
    """How far the peer's value is from gear-twin's."""
    return f"{100 * (theirs / own - 1):+.1f} %"


def within(theirs: float, own: float) -> str:
    """The same without its sign, where it is about rounding."""
    difference = abs(theirs / own - 1)
    return f"within {difference:.0e}" if difference else "identical"


def row(what: str, own: float, answer: Answer, time: str, check: Callable[[Mapping[str, Any]], str]) -> Row:
    """A row from a peer's answer; where there is none, it says why."""
    if answer.missing:
        return Row(what=what, peer=answer.peer, own=own, theirs=None, check=f"not available: {answer.missing}")
    return Row(what=what, peer=answer.peer, own=own, theirs=answer.times[time], check=check(answer.values))


def quickest(rounds: Sequence[Sequence[Row]]) -> list[Row]:
    """The rows with the shortest times of both sides over several rounds of the same rows."""

    def of_one(same: tuple[Row, ...]) -> Row:
        theirs = [row.theirs for row in same if row.theirs is not None]
        return replace(same[-1], own=min(row.own for row in same), theirs=min(theirs, default=None))

    return [of_one(same) for same in zip(*rounds, strict=True)]


def table(rows: Iterable[Row]) -> str:
    """Head and rows."""
    head = f"{'work':<{WHAT}}{'peer':<{PEER}}{'gear-twin':>9}{'peer':>9}{'ratio':>9}  results"
    return "\n".join((head, *(r.line for r in rows)))
