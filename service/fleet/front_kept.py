"""What front ends keep and read besides results: alarms, changes of assets, baselines, signals and the audit log.

Each call goes to the partition of its asset or number; what its worker is to take up is announced in the transaction
that writes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from sqlalchemy import Select, Table, func, select, text

from service.alarms.engine import Change
from service.alarms.memory import Memory
from service.contract.alarms import by_urgency
from service.fleet.front_store import FleetStore
from service.fleet.layout import schema_of
from service.fleet.notices import JOB, announce
from service.fleet.places import Divided
from service.results.alarm_store import AlarmStore, readable
from service.results.audit_log import AuditLog
from service.results.baseline_store import BaselineStore
from service.results.data_folder import BASELINES, SIGNALS
from service.results.job_queue import ALARM
from service.results.jobs import Job, Jobs
from service.results.names import Names
from service.results.schema import ALARMS, ASSETS, WEBHOOK_OUTBOX
from service.results.signal_reading import KeptFile, KeptSignals, folder_in, found_in

AUDIT_LOCK = 7_219_434  # of whoever adds an entry; other numbers are in `layout`, `claims` and `migrate`
NAMING = {"renamed", "other_machine"}  # changes that give an asset a name


def _open(table: Table) -> Select:
    return select(table.c.asset, table.c.id, table.c.record).where(table.c.open == 1)


class FleetAlarms(AlarmStore):
    """Alarms of all partitions."""

    def __init__(self, store: FleetStore) -> None:
        super().__init__(store.database)
        self._fleet, self._places = store.fleet, store.places
        self._parts: Divided[AlarmStore] = Divided(store.fleet, store.places, lambda _, tables: AlarmStore(tables))

    def rules(self, asset: str) -> dict[str, Any] | None:
        return self._parts.of(asset).rules(asset)

    def keep_rules(self, asset: str, rules: Sequence[Mapping[str, Any]], signed: Mapping[str, Any]) -> None:
        self._parts.of(asset).keep_rules(asset, rules, signed)

    def memory(self, asset: str) -> Memory:
        return self._parts.of(asset).memory(asset)

    def keep_memory(self, asset: str, memory: Memory) -> None:
        self._parts.of(asset).keep_memory(asset, memory)

    def apply(self, asset: str, change: Change, at: str, window: int | None) -> dict[str, Any] | None:
        return self._parts.of(asset).apply(asset, change, at, window)

    def sign(self, asset: str, number: int, verb: str, signed: Mapping[str, Any]) -> dict[str, Any] | None:
        with self.transaction() as db:
            done = self._parts.of(asset).sign(asset, number, verb, signed)
            if done is not None:
                announce(db, self._places.partition_of(asset), ALARM, asset)
            return done

    def open(self, asset: str | None = None) -> tuple[Mapping[str, Any], ...]:
        if asset is not None:
            return self._parts.of(asset).open(asset)
        return tuple(by_urgency(readable(self._named(self._fleet.rows_of_all(ALARMS, _open)))))

    def listed(
        self, asset: str | None = None, *, closed: bool = False, after: int = 0, limit: int = 1000
    ) -> tuple[Mapping[str, Any], ...]:
        if asset is not None:
            return self._parts.of(asset).listed(asset, closed=closed, after=after, limit=limit)

        def query(table: Table) -> Select:
            found = select(table.c.asset, table.c.id, table.c.record).where(table.c.id > after)
            return found if closed else found.where(table.c.open == 1)

        rows = self._fleet.rows_of_all(ALARMS, query, first=limit)
        return tuple(
            {**alarm, "history": self.history(alarm["id"])} for alarm in by_urgency(readable(self._named(rows)))
        )

    def _named(self, rows: Iterable[Any]) -> list[tuple[Any, ...]]:
        """Rows that begin with an asset, with its name in place of that."""
        rows = list(rows)
        own = {row[0] for row in rows}
        labels = self._fleet.rows_of_all(ASSETS, lambda t: select(t.c.asset, t.c.label).where(t.c.asset.in_(own)))
        names = {asset: label for asset, label in labels}
        return [(names[asset], *rest) for asset, *rest in rows]

    def alarm(self, asset: str, number: int) -> Mapping[str, Any] | None:
        return self._parts.of(asset).alarm(asset, number)

    def history(self, number: int) -> list[Any]:
        return self._parts.of_number(number).history(number)

    def enqueue(self, url: str, message: Mapping[str, Any], now_ns: int) -> None:
        """Keeps a message for the worker of the asset's partition, which sends it."""
        self._parts.of(message["asset"]).enqueue(url, message, now_ns)

    def waiting(self) -> int:
        counts = self._fleet.rows_of_all(WEBHOOK_OUTBOX, lambda table: select(func.count()).select_from(table))
        return sum(count for (count,) in counts)


