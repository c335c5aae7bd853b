"""Whoever waits for commits notices each of another process's, and asks the database only where it was written to."""

from __future__ import annotations

import random
import sqlite3
import threading
import time
from types import SimpleNamespace

import pytest

from service.results import commit_watch
from service.results.commit_watch import SOMETHING, FileWatch, Noticed, ServerWatch, Shown, say_committed


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "twin.sqlite"
    with sqlite3.connect(path) as db:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("CREATE TABLE numbers (n INTEGER)")
    db.close()
    return path


class Asked:
    """Connections that count what they are asked."""

    def __init__(self, path):
        self.path, self.count = path, 0

    def __call__(self):
        connection = sqlite3.connect(self.path, check_same_thread=False)
        connection.set_trace_callback(lambda statement: setattr(self, "count", self.count + 1))
        return connection


def add(db, path, number):
    with db:
        db.execute("INSERT INTO numbers VALUES (?)", (number,))
    say_committed(path.parent)


def test_the_latest_of_many_commits_in_quick_succession_is_always_noticed(path):
    db, watch, seen, rng = (
        sqlite3.connect(path, check_same_thread=False),
        FileWatch(Asked(path), path.parent),
        [0],
        random.Random(1),
    )
    ended = threading.Event()

    def look():
        reader = sqlite3.connect(path)
        while not ended.is_set():
            if watch.wait(5.0) is not None:
                seen.append(reader.execute("SELECT coalesce(max(n), 0) FROM numbers").fetchone()[0])
        reader.close()

    thread = threading.Thread(target=look)
    thread.start()
    try:
        number = 0
        for burst in range(30):
            for _ in range(rng.randint(1, 4)):
                number += 1
                add(db, path, number)
            end = time.monotonic() + 1.0  # before there is a look without a notice
            while seen[-1] != number and time.monotonic() < end:
                time.sleep(0.002)
            assert seen[-1] == number, burst
            time.sleep(rng.choice((0.0, 0.01, 0.1, 0.4)))
    finally:
        ended.set()
        add(db, path, 0)
        thread.join(10)
        watch.close()
        db.close()


def test_a_file_that_nobody_writes_to_is_asked_seldom(path):
    asked = Asked(path)
    watch = FileWatch(asked, path.parent)
    assert watch.wait(0.1) is SOMETHING
    before = asked.count
    for _ in range(20):
        assert watch.wait(0.2) is None
    assert asked.count - before <= 3
    watch.close()


@pytest.mark.parametrize("inotify", [True, False])
def test_a_commit_of_which_nothing_is_said_is_noticed(path, inotify, monkeypatch):
    """Its process was killed just then; and systems without inotify."""
    if not inotify:
        monkeypatch.setattr("ctypes.CDLL", lambda name: object())
    watch, db = FileWatch(Asked(path), path.parent), sqlite3.connect(path)
    assert watch.wait(0.1) is SOMETHING
    with db:
        db.execute("INSERT INTO numbers VALUES (1)")
    assert watch.wait(30.0) is SOMETHING
    watch.close()
    db.close()


def test_no_more_notices_than_the_system_has_are_needed(path, monkeypatch):
    monkeypatch.setattr("ctypes.CDLL", lambda name: SimpleNamespace(inotify_init1=lambda flags: -1))
    watch, db = FileWatch(Asked(path), path.parent), sqlite3.connect(path)
    assert watch.wait(0.1) is SOMETHING
    add(db, path, 1)
    assert watch.wait(30.0) is SOMETHING
    watch.close()
    db.close()


def test_a_commit_while_its_connection_was_lost_is_noticed(path):
    watch, db = FileWatch(Asked(path), path.parent), sqlite3.connect(path)
    assert watch.wait(0.1) is SOMETHING
    watch.close()
    add(db, path, 1)
    assert watch.wait(1.0) is SOMETHING
    watch.close()
    db.close()


def test_a_server_that_always_has_something_to_say_is_looked_behind_twice_a_second(monkeypatch):
    """A notice that was lost, as its process was killed just then, was never looked for while others kept coming."""
    now, said = [100.0], ["names", "", "0 7 unsw", "12 3 a b", "unsw", "x 1 unsw", "1 unsw"]
    server = SimpleNamespace(
        execute=lambda statement: None,
        notifies=lambda timeout, stop_after=None: [SimpleNamespace(payload=each) for each in said[:stop_after]],
        close=lambda: None,
    )
    monkeypatch.setattr(commit_watch, "time", SimpleNamespace(monotonic=lambda: now[0]))
    watch = ServerWatch(lambda: server)
    assert watch.wait(1.0) == Noticed(named=True, missed=True)  # what was said before it listened
    rows, looks = frozenset({Shown(0, 7, "unsw"), Shown(12, 3, "a b")}), []
    for _ in range(20):
        noticed = watch.wait(1.0)
        assert (noticed.shown, noticed.named, noticed.missed) == (rows, True, False)
        looks.append(noticed.look)
        now[0] += 0.125
    assert looks == [True, False, False, False] * 5
