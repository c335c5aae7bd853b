"""The pipeline as the service runs it: over store, board and Zenoh, from where the store ended."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from service.json_text import plain
from service.results.board import Board
from service.results.decision_queue import DecisionQueue
from service.results.store import Store
from service.runtime.live import LiveState
from service.runtime.pipeline import Checkpoint, Pipeline, WindowOutcome
from service.stream.frames import Frame
from service.stream.wire.topics import Channel
from twin.errors import TwinError
from twin.rig import Rig

log = logging.getLogger(__name__)

LEARN_WAIT = 0.5  # how long a new asset's channels are awaited before its first window [s]
LEARN_BYTES = 64 * 2**20  # frames of a new asset held meanwhile, at most [bytes]
QUALITY_EVERY = 1.0  # how often counters are shown while frames come [s]


class Ended(Exception):
    """The service ends: the windows that are whole but not taken in yet are left to the next start."""


@dataclass(slots=True)
class _Held:
    """A new asset's frames while its channels are learned."""

    since: float
    frames: list[Frame] = field(default_factory=list)
    bytes: int = 0


class ServedPipeline(Pipeline):
    """The pipeline over store, board and Zenoh, with counters shown between windows."""

    def __init__(
        self,
        store: Store,
        board: Board,
        live: LiveState,
        ending: threading.Event,
        desk: DecisionQueue,
        rig_lookup: Callable[[str], Rig],
        options: Any,
        **given: Any,
    ) -> None:
        super().__init__(rig_lookup, options, self._keep, self._show, **given)
        self._store, self._board, self._live, self._ending, self._desk = store, board, live, ending, desk
        self._shown: dict[str, float] = {}
        self._held: dict[str, _Held] = {}

    def restore_all(self, state_of: Callable[[Mapping[str, Any]], Any]) -> None:
        """Goes on where the store's assets ended."""
        for asset in self._store.assets():
            stored = self._store.asset(asset)
            if stored.state is None or stored.assembly is None or stored.quality is None:
                continue
            last = self._store.windows(asset)[-1].record
            self.restore(
                asset,
                Checkpoint(
                    index=last["index"],
                    state=state_of(stored.state),
                    report=stored.report,
                    assembly=stored.assembly,
                    quality=stored.quality,
                ),
            )

    def feed(self, frame: Frame) -> None:
        asset = frame.channel.asset
        if asset not in self._lines:
            self._line(asset)  # asks for the rig file now: who offers it may be gone later
            self._held[asset] = _Held(time.monotonic())
        if asset not in self._held:
            super().feed(frame)
        elif not self._hold(frame):
            return
        if time.monotonic() - self._shown.get(asset, 0.0) > QUALITY_EVERY:
            self._show_quality(asset)

    def reject(self, channel: Channel, error: Any) -> None:
        super().reject(channel, error)
        self._show_quality(channel.asset)

    def flush(self, asset: str | None = None) -> None:
        for name in list(self._held) if asset is None else [asset]:
            if name in self._held:
                self._release(name)
        super().flush(asset)

    def waiting(self, asset: str) -> bool:
        if asset in self._held:
            return True
        # Asked when a stream is silent: the last frames' counters are due.
        if asset in self._shown and self._shown[asset] > 0 and not super().waiting(asset):
            self._show_quality(asset)
            self._shown[asset] = 0.0
        return super().waiting(asset)

    def attend(self) -> None:
        """Carries out the decisions that wait."""
        if not self._desk.asked.is_set():
            return
        for waiting in self._desk.pending():
            if self._ending.is_set():
                raise Ended
            try:
                decided = self.decide(waiting.asset, waiting.name, waiting.verb)
            except TwinError as reason:
                self._store.refuse(waiting, str(reason))
                continue
            if self._store.carry_out(
                waiting, state=decided.state.to_dict(), report=decided.report, events=decided.events
            ):
                self.accept(decided)
                last = self._store.last_event_id(waiting.asset)
                self._board.update(waiting.asset, report=decided.report, last_event_id=last)
                self._live.publish(waiting.asset)
        self._desk.done()

    def _hold(self, frame: Frame) -> bool:
        """Holds a new asset's frame, since keys start at different times; whether all held are let go."""
        asset = frame.channel.asset
        held = self._held[asset]
        held.frames.append(frame)
        held.bytes += frame.nbytes
        if time.monotonic() - held.since < LEARN_WAIT and held.bytes < LEARN_BYTES:
            return False
        self._release(asset)
        return True

    def _release(self, asset: str) -> None:
        """Takes in the frames held for a new asset, whose channels are known now."""
        held = self._held.pop(asset)
        self._line(asset).assembler.expect({frame.channel.label for frame in held.frames})
        for frame in held.frames:
            super().feed(frame)

    def _take(self, *given: Any) -> None:
        if self._ending.is_set():
            raise Ended
        super()._take(*given)

    def _keep(self, outcome: WindowOutcome) -> None:
        self._committed = self._store.commit(
            outcome.asset,
            outcome.window.start_time_ns,
            record=outcome.record,
            state=outcome.state.to_dict(),
            report=outcome.report,
            assembly=outcome.assembly,
            quality=outcome.quality,
            events=outcome.events,
        )

    def _show(self, outcome: WindowOutcome) -> None:
        if self._committed is None:
            log.error("%s: window %s was committed before", outcome.asset, outcome.record["start_time"])
            return
        self._board.add_window(
            outcome.asset,
            self._committed,
            report=None if outcome.report is None else plain(outcome.report),
            quality=outcome.quality,
            last_event_id=self._store.last_event_id(outcome.asset),
        )
        self._live.publish(outcome.asset)

    def _show_quality(self, asset: str) -> None:
        self._shown[asset] = time.monotonic()
        self._board.update(asset, quality=self.quality(asset))
