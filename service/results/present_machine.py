"""Which windows of an asset show its machine as it is now."""

from __future__ import annotations

from collections.abc import Sequence

from service.errors import InputError
from service.results.jobs import Jobs

ENDING = ("gears_replaced", "reassembled", "sensor_moved")  # changes after which earlier windows show another machine


def demand_present(asset: str, indices: Sequence[int], jobs: Jobs) -> None:
    """InputError where a window was measured before a change of the machine."""
    ended = {c.outcome.get("from_window", 0): c.kind for c in jobs.changes(asset) if c.kind in ENDING and c.outcome}
    first = min(indices, default=0)
    if indices and first < max(ended, default=0):
        raise InputError(
            f"window {first} was measured before the change {ended[max(ended)]!r}: choose windows from "
            f"{max(ended)} on, of the machine as it is now"
        )
