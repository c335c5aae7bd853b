"""Jobs that fail whenever they are carried out, that lead to what is there already, and assets that cannot go on."""

from __future__ import annotations

import pytest
from loops import loop_of
from segments import segment_of
from sqlalchemy import select, update
from test_workers import window

from service.results.json_columns import load_text
from service.results.schema import ASSETS
from service.runtime import computing, work_loop


@pytest.fixture
def loop(store, tmp_path):
    return loop_of(store, tmp_path)


def records(store):
    return [each.record for each in store.windows("unsw")]


def test_a_window_that_cannot_be_made_is_refused_after_two_attempts(loop, store, monkeypatch):
    """It was made once more before it was refused, failed again, and kept its worker busy for good."""
    made = []

    def fails(*given):
        made.append(given)
        raise ZeroDivisionError("a fault of the program")

    loop.add("unsw", segment_of(window()))
    with monkeypatch.context() as patched:
        patched.setattr(computing, "window_of", fails)
        loop.carry_out(10)
    assert len(made) == 2 and not loop.windows.waiting("unsw")
    (record,) = records(store)
    assert record["quality"] == "refused" and "ZeroDivisionError: a fault of the program, 2 times" in record["reason"]
    loop.add("unsw", segment_of(window(1)))
    loop.carry_out()
    assert len(records(store)) == 2 and records(store)[1]["quality"] != "refused"


def test_a_window_that_is_there_already_counts_once(loop, store):
    """What the twin had learned of it was kept with the next window."""
    loop.add("unsw", segment_of(window()))
    loop.carry_out()
    loop.add("unsw", segment_of(window()))
    loop.add("unsw", segment_of(window(1)))
    loop.carry_out()
    assert [record["index"] for record in records(store)] == [0, 1] and not loop.windows.waiting("unsw")
    assert store.asset("unsw").state["windows_seen"] == 2


def test_an_asset_whose_state_is_damaged_goes_on_once_that_is_put_right(loop, store, monkeypatch):
    def keep(state):
        with store.database.transaction() as db:
            db.execute(update(ASSETS).where(ASSETS.c.asset == "unsw").values(state=state))

    monkeypatch.setattr(work_loop, "STOPPED_PAUSE", 0.0)
    loop.add("unsw", segment_of(window()))
    loop.carry_out()
    ((kept,),) = store.database.rows(select(ASSETS.c.state).where(ASSETS.c.asset == "unsw"))
    assert load_text(kept)
    keep(b"nothing of this can be read")
    loop.work._places.clear()  # as another worker has it
    loop.add("unsw", segment_of(window(1)))
    assert not loop.loop.turn() and loop.table.get("unsw").damaged is not None
    since = loop.table.get("unsw").damaged
    assert not loop.loop.turn() and loop.table.get("unsw").damaged == since
    keep(kept)
    store._damaged.clear()
    assert loop.loop.turn() and loop.table.get("unsw").damaged is None
    assert [record["index"] for record in records(store)] == [0, 1]
