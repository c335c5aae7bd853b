"""Reading a recording: every frame as an array."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from benchmarks.long_recording import write_long_recording
from benchmarks.peers.asking import Ask
from benchmarks.peers.programs.exchange import shortest, write_problem
from benchmarks.peers.rows import Row, row
from service.errors import FrameError
from service.stream.frames import EncoderFrame, Frame, SampleFrame
from service.stream.sources.mcap import Recording
from service.stream.wire.topics import Channel

SECONDS = 60.0  # of signal in the recording


def frames(path: Path) -> list[Frame]:
    with Recording(path) as recording:
        return list(recording.frames(_refuse))


def _refuse(channel: Channel, error: FrameError) -> NoReturn:
    raise error


def _values(frame: Frame) -> np.ndarray:
    assert isinstance(frame, SampleFrame | EncoderFrame)
    return frame.values if isinstance(frame, SampleFrame) else frame.edge_offsets_ns


def agreement(own: list[Frame], values: Mapping[str, Any]) -> str:
    arrays = [_values(frame) for frame in own]
    ours = len(arrays), sum(a.size for a in arrays), sum(float(np.sum(a, dtype=float)) for a in arrays)
    same = ours == (values["frames"], values["values"], values["sum"])
    return f"{ours[0]} frames, {ours[1]} values, {'the same' if same else 'NOT the same'}"


def rows(ask: Ask, folder: Path) -> list[Row]:
    path = folder / "reading.mcap"
    write_long_recording(path, SECONDS)
    answer = ask("mcap", "read", write_problem(folder / "reading.npz", recording=str(path)))
    own, found = shortest(lambda: frames(path)), frames(path)
    what = f"recording of {path.stat().st_size / 1e6:.0f} MB, decoded"
    return [
        row(f"{what}; reader without CRC", own, answer, "plain", lambda values: agreement(found, values)),
        row(f"{what}; reader with CRC", own, answer, "checked", lambda values: agreement(found, values)),
    ]
