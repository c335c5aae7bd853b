"""Clocks in Unix time that are not set back with this machine's.

Silence is measured by the steady one; by the later one things are dated and ordered, and expire.
"""

from __future__ import annotations

import time

_BEGAN_NS = time.time_ns() - time.monotonic_ns()


def steady_time_ns() -> int:
    """Unix time [ns] as it was set when the process began."""
    return _BEGAN_NS + time.monotonic_ns()


def later_time_ns() -> int:
    """Unix time [ns] of this machine, or of the steady clock where that is later.

    It follows a machine's clock that is set forward, as after a start without one, and goes on where that is set back.
    """
    return max(time.time_ns(), steady_time_ns())
