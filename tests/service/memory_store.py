"""Results kept in memory: another store is this one file."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
import threading
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from service.contract.overview import figures
from service.json_text import plain
from service.results.database import Database
from service.results.store import Event, StoredAsset, StoredDecision, StoredInspection, StoredWindow, faults_of


class MemoryStore:
    """A `ResultStore`; `open` may be called again, as a restart of the service does."""

    def __init__(self):
        self._lock = threading.RLock()
        folder = tempfile.mkdtemp()
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        self.database = Database(Path(folder) / "alarms.sqlite")  # of what has a store of its own: alarms
        self._epochs = {}
        self._assets, self._windows, self._events, self._inspections, self._decisions = {}, {}, [], [], []

    @contextmanager
    def open(self):
        yield self

    def commit(self, asset, start_ns, *, record, state, report, assembly, quality, received_ns, events=()):
        record, told = plain(record), report is not None and record.get("quality") != "refused"
        window = StoredWindow(start_ns=start_ns, record=record, figures=plain(figures(report)) if told else {})
        with self._lock:
            windows = self._windows.setdefault(asset, [])
            if any(w.start_ns == start_ns for w in windows):
                return None
            windows.append(window)
            self._epochs[asset, start_ns] = self.asset(asset).epoch
            before = self.asset(asset)
            totals = dict(before.fault_totals)
            for key, found in faults_of(record).items():
                count, concerned = totals.get(key, (0, 0))
                totals[key] = (count + found, concerned + 1)
            self._assets[asset] = replace(
                before,
                state=json.loads(json.dumps(state)),
                report=before.report if report is None else plain(report),
                assembly=assembly,
                quality=quality,
                windows=before.windows + 1,
                updates=before.updates + bool(record.get("updated")),
                fault_totals=totals,
                received_ns=received_ns,
            )
            self.note(asset, events)
        return window

    def note(self, asset, events, window_ns=None):
        with self._lock:
            self._assets.setdefault(asset, StoredAsset(asset=asset, label=asset))
            for kind, data in events:
                self._events.append(Event(id=len(self._events) + 1, asset=asset, kind=kind, data=plain(data)))

    def keep_rig(self, asset, rig):
        with self._lock:
            self._assets[asset] = replace(self.asset(asset), rig=rig)

    def keep(self, asset, **parts):
        with self._lock:
            known = {k: v for k, v in parts.items() if v is not None or k in ("question", "retired")}
            if parts.get("epoch", 0) > self.asset(asset).epoch:
                known |= {"windows": 0, "updates": 0}
            self._assets[asset] = replace(self.asset(asset), **json.loads(json.dumps(known)))

    def add_inspection(self, asset, inspection, answer):
        with self._lock:
            self._assets.setdefault(asset, StoredAsset(asset=asset, label=asset))
            number = len(self._inspections) + 1
            kept = StoredInspection(
                id=number, asset=asset, received_ns=1, inspection=inspection, answer=answer, done=False
            )
            self._inspections.append(kept)
            return number

    def use_inspection(self, inspection, *, answer, state, report, events):
        with self._lock:
            if self.inspection(inspection.id).done:
                return False
            self._inspections[inspection.id - 1] = replace(inspection, answer=answer, done=True)
            self._assets[inspection.asset] = replace(self.asset(inspection.asset), state=state, report=report)
            self.note(inspection.asset, events)
            return True

    def refuse_inspection(self, inspection, answer):
        with self._lock:
            self._inspections[inspection.id - 1] = replace(inspection, answer=answer, done=True)

    def add_decision(self, asset, name, verb, by=None, note=None):
        with self._lock:
            number = len(self._decisions) + 1
            self._decisions.append(
                StoredDecision(
                    id=number,
                    asset=asset,
                    received_ns=1,
                    name=name,
                    verb=verb,
                    done=False,
                    refused=None,
                    by=by,
                    note=note,
                )
            )
            return number

    def carry_out(self, decision, *, state, report, events):
        with self._lock:
            if self.decision(decision.id).done:
                return False
            self._decisions[decision.id - 1] = replace(decision, done=True)
            self._assets[decision.asset] = replace(self.asset(decision.asset), state=state, report=report)
            self.note(decision.asset, events)
            return True

    def refuse(self, decision, reason):
        with self._lock:
            self._decisions[decision.id - 1] = replace(decision, done=True, refused=reason)

    def assets(self):
        return tuple(sorted(self._assets))

    def asset(self, asset):
        return self._assets.get(asset, StoredAsset(asset=asset, label=asset))

    def all_assets(self):
        return tuple(self._assets[asset] for asset in self.assets())

    def next_indices(self):
        return {a: max((w.record["index"] + 1 for w in self._windows.get(a, [])), default=0) for a in self._assets}

    def epochs(self, asset):
        found = {}
        for w in self._windows.get(asset, []):
            found.setdefault(self._epochs[asset, w.start_ns], []).append(w.record)
        return tuple(
            {"epoch": n, "windows": len(r), "first": r[0]["index"], "last": r[-1]["index"], "since": r[0]["start_time"]}
            for n, r in sorted(found.items())
        )

    def _of(self, asset, epoch=None):
        epoch = self.asset(asset).epoch if epoch is None else epoch
        return [w for w in self._windows.get(asset, []) if self._epochs[asset, w.start_ns] == epoch]

    def windows(self, asset, after=-1, limit=1000, every=1, epoch=None):
        with self._lock:
            found = self._of(asset, epoch)
            chosen = [
                w for w in found if w.record["index"] > after and (w.record["index"] % every == 0 or w is found[-1])
            ]
            return tuple(chosen[:limit])

    def outline(self, asset, most, after=-1, epoch=None):
        found = [w for w in self._of(asset, epoch) if w.record["index"] > after]
        return tuple(found[:: max(1, -(-len(found) // most))])

    def latest_windows(self, asset, limit):
        return tuple(self._of(asset)[-limit:])

    def events(self, asset, after, limit=500):
        return tuple(e for e in self._events if e.asset == asset and e.id > after)[:limit]

    def last_event_id(self, asset):
        return max((e.id for e in self._events if e.asset == asset), default=0)

    def last_event_ids(self):
        return {asset: self.last_event_id(asset) for asset in self._assets}

    def inspections(self, asset, after=0, limit=1000):
        return tuple(i.to_dict() for i in self._inspections if i.asset == asset and i.id > after)[:limit]

    def inspection(self, number):
        return self._inspections[number - 1]

    def pending_inspections(self):
        return tuple(i for i in self._inspections if not i.done)

    def decision(self, number):
        return self._decisions[number - 1]

    def decisions(self, asset):
        return tuple(d for d in self._decisions if d.asset == asset)

    def decision_counts(self):
        counts = {}
        for decision in self._decisions:
            if decision.done and decision.refused is None:
                of = counts.setdefault(decision.asset, {})
                of[decision.verb] = of.get(decision.verb, 0) + 1
        return counts

    def pending_decisions(self):
        return tuple(d for d in self._decisions if not d.done)
