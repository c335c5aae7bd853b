"""`gear-twin fleet up`: the tables, the engine, its partitions and the network's router, looked after until the end.

Whoever runs it may be ended and started again: on a cluster of its own everything ends with it and goes on from what is
committed; on a plant's cluster the partitions go on meanwhile.
"""

from __future__ import annotations

import json
import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from service.errors import DeliveryError, InputError, StorageUnavailable
from service.fleet.census import Census, census
from service.fleet.cluster import LocalCluster, Node, end_left, environment, node_here
from service.fleet.databases import engine_of, made, reached
from service.fleet.engine_process import EngineProcess
from service.fleet.layout import FACTS, Layout, create, layout_of
from service.results.data_folder import only_service_of
from service.runtime.admission import demand_protected_links
from service.runtime.usable_cores import usable_cores
from service.settings import Settings
from service.transport.zenoh_session import open_session

log = logging.getLogger(__name__)

RUNNING = "fleet.json"  # in the fleet's folder: what `fleet drain`, `scale` and `down` need to find the fleet
PARTITIONS = 8  # of a new fleet where nobody says
LOOK_EVERY = 1.0  # [s]
ALARM_AFTER = 20.0  # time without a worker after which a partition is an alarm [s]
FRONT_WAIT = 10.0  # for the end of the front end [s]
REPLACE_AFTER = 20.0  # a node that has ended, where the others have room: its partitions need the cores first [s]
SPREAD_AFTER = 10.0  # time after a change of the nodes in which the engine has placed what it can [s]


def database_of(settings: Settings) -> str:
    """The URL of the fleet's database; InputError where none is set."""
    if settings.database is None:
        raise InputError(
            "a fleet needs a PostgreSQL database that all its machines reach: --database postgresql://user@host/name"
        )
    return settings.database.get_secret_value()


def prepared(settings: Settings, progress: Callable[[int, int], None] = lambda done, of: None) -> Layout:
    """The tables of the fleet and of all its partitions, made where they are not there."""
    database = database_of(settings)
    for bridge in ("mqtt", "opcua"):
        if getattr(settings, bridge) is not None:
            raise InputError(f"setting {bridge}: a fleet has no bridges to other networks; gear-twin serve has them")
    with reached(database):
        engine = engine_of(database, poolclass=sa.NullPool)
        known = layout_of(engine)
        wanted = settings.fleet_partitions or (known.partitions if known else PARTITIONS)
        layout = create(engine, wanted)
        for partition in layout.all:
            made(database, partition, layout.partitions)
            progress(partition + 1, layout.partitions)
    return layout


