"""A recording with some of its channels left out, as if they had never been measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from service.stream.frames import EncoderFrame, Frame
from service.stream.sources.mcap import Recording
from service.stream.wire.topics import PREFIX

TACHOMETER = "tachometer"  # the pinion's encoder with one edge a turn: speed and count, no transmission error
SETS: Mapping[str, tuple[str, ...]] = {
    "accel": ("accel", TACHOMETER),
    "accel+torque": ("accel", "torque", TACHOMETER),
    "accel+encoders": ("accel", "encoder"),
    "all": ("accel", "encoder", "torque"),
}


def once_a_turn(frame: EncoderFrame) -> EncoderFrame | None:
    """What a tachometer would have given in an encoder's place; None where no turn ends in the frame."""
    per_rev, first = frame.edges_per_rev, frame.first_edge_index
    kept = np.arange(-first % per_rev, frame.edge_offsets_ns.size, per_rev)
    if kept.size == 0:
        return None
    return replace(
        frame,
        edges_per_rev=1,
        first_edge_index=(first + int(kept[0])) // per_rev,
        edge_offsets_ns=frame.edge_offsets_ns[kept],
    )


@contextmanager
def only(kinds: tuple[str, ...]) -> Iterator[None]:
    """Within it `assess` reads the channels of these kinds alone."""

    class Partial(Recording):
        def __init__(self, path, prefix: str = PREFIX):
            super().__init__(path, prefix)
            self.channels = {
                ident: c
                for ident, c in self.channels.items()
                if c.kind in kinds or (TACHOMETER in kinds and c.label == "encoder/pinion")
            }

        def frames(self, on_error) -> Iterator[Frame]:
            for frame in super().frames(on_error):
                if isinstance(frame, EncoderFrame) and TACHOMETER in kinds:
                    seen = once_a_turn(frame)
                    if seen is not None:
                        yield seen
                else:
                    yield frame

    with patch("service.runtime.assess.Recording", Partial):
        yield
