"""Alarms that a window and a person change at the same time are shown and published as they are stored."""

from __future__ import annotations

import json

import pytest
from test_alarms import HEALTHY, NEAR, WORN, Bench


@pytest.fixture
def bench(tmp_path):
    made = Bench(tmp_path / "x.sqlite")
    yield made
    made.store.close()


def shown(bench):
    return [(a["level"], a["state"]) for a in bench.board.get("unsw").alarms]


def stored(bench):
    return [(a["level"], a["state"]) for a in bench.alarms()]


def published(bench):
    return [(a["level"], a["state"]) for a in json.loads(bench.network.alarms[-1][1])["alarms"]]


def test_an_alarm_that_escalates_while_it_is_acknowledged_is_shown_escalated(bench, monkeypatch):
    """The list showed the earlier level, acknowledged, until the next window."""
    bench.window(NEAR)
    (alarm,) = bench.alarms()
    changed = bench.board.changed

    def overtaken(asset):
        monkeypatch.undo()
        bench.window(WORN)  # committed after the signature, and shown before it
        changed(asset)

    monkeypatch.setattr(bench.board, "changed", overtaken)
    assert bench.sign(alarm["id"], "acknowledge").status_code == 200
    assert shown(bench) == stored(bench) == [("alarm", "active_unacknowledged")]
    assert bench.board.get("unsw").last_event_id == bench.store.last_event_id("unsw")


def test_what_a_window_shows_that_is_committed_just_before_a_signature_stays_shown(bench, monkeypatch):
    """The list of assets had the earlier row again."""
    bench.window(NEAR)
    (alarm,) = bench.alarms()
    transaction = bench.keeper.transaction

    def overtaken():
        monkeypatch.undo()
        bench.window(WORN)
        return transaction()

    monkeypatch.setattr(bench.keeper, "transaction", overtaken)
    monkeypatch.setattr(bench.board, "changed", lambda *assets: None)
    assert bench.sign(alarm["id"], "acknowledge").status_code == 200
    (listed,) = bench.board.summaries()
    assert listed["windows"] == 2


def test_an_alarm_that_is_cleared_while_a_window_is_published_stays_cleared(bench, monkeypatch):
    """The window showed it once more, active."""
    bench.window(NEAR)
    (alarm,) = bench.alarms()
    publish = bench.publication.publish

    def overtaken(asset):
        assert bench.sign(alarm["id"], "clear").json()["state"] == "closed"
        publish(asset)

    monkeypatch.setattr(bench.publication, "publish", overtaken)
    bench.window(HEALTHY)
    assert shown(bench) == stored(bench) == []
    assert len(bench.board.get("unsw").records) == 2  # the window is shown all the same


def test_an_acknowledgement_is_published_once_it_is_shown(bench, monkeypatch):
    """It was published before, as the alarm had been, and not again until the next window."""
    bench.window(NEAR)
    (alarm,) = bench.alarms()
    changed = bench.board.changed

    with bench.board.follow(fleeting=False) as changes:

        def publish():  # as the service does between frames
            for asset in changes.take(0):
                bench.publication.publish(asset)

        def looked_at(asset):
            publish()
            changed(asset)

        monkeypatch.setattr(bench.board, "changed", looked_at)
        assert bench.sign(alarm["id"], "acknowledge").status_code == 200
        publish()
    assert published(bench) == shown(bench) == [("watch", "active_acknowledged")]


def test_an_alarm_that_was_signed_by_an_attempt_of_which_nobody_knows_is_shown_signed(bench):
    """It was shown unsigned until the next window, whoever tried to sign it again."""
    bench.window(NEAR)
    (alarm,) = bench.alarms()
    with bench.keeper.transaction():
        bench.keeper.sign("unsw", alarm["id"], "acknowledged", "Anna", "seen")  # committed; the answer is lost
    assert shown(bench) == [("watch", "active_unacknowledged")]
    assert bench.sign(alarm["id"], "acknowledge").status_code == 409
    assert shown(bench) == stored(bench) == [("watch", "active_acknowledged")]
