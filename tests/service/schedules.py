"""A service's processes under a seeded scheduler: one thread, a false clock, a database that fails at any statement.

Who receives, three who compute and one who answers share a database and a folder, and nothing else. One of them runs at
a time, in the order of a seed, and can be killed, suspended at a statement while the others go on, or told nothing of
what was committed. The replica that takes the database's place lags behind it.
"""

from __future__ import annotations

import json
import logging
import random
import shutil
import sqlite3
import sys
import time
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import cache
from types import FunctionType
from unittest.mock import patch

import fake_twin
import service_fakes as fakes
import service_streams
import sqlalchemy as sa
from memory_transport import MemoryNetwork
from sqlalchemy import event, select
from sqlalchemy.dialects import sqlite
from sqlalchemy.engine import Engine

from service import steady_clock
from service.alarms.keeper import AlarmKeeper
from service.errors import SteppedBack, StorageUnavailable
from service.json_text import plain
from service.results import database as database_module
from service.results import fault_totals, sql_store, window_jobs
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.backends import SqliteFile
from service.results.commit_marks import Mark
from service.results.commit_watch import Noticed
from service.results.data_folder import SEGMENTS
from service.results.database import Database
from service.results.job_queue import JobQueue
from service.results.jobs import NOTICE, Jobs
from service.results.schema import JOBS, WINDOW
from service.results.schema import WINDOWS as WINDOW_ROWS
from service.results.sql_store import SqlStore
from service.runtime import begun
from service.runtime import receiver as receiving
from service.runtime.assess import assess
from service.runtime.begun import Begun
from service.runtime.feed import Feed
from service.runtime.learning_phase import LearningPhase
from service.runtime.questions import REPEATED
from service.runtime.rigs import GivenRigs, OfferedRigs
from service.runtime.staleness import StalenessWatch
from service.runtime.state_publication import StatePublication
from service.runtime.work import Workplace
from service.runtime.work_loop import WorkLoop
from service.settings import Settings
from service.stream.frames import SampleFrame
from service.stream.sources.mcap import Recording

ASSET, WINDOWS, FRAME_S = "unsw", 3, 1.0
WORKERS = 3
SIGNALS = ((2**28, WINDOWS), (1, 1), (0, 0))  # what they may take [bytes], and of how many windows they are kept then
NS = 10**9
CLOCK = time.monotonic
BEGAN_NS = 1_800_000_000 * NS
DONE_WITHIN = 400  # turns after which everything has been carried out, once nothing fails any more
HEARD = 0.8  # share of the notifications that arrive


class Killed(BaseException):
    """The process ends here."""

    unknown = True  # whatever is tidied up where it is known that nothing was committed, a killed process does not


# -- what fails ------------------------------------------------------------------------------------------------

AFTER = ("unanswered", "killed after")  # a commit
KINDS = ("lost", "killed", "suspended", *AFTER)


class Faults:
    """What happens at which statement or commit from now on.

    suspend  called where whoever is at the statement does not go on before others have
    spared   whether whoever is there is not to be killed
    """

    def __init__(self, suspend, spared):
        self.due, self.kind, self.happened, self.statements = 0, None, [], 0
        self._suspend, self._spared = suspend, spared

    def arm(self, due, kind):
        self.due, self.kind = due, kind

    def at(self, where, may_stop=False):
        """Counts one statement or commit; raises what is due before it, and answers what is due after it."""
        self.statements += where == "statement"
        if self.kind is None:
            return None
        self.due -= 1
        if self.due > 0 or (self.kind in AFTER and where != "commit") or (self.kind == "suspended" and not may_stop):
            return None
        kind, self.kind = self.kind, None
        if self._spared():
            kind = {"killed": "lost", "killed after": "unanswered"}.get(kind, kind)
        self.happened.append((where, kind))
        if kind == "suspended":
            self._suspend()
        elif kind not in AFTER:
            fail(kind)
        return kind


def fail(kind):
    if kind.startswith("killed"):
        raise Killed
    raise StorageUnavailable("the connection is lost", reason="connection lost", unknown=kind == "unanswered")


class Server(SqliteFile):
    """A file that behaves like a server of which another one may take the place: what is confirmed is marked."""

    upgrades = False  # it is a copy of one that has its tables, and is sound

    def __init__(self, path, writer):
        super().__init__(path)
        self.writer, self.number = writer, 0

    def examine(self, engine):
        pass

    def mark(self, db):
        self.number += 1
        db.connection.driver_connection.execute(
            "INSERT INTO commits VALUES (?, ?, 0) ON CONFLICT (writer) DO UPDATE SET number = excluded.number",
            (self.writer, self.number),
        )
        return Mark(self.writer, self.number, "")


