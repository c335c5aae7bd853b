"""The service's loop under seeded schedules: a database that fails at any statement, commits without an answer, kills.

All of it runs in one thread, in the order that a seed says, so that a schedule that fails does so again. More of them:

    GEAR_TWIN_TEST_SCHEDULES=10000 pytest tests/service/test_schedules.py
"""

from __future__ import annotations

import os
import random
import shutil
from contextlib import ExitStack, contextmanager
from unittest.mock import patch

import fake_twin
import pytest
import service_fakes as fakes
from loops import work_of
from memory_transport import MemoryNetwork
from service_streams import write_recording
from sqlalchemy import event, select
from sqlalchemy.engine import Engine

from service.errors import StorageUnavailable
from service.json_text import plain
from service.results import window_jobs
from service.results.data_folder import SEGMENTS
from service.results.database import Database
from service.results.jobs import WINDOW
from service.results.schema import JOBS
from service.results.schema import WINDOWS as WINDOW_ROWS
from service.results.sql_store import SqlStore
from service.runtime import storage_watch
from service.runtime.assess import assess
from service.runtime.begun import Begun
from service.runtime.learning_phase import LearningPhase
from service.runtime.rigs import GivenRigs, OfferedRigs
from service.runtime.state_publication import StatePublication
from service.runtime.worker import Worker
from service.settings import Settings
from service.stream.sources.mcap import Recording

ASSET, WINDOWS = "unsw", 5
SIGNALS = ((2**28, WINDOWS), (1, 1), (0, 0))  # what they may take [bytes], and of how many windows they are kept then


class Killed(BaseException):
    """The process ends here."""

    unknown = True  # whatever is tidied up where it is known that nothing was committed, a killed process does not


class Faults:
    """What happens at which statement or commit from now on."""

    def __init__(self):
        self.due, self.kind, self.happened = 0, None, []

    @contextmanager
    def watching(self):
        """Counts all statements and commits while inside."""
        commit = Database._commit

        def committed(database, db, mark):
            after = self.at("commit")
            commit(database, db, mark)
            if after is not None:
                _raise(after)

        def stated(*given):
            self.at("statement")

        event.listen(Engine, "before_cursor_execute", stated)
        try:
            with patch.object(Database, "_commit", committed):
                yield
        finally:
            event.remove(Engine, "before_cursor_execute", stated)

    def arm(self, due, kind):
        self.due, self.kind = due, kind

    def at(self, where):
        """Counts one statement or commit; raises what is due before it, and answers what is due after it."""
        if self.kind is None:
            return None
        self.due -= 1
        if self.due > 0 or (self.kind in AFTER and where != "commit"):
            return None
        kind, self.kind = self.kind, None
        self.happened.append((where, kind))
        if kind not in AFTER:
            _raise(kind)
        return kind


OVERTAKEN = 0.15  # share of the turns
AFTER = ("unanswered", "killed after")
KINDS = ("lost", "killed", *AFTER)


def _raise(kind):
    if kind.startswith("killed"):
        raise Killed
    raise StorageUnavailable("the connection is lost", reason="connection lost", unknown=kind == "unanswered")


class Workers:
    """Turns that are carried out at once, by the service or by one of two that share nothing with it but its database.

    Some are overtaken: while one has yet to commit what it has made, another one carries out the same job.
    """

    def __init__(self, rng, here, others):
        self.rng, self.works = rng, [here, *others]

    def start(self, turn, done):
        work, other = self.rng.sample(self.works, 2)
        if self.rng.random() < OVERTAKEN:
            commit = work._commits.commit

            def overtaken(*given):
                work._commits.commit = commit
                other.turn(turn)
                commit(*given)

            work._commits.commit = overtaken
            try:
                done(work.turn(turn))
            finally:
                work._commits.commit = commit
        else:
            done(work.turn(turn))

    def collect(self):
        pass

    def unusable(self):
        return None

    def at_work(self):
        return ()


