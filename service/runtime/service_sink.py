"""Where the service's outcomes go: into the store, then onto the board and the network."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.results.asset_rows import AssetRows
from service.results.board import TAIL, Board, Snapshot
from service.results.sql_store import SqlStore
from service.results.status_events import status_events
from service.results.store import StoredWindow
from service.results.window_jobs import WindowJobs
from service.runtime.outcomes import WindowOutcome
from service.runtime.signal_writer import SignalWriter
from service.runtime.state_publication import StatePublication
from service.runtime.twin_port import Events
from service.steady_clock import later_time_ns

log = logging.getLogger(__name__)


class ServiceSink:
    """A `ResultSink` over store, board and network."""

    def __init__(
        self,
        store: SqlStore,
        board: Board,
        publication: StatePublication,
        windows: WindowJobs,
        clock: Callable[[], int] = later_time_ns,
        signals: SignalWriter | None = None,
        alarms: AlarmKeeper | None = None,
        rows: AssetRows | None = None,
    ) -> None:
        self._signals, self._alarms, self._rows = signals, alarms, rows
        self._windows = windows
        self._open: tuple[Mapping[str, Any], ...] = ()  # alarms after the window that was committed last
        self._store, self._board, self._publication, self._clock = store, board, publication, clock
        self._received_ns = self._last_event_id = 0
        self._committed: StoredWindow | None = None

    def commit(self, outcome: WindowOutcome) -> bool:
        """Keeps a window with everything that a restart needs and the alarms that it raises, in one transaction."""
        self._received_ns = self._clock()
        self._committed = None
        with self._windows.transaction():
            self._committed = self._store.commit(
                outcome.asset,
                outcome.window.start_time_ns,
                record=outcome.record,
                state=outcome.state.to_dict(),
                report=outcome.report,
                assembly=outcome.assembly,
                quality=outcome.quality,
                received_ns=self._received_ns,
                events=outcome.events,
            )
            if self._committed is not None:
                self._keep_question(outcome)
                self._note_health(outcome)
            else:
                self._committed = self._found(outcome)
            if outcome.waited is not None:
                self._windows.drop_waiting(outcome.waited)
            self._last_event_id = self._store.last_event_id(outcome.asset)
            if self._committed is not None and self._rows is not None:
                self._rows.put(self._board.with_window(outcome.asset, self._committed, **self._shown(outcome)))
        if self._committed is None:
            self._delete(outcome)
            start = outcome.record["start_time"]
            told = {"asset": outcome.asset, "window": start}
            log.error("%s: window %s had been committed before", outcome.asset, start, extra=told)
        return self._committed is not None

    def _found(self, outcome: WindowOutcome) -> StoredWindow | None:
        """The window where an earlier attempt, of which that was not known, has committed it; else None."""
        found = self._store.windows(outcome.asset, outcome.index - 1, 1)
        ours = found and found[0].start_ns == outcome.window.start_time_ns and found[0].record["index"] == outcome.index
        if ours and self._alarms is not None:
            self._open = self._alarms.open(outcome.asset)
        return found[0] if ours else None

    def _delete(self, outcome: WindowOutcome) -> None:
        """Deletes the file in which a window waited; one that cannot be deleted now is by the next start."""
        if outcome.waited is not None:
            with suppress(OSError):
                self._windows.delete_file(outcome.waited)

    def _keep_question(self, outcome: WindowOutcome) -> None:
        snapshot = self._board.get(outcome.asset)
        if snapshot is not None and snapshot.question != outcome.question:
            self._store.keep(outcome.asset, question=outcome.question)

    def _note_health(self, outcome: WindowOutcome) -> None:
        """The alarms that the window raises or ends, and the event where the status changes; in its transaction."""
        asset = outcome.asset
        before = self._board.get(asset)
        before = before and replace(before, unstored=None)  # it can be stored now
        records = (*(before.records if before else ()), outcome.record)[-TAIL:]
        shown = replace(
            before or Snapshot(asset=asset),
            unstored=None,
            report=outcome.report,
            records=records,
            stale=None,
            question=outcome.question,
        )
        events: Events = ()
        if self._alarms is not None:
            _, data = shown.health()
            events = self._alarms.window(asset, outcome.window.start_time_ns, outcome.record, outcome.report, data)
            self._open = self._alarms.open(asset)
            shown = replace(shown, alarms=self._open)
        events = (*events, *status_events(before, *shown.health()))
        self._store.note(asset, events, outcome.window.start_time_ns)

    def _shown(self, outcome: WindowOutcome) -> dict[str, Any]:
        """What is shown otherwise with the window that was committed last."""
        return {
            "report": outcome.report, "quality": outcome.quality, "alarms": self._open, "question": outcome.question,
            "received_ns": self._received_ns, "last_event_id": self._last_event_id,
        }  # fmt: skip

    def publish(self, outcome: WindowOutcome) -> None:
        """Shows the window that was committed last."""
        assert self._committed is not None
        snapshot = self._board.add_window(outcome.asset, self._committed, **self._shown(outcome))
        if self._rows is not None:
            self._rows.kept(snapshot)
        self._publication.publish(outcome.asset)
        if self._signals is not None:
            self._signals.offer(outcome, None if outcome.waited is None else self._windows.file_of(outcome.waited))
        else:
            self._delete(outcome)