def is_there(connection, mark):
    """As that of PostgreSQL's driver."""
    found = connection.execute("SELECT number FROM commits WHERE writer = ?", (mark.writer,)).fetchone()
    return found is not None and found[0] >= mark.number


# -- the world -------------------------------------------------------------------------------------------------


class World:
    """What outlives every process: the data, the clock, and what is immutable and made once for all schedules.

    running  the schedule whose processes run
    """

    def __init__(self, folder):
        self.folder, self.now_ns, self.set_ns, self.running = folder, 0, 0, None
        recorded = folder / "recorded.mcap"
        with patch.object(service_streams, "FRAME_S", FRAME_S):
            service_streams.write_recording(recorded, WINDOWS)
        with Recording(recorded) as recording:
            self.frames = list(recording.frames(lambda channel, error: None))
        self.windows = plain(assess(recorded, twin=fake_twin.TWIN))["windows"]
        self.template = folder / "template.sqlite"
        SqlStore(self.template).close()
        data = folder / "data"
        self.settings = [Settings(data=data, signal_bytes=limit) for limit, _ in SIGNALS]
        self.rigs = GivenRigs.read(None, {})

    def begin(self, schedule):
        """The clock begins again, and the processes of a schedule run."""
        self.now_ns, self.set_ns, self.running = 0, 0, schedule

    def pass_time(self, seconds):
        self.now_ns += round(seconds * NS)

    @contextmanager
    def entered(self):
        """The clock is false, nothing waits for a disk or for channels that may come, and statements are counted."""
        world, commit, create, first = self, Database._commit, sa.create_engine, []

        def engine(url, **given):
            """Engines share the statements that they have compiled: what those are made of is immutable."""
            new = create(url, **given)
            first[:] = first or [(new.dialect, new._compiled_cache)]
            new.dialect, new._compiled_cache = first[0]
            return new

        def committed(database, db, mark):
            after = world.running.faults.at("commit")
            commit(database, db, mark)
            world.running.notify(database._present.shown)
            if after is not None:
                fail(after)

        def stated(*given):
            if world.running is not None:
                world.running.faults.at("statement", world.running.nobody_writes)

        with ExitStack() as stack:
            for init in _given_clocks():
                stack.enter_context(patch.object(init, "__kwdefaults__", _clocked(init.__kwdefaults__, world)))
                stack.enter_context(patch.object(init, "__defaults__", _clocked(init.__defaults__, world)))
            monotonic = {"monotonic": lambda: world.now_ns / NS, "monotonic_ns": lambda: world.now_ns}
            real = {"time_ns": lambda: BEGAN_NS + world.now_ns + world.set_ns, "sleep": world.pass_time}
            for module, given in (
                (time, monotonic | real),
                (steady_clock, {"_BEGAN_NS": BEGAN_NS}),
                (sa, {"create_engine": engine}),
                (database_module, {"is_there": is_there}),
                (Database, {"_commit": committed}),
                (SqliteFile, {"insert": staticmethod(cache(sqlite.insert))}),
                (sql_store, {"adding": cache(sql_store.adding)}),
                (fault_totals, {"adding": cache(fault_totals.adding)}),
                (begun, {"long_lived": nullcontext}),
                (window_jobs, {"sync_folder": lambda folder: None}),
                (LearningPhase, {"begin": lambda phase, asset, now: None}),
            ):
                stack.enter_context(patch.multiple(module, **given))
            stack.enter_context(patch("os.fsync", lambda file: None))
            stack.callback(logging.disable, logging.root.manager.disable)
            logging.disable(logging.CRITICAL)  # thousands of lines of failures that are meant
            event.listen(Engine, "before_cursor_execute", stated)
            try:
                yield self
            finally:
                event.remove(Engine, "before_cursor_execute", stated)


def _given_clocks():
    """The constructors that are given a clock."""
    modules = [module for name, module in sys.modules.items() if name.startswith("service.")]
    classes = {each for module in modules for each in vars(module).values() if isinstance(each, type)}
    inits = {init for each in classes if isinstance(init := vars(each).get("__init__"), FunctionType)}
    return [init for init in inits if CLOCK in (*(init.__defaults__ or ()), *(init.__kwdefaults__ or {}).values())]


