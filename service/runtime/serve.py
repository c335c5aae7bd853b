"""The service: a supervisor, and the roles `ingest`, `answer`, `work` and, where it is set, `record`.

Each role is a process that is started again where it ends. A termination signal ends all of them within seconds: what
is committed stays, and what was in progress is taken up from the store by the next start.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from service.operation.timing import Timing
from service.results.data_folder import database_of, only_service_of
from service.results.database import Database
from service.results.roles import ANSWER, INGEST, RECORD
from service.results.scratch import scratch
from service.results.sql_store import SqlStore
from service.runtime import SERVES
from service.runtime.answer import Answering, IngestSeen
from service.runtime.begun import Begun, OpenStore
from service.runtime.bridging import bridges_of
from service.runtime.by_settings import client_of, twin_of, zenoh_of
from service.runtime.ingest import ingest
from service.runtime.ingested import once_begun
from service.runtime.rig_sources import GivenRigs
from service.runtime.role_process import Context, Others
from service.runtime.supervisor import SUPERVISOR, Role, Supervisor
from service.runtime.twin_port import Twin
from service.runtime.work import Workplace
from service.runtime.work_processes import WORK
from service.runtime.work_role import work
from service.runtime.workers import in_processes, work_given, workers_here
from service.settings import Settings
from service.termination import until_told
from service.transport.protocol import OpenTransport

SLOW_DISK = 60.0  # how long a file of recordings may take to be completed on a disk that is slow [s]


def run(
    settings: Settings,
    *,
    twin: Twin | None = None,
    open_transport: OpenTransport | None = None,
    open_store: OpenStore | None = None,
    announce: Callable[[str], None] = lambda address: print(f"{SERVES} {address}", flush=True),
    stop: threading.Event | None = None,
) -> int:
    """Serves until a signal, or `stop`, ends it; the exit status.

    twin            its functions; None for the twin itself
    open_transport  the network; None for Zenoh at the endpoints of the settings
    open_store      where results are kept; None for the database of the settings
    announce        called once with the page's address, when HTTP is served
    stop            where it is given, or network or store are, all is done by threads of this process
    """
    given_rigs, twin = GivenRigs.read(settings.rig, settings.asset_rigs), twin or twin_of(settings)
    if settings.otlp is not None:
        import service.operation.traces  # noqa: F401  # ModuleNotFoundError before anything is begun
    with only_service_of(settings.data), Answering.at(settings) as answering:
        parts = _Parts(settings, given_rigs, twin, answering, announce, open_store)
        if (stop, open_transport, open_store) == (None, None, None):
            parts.in_processes()
        else:
            parts.here(stop or threading.Event(), open_transport or zenoh_of(settings))
    return 0


@dataclass(frozen=True, slots=True)
class _Parts:
    """The roles of one service, and what they are made of."""

    settings: Settings
    given_rigs: GivenRigs
    twin: Twin
    answering: Answering
    announce: Callable[[str], None]
    open_store: OpenStore | None

    def in_processes(self) -> None:
        """Has each role done by a process of its own, until a signal comes."""
        settings, records = self.settings, records_raw(self.settings)
        with ExitStack() as stack:
            within = stack.enter_context(scratch()) if records else None
            receive = partial(self._ingest, open_transport=zenoh_of(settings, within), processes=True)
            roles = [
                Role(name=INGEST, work=receive, essential=True, hears=(ANSWER, WORK, RECORD)),
                Role(name=ANSWER, work=self._answer, essential=True, hears=(INGEST, SUPERVISOR)),
            ]
            if in_processes(settings, self.twin):
                roles.append(work_in_processes(settings, self.twin, self._database))
            if within is not None:
                roles.append(recorder(settings, within, lambda others: once_begun(others, self._database)))
            Supervisor(roles).run(stack.enter_context(until_told()))

    def here(self, stop: threading.Event, open_transport: OpenTransport) -> None:
        """Has this process do what receives and answers, until `stop` is set or a signal comes."""
        others, failed = Others(), list[Exception]()

        def receive() -> None:
            try:
                self._ingest(Context(INGEST, stop, others), open_transport=open_transport, processes=False)
            except Exception as error:
                failed.append(error)
            finally:
                stop.set()

        thread = threading.Thread(target=receive, name=INGEST, daemon=True)
        thread.start()
        try:
            self._answer(Context(ANSWER, stop, others))
        finally:
            stop.set()
            thread.join()
        for error in failed:
            raise error

    # -- the roles -----------------------------------------------------------------------------------

    def _ingest(self, context: Context, *, open_transport: OpenTransport, processes: bool) -> None:
        settings, timing = self.settings, Timing()

        def own_store() -> AbstractContextManager[SqlStore]:
            """The store, which no other service writes to."""
            where = database_of(settings.data, settings.database)
            return SqlStore(Database(where, claimed=True, took=timing.stored))

        ingest(
            context, settings, partial(Begun.of, settings, self.given_rigs, self.open_store or own_store), self.twin,
            partial(workers_here, others=context.others if processes else None),
            timing=timing, open_transport=open_transport,
            bridges_of=lambda begun, offer: bridges_of(
                settings, begun.table, begun.store, offer, self.answering.access
            ),
            beside=partial(recorder_figures, context.others) if processes and records_raw(settings) else dict,
        )  # fmt: skip

    def _answer(self, context: Context) -> None:
        seen = partial(IngestSeen, context)
        store = self.open_store or (lambda: SqlStore(self._database()))
        opened = once_begun(context.others, store, wait=1.0)
        self.answering.answer(context, opened, seen, self.announce)

    def _database(self) -> Database:
        """The database, which the process that receives frames has opened before."""
        return Database(database_of(self.settings.data, self.settings.database), shared=True)


# -- roles that a host of a fleet has, too -------------------------------------------------------------------


def records_raw(settings: Settings) -> bool:
    """Whether a service records what comes."""
    return settings.raw_folder is not None or settings.raw_url is not None


def work_in_processes(settings: Settings, twin: Twin, database: Callable[[], Database], **given: Any) -> Role:
    """The role that computes.

    database  opens the results
    given     as `work_given` has it
    """
    make = twin.make
    assert make is not None

    def role(context: Context) -> None:
        def opened() -> SqlStore:
            return SqlStore(database())

        place = Workplace(settings=settings, open=opened, make=make, options=twin.options)
        work(context, work_given(settings, place, **given))

    return Role(name=WORK, work=role, threads=False, hears=(INGEST,))


def recorder(
    settings: Settings, within: Path, database: Callable[[Others], Callable[[], Database]], *, name: str = RECORD,
    **given: Any,
) -> Role:  # fmt: skip
    """The role that records what comes.

    within    the folder in which the embedded router listens for it
    database  what opens the results, by what the other roles say
    given     as in `service.runtime.raw_recorder.keep_recording`
    """

    def work(context: Context) -> None:
        from service.runtime.raw_recorder import keep_recording

        keep_recording(
            settings, client_of(settings, within), stop=context.stop, beat=context.beat,
            open_database=database(context.others), **given,
        )  # fmt: skip

    return Role(name=name, work=work, silent=SLOW_DISK, hears=(INGEST,))


def recorder_figures(others: Others, role: str = RECORD) -> Mapping[str, float]:
    """Whether nobody records, for /metrics."""
    return {"raw_recording_stopped": float(not others.state(role).lives)}
