"""A window of a recording as something to look at, without a service."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from service.errors import FrameError, InputError
from service.files.rig import assembly_for, choose_asset, rig_of
from service.results.jobs import Job
from service.runtime.outcomes import Outcome
from service.runtime.pipeline import Pipeline
from service.runtime.twin_port import gear_twin
from service.signals.subject import Subject, modelling
from service.stream.assembly import AssemblySettings
from service.stream.frames import Frame
from service.stream.sources.mcap import Recording, windows_of
from service.stream.window import by_sound_instruments
from service.stream.wire.topics import Channel
from twin.rig import Rig
from twin.windows import Window


class _Last:
    """A `ResultSink` that keeps the window asked for, and the state after all of them."""

    def __init__(self, wanted: int) -> None:
        self.wanted, self.count = wanted, 0
        self.found: Outcome | None = None
        self.state: Any = None

    def commit(self, outcome: Outcome, job: Job | None = None) -> bool:
        self.count, self.state = self.count + 1, outcome.state
        if self.wanted in (-1, outcome.index):
            self.found = outcome
        return True

    def publish(self, outcome: Outcome) -> None:
        """Nobody watches."""


def recorded_subject(
    path: Path,
    index: int,
    *,
    rig_path: Path | None,
    asset: str | None,
    prefix: str,
    assembly: AssemblySettings,
    modelled: bool,
) -> Subject:
    """A window by its index, −1 for the last; InputError where there is none. `modelled` runs the twin on all of it."""
    with Recording(path, prefix) as recording:
        asset = choose_asset(recording, asset)
        rig = rig_of(recording, rig_path)
        if modelled:
            frames = (frame for frame in recording.frames(_left_out) if frame.channel.asset == asset)
            return _assessed(path, frames, rig, asset, index, assembly.waiting_for(recording.labels(asset)))
        last: tuple[int, Window] | None = None
        for last in enumerate(windows_of(recording, assembly_for(rig, assembly), asset)):
            if last[0] == index:
                break
    if last is None or index not in (-1, last[0]):
        raise _no_window(path, index, 0 if last is None else last[0] + 1)
    return Subject(asset=asset, index=last[0], window=by_sound_instruments(rig, last[1]), rig=rig)


def _assessed(
    path: Path, frames: Iterable[Frame], rig: Rig, asset: str, index: int, assembly: AssemblySettings
) -> Subject:
    """The window with what the twin expects of it, once it has processed all of them."""
    results = _Last(index)
    pipeline = Pipeline(lambda name: rig, gear_twin(), results, assembly=assembly)
    for frame in frames:
        pipeline.feed(frame)
    pipeline.flush(asset)
    found = results.found
    if found is None or found.window is None:
        raise _no_window(path, index, results.count)
    model = modelling(rig, results.state, lambda: found.record.get("wear_depth_um"))
    return Subject(asset=asset, index=found.index, window=found.window, rig=rig, model=model)


def _left_out(channel: Channel, error: FrameError) -> None:
    """A frame that cannot be read: the window has a gap there, and says so."""


def _no_window(path: Path, index: int, count: int) -> InputError:
    return InputError(
        f"{path}: there is no window {index}; the recording has "
        + (f"windows 0 to {count - 1}" if count else "no whole window")
    )
