"""Alarms, their rules, what the engine remembers, and the messages that wait to be sent: in the results' database.

Every call is one transaction, and part of the caller's where that has begun one: a window and the alarms that it
raises are there together or not at all.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

from service.alarms.engine import Change
from service.alarms.memory import Memory
from service.contract.alarms import by_urgency, state_of
from service.results.json_columns import dump, load
from service.results.store import Tables

MOST_HISTORY = 200  # entries of one alarm that are answered


class AlarmStore:
    """Alarms of all assets over the results' database."""

    def __init__(self, database: Tables) -> None:
        self._database = database

    def transaction(self) -> AbstractContextManager[Any]:
        """A transaction that other stores of the same database take part in."""
        return self._database.transaction()

    # -- rules and memory ----------------------------------------------------------------------------

    def rules(self, asset: str) -> dict[str, Any] | None:
        """The asset's own rules with who changed them: `rules`, `by`, `note`, `at`; None where it has none."""
        rows = self._database.rows("SELECT rules, changed FROM alarm_rules WHERE asset = ?", (asset,))
        return {"rules": load(rows[0][0]), **load(rows[0][1])} if rows else None

    def keep_rules(self, asset: str, rules: Sequence[Mapping[str, Any]], signed: Mapping[str, Any]) -> None:
        """Keeps rules of the asset's own."""
        with self._database.transaction() as db:
            db.execute("INSERT OR IGNORE INTO assets (asset) VALUES (?)", (asset,))
            db.execute("INSERT OR REPLACE INTO alarm_rules VALUES (?, ?, ?)", (asset, dump(list(rules)), dump(signed)))

    def memory(self, asset: str) -> Memory:
        """What the engine remembers of the asset."""
        rows = self._database.rows("SELECT memory FROM alarm_memory WHERE asset = ?", (asset,))
        return Memory.from_dict(load(rows[0][0]) if rows else None)

    def keep_memory(self, asset: str, memory: Memory) -> None:
        """Keeps what the engine remembers."""
        with self._database.transaction() as db:
            db.execute("INSERT OR IGNORE INTO assets (asset) VALUES (?)", (asset,))
            db.execute("INSERT OR REPLACE INTO alarm_memory VALUES (?, ?)", (asset, dump(memory.to_dict())))

    # -- alarms --------------------------------------------------------------------------------------

    def apply(self, asset: str, change: Change, at: str, window: int | None) -> dict[str, Any] | None:
        """Carries out one change; the alarm afterwards, None where it concerns none that is open."""
        with self._database.transaction() as db:
            rows = db.execute(
                "SELECT id, record FROM alarms WHERE asset = ? AND name = ? AND open = 1", (asset, change.key)
            ).fetchall()
            number, alarm = (rows[0][0], load(rows[0][1])) if rows else (None, {})
            if number is None:
                if change.verb != "raised":
                    return None
                number = db.execute(
                    "INSERT INTO alarms (asset, name, open, record) VALUES (?, ?, 1, '{}')", (asset, change.key)
                ).lastrowid
                alarm = {
                    "id": number, "asset": asset, "rule": change.rule, "quantity": change.quantity,
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
            rows = db.execute(
                "SELECT name, record FROM alarms WHERE asset = ? AND id = ? AND open = 1", (asset, number)
            ).fetchall()
            if not rows or (verb == "acknowledged" and load(rows[0][1])["acknowledged"]):
                return None
            name, alarm = rows[0][0], load(rows[0][1])
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
        which, values = ("AND asset = ?", (asset,)) if asset is not None else ("", ())
        rows = self._database.rows(f"SELECT asset, record FROM alarms WHERE open = 1 {which}", values)
        return tuple(by_urgency(_alarm(*row) for row in rows))

    def listed(
        self, asset: str | None = None, *, closed: bool = False, after: int = 0, limit: int = 1000
    ) -> tuple[Mapping[str, Any], ...]:
        """Alarms with an id above `after`, with closed ones where asked for, most urgent first; with their history."""
        which = ["id > ?"] + ([] if closed else ["open = 1"]) + ([] if asset is None else ["asset = ?"])
        values = (after, *(() if asset is None else (asset,)), limit)
        rows = self._database.rows(
            f"SELECT asset, record FROM alarms WHERE {' AND '.join(which)} ORDER BY id LIMIT ?", values
        )  # fmt: skip
        return tuple({**alarm, "history": self.history(alarm["id"])} for alarm in by_urgency(_alarm(*r) for r in rows))

    def alarm(self, asset: str, number: int) -> Mapping[str, Any] | None:
        """One alarm with its history; None where there is none."""
        rows = self._database.rows("SELECT asset, record FROM alarms WHERE asset = ? AND id = ?", (asset, number))
        return {**_alarm(*rows[0]), "history": self.history(number)} if rows else None

    def history(self, number: int) -> list[Any]:
        """What has happened to an alarm, oldest first; of a long history the newest entries."""
        rows = self._database.rows(
            "SELECT entry FROM alarm_history WHERE alarm = ? ORDER BY id DESC LIMIT ?", (number, MOST_HISTORY)
        )
        return [load(row[0]) for row in rows[::-1]]

    # -- messages that wait to be sent ---------------------------------------------------------------

    def enqueue(self, url: str, message: Mapping[str, Any], now_ns: int) -> None:
        """Keeps a message until it has been delivered; its id stays the same however often it is sent."""
        name = str(uuid.uuid4())
        with self._database.transaction() as db:
            db.execute(
                "INSERT INTO webhook_outbox (name, url, body, created_ns, next_ns) VALUES (?, ?, ?, ?, ?)",
                (name, url, dump({"id": name, **message}), now_ns, now_ns),
            )

    def due(self, now_ns: int, limit: int = 50) -> list[tuple[int, str, str, str, int, int]]:
        """Messages to be sent now, the oldest of each address: number, id, address, body, created [ns], attempts."""
        return self._database.rows(
            "SELECT number, name, url, body, created_ns, attempts FROM webhook_outbox WHERE next_ns <= ? AND number IN "
            "(SELECT MIN(number) FROM webhook_outbox GROUP BY url) ORDER BY number LIMIT ?",
            (now_ns, limit),
        )  # type: ignore[return-value]

    def waiting(self) -> int:
        """How many messages have not been delivered yet."""
        return self._database.rows("SELECT COUNT(*) FROM webhook_outbox")[0][0]

    def sent(self, number: int) -> None:
        """Forgets a message that was delivered, or given up."""
        with self._database.transaction() as db:
            db.execute("DELETE FROM webhook_outbox WHERE number = ?", (number,))

    def postpone(self, number: int, next_ns: int) -> None:
        """Tries a message again later."""
        with self._database.transaction() as db:
            db.execute(
                "UPDATE webhook_outbox SET attempts = attempts + 1, next_ns = ? WHERE number = ?", (next_ns, number)
            )

    # -- within --------------------------------------------------------------------------------------

    @staticmethod
    def _keep(db: Any, alarm: dict[str, Any]) -> None:
        alarm["state"] = state_of(alarm["active"], alarm["acknowledged"])
        db.execute(
            "UPDATE alarms SET record = ?, open = ? WHERE id = ?",
            (dump(alarm), alarm["state"] != "closed", alarm["id"]),
        )

    @staticmethod
    def _note(db: Any, number: int, entry: Mapping[str, Any]) -> None:
        db.execute("INSERT INTO alarm_history (alarm, entry) VALUES (?, ?)", (number, dump(entry)))


def _alarm(asset: str, record: str) -> dict[str, Any]:
    """An alarm as it was kept, under the asset's present name."""
    return {**load(record), "asset": asset}


def _changed(alarm: Mapping[str, Any], change: Change, at: str, window: int | None) -> dict[str, Any]:
    """An alarm after a change of the engine's."""
    if change.verb == "ended":
        return {**alarm, "active": False, "ended_at": at}
    now = {
        **alarm, "level": change.level, "active": True, "value": change.value, "limit": change.limit,
        "unit": change.unit, "reason": change.reason, "action": change.action,
    }  # fmt: skip
    if change.verb == "raised":
        now |= {"raised_at": at, "window": window, "ended_at": None, "acknowledged": False, "acknowledgement": None}
    elif change.verb == "escalated":
        now |= {"acknowledged": False, "acknowledgement": None}
    return now
