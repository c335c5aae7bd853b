"""Processes say of themselves in rows how they are; whoever reads them knows by a number that rises who lives."""

from __future__ import annotations

import signal

import pytest
from fleets import at_front, worker
from service_streams import Service, free_port, wait_until

from service.fleet.census import census
from service.results.roles import INGEST, RECORD, SILENT, OwnRole, Roles
from service.results.sql_store import SqlStore


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def store(tmp_path):
    with SqlStore(tmp_path / "twin.db") as store:
        yield store


@pytest.mark.parametrize("back", [0, 3600])
def test_a_process_lives_as_long_as_its_number_rises_whatever_the_clocks_of_machines_say(store, monkeypatch, back):
    clock, own = Clock(), OwnRole(store.database, INGEST)
    monkeypatch.setattr("service.results.roles.later_time_ns", lambda: 10**18 - back * 10**9)
    roles = Roles(store.database, clock)
    own.say({"queue_frames": 1.0})
    assert [(r.lives, r.seen) for r in roles.look()] == [(True, False)]  # nobody knows yet
    clock.now += SILENT - 1.0
    own.say({"queue_frames": 2.0}, "the router is away")
    (row,) = roles.look()
    assert (row.lives, row.seen, row.not_ready) == (True, True, "the router is away")
    clock.now += SILENT + 1.0
    assert [r.lives for r in roles.look()] == [False] and roles.figures() == {}
    own.say({"queue_frames": 3.0})
    assert [r.lives for r in roles.look()] == [True] and roles.figures() == {"queue_frames": 3.0}
    own.gone()
    assert roles.look() == []


def test_another_process_of_the_same_role_takes_the_row_and_lives(store):
    clock = Clock()
    roles = Roles(store.database, clock)
    OwnRole(store.database, RECORD).say({})
    roles.look()
    clock.now += SILENT + 1.0
    OwnRole(store.database, RECORD, "node").say({})  # the number of the first word is the same
    assert [(r.lives, r.node) for r in roles.look()] == [(True, "node")]


def test_whoever_looks_once_waits_until_each_has_been_seen_to_live_or_not_to(store, monkeypatch):
    clock, slept, own = Clock(), [], OwnRole(store.database, INGEST)
    own.say({})
    OwnRole(store.database, RECORD).say({})

    def sleep(seconds):
        slept.append(seconds)
        clock.now += seconds
        if len(slept) == 20:
            own.say({})

    monkeypatch.setattr("service.results.roles.time.sleep", sleep)
    roles = Roles(store.database, clock)
    roles.settle()
    assert {r.role: r.lives for r in roles.look()} == {INGEST: True, RECORD: False}
    assert sum(slept) == pytest.approx(SILENT, abs=0.2)


def test_figures_are_numbers_those_of_assets_added_up(store):
    OwnRole(store.database, INGEST).say({"lag_seconds": {"a": 1.0, "b": 2.0}, "frames_left_out": {"no_room": 3}})
    (row,) = Roles(store.database).look()
    assert row.figures == {"lag_seconds": 3.0, "frames_left_out": {"no_room": 3.0}}


@pytest.mark.slow
def test_a_service_says_in_its_row_how_it_is_until_it_ends(tmp_path):
    running = Service(tmp_path).start()
    with running.store() as store:
        roles = Roles(store.database)
        wait_until(lambda: [(r.lives, r.seen, r.not_ready) for r in roles.look()] == [(True, True, None)])
        assert running.end()[0] == 0 and roles.look() == []


@pytest.mark.slow
def test_a_worker_says_why_it_takes_no_frames(tmp_path, fleet):
    """The router is away; a suspended worker says nothing, and counts as one that does not serve."""
    with worker(tmp_path, fleet, f"tcp/127.0.0.1:{free_port()}") as process, at_front(fleet) as store:
        roles, number = Roles(store.database), process.partition
        wait_until(lambda: census(roles).partitions[number]["not_ready"] is not None)
        said = census(roles).partitions[number]
        assert said["served"] and "no router answers" in said["not_ready"], said
        assert not census(roles).receiving
        process.process.send_signal(signal.SIGSTOP)
        wait_until(lambda: number in census(roles).not_served)
        process.process.send_signal(signal.SIGCONT)
        wait_until(lambda: number not in census(roles).not_served)
