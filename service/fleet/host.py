"""A host of a fleet: it computes for the assets of all partitions, and receives the frames of those that it has leased.

    Host(settings=settings, layout=layout, name="node-1").serve(stop)

Any number of hosts share a database and a folder, and nothing else. Each is a supervisor with a process for each role,
which is started again where it ends; how many there are, and where, is settled by who starts them.
"""

from __future__ import annotations

import logging
import pickle
import sys
import threading
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from service.errors import InputError
from service.fleet.databases import database_of, fleet_tables
from service.fleet.kept_curves import StoredCurves
from service.fleet.layout import Layout
from service.fleet.lease import HOST, LEASE, Leased, lease
from service.fleet.partition import PartitionRoles
from service.logs import logging_by
from service.results.backends import STATEMENT_WAIT
from service.results.data_folder import SEGMENTS
from service.results.database import Database
from service.results.window_jobs import WindowJobs
from service.runtime.by_settings import twin_of
from service.runtime.role_process import Context, ends_with
from service.runtime.serve import work_in_processes
from service.runtime.supervisor import Role, Supervisor
from service.runtime.twin_port import Twin
from service.runtime.work_processes import WORK
from service.runtime.workers import in_processes, workers_of
from service.settings import Settings
from service.stream.wire.topics import NAME
from service.termination import until_told

log = logging.getLogger(__name__)

SLOW_SERVER = 2 * STATEMENT_WAIT  # how long the database may take to say which partitions are this host's [s]
BEGIN = "from service.fleet.host import main; main()"  # of a fresh interpreter


@dataclass(kw_only=True)
class Host:
    """The roles of one host.

    settings  of the fleet
    name      by which it leases partitions: no other one has it, and it has it again after a restart
    twin      its functions; None for the twin itself
    """

    settings: Settings
    layout: Layout
    name: str = ""
    twin: Twin | None = None

    @cached_property
    def _twin(self) -> Twin:
        return self.twin or twin_of(self.settings)

    def serve(self, stop: threading.Event, beside: Iterable[Role] = ()) -> None:
        """Serves until `stop` is set, in the main thread; raises what has ended it before.

        beside  other roles

        Raises InputError where no router is set that all hosts use, a name cannot be used, or the folder is not that
        of the fleet.
        """
        demand_router(self.settings)
        if not NAME.fullmatch(self.name):
            raise InputError(f"name = {self.name!r} must be 1 to 64 letters, digits, '_', '-' or '.'")
        with closing(self._tables("gear-twin host")) as database:
            WindowJobs(database, self.settings.data / SEGMENTS, sweeps=False).demand_folder()
        roles = [Role(name=LEASE, work=self._lease, silent=SLOW_SERVER, essential=True, hears=(WORK,)), *beside]
        if in_processes(self.settings, self._twin):
            roles.append(
                work_in_processes(
                    self.settings, self._twin, self._tables, curves=StoredCurves(database_of(self.settings)),
                    name=self.name, waits=False,
                )
            )  # fmt: skip

        leased = Leased()

        def heard(role: str, what: Any) -> None:
            nonlocal leased
            if isinstance(what, Leased) and what != leased:
                leased = what
                supervisor.want(each for number in what.partitions for each in self._partition(number).roles)

        supervisor = Supervisor(roles, heard)
        supervisor.run(stop)

    def _partition(self, number: int) -> PartitionRoles:
        return PartitionRoles(
            settings=self.settings, partition=number, layout=self.layout, twin=self._twin, node=self.name,
            host=f"{HOST} {self.name}",
        )  # fmt: skip

    def _lease(self, context: Context) -> None:
        count = workers_of(self.settings) if in_processes(self.settings, self._twin) else None
        lease(context, partial(self._tables, "gear-twin host"), self.name, count)

    def _tables(self, called: str = "gear-twin work") -> Database:
        return fleet_tables(database_of(self.settings), self.layout, called)


def demand_router(settings: Settings) -> None:
    """InputError where no router is set that all hosts use."""
    if not settings.connect:
        raise InputError("connect must name the router of the fleet, such as tcp/router:7447")


def main() -> None:
    """Serves a host in a fresh interpreter, which ends with the thread that has started it.

    The host comes on standard input; the argument is the number of the process that has started this.
    """
    if not ends_with(int(sys.argv[1])):
        return
    host: Host = pickle.load(sys.stdin.buffer)
    with logging_by(host.settings), until_told() as stop:
        try:
            host.serve(stop)
        except BaseException:
            log.exception("%s cannot go on: its process ends, and is started again", host.name)
            raise
