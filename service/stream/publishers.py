"""Who publishes a key, where the network says it: two that send in turn for some time are two publishers.

A publisher that is started anew has another identity, and the old one is not received again, but for frames that were
on their way. So only one that comes back again and again, over some seconds, is named.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from twin.windows import Fault

RETURNS = 5  # times that a publisher comes back after another one ...
SPAN = 10.0  # ... over so long a time at least, evenly [s] ...
WITHIN = 60.0  # ... and without a longer pause [s]
_MOST = 4  # publishers of a key that are remembered


@dataclass(slots=True)
class Publishers:
    """The publishers of one key, the newest last."""

    known: deque[str] = field(default_factory=lambda: deque(maxlen=_MOST))
    returns: deque[float] = field(default_factory=deque)  # on the monotonic clock [s]

    def note(self, source: str, now: float) -> tuple[str, str] | None:
        """A frame of a publisher has come; the two that send in turn, where that is certain, once for each proof."""
        if self.known and source == self.known[-1]:
            return None
        if source not in self.known:
            self.known.append(source)
            return None
        other = self.known[-1]
        self.known.remove(source)
        self.known.append(source)
        if self.returns and now - self.returns[-1] > WITHIN:
            self.returns.clear()
        if self.returns and now - self.returns[-1] < SPAN / (RETURNS - 1):
            return None
        self.returns.append(now)
        if len(self.returns) < RETURNS:
            return None
        self.returns.clear()
        first, second = sorted((source, other))
        return first, second


def two_publishers(label: str, two: tuple[str, str]) -> Fault:
    """The fault of a window in which two publishers sent on a channel's key."""
    detail = f"{two[0]} and {two[1]} send on this key in turn"
    return Fault(kind="two_publishers", channel=label, count=1, action="none", detail=detail)
