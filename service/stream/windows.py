"""Frames in, whole windows out, as their channels show them: for whoever reads a recording and needs no service.

windows = Windows(settings)
for frame in frames:
    made = windows.add(frame)
made = windows.flush()
"""

from __future__ import annotations

from collections.abc import Iterable

from service.stream.assembly import DEFAULT, Assembler, AssemblySettings, Closed
from service.stream.edge_counts import EncoderCounts
from service.stream.frames import Frame
from service.stream.window import laid_out
from twin.windows import Window


class Windows(Assembler):
    """An assembler that makes the windows of one asset itself; what that finds is counted with the frames."""

    def __init__(self, settings: AssemblySettings = DEFAULT):
        super().__init__(settings)
        self.encoders = EncoderCounts()  # by the end of the newest window

    def add(self, frame: Frame, now_ns: int | None = None) -> list[Window]:
        """Takes one frame in; answers the windows that it completes, in time order."""
        return self._made(self.assemble(frame, now_ns))

    def flush(self) -> list[Window]:
        """Closes everything that waits; what is missing is declared lost."""
        return self._made(self.finish())

    def _made(self, closed: Iterable[Closed]) -> list[Window]:
        windows = []
        for segment, _ in closed:
            made = laid_out(segment, self.settings.rig, self.encoders)
            self.encoders = made.counts
            for (label, kind), number in made.found.items():
                self.count(label, kind, number)
            windows.append(made.window)
        return windows
