"""Frames of any source → whole windows → the twin → the results, in one thread.

    pipeline = Pipeline(rig_of, twin, sink)
    for frame in source:
        pipeline.feed(frame)
    pipeline.flush()

The parts of the service without a database, for a program that waits for each window: `gear-twin assess`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from service.runtime.computing import Ask, Call, WindowToUse, carry_out
from service.runtime.outcomes import ClosedWindow, ResultSink
from service.runtime.place import Place
from service.runtime.reception import Reception
from service.runtime.twin_port import Twin
from service.runtime.window_outcomes import outcome_of
from service.stream.assembly import DEFAULT, AssemblySettings
from service.stream.quality import data_quality
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
        self._twin, self._sink = twin, sink
        self._places: dict[str, Place] = {}
        self.assemblies: dict[str, Mapping[str, Any]] = {}  # by asset: where its stream goes on after the newest window

    def place(self, asset: str) -> Place:
        """Where the windows of an asset have come to."""
        if asset not in self._places:
            self._places[asset] = Place(
                asset=asset, rig=self.rig(asset), twin=self._twin, state=self._twin.new_state()
            )  # fmt: skip
        return self._places[asset]

    def quality(self, asset: str) -> dict[str, Any]:
        """The section `data_quality` as of now."""
        return data_quality(self.place(asset).making, super().quality(asset))

    def _process(self, closed: ClosedWindow) -> None:
        place = self.place(closed.asset)
        window = WindowToUse(start_ns=closed.segment.start_ns, segment=closed.segment, before=place.encoders)
        made = carry_out(
            Call(asset=place.asset, twin=place.twin, rig=place.rig, state=place.state, ask=Ask("window", window))
        )
        if made.fell is not None:  # nobody is there who could be asked
            made = replace(made, refused=made.fell.reason)
        outcome = outcome_of(place, made)
        committed = self._sink.commit(outcome)
        self.assemblies[closed.asset] = closed.assembly
        if committed:
            place.accept(outcome)
            self._sink.publish(outcome)