def _clocked(defaults, world):
    """Defaults with the false clock."""
    clocks = {CLOCK: lambda: world.now_ns / NS}
    if isinstance(defaults, dict):
        return {name: clocks.get(each, each) if callable(each) else each for name, each in defaults.items()}
    return defaults and tuple(clocks.get(each, each) if callable(each) else each for each in defaults)


# -- processes -------------------------------------------------------------------------------------------------


class Nobody:
    """Those who compute, who are processes of their own; and claims that exclude nobody."""

    thread = None

    def unusable(self):
        return None

    def stuck(self):
        return None

    def at_work(self):
        return ()

    def take(self, asset):
        return True

    def give_back(self, asset):
        pass


class Process:
    """One process: all that it has is gone when it ends.

    lives  how often it has been started
    told   the rows of which it has been told since it last looked; None where it has been told nothing
    """

    def __init__(self, schedule, name):
        self.schedule, self.name, self.lives, self.told = schedule, name, 0, None
        self.stack, self.store = ExitStack(), None

    def start(self):
        """Starts it, as often as it takes."""
        while True:
            self.lives += 1
            try:
                self.begin()
                return
            except StorageUnavailable:
                self.end()

    def begin(self):
        raise NotImplementedError

    def end(self):
        """Ends it where it is, as a kill does: nothing is tidied up."""
        self.schedule.faults.kind = None
        self.stack.pop_all()
        if self.store is not None:
            self.disconnect()
        self.store = None

    def disconnect(self):
        self.store.database._writer.dispose()
        self.store.database._reader.dispose()

    def opened(self, **given):
        """The database of this process."""
        server = Server(self.schedule.file, f"{self.name} {self.lives}")
        self.store = self.stack.enter_context(SqlStore(server, **given))
        return self.store

    def look(self):
        """What it does where something has been committed, or where nothing was noticed for a while."""
        told, self.told = self.told, None
        look = told is None or self.schedule.rng.random() < 0.5
        with suppress(StorageUnavailable):
            self.feed.turn(Noticed(told or frozenset(), look))


class Ingest(Process):
    """Who receives frames."""

    def begin(self):
        schedule = self.schedule
        network = self.network = MemoryNetwork()
        has = Begun.of(schedule.settings, schedule.world.rigs, lambda: self.opened(claimed=True))
        for _ in range(schedule.rng.choice((0, 0, 0, 4))):  # until the network is there, others go on
            schedule.turn_of_another()
        self.kept, self.table = has.kept, has.table
        reception = self.reception = receiving.Receiver(
            schedule.settings, has.kept, has.rigs, fake_twin.TWIN, network.open, workers_of=lambda *given: Nobody()
        )
        reception._beat = lambda: None
        self.feed = reception._feed
        changes = self.stack.enter_context(has.table.follow(fleeting=False))
        publication, offered = StatePublication(network, has.table), OfferedRigs(network, has.kept.unknown)
        with patch.object(receiving, "StalenessWatch", self._watching):
            _, self.streams, self.between = reception._prepared(network, publication, offered, changes)

    def _watching(self, *given, **named):
        self.watch = StalenessWatch(*given, **named)
        return self.watch

    def stored_until_ns(self):
        """Until when frames are stored, by what it has published last [ns]; None where it has said nothing of that."""
        positions = self.network.positions
        return json.loads(positions[-1][1])["settled_until_ns"] if positions else None

    def turn(self):
        self.between()
        if self.schedule.rng.random() < 0.5:
            self.look()


class Compute(Process):
    """One of those who compute.

    row  of the job that it is at
    """

    row, ended_at = 0, None

    def begin(self):
        place = Workplace(
            settings=self.schedule.settings, open=lambda: self.opened(shared=True), make=lambda _: fake_twin.TWIN,
            options=None,
        )  # fmt: skip
        work = place.work(self.at, self.name)
        jobs = Jobs(work.database)
        if self.ended_at:  # the role that has forked it says so
            jobs.failed(self.ended_at, "ended its worker process")
            self.ended_at = None
        self.loop = WorkLoop(work, jobs, Nobody(), self.name, at=lambda asset: self.at(0) if asset is None else None)

    def at(self, row, refused=False):
        self.row = row

    def end(self):
        super().end()
        self.row, self.ended_at = 0, self.row or self.ended_at
        if self.ended_at:
            self.schedule.blamed.add(self.ended_at)

    def turn(self):
        with suppress_unavailable():
            self.loop.turn()


