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
)

from service.errors import StorageUnavailable
from service.results.asset_life import AssetLife
from service.results.database import Database


@pytest.fixture
def unanswered(monkeypatch):
    """The commit of each change is carried out, and its answer lost once."""
    done, commit, seen, lost = AssetLife.change_done, Database._commit, set(), []

    def change_done(self, number, effect):
        if number not in seen:
            seen.add(number)
            lost.append(number)
        return done(self, number, effect)

    def committed(self, db, number):
        commit(self, db, number)
        if lost:
            lost.clear()
            raise StorageUnavailable("a commit was not answered", reason="connection lost", unknown=True)

    monkeypatch.setattr(AssetLife, "change_done", change_done)
    monkeypatch.setattr(Database, "_commit", committed)
    return seen


def test_replaced_gears_begin_one_epoch(running, network, first, second, unanswered):  # noqa: F811
    asked(running, network, first, second)
    status, answer = change(running, "gears_replaced", by="A. Fitter")
    assert (status, answer["done"], answer["effect"]["epoch"]) == (201, True, 1) and unanswered
    wait_until(lambda: running.get(UNSW)["windows_total"] == WINDOWS)
    state = running.get(UNSW)
    assert state["question"] is None and state["epoch"] == 1 and revolutions(state["windows"]) == FIRST
    assert [data["kind"] for kind, data in events(running) if kind == "change"] == ["gears_replaced"]


def test_a_renamed_asset_goes_on_under_its_new_name(running, network, first, second, unanswered):  # noqa: F811
    asked(running, network, first, second)
    assert change(running, "ignore")[1]["done"]
    assert change(running, "renamed", name="press-7")[1]["done"] and len(unanswered) == 2
    wait_until(lambda: running.get("/v1/assets/press-7") is not None)
    assert running.get(UNSW) is None and running.get("/v1/assets/press-7")["question"] is None
    assert [data["kind"] for kind, data in events(running, "press-7") if kind == "change"] == ["ignore", "renamed"]


def test_another_machine_has_the_windows_that_waited(running, network, first, second, unanswered):  # noqa: F811
    asked(running, network, first, second)
    assert change(running, "other_machine", name="press-7")[1]["done"] and unanswered
    wait_until(lambda: len(running.windows("press-7")) == WINDOWS)
    assert revolutions(running.windows()) == FIRST and running.get(UNSW)["question"] is None


def test_an_asset_is_retired(running, network, first, second, unanswered):  # noqa: F811
    asked(running, network, first, second)
    assert change(running, "retired", note="scrapped")[1]["done"] and unanswered
    assert running.get(UNSW)["retired"]["note"] == "scrapped"
