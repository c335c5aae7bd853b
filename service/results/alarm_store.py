"""Alarms, their rules, what the engine remembers, and the messages that wait to be sent: in the results' database.

Every call is one transaction, and part of the caller's where that has begun one: a window and the alarms that it
raises are there together or not at all.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

from sqlalchemy import BindParameter, Connection, Table, Text, bindparam, cast, delete, func, select, update

from service.alarms.engine import Change
from service.alarms.memory import Memory
from service.contract.alarms import by_urgency, state_of
from service.json_text import plain
from service.printable import all_printable
from service.results.json_columns import dump, salvage
from service.results.schema import ALARM_HISTORY, ALARM_MEMORY, ALARM_RULES, ALARMS, ASSETS, WEBHOOK_OUTBOX
from service.results.store import Tables
from twin.serial import from_plain, to_plain

MOST_HISTORY = 200  # entries of one alarm that are answered

_OF: BindParameter[str] = bindparam("of")
_RULES = select(ALARM_RULES.c.rules, ALARM_RULES.c.changed).where(ALARM_RULES.c.asset == _OF)
_MEMORY = select(ALARM_MEMORY.c.memory).where(ALARM_MEMORY.c.asset == _OF)
_NAMED_ASSET = select(cast(_OF, Text).label("asset")).subquery()
_KNOWN = (
    select(ALARM_RULES.c.rules, ALARM_MEMORY.c.memory)
    .select_from(_NAMED_ASSET)
    .outerjoin(ALARM_RULES, ALARM_RULES.c.asset == _NAMED_ASSET.c.asset)
    .outerjoin(ALARM_MEMORY, ALARM_MEMORY.c.asset == _NAMED_ASSET.c.asset)
)
_LABEL = select(ASSETS.c.label).where(ASSETS.c.asset == _OF)
_ALARM = select(ASSETS.c.label, ALARMS.c.id, ALARMS.c.record).join(ASSETS, ASSETS.c.asset == ALARMS.c.asset)
_OPEN = _ALARM.where(ALARMS.c.open == 1)
_OPEN_OF = _OPEN.where(ALARMS.c.asset == _OF)
_NAMED = _OPEN_OF.where(ALARMS.c.name == bindparam("named"))
_HISTORY = (
    select(ALARM_HISTORY.c.entry)
    .where(ALARM_HISTORY.c.alarm == bindparam("number"))
    .order_by(ALARM_HISTORY.c.id.desc())
    .limit(MOST_HISTORY)
)
_OLDEST = select(func.min(WEBHOOK_OUTBOX.c.number)).group_by(WEBHOOK_OUTBOX.c.url)
_DUE = (
    select(*(WEBHOOK_OUTBOX.c[n] for n in ("number", "name", "url", "body", "created_ns", "attempts")))
    .where(WEBHOOK_OUTBOX.c.next_ns <= bindparam("now"))
    .order_by(WEBHOOK_OUTBOX.c.number)
    .limit(bindparam("most"))
)
_WAITING = select(func.count()).select_from(WEBHOOK_OUTBOX)


class AlarmStore:
    """Alarms of all assets over the results' database."""

    def __init__(self, database: Tables) -> None:
        self._database = database
        self._keep_memory = self._replacing(ALARM_MEMORY, "memory")
        self._keep_rules = self._replacing(ALARM_RULES, "rules", "changed")

    def _replacing(self, table: Table, *columns: str) -> Any:
        """Writes the one row that an asset has in a table."""
        insert = self._database.insert(table)
        return insert.on_conflict_do_update(
            index_elements=["asset"], set_={name: insert.excluded[name] for name in columns}
        )

    def transaction(self) -> AbstractContextManager[Connection]:
        """A transaction that other stores of the same database take part in."""
        return self._database.transaction()

    # -- rules and memory ----------------------------------------------------------------------------

    def rules(self, asset: str) -> dict[str, Any] | None:
        """The asset's own rules with who changed them: `rules`, `by`, `note`, `at`; None where it has none."""
        rows = self._database.rows(_RULES, {"of": asset})
        if not rows:
            return None
        rules, changed = (salvage(kept, f"the alarm rules of {asset}") for kept in rows[0])
        return None if rules is None else {"rules": rules, **(changed or {"by": "", "note": "", "at": ""})}

    def keep_rules(self, asset: str, rules: Sequence[Mapping[str, Any]], signed: Mapping[str, Any]) -> None:
        """Keeps rules of the asset's own."""
        with self._database.transaction() as db:
            self._database.ensure(db, asset)
            db.execute(self._keep_rules, {"asset": asset, "rules": dump(list(rules)), "changed": dump(signed)})

    def memory(self, asset: str) -> Memory:
        """What the engine remembers of the asset."""
        rows = self._database.rows(_MEMORY, {"of": asset})
        return _memory_of(asset, rows[0][0] if rows else None)

    def known(self, asset: str) -> tuple[list[Any] | None, Memory]:
        """The asset's own rules, None where it has none, and what the engine remembers; in one query."""
        ((rules, memory),) = self._database.rows(_KNOWN, {"of": asset})
        return salvage(rules, f"the alarm rules of {asset}"), _memory_of(asset, memory)

    def keep_memory(self, asset: str, memory: Memory) -> None:
        """Keeps what the engine remembers."""
        with self._database.transaction() as db:
            self._database.ensure(db, asset)
            db.execute(self._keep_memory, {"asset": asset, "memory": dump(to_plain(memory))})

    # -- alarms --------------------------------------------------------------------------------------

    def apply(self, asset: str, change: Change, at: str, window: int | None) -> dict[str, Any] | None:
        """Carries out one change; the alarm afterwards, None where it concerns none that is open."""
        with self._database.transaction() as db:
            rows = db.execute(_NAMED, {"of": asset, "named": change.key}).all()
            number, alarm = (rows[0][1], _read(*rows[0])) if rows else (None, None)
            if number is None:
                if change.verb != "raised":
                    return None
                self._database.ensure(db, asset)
                row = {"asset": asset, "name": change.key, "open": 1, "record": dump({})}
                number = self._database.add(db, ALARMS, row)
            if alarm is None:  # it is new, or what was kept of it is damaged
                name = db.execute(_LABEL, {"of": asset}).scalar_one()
                alarm = {
                    "id": number, "asset": name, "rule": change.rule, "quantity": change.quantity,
                    "place": change.place, "acknowledged": False,
                }  # fmt: skip
            alarm = _changed(alarm, change, at, window)
            self._keep(db, alarm)
            if change.verb != "updated":
                entry = {
                    "at": at, "verb": change.verb, "level": change.level, "value": change.value,
                    "limit": change.limit, "window": window, "reason": change.reason,
                }  # fmt: skip
                self._note(db, number, entry)
            return alarm

    def sign(self, asset: str, number: int, verb: str, signed: Mapping[str, Any]) -> dict[str, Any] | None:
        """Acknowledges or clears an open alarm by name; None where it is not open, or acknowledged already.

        A cleared quantity that is still beyond its limit is raised again after the rule's duration.
        """
        with self._database.transaction() as db:
            self._database.ensure(db, asset)
            open_one = _OPEN_OF.where(ALARMS.c.id == number).add_columns(ALARMS.c.name)
            rows = db.execute(open_one, {"of": asset}).all()
            alarm = _read(*rows[0][:3]) if rows else None
            if alarm is None or (verb == "acknowledged" and alarm["acknowledged"]):
                return None
            name = rows[0][3]
            key = "acknowledgement" if verb == "acknowledged" else "clearance"
            alarm = {**alarm, "acknowledged": True, key: dict(signed)}
            if verb == "cleared":
                alarm["active"] = False
                memory = self.memory(asset)
                memory.forget_level(name)
                self.keep_memory(asset, memory)
            self._keep(db, alarm)
            entry = {
                "at": signed["at"], "verb": verb, "level": alarm["level"], "by": signed["by"], "note": signed["note"],
            }  # fmt: skip
            self._note(db, number, entry)
            return {**alarm, "state": state_of(alarm["active"], True)}

    def open(self, asset: str | None = None) -> tuple[Mapping[str, Any], ...]:
        """Open alarms of one asset, or of all, most urgent first."""
        rows = self._database.rows(_OPEN) if asset is None else self._database.rows(_OPEN_OF, {"of": asset})
        return tuple(by_urgency(_readable(rows)))

    def open_by_asset(self) -> dict[str, tuple[Mapping[str, Any], ...]]:
        """Open alarms by asset, most urgent first."""
        rows: dict[str, list[Any]] = {}
        for *row, asset in self._database.rows(
            _OPEN.add_columns(ALARMS.c.asset).where(self._database.own(ALARMS.c.asset))
        ):
            rows.setdefault(asset, []).append(row)
        return {asset: tuple(by_urgency(_readable(own))) for asset, own in rows.items()}

    def listed(
        self, asset: str | None = None, *, closed: bool = False, after: int = 0, limit: int = 1000
    ) -> tuple[Mapping[str, Any], ...]:
        """Alarms with an id above `after`, with closed ones where asked for, most urgent first; with their history."""
        query = _ALARM.where(ALARMS.c.id > after).order_by(ALARMS.c.id).limit(limit)
        if not closed:
            query = query.where(ALARMS.c.open == 1)
        if asset is not None:
            query = query.where(ALARMS.c.asset == asset)
        rows = self._database.rows(query)
        return tuple({**alarm, "history": self.history(alarm["id"])} for alarm in by_urgency(_readable(rows)))

    def alarm(self, asset: str, number: int) -> Mapping[str, Any] | None:
        """One alarm with its history; None where there is none."""
        rows = self._database.rows(_ALARM.where(ALARMS.c.asset == asset, ALARMS.c.id == number))
        found = _readable(rows)
        return {**found[0], "history": self.history(number)} if found else None

    def history(self, number: int) -> list[Any]:
        """What has happened to an alarm, oldest first; of a long history the newest entries."""
        rows = self._database.rows(_HISTORY, {"number": number})
        entries = [salvage(row[0], f"an entry of the history of alarm {number}") for row in rows[::-1]]
        return [entry for entry in entries if entry is not None]

    # -- messages that wait to be sent ---------------------------------------------------------------

    def enqueue(self, asset: str, url: str, message: Mapping[str, Any], now_ns: int) -> None:
        """Keeps a message until it has been delivered; its id stays the same however often it is sent."""
        name = str(uuid.uuid4())
        with self._database.transaction() as db:
            body = json.dumps(all_printable(plain({"id": name, **message})), allow_nan=False, separators=(",", ":"))
            self._database.ensure(db, asset)
            row = {"asset": asset, "name": name, "url": url, "body": body, "created_ns": now_ns, "next_ns": now_ns}
            self._database.add(db, WEBHOOK_OUTBOX, row)

    def due(self, now_ns: int, limit: int = 50) -> list[tuple[int, str, str, str, int, int]]:
        """Messages to be sent now, the oldest of each address: number, id, address, body, created [ns], attempts."""
        query = _DUE.where(WEBHOOK_OUTBOX.c.number.in_(_OLDEST.where(self._database.own(WEBHOOK_OUTBOX.c.asset))))
        return [tuple(row) for row in self._database.rows(query, {"now": now_ns, "most": limit})]

    def waiting(self) -> int:
        """How many messages have not been delivered yet."""
        return self._database.rows(_WAITING.where(self._database.own(WEBHOOK_OUTBOX.c.asset)))[0][0]

    def sent(self, number: int) -> None:
        """Forgets a message that was delivered, or given up."""
        with self._database.transaction() as db:
            db.execute(delete(WEBHOOK_OUTBOX).where(WEBHOOK_OUTBOX.c.number == number))

    def postpone(self, number: int, next_ns: int) -> None:
        """Tries a message again later."""
        with self._database.transaction() as db:
            later = update(WEBHOOK_OUTBOX).where(WEBHOOK_OUTBOX.c.number == number)
            db.execute(later.values(attempts=WEBHOOK_OUTBOX.c.attempts + 1, next_ns=next_ns))

    # -- within --------------------------------------------------------------------------------------

    @staticmethod
    def _keep(db: Connection, alarm: dict[str, Any]) -> None:
        alarm["state"] = state_of(alarm["active"], alarm["acknowledged"])
        columns = {"record": dump(alarm), "open": int(alarm["state"] != "closed")}
        db.execute(update(ALARMS).where(ALARMS.c.id == alarm["id"]).values(**columns))

    def _note(self, db: Connection, number: int, entry: Mapping[str, Any]) -> None:
        self._database.add(db, ALARM_HISTORY, {"alarm": number, "entry": dump(entry)})


