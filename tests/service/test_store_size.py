"""The size of a database is foretold by a formula, which the databases that the program makes keep to."""

from __future__ import annotations

import json
import random

import pytest
from test_retention import RETENTION, clear, kept, long  # noqa: F401  the fixture

from service.cli import run
from service.results.data_folder import DATABASE
from service.results.retention import DAY_NS
from service.results.sql_store import SqlStore
from service.results.store_size import forecast, window_bytes


def fill(store, assets, windows, body, spacing_ns=DAY_NS // 24):
    """Windows whose records are about as large as `body`, compressed."""
    given = {"state": {"memory": random.Random(1).randbytes(9000).hex()}, "report": {}, "received_ns": 1}
    draw = random.Random(2)
    with store.database.transaction():
        for index in range(windows):
            for asset in assets:
                own = {"rms_measured": draw.random(), "values": draw.randbytes(body).hex()}
                record = {"index": index, "updated": index % 50 == 0, **own}
                events = [("window", record)] + ([("update", {"index": index})] if record["updated"] else [])
                assert store.commit(asset, index * spacing_ns, record=record, events=events, **given)


@pytest.mark.slow
@pytest.mark.parametrize(("body", "assets"), [(200, ("unsw",)), (900, ("press-7", "a-machine-with-a-long-name"))])
def test_a_database_is_as_large_as_the_formula_says(tmp_path, body, assets):
    with SqlStore(tmp_path / "twin.sqlite") as store:
        fill(store, assets, 1200, body)
        with store.database._reader.connect() as db:
            found = forecast(db, RETENTION)
            pages = db.exec_driver_sql("PRAGMA page_count").scalar_one()
            free = db.exec_driver_sql("PRAGMA freelist_count").scalar_one()
    assert found.windows == 1200 * len(assets)
    assert found.now == pytest.approx(4096 * (pages - free), rel=0.1)


@pytest.mark.slow
def test_the_windows_that_a_retention_keeps_are_foretold(long):  # noqa: F811
    with long.database._reader.connect() as db:
        found = forecast(db, RETENTION)
    clear(long)
    assert len(kept(long)) == pytest.approx(found.windows_then, rel=0.1)


def test_a_year_of_ten_minute_windows_takes_84_mb():
    assert 52_560 * window_bytes(1200, 11) / 1e6 == pytest.approx(84, abs=1)


def test_check_says_how_large_the_database_becomes(tmp_path, capsys):
    with SqlStore(tmp_path / DATABASE) as store:
        fill(store, ("unsw",), 50, 900)
    assert run(["db", "check", "--data", str(tmp_path), "--json", "-"]) == 0
    said = capsys.readouterr()
    size = json.loads(said.out)["size"]
    assert size["windows"] == 50 and size["windows_then"] > 10_000 and size["then"] > 100 * size["now"]
    assert run(["db", "check", "--data", str(tmp_path)]) == 0
    assert "at this rate the retention keeps" in capsys.readouterr().err
