"""Recordings of one asset that follow one another, as one source of frames; they are fetched one at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any

from service.errors import FrameError, InputError
from service.files.documents import parsed_document
from service.results.stored_recordings import Part
from service.stream.frames import Frame
from service.stream.sources.mcap import RIG_ATTACHMENT, Recording
from service.stream.wire.topics import Channel


class Segments:
    """The segments in their order; what cannot be read of one is left out, and noted in `faults`.

    any_rig  whether their rig files may differ, because another is used
    """

    def __init__(self, where: str, parts: Sequence[Part], prefix: str, *, any_rig: bool) -> None:
        self.path, self._parts, self._prefix, self._any_rig = where, parts, prefix, any_rig
        self.size = sum(part.size for part in parts)
        self.bytes_read = 0
        self.faults: list[str] = []

    def __enter__(self) -> Segments:
        with ExitStack() as stack:
            for part in self._parts:
                opened = self._opened(part, stack)
                if opened is not None:
                    self.assets, self._rig_text = opened.assets, opened.rig_text
                    self._labels = {asset: opened.labels(asset) for asset in opened.assets}
                    return self
        raise InputError(f"{self.path}: no segment can be read: {self.faults[0]}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is open between two segments."""

    def labels(self, asset: str) -> tuple[str, ...]:
        """The channels of an asset in the first segment that can be read."""
        return self._labels[asset]

    def rig(self) -> dict[str, Any] | None:
        """The rig file of the first segment as a mapping."""
        if self._rig_text is None:
            return None
        return parsed_document(self._rig_text, f"{self.path}: attachment {RIG_ATTACHMENT}")

    def frames(self, on_error: Callable[[Channel, FrameError], None]) -> Iterator[Frame]:
        """The frames of all segments; what breaks the contract is handed to `on_error` instead."""
        self.faults.clear()
        before = 0
        for part in self._parts:
            with ExitStack() as stack:
                recording = self._opened(part, stack)
                if recording is not None:
                    self._demand_one_machine(part, recording)
                    frames = recording.frames(on_error)
                    while (frame := self._next(part, frames)) is not None:
                        yield frame
                        self.bytes_read = before + recording.bytes_read
                    self.faults += [f"{part.where}: {fault}" for fault in recording.faults]
            before += part.size
            self.bytes_read = before

    def _opened(self, part: Part, stack: ExitStack) -> Recording | None:
        path = stack.enter_context(part.fetched())
        try:
            return stack.enter_context(Recording(path, self._prefix))
        except InputError as error:
            self.faults.append(str(error).replace(str(path), part.where))
            return None

    def _next(self, part: Part, frames: Iterator[Frame]) -> Frame | None:
        try:
            return next(frames, None)
        except InputError as error:  # not one whole frame
            self.faults.append(f"{part.where}: {error}")
            return None

    def _demand_one_machine(self, part: Part, recording: Recording) -> None:
        if recording.assets != self.assets:
            first, here = ", ".join(self.assets), ", ".join(recording.assets)
            raise InputError(f"{part.where}: is of {here}, but the segments before it are of {first}")
        if not self._any_rig and recording.rig_text != self._rig_text:
            raise InputError(
                f"{part.where}: its rig file differs from that of the segments before it: "
                "give the one that holds for all of them with --rig, or assess them in parts"
            )