class Answer(Process):
    """Who answers people, and takes what they ask."""

    shown = (0, 0)

    def begin(self):
        store = self.opened(shared=True)
        self.table = AssetTable(store, AlarmKeeper(AlarmStore(store.database)))
        self.queue, self.feed = JobQueue(Jobs(store.database)), Feed(store, self.table)

    def ask(self, kind, given):
        """A person asks for a job; whether that was acknowledged."""
        with suppress_unavailable():
            self.queue.submit(ASSET, kind, given)
            return True
        return False

    def turn(self):
        """A person looks at the asset: nothing that was shown before is gone."""
        self.look()
        with suppress_unavailable():
            snapshot = self.table.get(ASSET)
            shown = (0, 0) if snapshot is None else (snapshot.windows_total, snapshot.last_event_id)
            assert all(new >= old for new, old in zip(shown, self.shown, strict=True)), (shown, self.shown)
            self.shown = shown


@contextmanager
def suppress_unavailable():
    """Storage that cannot be used now is tried again; one that has stepped back ends the process."""
    try:
        yield
    except SteppedBack:
        raise
    except StorageUnavailable:
        pass


# -- schedules -------------------------------------------------------------------------------------------------

GIVEN = (
    ("decision", {"name": "misalignment", "verb": "pin"}),
    ("decision", {"name": "misalignment", "verb": "reject"}),
    ("inspection", {"inspection": {"revolutions": 10.0, "max_depth_um": 20.0}, "answer": {}}),
    ("oil_changed", {}),
    ("renamed", {}),
)


