"""A clock in Unix time that cannot step: it begins as this machine's, and is carried on by the monotonic one."""

from __future__ import annotations

import time

_BEGAN_NS = time.time_ns() - time.monotonic_ns()


def steady_time_ns() -> int:
    """Unix time [ns] as it was set when the process began."""
    return _BEGAN_NS + time.monotonic_ns()