class Service:
    """A service in this thread: frames are handed to it, and its loop is turned by hand.

    Its database and its files outlive it; all else is gone when it is killed.
    """

    def __init__(self, data, faults, rng, signal_bytes):
        self.data, self.faults, self.rng, self.signal_bytes, self.starts = data, faults, rng, signal_bytes, 0
        self.stack = ExitStack()

    def start(self):
        """Starts it, as often as it takes."""
        while True:
            self.starts += 1
            try:
                self._start()
                return
            except StorageUnavailable:
                self.end()

    def _start(self):
        settings, network = Settings(data=self.data, signal_bytes=self.signal_bytes), MemoryNetwork()
        begun = Begun.of(settings, GivenRigs.read(None, {}), lambda: SqlStore(self.data / "twin.sqlite"))
        self.begun, self.kept = self.stack.enter_context(begun), begun.kept
        others = [work_of(begun.store, self.data, signals=begun.kept.signals) for _ in range(2)]
        self.worker = Worker(
            settings, begun.kept, begun.rigs, fake_twin.TWIN, network.open,
            computing_of=lambda settings, twin, here, wake: Workers(self.rng, here.__self__, others),
        )  # fmt: skip
        self.worker._beat = self.worker._supervised = lambda: None
        publication, offered = StatePublication(network, begun.table), OfferedRigs(network, begun.kept.unknown)
        _, self.streams, self.between = self.worker._prepared(network, publication, offered)
        self.worker._go_on()

    def end(self):
        self.faults.kind = None
        self.stack.close()

    def turn(self):
        self.between()


class Schedule:
    """What happens, in the order of a seed."""

    def __init__(self, seed, data, frames):
        self.rng, self.frames, self.sent = random.Random(seed), frames, 0
        self.faults = Faults()
        self.service = Service(data, self.faults, self.rng, SIGNALS[seed % len(SIGNALS)][0])
        self.asked = []  # jobs of people: number, kind and given, as far as they were acknowledged
        self.names = 0

    def run(self):
        """Everything is sent and carried out; the service that is left."""
        with self.faults.watching():
            self._alive(self.service.start)
            while self.sent < len(self.frames):
                self._alive(self.rng.choices((self._send, self._ask, self._arm, self._kill), (8, 3, 3, 0.1))[0])
            self.faults.kind = None
            self._alive(lambda: self.service.streams.flush(ASSET))
            for _ in range(20):
                self._alive(self.service.turn)
        return self.service

    def _alive(self, action):
        """Does something; a service that is killed meanwhile is started again, and gets all frames again."""
        try:
            action()
        except Killed:
            self.service.end()
            self.sent = 0
            self._alive(self.service.start)

    def _send(self):
        for frame in self.frames[self.sent : self.sent + self.rng.randint(1, 12)]:
            self.service.streams.feed(frame)
            self.sent += 1
        self.service.turn()

    def _ask(self):
        if self.service.begun.table.latest(ASSET) is None:
            return
        kind, given = self.rng.choice(GIVEN)
        if kind == "renamed":
            self.names += 1
            given = {**given, "name": f"press-{self.names}"}
        try:
            number = self.service.kept.queue.submit(ASSET, kind, given)
        except StorageUnavailable:
            return
        self.asked.append(number)
        self.service.turn()

    def _arm(self):
        if self.faults.kind is None:
            self.faults.arm(self.rng.choice((1, 3, 9, 27)) * self.rng.randint(1, 3), self.rng.choice(KINDS))

    def _kill(self):
        raise Killed