class Schedule:
    """What happens, in the order of a seed.

    asked    by whom, as far as it was acknowledged
    blamed   rows of jobs that have ended a worker: another time, and they would be refused
    at       processes that have begun something, the innermost last
    """

    def __init__(self, world, seed):
        self.world, self.rng, self.seed = world, random.Random(seed), seed
        self.settings, self.kept = world.settings[seed % len(SIGNALS)], SIGNALS[seed % len(SIGNALS)][1]
        self.data = self.settings.data
        self.file = self.data / "twin.sqlite"
        self.faults = Faults(self._suspend, self._spared)
        self.asked, self.blamed, self.people, self.at, self.fail_overs = set(), set(), 0, [], 0
        self.ingest, self.answer = Ingest(self, "ingest"), Answer(self, "answer")
        self.workers = [Compute(self, f"worker {number}") for number in range(WORKERS)]
        self.processes = [self.ingest, *self.workers, self.answer]
        self.sent, self.sent_to, self.flushed, self.silences = 0, 0, 0, 0
        self.heard, self.all_again = None, False  # until when frames are stored, as far as that holds
        self.did = []  # what has been done, by name: the same for the same seed

    @property
    def nobody_writes(self):
        """Whether no process is in a transaction: who is suspended there has all others wait."""
        stores = [process.store for process in self.processes if process.store is not None]
        return bool(self.at) and all(store.database._present.db is None for store in stores)

    def notify(self, shown):
        """Something has been committed, and some rows by which assets are shown: who is told of it looks."""
        for process in self.processes:
            if self.rng.random() < HEARD:
                process.told = (process.told or frozenset()) | shown

    # -- all of it -----------------------------------------------------------------------------------

    def run(self):
        """Everything is sent and carried out."""
        shutil.rmtree(self.data, ignore_errors=True)
        self.data.mkdir()
        shutil.copyfile(self.world.template, self.file)
        self.world.begin(self)
        self.rows, self.replica = sqlite3.connect(self.file), sqlite3.connect(":memory:")
        self._catch_up()
        for process in self.processes:
            self._do(process, process.start)
        while self.sent < len(self.world.frames):
            self._act()
        for _ in range(DONE_WITHIN):
            self.faults.kind = None
            if self._is_done():
                break
            self.world.pass_time(0.3)
            self._send()
            self._turn()
        else:
            raise AssertionError("not everything is carried out")
        for _ in range(2):
            self.world.pass_time(2.0)  # after which silence is looked for again
            for process in self.processes:
                self._do(process, process.turn)
        for process in (self.answer, self.ingest):
            process.told = None  # nothing comes any more: it looks by itself
            process.look()

    def close(self):
        for process in self.processes:
            process.end()
        self.rows.close()
        self.replica.close()
        self.world.running = None

    def _act(self):
        self.world.pass_time(self.rng.choice(PAUSES))
        (action,) = self.rng.choices(*ACTIONS)
        self.did.append(action)
        getattr(self, action)()

    def _is_done(self):
        """Whether all windows are there, and nobody waits for anything."""
        ((windows,),) = self.rows.execute("SELECT count(*) FROM windows")
        ((waiting,),) = self.rows.execute("SELECT count(*) FROM jobs WHERE kind = 'window' OR done = 0")
        return windows == WINDOWS and not waiting

    def _do(self, process, action):
        """Has a process do something; one that is killed meanwhile is started again."""
        lives = process.lives
        self.at.append(process)
        try:
            action()
        except Killed:
            if process.lives == lives:
                self._start_again(process)
        except SteppedBack:
            self.faults.happened.append((process.name, "stepped back"))
            for worker in self.workers:  # end with who has forked them: nobody is left who would say at what
                worker.row = 0
            self._start_again(*self.processes)
        finally:
            self.at.remove(process)

    def _start_again(self, *processes):
        for process in processes:
            process.end()
        for process in processes:
            self._do(process, process.start)

    # -- what processes do ---------------------------------------------------------------------------

    def _free(self, *of):
        """Processes that are not in the midst of something."""
        return [process for process in of or self.processes if process not in self.at]

    def _turn(self):
        process = self.rng.choice(self._free())
        self._do(process, process.turn)

    def turn_of_another(self):
        """A process that has begun goes on, where any has."""
        begun = [process for process in self._free() if process.store is not None]
        if begun:
            process = self.rng.choice(begun)
            self._do(process, process.turn)

    def _send(self):
        """Publishes frames, again from what was not stored where who receives them has been started anew."""
        ingest = self.ingest
        if not self._free(ingest):
            return
        if self.sent_to != ingest.lives:
            self.sent_to, self.sent, self.all_again = ingest.lives, self._first_to_send(), False
        frames = self.world.frames[self.sent : self.sent + self.rng.randint(1, 5)]

        def send():
            for frame in frames:
                ingest.streams.feed(frame)
                self.sent += 1
            if self.sent == len(self.world.frames) and self.flushed != ingest.lives:
                ingest.streams.flush(ASSET)
                self.flushed = ingest.lives
            ingest.turn()

        self._do(ingest, send)
        if self.sent_to == ingest.lives and not self.all_again:
            self.heard = ingest.stored_until_ns() or self.heard

    def _first_to_send(self):
        """Which frame a publisher begins with that keeps those that it has not heard to be stored."""
        self.heard = None if self.all_again else self.heard
        if self.heard is None or self.rng.random() < 0.25:
            return 0
        frames = self.world.frames
        return next((i for i, f in enumerate(frames) if f.start_time_ns + FRAME_S * NS > self.heard), len(frames))

    def _silence(self):
        """Two days without a frame."""
        self.silences += 1
        self.world.pass_time(2 * 86_400)
        self._turn()

    def _repeat(self):
        """Frames of passed times come that are not those which were used."""
        ingest = self.ingest
        passed = self.world.frames[: len(self.world.frames) // WINDOWS]
        if not self._free(ingest) or self.sent_to != ingest.lives or self.sent <= 2 * len(passed):
            return

        def send():
            for frame in 4 * [frame for frame in passed if isinstance(frame, SampleFrame)]:
                ingest.streams.feed(replace(frame, values=3 * frame.values))
            ingest.turn()

        self._do(ingest, send)

    def _ask(self):
        answer = self.answer
        if not self._free(answer):
            return
        self.people += 1
        by, (kind, given) = f"person {self.people}", self.rng.choice(GIVEN)
        given = {**given, "by": by, "note": None} | ({"name": f"press-{self.people}"} if kind == "renamed" else {})

        def ask():
            if answer.ask(kind, given):
                self.asked.add(by)

        self._do(answer, ask)

    # -- what happens to them ------------------------------------------------------------------------

    def _arm(self):
        if self.faults.kind is None:
            self.faults.arm(self.rng.choice((1, 3, 9, 27)) * self.rng.randint(1, 3), self.rng.choice(KINDS))

    def _kill(self):
        process = self.rng.choice(self._free())
        self.faults.happened.append((process.name, "killed"))
        self._start_again(process)

    def _suspend(self):
        """Who is at a statement goes on after others have."""
        process, fail_overs = self.at[-1], self.fail_overs
        lives = process.lives
        for _ in range(self.rng.randint(1, 8)):
            self._act()
        if process.lives != lives:
            raise Killed
        if self.fail_overs != fail_overs:
            fail("lost")

    def _spared(self):
        """Whether the process is not to be killed now."""
        return bool(self.at) and getattr(self.at[-1], "row", 0) in self.blamed

    def _set_clock(self):
        """The host's clock is set."""
        self.world.set_ns += self.rng.choice((-3600, -5, 5)) * NS

    def _catch_up(self):
        """The replica has all that is committed."""
        self.rows.backup(self.replica)
        self.asked_there = set(self.asked)

    def _fail_over(self):
        """The replica takes the database's place: all connections are lost, and what it does not have."""
        self.faults.happened.append(("database", "failed over"))
        self.replica.backup(self.rows)
        self.fail_overs += 1
        self.asked, self.all_again = set(self.asked_there), True
        self.answer.shown = (0, 0)
        for process in self.processes:
            if process.store is not None:
                process.disconnect()

    # -- what must hold ------------------------------------------------------------------------------

    def check(self):
        """All windows once, in order; all jobs of people; and everyone shows what is there."""
        what = f"seed {self.seed}: {self.faults.happened}"
        store, windows, table = self.ingest.store, self.world.windows, self.ingest.table
        stored = plain([window.record for window in store.windows(ASSET)])
        judged = ("start_time", "quality", "revolutions", "rms_measured", "rms_predicted", "wear_depth_um", "index")
        assert [[w[n] for n in judged] for w in stored] == [[w[n] for n in judged] for w in windows], what
        jobs = self.ingest.kept.jobs._read(select(JOBS).where(JOBS.c.kind != WINDOW).order_by(JOBS.c.id))
        assert all(job.done for job in jobs) and not any(job.kind == NOTICE for job in jobs), what
        assert self.asked <= {job.given["by"] for job in jobs}, what
        done = [job for job in jobs if job.refused is None]
        assert all(job.refused is None or "FAULT" not in job.refused for job in jobs), what
        state = store.asset(ASSET).state
        decided = [[j.given["name"], j.given["verb"]] if j.kind == "decision" else [j.kind, "None"]
                   for j in done if j.kind in ("decision", "oil_changed")]  # fmt: skip
        assert [list(each) for each in state["decided"]] == decided, what
        assert len(state["inspected"]) == sum(job.kind == "inspection" for job in done), what
        for job in done:
            if job.kind == "oil_changed":  # says the place to which the asset had come, whoever has carried it out
                assert job.outcome["revolutions"] == stored[job.outcome["from_window"] - 1]["revolutions"], what
        events = store.events(ASSET, 0, 10_000)
        kinds = [event.kind for event in events]
        stale = [event.data["detail"] for event in events if event.data.get("kind") == "stale"]
        assert len(stale) <= 2 * (self.silences + self.ingest.lives), what  # and once more where frames come again
        named = [
            event.data["effect"]["asset"]
            for event in events
            if event.kind == "change" and event.data["kind"] == "renamed"
        ]
        assert named == [job.given["name"] for job in done if job.kind == "renamed"], what
        read = fakes.WrittenTable(store).get(ASSET)
        assert read.stale == self.ingest.watch._heard[ASSET].noticed, what
        repeated = ASSET in self.ingest.reception._questions._repeated
        assert (read.question and read.question["kind"]) == (REPEATED if repeated else None), what
        assert kinds.count("window") == len(windows) and kinds.count("inspection") == len(state["inspected"]), what
        for shown in (table.latest(ASSET), self.answer.table.latest(ASSET)):
            for part in SHOWN:
                assert getattr(shown, part) == getattr(read, part), (what, part)
        named = {row[0] for row in store.database.rows(select(WINDOW_ROWS.c.segment))}
        assert not self.ingest.kept.windows.waiting(ASSET), what
        assert named - {None} <= self._files(), what
        self._start_again(self.ingest)  # deletes what a process that was killed has left
        files = self._files()
        assert (files, len(files)) == (named - {None}, self.kept), what

    def _files(self):
        return {path.name for path in (self.data / SEGMENTS).glob("*.mcap")}


SHOWN = ("records", "report", "alarms", "question", "label", "windows_total", "updates", "last_event_id")
PAUSES = (0.0, 0.0, 0.02, 0.3, 1.2, 3.0)  # between two actions [s]
ACTIONS = (
    ("_send", "_turn", "_ask", "_arm", "_kill", "_set_clock", "_catch_up", "_fail_over", "_silence", "_repeat"),
    (8, 16, 3, 5, 0.2, 0.1, 1, 0.3, 0.3, 0.3),
)
