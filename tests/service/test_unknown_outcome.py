"""A commit whose outcome nobody can say at first: what a person changed takes effect, once."""

from __future__ import annotations

import pytest
from service_streams import wait_until
from test_asset_life import (  # noqa: F401  fixtures
    FIRST,
    UNSW,
    WINDOWS,
    asked,
    change,
    events,
    first,
    network,
    revolutions,
    running,
    second,
    send,
)
from test_decisions import post

from service.errors import StorageUnavailable
from service.results.alarm_store import AlarmStore
from service.results.database import Database
from service.results.jobs import Jobs


@pytest.fixture
def unanswered(monkeypatch):
    """The commit of each change, inspection and decision is carried out, and its answer lost once."""
    commit, seen, lost = Database._commit, set(), []

    def first_lost(of, name):
        done = getattr(of, name)

        def called(self, what, *args, **given):
            number = what if isinstance(what, int) else what.id
            if (name, number) not in seen:
                seen.add((name, number))
                lost.append(number)
            return done(self, what, *args, **given)

        monkeypatch.setattr(of, name, called)

    def committed(self, db, number):
        commit(self, db, number)
        if lost:
            lost.clear()
            raise StorageUnavailable("a commit was not answered", reason="connection lost", unknown=True)

    first_lost(Jobs, "end")
    monkeypatch.setattr(Database, "_commit", committed)
    return seen


@pytest.mark.slow
def test_replaced_gears_begin_one_epoch(running, network, first, second, unanswered):  # noqa: F811
    asked(running, network, first, second)
    status, answer = change(running, "gears_replaced", by="A. Fitter")
    assert (status, answer["done"], answer["effect"]["epoch"]) == (201, True, 1) and unanswered
    wait_until(lambda: running.get(UNSW)["windows_total"] == WINDOWS)
    state = running.get(UNSW)
    assert state["question"] is None and state["epoch"] == 1 and revolutions(state["windows"]) == FIRST
    assert [data["kind"] for kind, data in events(running) if kind == "change"] == ["gears_replaced"]


@pytest.mark.slow
def test_a_renamed_asset_goes_on_under_its_new_name(running, network, first, second, unanswered):  # noqa: F811
    asked(running, network, first, second)
    assert change(running, "ignore")[1]["done"]
    assert change(running, "renamed", name="press-7")[1]["done"] and len(unanswered) == 2
    wait_until(lambda: running.get("/v1/assets/press-7") is not None)
    assert running.get(UNSW) is None and running.get("/v1/assets/press-7")["question"] is None
    assert [data["kind"] for kind, data in events(running) if kind == "change"] == ["ignore", "renamed"]


@pytest.mark.slow
def test_another_machine_has_the_windows_that_waited(running, network, first, second, unanswered):  # noqa: F811
    asked(running, network, first, second)
    assert change(running, "other_machine", name="press-7")[1]["done"] and unanswered
    wait_until(lambda: len(running.windows("press-7")) == WINDOWS)
    assert revolutions(running.windows()) == FIRST and running.get(UNSW)["question"] is None


@pytest.mark.slow
def test_an_asset_is_retired(running, network, first, second, unanswered):  # noqa: F811
    asked(running, network, first, second)
    assert change(running, "retired", note="scrapped")[1]["done"] and unanswered
    assert running.get(UNSW)["retired"]["note"] == "scrapped"


@pytest.mark.slow
def test_the_alarm_that_an_inspection_raised_is_shown(running, network, first, unanswered):  # noqa: F811
    send(network, first)
    running.wait_for_windows(WINDOWS)
    rules = [{"name": "depth", "quantity": "depth", "watch": 60.0, "alarm": 100.0}]
    with running.store() as store:
        AlarmStore(store.database).keep_rules("unsw", rules, {"by": "Anna", "note": "", "at": ""})
    given = {"revolutions": 1800, "max_depth_um": 300.0, "flank": "combined", "std_um": 5.0}
    assert post(running, f"{UNSW}/inspections", given)[1]["applied"] and unanswered
    (kept,) = running.get(f"{UNSW}/alarms")
    assert kept["state"] == "active_unacknowledged" and running.get(UNSW)["alarms"]["active"] == 1
    assert [kind for kind, _ in events(running) if kind in ("alarm", "inspection")] == ["inspection", "alarm"]
