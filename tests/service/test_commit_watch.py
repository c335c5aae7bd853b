"""Whoever waits for commits notices each of another process's, and asks the database only where it was written to."""

from __future__ import annotations

import random
import sqlite3
import threading
import time

import pytest

from service.results.commit_watch import FileWatch


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


def add(db, number):
    with db:
        db.execute("INSERT INTO numbers VALUES (?)", (number,))


def test_the_latest_of_many_commits_in_quick_succession_is_always_noticed(path):
    db, watch, seen, rng = (
        sqlite3.connect(path, check_same_thread=False),
        FileWatch(Asked(path), path),
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
                add(db, number)
            end = time.monotonic() + 3.0  # before the wait is over and there is a look without a notice
            while seen[-1] != number and time.monotonic() < end:
                time.sleep(0.002)
            assert seen[-1] == number, burst
            time.sleep(rng.choice((0.0, 0.01, 0.1, 0.4)))
    finally:
        ended.set()
        add(db, 0)
        thread.join(10)
        watch.close()
        db.close()


def test_a_file_that_nobody_writes_to_is_asked_seldom(path):
    asked = Asked(path)
    watch = FileWatch(asked, path)
    assert watch.wait(0.1) == ()
    while watch.wait(0.2) is not None or time.time_ns() - path.stat().st_mtime_ns < 10**9:
        pass
    before = asked.count
    for _ in range(20):
        assert watch.wait(0.2) is None
    assert asked.count - before <= 3
    watch.close()


def test_a_commit_that_the_times_of_the_files_do_not_show_is_noticed(path, monkeypatch):
    """Some file systems keep whole seconds, and the log is written over."""
    watch, db = FileWatch(Asked(path), path), sqlite3.connect(path)
    monkeypatch.setattr(watch, "_as_written", lambda: [(0, 0), (0, 0)])
    assert watch.wait(0.1) == ()
    add(db, 1)
    assert watch.wait(30.0) == ()
    watch.close()
    db.close()


def test_a_commit_while_its_connection_was_lost_is_noticed(path):
    watch, db = FileWatch(Asked(path), path), sqlite3.connect(path)
    assert watch.wait(0.1) == ()
    watch.close()
    add(db, 1)
    assert watch.wait(1.0) == ()
    watch.close()
    db.close()
