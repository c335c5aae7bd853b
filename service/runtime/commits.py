"""One transaction for all that a job has led to, and how the asset is shown then.

A job is committed by whoever has carried it out. It holds the asset's mark, which says what it has gone on from: where
something else has been committed meanwhile, it is not committed; where an attempt before had no answer, it is seen
whether that was committed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from service.alarms.keeper import AlarmKeeper
from service.errors import StoreError
from service.results.asset_table import AssetTable
from service.results.jobs import Job, Jobs
from service.results.kept_signals import KeptSignals
from service.results.retention import Retention, delete_old
from service.results.snapshot import Snapshot
from service.results.sql_store import SqlStore, Superseded
from service.results.status_events import status_events
from service.results.store import StoredWindow
from service.results.window_jobs import WaitingWindow, WindowJobs, delete_file
from service.runtime.outcomes import Outcome
from service.runtime.twin_port import Events
from service.steady_clock import later_time_ns

log = logging.getLogger(__name__)

CLEAR_EVERY = 64  # windows of an asset, after which what is older than it is kept is deleted
MOST_BATCHES = 50  # of rows that are deleted between two windows
KEPT = ("question", "rig", "retired", "epoch")  # parts of a snapshot that are columns of the asset's row
HEALTH = {"report", "question", "stale"}  # parts of a snapshot that its status is made of


class Marks(NamedTuple):
    """By what a job's transaction is known: the asset's mark before it, and after it."""

    before: int
    after: int


class Commits:
    """Where outcomes are kept."""

    def __init__(
        self,
        store: SqlStore,
        table: AssetTable,
        windows: WindowJobs,
        signals: KeptSignals | None = None,
        alarms: AlarmKeeper | None = None,
        clock: Callable[[], int] = later_time_ns,
        worker: str | None = None,
        retention: Retention | None = None,
    ) -> None:
        """
        worker     who carries jobs out here
        retention  how long what is kept; None for ever
        """
        self._retention = retention
        self._cleared: set[str] = set()  # assets that had nothing older than that when it was looked at last
        self._store, self._windows, self._jobs = store, windows, Jobs(store.database)
        self._table, self._signals, self._alarms, self._clock = table, signals, alarms, clock
        self._worker = worker

    def commit(self, outcome: Outcome, job: Job | None, marks: Marks) -> bool:
        """Keeps an outcome, with the alarms that it raises and how the asset is shown then, in one transaction.

        job  that people have asked for, or a notice; it ends with this. None for a window

        False for a window that was there already: nothing but its job has gone.

        Raises Superseded where the job cannot be committed any more, and InputError where it is refused.
        """
        asset, unnamed = outcome.asset, list[Path]()
        with self._windows.transaction() as db:
            self._store.database.ensure(db, asset)
            if not self._store.hold(asset, *marks, self._worker):
                self._table.changed(asset)  # by an attempt of which nobody knew
                return True
            before = self._table.get(asset)
            shown, is_new = self._kept(outcome, job, before, unnamed)
            shown = replace(shown, last_event_id=self._store.last_event_id(asset)).with_whole()
            version = self._table.write(shown)
        self._table.written(shown, version)
        for file in unnamed:
            delete_file(file)
        if outcome.window is not None and (asset not in self._cleared or outcome.index % CLEAR_EVERY == 0):
            self._clear(asset)
        return is_new

    def _clear(self, asset: str) -> None:
        """Deletes what an asset has that is older than it is kept: only a window that is committed makes others old."""
        if self._retention is None:
            return
        assert self._windows.folder is not None
        folder = self._windows.folder
        self._cleared.discard(asset)
        try:
            for _ in range(MOST_BATCHES):
                if not delete_old(
                    self._store.database, asset, self._retention, unnamed=lambda file: delete_file(folder / file)
                ):
                    self._cleared.add(asset)
                    return
        except StoreError as error:  # after the next window it is tried again
            log.warning("%s: nothing old could be deleted: %s", asset, error, extra={"asset": asset})

    # -- within --------------------------------------------------------------------------------------

    def _kept(
        self, outcome: Outcome, job: Job | None, before: Snapshot | None, unnamed: list[Path]
    ) -> tuple[Snapshot, bool]:
        """Writes an outcome; how the asset is shown then, and whether it was not there before.

        unnamed  takes the files that no row names any more
        """
        asset, changed = outcome.asset, dict(outcome.changed)
        parts = {n: v for n in ("making", "report") if (v := getattr(outcome, n)) is not None}
        changed |= {"counts" if n == "making" else n: part for n, part in parts.items()}
        if outcome.state is not None:
            parts["state"] = outcome.state.to_dict()
        if outcome.window is not None or outcome.held:
            changed["received_ns"] = self._clock()
            stale = None if before is None else before.stale
            if stale is not None and (outcome.waited is None or stale.notice < outcome.waited.id):
                changed["stale"] = None
        if job is not None:
            _demand(self._jobs.end(job, outcome.led_to, self._stages(outcome)), asset)
        waited = None
        if outcome.waited is not None and outcome.held:
            _demand(self._windows.hold(outcome.waited), asset)
        elif outcome.waited is not None:
            waited = self._windows.drop_waiting(outcome.waited)
            _demand(waited is not None, asset)
        if changed.get("question") is not None:
            changed["question"] = {**changed["question"], "waiting": self._windows.held(asset)}
        elif "question" in changed:
            self._windows.release(asset, outcome.refuse)
        columns = {name: changed[name] for name in KEPT if name in changed}
        shown = Snapshot(asset=asset, label=asset) if before is None else replace(before, damaged=None)
        if outcome.window is None:
            received = {"received_ns": changed["received_ns"]} if outcome.held else {}
            self._store.keep(asset, **parts, **columns, **received)
            return self._judged(outcome, before, replace(shown, **changed)), True
        window = self._window(outcome, changed["received_ns"], parts, waited, unnamed)
        if window is None:
            return shown, False
        if columns:
            self._store.keep(asset, **columns)
        return self._judged(outcome, before, replace(shown.with_window(window), **changed)), True

    def _window(
        self,
        outcome: Outcome,
        received_ns: int,
        parts: Mapping[str, Any],
        waited: WaitingWindow | None,
        unnamed: list[Path],
    ) -> StoredWindow | None:
        """Writes a window, and which file has its signals; None where it had been committed before."""
        asset, signals = outcome.asset, self._signals
        named = waited if outcome.signals and signals is not None and signals.limit else None
        assert outcome.window is not None
        window = self._store.commit(
            asset,
            outcome.window.start_time_ns,
            record=outcome.record,
            received_ns=received_ns,
            events=outcome.events,
            before=outcome.before,
            stages=self._stages(outcome),
            segment=None if named is None else named.file,
            segment_bytes=None if named is None else named.bytes,
            **{"report": None, **parts},
        )
        if waited is not None and (named is None or window is None):
            unnamed += filter(None, [self._windows.path_of(waited)])
        if signals is not None and named is not None:
            unnamed += signals.thin(asset)
        if window is None:
            start = outcome.record["start_time"]
            log.error("%s: window %s had been committed before", asset, start, extra={"asset": asset, "window": start})
        return window

    def _stages(self, outcome: Outcome) -> Mapping[str, Any]:
        return {**outcome.stages, "stored_ns": self._clock()}

    def _judged(self, outcome: Outcome, before: Snapshot | None, shown: Snapshot) -> Snapshot:
        """Judges the alarms, and writes what has happened; the snapshot with the alarms that are open then."""
        asset, alarms = outcome.asset, self._alarms
        health = replace(shown, unstored=None)  # it can be stored now
        events = () if outcome.window is not None else outcome.events
        outcome.also()
        if alarms is not None:
            events = (*events, *_alarm_events(outcome, alarms, health.health()[1]))
            opened = alarms.open(asset)
            health, shown = replace(health, alarms=opened), replace(shown, alarms=opened)
        if outcome.window is not None or HEALTH & outcome.changed.keys() or outcome.report is not None:
            events = (*events, *status_events(before, *health.health()))
        self._store.note(asset, events, None if outcome.window is None else outcome.window.start_time_ns)
        return shown


def _demand(waits: bool, asset: str) -> None:
    """Superseded where the job that has been carried out does not wait any more: the database was put back."""
    if not waits:
        raise Superseded(f"a job of {asset} that has been carried out does not wait any more")


def _alarm_events(outcome: Outcome, alarms: AlarmKeeper, data: Mapping[str, Any]) -> Events:
    """Judges the alarms of an asset; `data` is the quality of its data as it is shown."""
    window, record = outcome.window, outcome.record
    if window is None:
        return outcome.judge(alarms, data)
    return alarms.window(outcome.asset, window.start_time_ns, record, outcome.report, data)
