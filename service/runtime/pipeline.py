"""Frames of any source → whole windows → the twin → the results, in one thread.

    pipeline = Pipeline(rig_of, twin, sink)
    for frame in source:
        pipeline.feed(frame)
    pipeline.flush()

The parts of the service, reception and lanes, for a program that waits for each window: `gear-twin assess`.
"""

from __future__ import annotations

from collections.abc import Callable

from service.runtime.computing import Inline
from service.runtime.lane import Entry
from service.runtime.lanes import Lanes
from service.runtime.outcomes import ClosedWindow, ResultSink
from service.runtime.reception import Reception
from service.runtime.twin_port import Twin
from service.stream.assembly import DEFAULT, AssemblySettings
from twin.rig import Rig


class Pipeline(Reception):
    """A reception whose windows are processed at once."""

    def __init__(
        self,
        rig_of: Callable[[str], Rig],
        twin: Twin,
        sink: ResultSink,
        *,
        assembly: AssemblySettings = DEFAULT,
    ):
        super().__init__(rig_of, self._process, assembly=assembly)
        self.lanes = Lanes(self, sink, Inline(), twin_of=lambda asset, rig: twin, new_state=twin.new_state)

    def _process(self, closed: ClosedWindow) -> None:
        entry = Entry(start_ns=closed.segment.start_ns, segment=closed.segment)
        self.lanes.put(closed.asset, entry, closed.assembly)
