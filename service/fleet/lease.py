"""Which partitions a host serves: a lease is the host's name in the row of a partition.

Each host says every second that it lives, and counts those that do, which gives its share. As long as it has less, it
takes partitions of nobody, or of a host that is silent; what it has beyond its share it gives back. A lease spares
work; who may write is settled by the fence of the partition.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy import bindparam

from service.errors import InputError, SteppedBack, StorageUnavailable
from service.fleet.layout import PARTITIONS, look
from service.results.database import Database
from service.results.roles import INGEST, OwnRole, Roles, forget, ident_of
from service.results.storage_faults import is_away
from service.runtime.role_process import Context
from service.runtime.storage_watch import StoppedWaiting, awaited
from service.runtime.work_processes import WorkProcesses

log = logging.getLogger(__name__)

HOST = "host"  # in the table of roles
LEASE = "lease"  # the role of a host that does this
LOOK_EVERY = 1.0  # [s]
SILENT = 5.0  # time for which a host says nothing after which the others take what it had [s]
LEAVE_EVERY, LEAVE_WITHIN = 0.1, 6.0  # looks at the end, and how long: less than the supervisor waits [s]
GIVE_WAIT = 10.0  # for the end of who has served a partition that is given back [s]

_ALL = sa.select(PARTITIONS.c.number, PARTITIONS.c.host).order_by(PARTITIONS.c.number)
_OF = PARTITIONS.c.number == bindparam("of")
_TAKE = (
    sa.update(PARTITIONS)
    .where(_OF, PARTITIONS.c.host.is_not_distinct_from(bindparam("from")))
    .values(host=bindparam("own"))
)
_BEGIN_ANEW = sa.update(PARTITIONS).values(token=PARTITIONS.c.token + 1)


@dataclass(frozen=True, slots=True)
class Leased:
    """The partitions that this host is to serve."""

    partitions: tuple[int, ...] = ()


class Leases:
    """The leases of one host, by its name."""

    def __init__(self, database: Database, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._database, self._name, self._clock = database, name, clock
        self._roles = Roles(database, clock, SILENT)
        self._looked = float("-inf")
        self._giving: dict[int, float] = {}  # partitions that are no longer served here, and since when [s]

    def look(self) -> Leased:
        """Takes and gives back; what is to be served.

        Raises StorageUnavailable where the tables cannot be used now.
        """
        if self._clock() - self._looked > SILENT:  # held up, or the tables were away: silence counts from now
            self._roles = Roles(self._database, self._clock, SILENT)
        rows = self._roles.look()
        hosts = {row.id: row for row in rows if row.role == HOST}
        leases = {number: host for number, host in self._database.rows(_ALL)}
        self._looked = self._clock()
        living = {host for host, row in hosts.items() if row.lives} | {self._name}
        share = math.ceil(len(leases) / len(living))
        own = [number for number, host in leases.items() if host == self._name and number not in self._giving]
        free = [number for number, host in leases.items() if host not in living]
        while free and len(own) < share:
            number = free.pop(0)
            if self._move(number, leases[number], self._name):
                own.append(number)
        if any(hosts[host].seen for host in living - {self._name}):  # a row alone may be that of one that has ended
            self._giving |= dict.fromkeys(own[share:], self._clock())
            own = own[:share]
        self._give({row.id for row in rows})
        for host in hosts.keys() - living - set(leases.values()):
            self._forget(host)
        return Leased(tuple(sorted(own)))

    def leave(self, seconds: float) -> None:
        """Gives all back, each partition once nobody serves it here, within a time [s]."""
        until = self._clock() + seconds
        own = {number for number, host in self._database.rows(_ALL) if host == self._name}
        while own and self._clock() < until:
            served = {row.share for row in self._roles.look() if row.role == INGEST}
            for number in own - served:
                self._move(number, self._name, None)
            own &= served
            time.sleep(LEAVE_EVERY)
        self._forget(self._name)

    def begin_anew(self) -> None:
        """Has whoever serves a partition begin anew from what is there."""
        with self._database.transaction() as db:
            db.execute(_BEGIN_ANEW)

    def _give(self, rows: set[str]) -> None:
        """Gives back what nobody serves any more here."""
        for number, since in list(self._giving.items()):
            if ident_of(INGEST, number) not in rows or self._clock() - since > GIVE_WAIT:
                self._move(number, self._name, None)
                del self._giving[number]

    def _move(self, number: int, before: str | None, after: str | None) -> bool:
        """Whether a lease is another one's from now on; not where somebody else has been faster."""
        with self._database.transaction() as db:
            return bool(db.execute(_TAKE, {"of": number, "from": before, "own": after}).rowcount)

    def _forget(self, host: str) -> None:
        with self._database.transaction() as db:
            forget(db, host)


def lease(context: Context, open_database: Callable[[], Database], name: str, workers: int | None) -> None:
    """Does the role until it is to end: says which partitions this host is to serve, and to other hosts that it lives.

    name     of the host
    workers  processes of this host that compute; None where it has none

    Raises InputError where another host has the name, and SteppedBack where a worker of this host, or this process, has
    found that the database lacks what it had confirmed: all hosts begin anew.
    """

    def waits(error: StorageUnavailable) -> bool:
        context.beat()
        return is_away(error)

    with suppress(StoppedWaiting), closing(awaited(open_database, context.stop, waits)) as database:
        ident, computing = f"{HOST} {name}", None if workers is None else WorkProcesses(workers, context.others)
        own = OwnRole(database, HOST, name, ident)
        leases = Leases(database, ident)
        while not context.stop.is_set():
            context.beat()
            try:
                back = None if computing is None else computing.stuck()
                if isinstance(back, SteppedBack):
                    leases.begin_anew()
                    raise back
                look(database)
                figures, why = ({}, None) if computing is None else (computing.figures(), computing.unusable())
                if elder := own.elder():
                    raise InputError(f"{elder} is {ident} already: give this host another name (fleet host --name)")
                own.say(figures, why)
                context.say(leases.look())
            except SteppedBack:
                raise
            except StorageUnavailable as error:
                log.debug("nobody knows now which partitions are this host's: %s", error)
            context.stop.wait(LOOK_EVERY)
        with suppress(StorageUnavailable):  # then the others find it by its silence
            leases.leave(LEAVE_WITHIN)