SIGNED = {"by": "Anna", "note": None}
GIVEN = (
    ("decision", {"name": "misalignment", "verb": "pin", **SIGNED}),
    ("decision", {"name": "misalignment", "verb": "reject", **SIGNED}),
    ("inspection", {"inspection": {"revolutions": 10.0, "max_depth_um": 20.0}, "answer": {}}),
    ("oil_changed", {"by": "Anna"}),
    ("renamed", {"by": "Anna"}),
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The frames of a campaign, and what an undisturbed run makes of them."""
    path = write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)
    with Recording(path) as recording:
        frames = list(recording.frames(lambda channel, error: None))
    return frames, plain(assess(path, twin=fake_twin.TWIN))["windows"]


@pytest.fixture(scope="module")
def template(tmp_path_factory):
    """A data folder with an empty database."""
    folder = tmp_path_factory.mktemp("template")
    SqlStore(folder / "twin.sqlite").close()
    return folder


@pytest.fixture
def at_once():
    """No pauses between attempts, no first seconds in which channels are learned, no disk that is waited for."""
    with ExitStack() as stack:
        stack.enter_context(patch.multiple(storage_watch, FIRST_PAUSE=0.0, LONGEST_PAUSE=0.0))
        stack.enter_context(patch.object(window_jobs, "sync_folder", lambda folder: None))
        stack.enter_context(patch("os.fsync", lambda file: None))
        stack.enter_context(patch.object(LearningPhase, "begin", lambda phase, asset, now: None))
        yield


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", range(4))
def test_whatever_fails_everything_is_kept_once_in_order_and_shown(part, recorded, template, tmp_path, at_once):
    count = int(os.environ.get("GEAR_TWIN_TEST_SCHEDULES", "60"))
    for seed in range(part, count, 4):
        data = tmp_path / str(seed)
        shutil.copytree(template, data)
        check(seed, data, *recorded)
        shutil.rmtree(data)


def check(seed, data, frames, windows):
    """One schedule, and what must hold after it."""
    schedule = Schedule(seed, data, frames)
    service = schedule.run()
    what = f"seed {seed}: {schedule.faults.happened}"
    store, table = service.kept.store, service.begun.table
    try:
        stored = plain([window.record for window in store.windows(ASSET)])
        judged = ("start_time", "quality", "revolutions", "rms_measured", "rms_predicted", "wear_depth_um", "index")
        assert [[w[n] for n in judged] for w in stored] == [[w[n] for n in judged] for w in windows], what
        jobs = service.kept.queue.jobs._read(select(JOBS).where(JOBS.c.kind != WINDOW).order_by(JOBS.c.id))
        assert all(job.done for job in jobs), what
        assert {*schedule.asked} <= {job.id for job in jobs}, what
        done = [job for job in jobs if job.refused is None]
        state = store.asset(ASSET).state
        decided = [[j.given["name"], j.given["verb"]] if j.kind == "decision" else [j.kind, "None"]
                   for j in done if j.kind in ("decision", "oil_changed")]  # fmt: skip
        assert [list(each) for each in state["decided"]] == decided, what
        assert len(state["inspected"]) == sum(job.kind == "inspection" for job in done), what
        events = store.events(ASSET, 0, 10_000)
        kinds = [event.kind for event in events]
        assert kinds.count("window") == len(windows) and kinds.count("inspection") == len(state["inspected"]), what
        named = [
            event.data["effect"]["asset"]
            for event in events
            if event.kind == "change" and event.data["kind"] == "renamed"
        ]
        assert named == [job.given["name"] for job in done if job.kind == "renamed"], what
        again = fakes.WrittenTable(store)
        shown, read = table.get(ASSET), again.get(ASSET)
        for part in ("records", "report", "alarms", "question", "label", "windows_total", "updates", "last_event_id"):
            assert getattr(shown, part) == getattr(read, part), (what, part)
        named = {row[0] for row in store.database.rows(select(WINDOW_ROWS.c.segment))}
        assert not service.kept.windows.waiting(ASSET), what
        assert named - {None} <= {path.name for path in (data / SEGMENTS).iterdir()}, what
    finally:
        service.end()
    service.start()  # deletes what a process that was killed has left
    service.end()
    files = {path.name for path in (data / SEGMENTS).iterdir()}
    assert (files, len(files)) == (named - {None}, SIGNALS[seed % len(SIGNALS)][1]), what
