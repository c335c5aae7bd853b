"""Frames that are disturbed on their way, and what a service must make of them."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from fake_twin import TWIN

from service.runtime.assess import assess
from service.stream.sources.mcap import RawFrame
from tests.streams import shuffled
from twin.options import Options


def disturbed(frames: list[RawFrame], how: str, rng: random.Random) -> Iterator[RawFrame]:
    """The frames in another order, some of them twice, or without some."""
    if how == "shuffled":
        yield from shuffled(frames, 8, rng.randrange(2**31))
    for frame in frames if how != "shuffled" else ():
        lost = how == "lost" and rng.random() < 0.02
        if not lost:
            yield frame
        if how == "repeated" and rng.random() < 0.2:
            yield frame


def expected_windows(recording: Path) -> list[dict[str, Any]]:
    """The windows that the same frames give without any fault."""
    return assess(recording, twin=replace(TWIN, options=Options()))["windows"]


def same(found: Any, right: Any) -> bool:
    """Whether two values of a record are the same, to 1e-9."""
    if isinstance(right, float) and isinstance(found, int | float):
        return abs(found - right) <= 1e-9 * max(abs(found), abs(right), 1e-12)
    if isinstance(right, list) and isinstance(found, list):
        return len(found) == len(right) and all(map(same, found, right))
    if isinstance(right, dict) and isinstance(found, dict):
        return found.keys() == right.keys() and all(same(found[key], right[key]) for key in right)
    return found == right
