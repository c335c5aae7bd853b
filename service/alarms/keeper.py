"""Alarms of a running service: evaluated with each window and look at the clock, acknowledged and cleared by people.

`window`, `decision`, `data` and `learn_anew` are called within the transaction that keeps what they are about, and
answer the events of it. Whoever is to be notified is found in the outbox afterwards: a process that is killed in
between forgets nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

from service.alarms.engine import Change, Moment, evaluate, learn_anew
from service.alarms.learning import progress
from service.alarms.memory import Memory
from service.alarms.readings import Readings, of_data, of_report, of_window, usable
from service.alarms.rules import DEFAULT_RULES, Rule, rules_from
from service.contract.base import iso_time
from service.results.alarm_store import AlarmStore
from service.steady_clock import later_time_ns

Events = tuple[tuple[str, Mapping[str, Any]], ...]

UNHEALTHY = ("alarm", "end_of_life")
SILENT = ("updated",)  # changes that are no event


class AlarmKeeper:
    """The alarms of all assets, by their rules."""

    def __init__(
        self,
        store: AlarmStore,
        rules: Sequence[Rule] = DEFAULT_RULES,
        webhooks: Iterable[str] = (),
        *,
        clock: Callable[[], int] = later_time_ns,
    ) -> None:
        """rules  of assets that have none of their own; webhooks  addresses that every change is sent to"""
        self.store, self._rules, self._clock = store, tuple(rules), clock
        self._webhooks = tuple(dict.fromkeys(webhooks))
        self.waiting = threading.Event()  # set where messages wait to be sent
        if store.waiting():
            self.waiting.set()

    def transaction(self) -> AbstractContextManager[Any]:
        """The transaction of which an evaluation is a part."""
        return self.store.transaction()

    def open(self, asset: str) -> tuple[Mapping[str, Any], ...]:
        """Open alarms of an asset, most urgent first."""
        return self.store.open(asset)

    # -- rules ---------------------------------------------------------------------------------------

    def rules(self, asset: str) -> tuple[Rule, ...]:
        """The rules of an asset: its own, or those of the settings."""
        own = self.store.rules(asset)
        return self._in_force(None if own is None else own["rules"])

    def _in_force(self, own: Sequence[Mapping[str, Any]] | None) -> tuple[Rule, ...]:
        return self._rules if own is None else rules_from(own)

    def described(self, asset: str) -> dict[str, Any]:
        """The rules of an asset with who changed them, and how far limits have been learned."""
        own, memory = self.store.rules(asset), self.store.memory(asset)
        rules = self.rules(asset)
        learn = {rule.name: rule.learn_windows for rule in rules if rule.limits_from == "learned"}
        learning = [
            {"rule": key.rule, "quantity": key.quantity, "place": key.place, **point}
            for key in memory.keys.values()
            if key.rule in learn
            for point in progress(key, learn[key.rule])
        ]
        signed = {name: (own or {}).get(name) for name in ("by", "note", "at")}
        return {
            "own": own is not None,
            **signed,
            "rules": [{**rule.model_dump(exclude_none=True), "basis": rule.limits_from} for rule in rules],
            "learning": learning,
        }

    def set_rules(self, asset: str, rules: Sequence[Rule], by: str, note: str) -> None:
        """Gives an asset rules of its own; alarms of rules that are gone end with the next window."""
        signed = {"by": by, "note": note, "at": iso_time(self._clock())}
        self.store.keep_rules(asset, [rule.model_dump(exclude_none=True) for rule in rules], signed)

    # -- evaluation ----------------------------------------------------------------------------------

    def window(
        self,
        asset: str,
        time_ns: int,
        record: Mapping[str, Any],
        report: Mapping[str, Any] | None,
        data: Mapping[str, Any],
    ) -> Events:
        """A committed window, by its start [ns, Unix time]."""
        level = ((report or {}).get("status") or {}).get("level")
        learn = usable(record) and level not in UNHEALTHY
        at = Moment(time_ns=time_ns, window=record["index"], learn=learn)
        return self._evaluate(asset, of_window(record, report, data), at)

    def decision(self, asset: str, report: Mapping[str, Any]) -> Events:
        """A report that a decision on an effect has changed."""
        return self._evaluate(asset, of_report(report), Moment(time_ns=self._clock()))

    def data(self, asset: str, data: Mapping[str, Any]) -> Events:
        """Data that have become stale, or are no longer: a state that lasts, not one window of several."""
        at_once = {"windows": 1, "seconds": 0.0}
        rules = [rule.model_copy(update=at_once) if rule.quantity == "data" else rule for rule in self.rules(asset)]
        return self._evaluate(asset, of_data(data), Moment(time_ns=self._clock()), rules)

    def learn_anew(self, asset: str, sensor: str, reason: str) -> Events:
        """The machine, or the given sensor, is not that of which limits were learned: their alarms end with them."""
        memory, changes = learn_anew(self.rules(asset), self.store.memory(asset), sensor, reason)
        return self._kept(asset, memory, changes, Moment(time_ns=self._clock()))

    def _evaluate(self, asset: str, readings: Readings, at: Moment, rules: Sequence[Rule] | None = None) -> Events:
        own, memory = self.store.known(asset)
        memory, changes = evaluate(self._in_force(own) if rules is None else rules, memory, readings, at)
        return self._kept(asset, memory, changes, at)

    def _kept(self, asset: str, memory: Memory, changes: Sequence[Change], at: Moment) -> Events:
        self.store.keep_memory(asset, memory)
        return tuple(event for change in changes for event in self._applied(asset, change, at))

    def _applied(self, asset: str, change: Change, at: Moment) -> Events:
        alarm = self.store.apply(asset, change, iso_time(at.time_ns), at.window)
        if alarm is None or change.verb in SILENT:
            return ()
        return self._told(asset, change.verb, alarm)

    # -- people --------------------------------------------------------------------------------------

    def sign(self, asset: str, number: int, verb: str, by: str, note: str) -> tuple[dict[str, Any], Events] | None:
        """`acknowledged` or `cleared` by name: the alarm afterwards and the event; None where that cannot be done."""
        signed = {"by": by, "note": note, "at": iso_time(self._clock())}
        alarm = self.store.sign(asset, number, verb, signed)
        return None if alarm is None else (alarm, self._told(asset, verb, alarm))

    def look(self) -> None:
        """Another process may have written messages that are to be sent."""
        if self._webhooks:
            self.waiting.set()

    def _told(self, asset: str, verb: str, alarm: Mapping[str, Any]) -> Events:
        """The event of a change, and the messages that wait to be sent."""
        told = {"verb": verb, "alarm": dict(alarm)}
        for url in self._webhooks:
            self.store.enqueue(asset, url, {"kind": "alarm", "asset": alarm["asset"], **told}, self._clock())
        if self._webhooks:
            self.waiting.set()
        return (("alarm", told),)