class Fleet:
    """A fleet that runs: engine, partitions, and what is known of both.

    told  called with a line when a partition has no worker for long, and when it has one again
    """

    def __init__(
        self, settings: Settings, layout: Layout, *, twin_from: str | None = None,
        told: Callable[[str], None] = log.error,
    ) -> None:  # fmt: skip
        self._settings, self._layout, self._told, self._twin_from = settings, layout, told, twin_from
        self._tables = engine_of(database_of(settings), pool_size=1, max_overflow=1)
        self._engine: EngineProcess | None = None
        self.cluster: LocalCluster | None = None
        self._node: Node | None = None  # of a plant's cluster, by which it is joined
        self._opened = ExitStack()
        self._seen: set[str] | None = None  # nodes of a plant's cluster
        self._silent: set[int] = set()
        self._begun = time.monotonic()
        self._spread_at: float | None = None
        self._scale_at = 0.0
        self._told_where = ""

    def start(self) -> None:
        """Starts or joins the engine, and has an actor for each partition."""
        settings = self._settings
        folder = settings.data
        folder.mkdir(parents=True, exist_ok=True)
        if left := end_left(_written(folder).get("groups", ())):
            log.warning("%d processes of an engine that an earlier fleet up has left behind were ended", left)
        if settings.fleet_address is None:
            workers = self._workers
            cores = settings.fleet_cores or max(usable_cores() // workers, 1)
            self.cluster = LocalCluster(folder, settings.fleet_room or self._layout.partitions, cores)
            os.environ.update(environment(folder))
            self.cluster.start(workers)
        else:
            self._node = self._opened.enter_context(node_here(folder, settings.fleet_address))
        self._join()

    def _join(self) -> None:
        """Joins the engine, and has an actor for each partition."""
        self._engine = EngineProcess.joined(
            self._settings, self._layout, self._twin_from, self.address, alone=self.cluster is not None,
            lost=self._is_lost,
        )  # fmt: skip
        self._engine.place()
        self._write()

    def _write(self) -> None:
        """Writes where the fleet is found, and what would be left of it if this process were killed."""
        found: dict[str, Any] = {"pid": os.getpid(), "address": self.address, "workers": None}
        if self.cluster is not None:
            found |= {"workers": len(self.cluster.nodes), "groups": self.cluster.groups}
        text = json.dumps(found) + "\n"
        if text != self._told_where:
            self._told_where = text
            (self._settings.data / RUNNING).write_text(text, encoding="utf-8")

    def _is_lost(self) -> bool:
        """Whether that has ended which the engine was joined by."""
        if self.cluster is not None:
            return self.cluster.lost
        return self._node is not None and self._node.process.poll() is not None

    @property
    def _workers(self) -> int:
        """How many nodes people want on this machine."""
        return wanted_workers(self._tables) or self._settings.fleet_workers

    @property
    def engine(self) -> EngineProcess:
        """The engine, once it has been started or joined."""
        assert self._engine is not None
        return self._engine

    @property
    def address(self) -> str:
        """Where the engine is reached."""
        return self._settings.fleet_address or (self.cluster.address if self.cluster else "auto")

    def look(self) -> None:
        """One look at everything: nodes that ended, how many are wanted, partitions without a worker.

        Raises DeliveryError where a plant's cluster is lost, or the node by which it was joined: whoever runs this
        starts it again.
        """
        if self.cluster is None and self._is_lost():
            raise DeliveryError(
                f"the node by which the engine at {self.address} was joined has ended: the engine was lost, or was "
                "started anew; start gear-twin fleet up again"
            )
        try:
            self._look()
        except DeliveryError as error:
            if self.cluster is None:
                raise
            log.error("%s: it is tried again", error)

    def _look(self) -> None:
        if self.cluster is not None:
            if self.cluster.lost:
                self._begin_again()
            elif not self.engine.is_alive:
                self._join()
            if self.cluster.clear():
                room = self.cluster.room * len(self.cluster.nodes) >= self._layout.partitions
                self._scale_at = time.monotonic() + (REPLACE_AFTER if room else 0.0)
            wanted = self._workers
            if wanted > len(self.cluster.nodes) and time.monotonic() >= self._scale_at:
                self.cluster.scale(wanted)
                self._spread_at = time.monotonic() + SPREAD_AFTER
            if wanted < len(self.cluster.nodes):
                self._shrink(wanted)
            self._write()
        elif self._nodes_have_come():
            self._spread_at = time.monotonic() + SPREAD_AFTER
        found = census(self._tables, self._layout)
        if self._spread_at is not None and time.monotonic() >= self._spread_at and not found.silent:
            self._spread_at = None
            for partition, node in self.engine.spread(found.nodes):
                self.engine.move(partition, node)
        self._say(found)

    def end(self) -> None:
        """Ends the partitions in good order, and the engine where it is this fleet's own."""
        try:
            if self._engine is not None:
                try:
                    self._engine.end()
                except DeliveryError as error:
                    log.warning("the partitions did not end in good order: %s", error)
                self._engine.close()
        finally:
            (self._settings.data / RUNNING).unlink(missing_ok=True)
            if self.cluster is not None:
                self.cluster.end()
            self._opened.close()
            self._tables.dispose()

    def _nodes_have_come(self) -> bool:
        """Whether a plant's cluster has nodes that were not there at the last look."""
        nodes = {node.id for node in self.engine.nodes() if node.alive and node.room}
        come = self._seen is not None and bool(nodes - self._seen)
        self._seen = nodes
        return come

    def _begin_again(self) -> None:
        """Starts the engine anew after its head was lost; the partitions go on from what is committed."""
        assert self.cluster is not None
        self._told("the head of the engine has ended: the engine is started again")
        self.engine.close()
        self.cluster.end()
        try:
            self.cluster.start(self._workers)
        except DeliveryError:
            self.cluster.end()
            raise
        self._join()

    def _shrink(self, wanted: int) -> None:
        """Empties and ends the newest nodes until there are so many."""
        assert self.cluster is not None
        while len(self.cluster.nodes) > max(wanted, 1):
            leaving = self.cluster.nodes[-1]
            found = census(self._tables, self._layout)
            node = next((n for n in self.engine.nodes() if n.alive and n.name == leaving.name), None)
            if node is not None:
                self.engine.drain(node, found.nodes, self.address)
            self.cluster.nodes.pop().end()

    def _say(self, found: Census) -> None:
        """Partitions that have been without a worker for long are said once, with the likely reason."""
        late = {p for p, seconds in found.silent.items() if min(seconds, time.monotonic() - self._begun) > ALARM_AFTER}
        if new := late - self._silent:
            room, of = self.engine.room(), self._layout.partitions
            why = f"no worker has begun to serve within {ALARM_AFTER:g} s; the log of its node says what it does"
            if room < of:
                why = f"the nodes have room for {room} of {of} partitions; add a node, or raise fleet_room"
            self._told(f"{_partitions(new)} not served: {why}. Its assets' frames wait with their publishers.")
        if back := self._silent - late:
            self._told(f"{_partitions(back)} served again")
        self._silent = late


def _partitions(numbers: set[int]) -> str:
    listed = ", ".join(str(number) for number in sorted(numbers))
    return f"partition {listed} is" if len(numbers) == 1 else f"partitions {listed} are"


def wanted_workers(tables: sa.Engine) -> int | None:
    """How many nodes people want on this machine; None where nobody has said."""
    with tables.connect() as db:
        found = db.execute(sa.select(FACTS.c.value).where(FACTS.c.name == "workers")).scalar()
    return None if found is None else int(found)


def want_workers(tables: sa.Engine, workers: int) -> None:
    """Notes how many nodes people want on the machine of `fleet up`, which follows within a second."""
    from sqlalchemy.dialects import postgresql

    row = postgresql.insert(FACTS).values(name="workers", value=str(workers))
    with tables.begin() as db:
        db.execute(row.on_conflict_do_update(index_elements=[FACTS.c.name], set_={"value": row.excluded.value}))


def running(folder: Path) -> dict[str, Any]:
    """What `fleet up` has written of the fleet that runs; InputError where none does."""
    found = _written(folder)
    if not found:
        raise InputError(
            f"no fleet runs with the folder {folder}: there is no {RUNNING} in it; gear-twin fleet up starts one"
        )
    return found


def _written(folder: Path) -> dict[str, Any]:
    try:
        return json.loads((folder / RUNNING).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


@contextmanager
def until_told() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set while inside."""
    stop = threading.Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def up(
    settings: Settings,
    layout: Layout,
    *,
    front: bool = True,
    twin_from: str | None = None,
    announce: Callable[[str], None] = print,
) -> None:
    """Runs the fleet until it is told to end.

    front      whether a front end is served from this process, too
    twin_from  module and name of the twin, `module:name`; None for the twin itself
    announce   called with a line when the fleet has been started, and one when HTTP is served
    """
    with until_told() as stop, ExitStack() as stack:
        stack.enter_context(only_service_of(settings.data))
        if not settings.connect:
            demand_protected_links(settings)
            stack.enter_context(open_session(settings.listen, links=settings.zenoh_links))
            settings = settings.model_copy(update={"connect": [_reached(e) for e in settings.listen]})
        fleet = Fleet(settings, layout, twin_from=twin_from)
        stack.callback(fleet.end)
        fleet.start()
        if front:
            stack.enter_context(_front(settings, announce, stop))
        announce(f"fleet of {layout.partitions} partitions at {fleet.address}")
        away: str | None = None
        while not stop.wait(LOOK_EVERY):
            try:
                with reached(database_of(settings)):
                    fleet.look()
                away = None
            except StorageUnavailable as error:
                if away is None:
                    log.error("%s: the partitions wait for it", error)
                away = str(error)


@contextmanager
def _front(settings: Settings, announce: Callable[[str], None], stop: threading.Event) -> Iterator[None]:
    """A front end in a thread of its own, until `stop` is set."""
    from service.fleet.front import serve_front
    from service.runtime import SERVES

    failed: list[Exception] = []

    def serve() -> None:
        try:
            serve_front(settings, announce=lambda address: announce(f"{SERVES} {address}"), stop=stop)
        except Exception as error:
            failed.append(error)
        finally:
            stop.set()

    thread = threading.Thread(target=serve, name="front end", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(FRONT_WAIT)
    if failed:
        raise failed[0]


def _reached(endpoint: str) -> str:
    """How this machine reaches a router that listens at an endpoint."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