class FleetJobs(Jobs):
    """People's jobs of all partitions."""

    def __init__(self, store: FleetStore) -> None:
        super().__init__(store.database)
        self._store = store
        self._parts: Divided[Jobs] = Divided(store.fleet, store.places, lambda _, tables: Jobs(tables))

    def add(self, asset: str, kind: str, given: Mapping[str, Any]) -> int:
        """Keeps a job; one that gives a name which an asset of another partition has or had is refused at once."""
        own = self._parts.of(asset)
        with self.transaction() as db:
            number = own.add(asset, kind, given)
            name = given.get("name") if kind in NAMING else None
            if name is not None and self._store.places.elsewhere(name, asset):
                reason = f"there is an asset {name!r} already, or one that was called so: give another name"
                own.refuse(number, reason)
            announce(db, self._store.places.partition_of(asset), JOB, asset)
            return number

    def job(self, number: int) -> Job:
        return self._parts.of_number(number).job(number)

    def pending(self) -> tuple[Job, ...]:
        return tuple(job for part in self._parts.all() for job in part.pending())

    def of(self, asset: str, kind: str, after: int = 0, limit: int | None = None) -> tuple[Job, ...]:
        return self._parts.of(asset).of(asset, kind, after, limit)

    def changes(self, asset: str) -> tuple[Job, ...]:
        return self._parts.of(asset).changes(asset)

    def decision_counts(self) -> dict[str, dict[str, int]]:
        return dict(chain(*(part.decision_counts().items() for part in self._parts.all())))


class FleetNames(Names):
    """The names of all partitions' assets."""

    def __init__(self, store: FleetStore) -> None:
        super().__init__(store.database)
        self._parts: Divided[Names] = Divided(store.fleet, store.places, lambda _, tables: Names(tables))

    def label(self, asset: str) -> str:
        return self._parts.of(asset).label(asset)

    def labelled(self, name: str) -> str | None:
        return self._parts.of(name).labelled(name)

    def asset_of(self, stream: str) -> str:
        return self._parts.of(stream).asset_of(stream)

    def is_free(self, name: str) -> bool:
        return self._parts.of(name).is_free(name)


class FleetAudit(AuditLog):
    """The audit log of a fleet, in the schema that all partitions share."""

    def enter(self, *given: Any, **named: Any) -> int:
        """Adds an entry; the numbers of entries rise in the order in which they are committed."""
        with self.transaction() as db:
            db.execute(text("SELECT pg_advisory_xact_lock(:number)"), {"number": AUDIT_LOCK})
            return super().enter(*given, **named)


def baselines_of(store: FleetStore, data: Path) -> Divided[BaselineStore]:
    """The healthy baselines of each partition, in the folders of the workers, which alone clear them."""
    return Divided(
        store.fleet,
        store.places,
        lambda number, tables: BaselineStore(tables, data / schema_of(number) / BASELINES, clears=False),
    )


class FleetSignals(KeptSignals):
    """Raw windows that the workers keep, read from their folders each time, as far as this front end sees them."""

    def __init__(self, store: FleetStore, data: Path) -> None:
        self._places, self._data = store.places, data

    def files(self, asset: str) -> Mapping[int, KeptFile]:
        return found_in(folder_in(self._data / schema_of(self._places.partition_of(asset)) / SIGNALS, asset))