def _memory_of(asset: str, kept: bytes | None) -> Memory:
    stored = salvage(kept, f"what the alarms remember of {asset}")
    return Memory() if stored is None else from_plain(Memory, stored)


def _read(name: str, number: int, record: bytes) -> dict[str, Any] | None:
    """An alarm as it was kept, under the asset's present name; None where it is damaged."""
    found = salvage(record, f"alarm {number} of {name}")
    return None if found is None else {**found, "asset": name}


def _readable(rows: Iterable[Any]) -> list[dict[str, Any]]:
    """Alarms of rows with the asset's name, id and record; what is damaged is left out."""
    return [alarm for row in rows if (alarm := _read(*row)) is not None]


def _changed(alarm: Mapping[str, Any], change: Change, at: str, window: int | None) -> dict[str, Any]:
    """An alarm after a change of the engine's."""
    if change.verb == "ended":
        return {**alarm, "active": False, "ended_at": at}
    now = {
        **alarm, "quantity": change.quantity, "level": change.level, "active": True, "value": change.value,
        "limit": change.limit, "unit": change.unit, "reason": change.reason, "action": change.action,
    }  # fmt: skip
    if change.verb == "raised":
        now |= {"raised_at": at, "window": window, "ended_at": None, "acknowledged": False, "acknowledgement": None}
    elif change.verb == "escalated":
        now |= {"acknowledged": False, "acknowledgement": None}
    return now
