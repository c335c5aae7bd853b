"""A recording with some of its channels left out, as if they had never been measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from unittest.mock import patch

from service.sources.mcap import Recording
from service.wire.topics import PREFIX

SETS: Mapping[str, tuple[str, ...]] = {
    "accel": ("accel",),
    "accel+encoders": ("accel", "encoder"),
    "all": ("accel", "encoder", "torque"),
}


@contextmanager
def only(kinds: tuple[str, ...]) -> Iterator[None]:
    """Within it `assess` reads the channels of these kinds alone."""

    class Partial(Recording):
        def __init__(self, path, prefix: str = PREFIX):
            super().__init__(path, prefix)
            self.channels = {ident: c for ident, c in self.channels.items() if c.kind in kinds}

    with patch("service.assess.Recording", Partial):
        yield
