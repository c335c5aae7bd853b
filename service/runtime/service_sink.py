"""Where the service's outcomes go: into the store, then onto the board and the network."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from service.results.board import TAIL, Board, Snapshot
from service.results.store import ResultStore, StoredWindow
from service.runtime.pipeline import WindowOutcome
from service.runtime.signal_writer import SignalWriter
from service.runtime.state_publication import StatePublication
from service.runtime.status_events import status_events

log = logging.getLogger(__name__)


class ServiceSink:
    """A `ResultSink` over store, board and network."""

    def __init__(
        self,
        store: ResultStore,
        board: Board,
        publication: StatePublication,
        clock: Callable[[], int] = time.time_ns,
        signals: SignalWriter | None = None,
    ) -> None:
        self._signals = signals
        self._store, self._board, self._publication, self._clock = store, board, publication, clock
        self._received_ns = 0
        self._committed: StoredWindow | None = None

    def commit(self, outcome: WindowOutcome) -> bool:
        """Keeps a window with everything that a restart needs, in one transaction."""
        self._received_ns = self._clock()
        before = self._board.get(outcome.asset)
        status, data = (before or Snapshot(asset=outcome.asset)).health_after(
            report=outcome.report,
            records=(*(before.records if before else ()), outcome.record)[-TAIL:],
            stale=None,
        )
        self._committed = self._store.commit(
            outcome.asset,
            outcome.window.start_time_ns,
            record=outcome.record,
            state=outcome.state.to_dict(),
            report=outcome.report,
            assembly=outcome.assembly,
            quality=outcome.quality,
            received_ns=self._received_ns,
            events=(*outcome.events, *status_events(before, status, data)),
        )
        if self._committed is None:
            log.error("%s: window %s had been committed before", outcome.asset, outcome.record["start_time"])
        return self._committed is not None

    def publish(self, outcome: WindowOutcome) -> None:
        """Shows the window that was committed last."""
        assert self._committed is not None
        self._board.add_window(
            outcome.asset,
            self._committed,
            report=outcome.report,
            quality=outcome.quality,
            received_ns=self._received_ns,
            last_event_id=self._store.last_event_id(outcome.asset),
        )
        self._publication.publish(outcome.asset)
        if self._signals is not None:
            self._signals.offer(outcome)
