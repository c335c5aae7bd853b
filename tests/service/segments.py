"""Windows as the frames that they would have been made of, for tests of what is kept and computed."""

from __future__ import annotations

import secrets

import numpy as np
from sqlalchemy import update

from service.results.kept_signals import KeptSignals
from service.results.schema import WINDOWS
from service.results.segment_file import write_segment
from service.stream.edge_counts import EncoderCounts
from service.stream.frames import NS, EncoderFrame, SampleFrame
from service.stream.pieces import Piece, size_of
from service.stream.samples import Span
from service.stream.segment import Segment
from service.stream.window import laid_out
from service.stream.wire.topics import Channel

LONGEST = 5.0  # of a frame of samples [s]


def segment_of(window, asset="unsw", **changes):
    """The frames of a window, of which `made` makes the same one as far as samples are numbers of 32 bits."""
    frames, start = [], window.start_time_ns
    for kind, channels in (("accel", window.accelerations), ("torque", window.torques)):
        for name, samples in channels.items():
            values, at = samples.values.astype(np.float32), 0
            for i, part in enumerate(np.array_split(values, int(values.size / samples.rate / LONGEST) + 1)):
                frames.append(
                    SampleFrame(
                        channel=Channel(asset, kind, name), sequence=i, sample_rate=samples.rate, values=part,
                        start_time_ns=start + round((samples.start + at / samples.rate) * NS),
                    )
                )  # fmt: skip
                at += part.size
    for name, edges in window.encoders.items():
        frames.append(
            EncoderFrame(
                channel=Channel(asset, "encoder", name), sequence=0, start_time_ns=start, edges_per_rev=edges.per_rev,
                first_edge_index=edges.first_index, edge_offsets_ns=edges.times * NS,
            )
        )  # fmt: skip
    pieces = {}
    for frame in frames:
        pieces.setdefault(frame.channel.label, []).append(Piece(frame, 0, size_of(frame)))
    end = max((frame.end_time_ns for frame in frames), default=start + NS)
    given = {"span": Span(start, end), "pieces": pieces, "slow": dict(window.slow), "faults": window.faults}
    return Segment(**given | changes)


def made(segment, rig=None):
    """The window of a segment that is an asset's first."""
    return laid_out(segment, rig, EncoderCounts()).window


def keep(signals, asset, number, window, **about):
    """Keeps the frames of a window that has been committed; `about` are columns of its row."""
    folder = signals._folder
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{secrets.token_hex(8)}.mcap"
    row = {"segment": file.name, "segment_bytes": write_segment(file, segment_of(window)), **about}
    with signals._database.transaction() as db:
        of = (WINDOWS.c.asset == asset, WINDOWS.c.number == number)
        assert db.execute(update(WINDOWS).where(*of).values(row)).rowcount == 1


def in_folder(store, folder, limit=2**30):
    """The kept signals of a database whose segments are all in one folder."""
    return KeptSignals(store.database, folder, limit)
