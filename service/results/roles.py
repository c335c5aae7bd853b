"""What the processes of a service say of themselves: a row each, which whoever answers reads.

A process writes its row every few seconds, with a number that rises. Whoever reads sees by that number that the process
lives, and for how long it has said nothing by a clock of its own: the clocks of two machines are never compared.
"""

from __future__ import annotations

import os
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import bindparam, delete, select

from service.errors import StoreError
from service.operation.metric_catalogue import METRICS
from service.results.json_columns import dump, load, salvage
from service.results.schema import ROLES
from service.results.store import Tables
from service.steady_clock import later_time_ns

INGEST, ANSWER, RECORD = "ingest", "answer", "record"  # roles: whoever receives frames, answers, records
SILENT = 10.0  # time without another number after which a process does not live [s]
LOOK_EVERY = 0.1  # [s]
LEAST = {"network_connected"}  # figures of which the smallest of all counts
GREATEST = {"storage_unavailable", "store_bytes", "twin_call_seconds", "raw_recording_newest_seconds"}
GREATEST |= {"raw_recording_stopped", "raw_store_unavailable"}

Figures = Mapping[str, Any]

_WRITTEN = select(ROLES.c.host, ROLES.c.began_ns, ROLES.c.beat).where(ROLES.c.id == bindparam("of"))
_GONE = delete(ROLES).where(ROLES.c.id == bindparam("of"))


class OwnRole:
    """The row of this process, for one of its threads.

    node  of a cluster, where it is on one
    name  of the row, where several do the role; None for one of them, or one for each share
    """

    def __init__(self, database: Tables, role: str, node: str | None = None, name: str | None = None) -> None:
        self._database, self._beat, self._ident = database, 0, name or ident_of(role, database.share)
        here, self.began_ns = f"{socket.gethostname()}:{os.getpid()}", later_time_ns()
        self._row = {"id": self._ident, "role": role, "share": database.share, "host": here, "node": node}
        self._row["began_ns"] = self.began_ns

    def say(self, figures: Figures, not_ready: str | None = None) -> None:
        """Writes the row, in place of that of the process before it.

        figures    as for /metrics
        not_ready  why the process takes no frames, or None
        """
        self._beat += 1
        said = {"beat": self._beat, "not_ready": not_ready, "figures": dump(_numbers(figures))}
        insert = self._database.insert(ROLES)
        new = {name: insert.excluded[name] for name in ROLES.c.keys() if name != "id"}  # noqa: SIM118
        with self._database.transaction() as db:
            db.execute(insert.on_conflict_do_update(index_elements=["id"], set_=new), self._row | said)

    def elder(self) -> str | None:
        """Another process that writes the same row and has done so for longer, by its computer and number there.

        None where there is none, or this one has not written yet: the row may be that of one that has ended.
        """
        rows = self._database.rows(_WRITTEN, {"of": self._ident}) if self._beat else []
        if not rows or (rows[0].host, rows[0].began_ns) == (self._row["host"], self.began_ns):
            return None
        own = self._beat, self._row["host"], self.began_ns  # the latter two only where both have written as often
        return rows[0].host if (rows[0].beat, rows[0].host, rows[0].began_ns) > own else None

    def gone(self) -> None:
        """The process ends."""
        with self._database.transaction() as db:
            forget(db, self._ident)


def ident_of(role: str, share: int | None) -> str:
    """The name of the row of whoever does a role; for a share of a fleet's assets."""
    return role if share is None else f"{role} {share}"


def forget(db: Any, ident: str) -> None:
    """Within a transaction: whoever had a row does its role no longer."""
    db.execute(_GONE, {"of": ident})


@dataclass(frozen=True, slots=True, kw_only=True)
class Role:
    """What a process has said last.

    host      of its computer, and its number there
    began_ns  Unix time [ns]
    lives     whether it says something now and then; what is seen for the first time does
    seen      whether it has said something while it was looked for
    """

    id: str
    role: str
    share: int | None
    host: str
    node: str | None
    began_ns: int
    not_ready: str | None
    figures: Figures
    lives: bool
    seen: bool


class Roles:
    """The rows of all processes of a service, for whoever looks at them from time to time.

    silent  time without another number after which a process does not live [s]
    """

    def __init__(self, database: Tables, clock: Callable[[], float] = time.monotonic, silent: float = SILENT) -> None:
        self.database, self._clock, self._silent = database, clock, silent
        self._known: dict[str, tuple[tuple[int, int], float, bool]] = {}  # by row: number, since when, whether it rose

    def look(self) -> list[Role]:
        """What all have said last. StoreError where it cannot be read now."""
        now, before = self._clock(), self._known
        known, found = {}, []
        for row in self.database.rows(select(ROLES).order_by(ROLES.c.id)):
            beat = row.began_ns, row.beat
            was, since, rose = before.get(row.id, (beat, now, False))
            known[row.id] = (was, since, rose) if was == beat else (beat, now, True)
            _, since, rose = known[row.id]
            found.append(
                Role(
                    id=row.id, role=row.role, share=row.share, host=row.host, node=row.node, began_ns=row.began_ns,
                    not_ready=row.not_ready, lives=now - since <= self._silent, seen=rose,
                    figures=salvage(row.figures, f"figures of {row.id}", load) or {},
                )
            )  # fmt: skip
        self._known = known
        return found

    def settle(self) -> None:
        """Waits until all processes that have a row have been seen to live, or not to."""
        while any(role.lives and not role.seen for role in self.look()):
            time.sleep(LOOK_EVERY)

    def figures(self, *beside: Callable[[], Figures]) -> dict[str, Any]:
        """The figures of all processes that live, and of some parts of this process, together."""
        try:
            said = [role.figures for role in self.look() if role.lives]
        except StoreError:  # whoever keeps windows says it
            said = []
        return together([*(part() for part in beside), *said])


def together(figures: Iterable[Figures]) -> dict[str, Any]:
    """The figures of several processes as one: their sum, or the smallest or greatest where a sum has no meaning.

    A histogram is that of the one process that has it.
    """
    values: dict[str, list[float]] = {}
    labelled: dict[str, Counter[str]] = {}
    histograms: dict[str, Any] = {}
    for each in figures:
        for name, value in each.items():
            entry = METRICS.get(name)
            if entry is None:
                continue
            if entry.type == "histogram":
                histograms[name] = value
            elif isinstance(value, Mapping):
                labelled.setdefault(name, Counter()).update(value)
            elif not entry.labels and isinstance(value, int | float):
                values.setdefault(name, []).append(float(value))
    how = {**dict.fromkeys(LEAST, min), **dict.fromkeys(GREATEST, max)}
    return {name: how.get(name, sum)(found) for name, found in values.items()} | labelled | histograms


def _numbers(figures: Figures) -> dict[str, float | dict[str, float]]:
    """The figures that are numbers; those of each cause or the like by their label, of those of each asset the sum."""
    out: dict[str, float | dict[str, float]] = {}
    for name, value in figures.items():
        parts = dict(value) if isinstance(value, Mapping) else {"": value}
        if not all(isinstance(part, int | float) for part in parts.values()):
            continue
        labels = METRICS[name].labels if name in METRICS else ()
        by_label = isinstance(value, Mapping) and len(labels) == 1 and labels != ("asset",)
        out[name] = (
            {str(label): float(part) for label, part in parts.items()} if by_label else float(sum(parts.values()))
        )
    return out
