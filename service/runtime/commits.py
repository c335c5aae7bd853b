"""One transaction for all that a job has led to; then it is shown in the table of assets and on the network.

A job may be committed a second time where an earlier attempt was committed without an answer: nothing is kept twice,
and what is shown is what it has led to.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.results.asset_table import AssetTable
from service.results.jobs import Job, Jobs
from service.results.kept_signals import KeptSignals
from service.results.snapshot import Snapshot
from service.results.sql_store import SqlStore
from service.results.status_events import status_events
from service.results.store import StoredWindow
from service.results.window_jobs import WaitingWindow, WindowJobs, delete_file
from service.runtime.outcomes import Outcome
from service.runtime.state_publication import StatePublication
from service.runtime.twin_port import Events
from service.steady_clock import later_time_ns

log = logging.getLogger(__name__)

KEPT = ("question", "rig", "retired", "epoch")  # parts of a snapshot that are columns of the asset's row
HEALTH = {"report", "question", "stale"}  # parts of a snapshot that its status is made of


class Commits:
    """A `ResultSink` over store, table of assets and network."""

    def __init__(
        self,
        store: SqlStore,
        table: AssetTable,
        publication: StatePublication,
        windows: WindowJobs,
        clock: Callable[[], int] = later_time_ns,
        signals: KeptSignals | None = None,
        alarms: AlarmKeeper | None = None,
    ) -> None:
        self._store, self._windows, self._jobs = store, windows, Jobs(store.database)
        self._table, self._publication, self._clock = table, publication, clock
        self._signals, self._alarms = signals, alarms
        self._committed: tuple[Snapshot, int] | None = None  # how the asset is shown, and the version of its row

    def commit(self, outcome: Outcome, job: Job | None = None) -> bool:
        """Keeps an outcome, with the alarms that it raises and how the asset is shown then, in one transaction."""
        before, unnamed = self._table.latest(outcome.asset), list[Path]()
        with self._windows.transaction():
            waited = None if outcome.waited is None else self._windows.drop_waiting(outcome.waited)
            named = waited if outcome.signals and self._signals is not None and self._signals.limit else None
            shown = self._kept(outcome, job, before, named)
            if shown is not None:
                shown = replace(shown, last_event_id=self._store.last_event_id(outcome.asset)).with_whole()
                version = self._table.write(shown)
            if self._signals is not None and named is not None:
                unnamed += self._signals.thin(outcome.asset)
        if waited is not None and (named is None or shown is None):
            unnamed.append(self._windows.path_of(waited))
        for file in unnamed:
            delete_file(file)
        if shown is None:
            start = outcome.record["start_time"]
            told = {"asset": outcome.asset, "window": start}
            log.error("%s: window %s had been committed before", outcome.asset, start, extra=told)
            return False
        self._committed = shown, version
        return True

    def publish(self, outcome: Outcome) -> None:
        """Shows the outcome that was committed last."""
        assert self._committed is not None
        self._table.written(*self._committed)
        self._publication.publish(outcome.asset)

    # -- within --------------------------------------------------------------------------------------

    def _kept(
        self, outcome: Outcome, job: Job | None, before: Snapshot | None, named: WaitingWindow | None
    ) -> Snapshot | None:
        """Writes an outcome; how the asset is shown then. None where its window is another attempt's.

        named  the window that waited, whose file its row names from now on
        """
        asset, changed = outcome.asset, dict(outcome.changed)
        parts = {n: v for n in ("making", "report") if (v := getattr(outcome, n)) is not None}
        changed |= {"counts" if n == "making" else n: part for n, part in parts.items()}
        if outcome.state is not None:
            parts["state"] = outcome.state.to_dict()
        if outcome.window is not None or outcome.held:
            changed["received_ns"] = self._clock()
        columns = {name: changed[name] for name in KEPT if name in changed}
        window, first = None, job is None or self._jobs.end(job.id, outcome.led_to)
        if outcome.window is not None:
            window = self._store.commit(
                asset,
                outcome.window.start_time_ns,
                record=outcome.record,
                received_ns=changed["received_ns"],
                events=outcome.events,
                before=outcome.before,
                segment=None if named is None else named.file,
                segment_bytes=None if named is None else named.bytes,
                **{"report": None, **parts},
            )
            first = window is not None
            window = window or self._found(outcome)
            if window is None:
                return None
            if first and columns:
                self._store.keep(asset, **columns)
        elif first:
            received = {"received_ns": changed["received_ns"]} if outcome.held else {}
            self._store.keep(asset, **parts, **columns, **received)
        shown = before or Snapshot(asset=asset, label=asset)
        shown = replace(shown if window is None else shown.with_window(window), **changed)
        return self._judged(outcome, before, shown, first)

    def _judged(self, outcome: Outcome, before: Snapshot | None, shown: Snapshot, first: bool) -> Snapshot:
        """Judges the alarms, and writes what has happened; the snapshot with the alarms that are open then."""
        asset, alarms = outcome.asset, self._alarms
        health = replace(shown, unstored=None)  # it can be stored now
        events = () if outcome.window is not None else outcome.events
        if first:
            outcome.also()
            if alarms is not None:
                events = (*events, *_alarm_events(outcome, alarms, health.health()[1]))
        if alarms is not None:
            opened = alarms.open(asset)
            health, shown = replace(health, alarms=opened), replace(shown, alarms=opened)
        if first:
            if outcome.window is not None or HEALTH & outcome.changed.keys() or outcome.report is not None:
                events = (*events, *status_events(before, *health.health()))
            self._store.note(asset, events, None if outcome.window is None else outcome.window.start_time_ns)
        return shown

    def _found(self, outcome: Outcome) -> StoredWindow | None:
        """The window where an earlier attempt, of which that was not known, has committed it; else None."""
        assert outcome.window is not None
        found = self._store.windows(outcome.asset, outcome.index - 1, 1)
        ours = found and (found[0].start_ns, found[0].record["index"]) == (outcome.window.start_time_ns, outcome.index)
        return found[0] if ours else None


def _alarm_events(outcome: Outcome, alarms: AlarmKeeper, data: Mapping[str, Any]) -> Events:
    """Judges the alarms of an asset; `data` is the quality of its data as it is shown."""
    window, record = outcome.window, outcome.record
    if window is None:
        return outcome.judge(alarms, data)
    return alarms.window(outcome.asset, window.start_time_ns, record, outcome.report, data)
