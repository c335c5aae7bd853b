"""The database's schema: databases of earlier releases are taken over in place, and given back as they were."""

from __future__ import annotations

import gzip
import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import select

from service.errors import StoreError
from service.results import migrate
from service.results.alarm_store import AlarmStore
from service.results.asset_life import AssetLife
from service.results.backends import backend_of
from service.results.baseline_store import BaselineStore
from service.results.migrations.release_scripts import SCRIPTS
from service.results.schema import EVENTS, METADATA, REVISION, WINDOWS
from service.results.sql_store import SqlStore

ROOT = Path(__file__).parents[2]
OLD = gzip.decompress((ROOT / "tests" / "data" / "store_v8.sqlite.gz").read_bytes())
ASSETS = ("gone", "made", "real")


pytestmark = pytest.mark.usefixtures("new_files_are_made")


@pytest.fixture
def postgresql(empty_postgresql):
    return empty_postgresql


@pytest.fixture
def path(tmp_path):
    out = tmp_path / "gear-twin.sqlite"
    out.write_bytes(OLD)
    return out


def whole(path):
    """Tables, indexes, version and all rows of a file of SQLite."""
    with closing(sqlite3.connect(path)) as db:
        schema = db.execute("SELECT type, name, tbl_name, sql FROM sqlite_master ORDER BY type, name").fetchall()
        tables = [name for kind, name, *_ in schema if kind == "table"]
        rows = {name: sorted(db.execute(f"SELECT * FROM {name}").fetchall(), key=repr) for name in tables}
        return schema, rows, db.execute("PRAGMA user_version").fetchone()


def column(path, query):
    with closing(sqlite3.connect(path)) as db:
        return [json.loads(text) if text else None for (text,) in db.execute(query)]


def test_database_of_the_last_release_answers_as_before(path, tmp_path):
    before = tmp_path / "before.sqlite"
    before.write_bytes(OLD)
    with SqlStore(path) as store:
        assert store.assets() == ASSETS
        for asset in ASSETS:
            of = f"FROM windows WHERE asset = '{asset}' ORDER BY number"
            windows = [w for e in store.epochs(asset) for w in store.windows(asset, epoch=e["epoch"])]
            assert [w.record for w in windows] == column(before, f"SELECT record {of}")
            assert [w.figures for w in windows] == column(before, f"SELECT figures {of}")
            events = column(before, f"SELECT data FROM events WHERE asset = '{asset}' ORDER BY id")
            assert [e.data for e in store.events(asset, 0, 1000)] == events
            stored = store.asset(asset)
            for part in ("rig", "state", "report", "assembly", "quality", "question", "retired"):
                assert [getattr(stored, part)] == column(before, f"SELECT {part} FROM assets WHERE asset = '{asset}'")
        assert len(store.windows("real")) == store.asset("real").windows == 8
        assert store.decision_counts() == {"made": {"pin": 1}} and len(store.pending_decisions()) == 1
        assert len(store.inspections("made")) == 2 and len(store.pending_inspections()) == 1
        alarms = AlarmStore(store.database)
        (alarm,) = alarms.open("made")
        assert alarm["rule"] == "rms high" and len(alarms.history(alarm["id"])) == 1 and alarms.waiting() == 1
        life = AssetLife(store.database)
        assert [change.done for change in life.changes("made")] == [True, False]
        assert life.routes() == {"old-name": "made"} and len(life.waiting("made")) == 1
        assert BaselineStore(store.database, tmp_path / "baselines").about("made") == {"by": "Anna"}


def test_windows_of_earlier_releases_know_whether_they_are_kept_when_a_history_is_thinned(path):
    with SqlStore(path) as store:
        rows = store.database.rows(select(WINDOWS.c.number, WINDOWS.c.notable).where(WINDOWS.c.asset == "made"))
        notable = dict(map(tuple, rows))
    assert notable == {**dict.fromkeys(range(14), 0), 0: 2, 5: 1, 13: 2, 20: 2}


def test_windows_follow_in_a_database_that_was_taken_over(path):
    with SqlStore(path) as store:
        given = {"state": {}, "report": {}, "assembly": {}, "quality": {}, "received_ns": 1}
        assert store.commit("real", 5, record={"index": store.next_indices()["real"]}, **given)
        assert store.asset("real").windows == 9 and store.latest_windows("real", 1)[0].record == {"index": 8}


def test_downgrade_gives_the_file_back_as_the_last_release_knows_it(path, tmp_path):
    before = tmp_path / "before.sqlite"
    before.write_bytes(OLD)
    SqlStore(path).close()
    migrate.downgrade(backend_of(path))
    assert whole(path) == whole(before)
    SqlStore(path).close()  # and forward again
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("PRAGMA user_version").fetchone() == (migrate.user_version(REVISION),)


def test_copy_of_the_file_is_kept_before_it_is_changed(path, tmp_path):
    before = tmp_path / "before.sqlite"
    before.write_bytes(OLD)
    SqlStore(path).close()
    (copy,) = tmp_path.glob("gear-twin.sqlite.before-*")
    assert whole(copy) == whole(before)


def test_new_database_needs_no_copy(tmp_path):
    SqlStore(tmp_path / "new.sqlite").close()
    SqlStore(tmp_path / "new.sqlite").close()
    assert [p.name for p in tmp_path.iterdir()] == ["new.sqlite"]


@pytest.mark.parametrize("version", range(1, len(SCRIPTS)))
def test_database_of_every_earlier_release_is_brought_to_the_newest_schema(tmp_path, version):
    path = tmp_path / "old.sqlite"
    with closing(sqlite3.connect(path)) as db:
        for script in SCRIPTS[:version]:
            db.executescript(script)
        db.execute("INSERT INTO assets (asset) VALUES ('unsw')")
        db.execute(f"PRAGMA user_version = {version}")
        db.commit()
    with SqlStore(path) as store:
        assert store.assets() == ("unsw",)
    SqlStore(tmp_path / "new.sqlite").close()
    assert whole(path)[0] == whole(tmp_path / "new.sqlite")[0]


def test_migration_that_fails_leaves_the_file_as_it_was(path, tmp_path, monkeypatch):
    before = tmp_path / "before.sqlite"
    before.write_bytes(OLD)

    def fail(*_):
        raise StoreError("rows belong to nothing")

    monkeypatch.setattr(migrate, "_finish", fail)
    with pytest.raises(StoreError, match="rows belong to nothing"):
        SqlStore(path)
    monkeypatch.undo()
    assert whole(path) == whole(before)
    SqlStore(path).close()


KILLED = """
import os, sys
from pathlib import Path
from service.results import migrate
migrate._finish = lambda *_: os.kill(os.getpid(), 9)  # all is written, and nothing is committed
from service.results.sql_store import SqlStore
SqlStore(Path(sys.argv[1]))
"""


@pytest.mark.slow
def test_migration_that_is_killed_leaves_the_file_as_it_was(path, tmp_path):
    before = tmp_path / "before.sqlite"
    before.write_bytes(OLD)
    done = subprocess.run([sys.executable, "-c", KILLED, str(path)], cwd=ROOT)
    assert done.returncode == -9
    assert whole(path) == whole(before)
    with SqlStore(path) as store:
        assert store.assets() == ASSETS


@pytest.mark.slow
def test_database_of_a_newer_program_is_refused_whichever_it_is(where):
    SqlStore(where).close()
    engine = backend_of(where).for_migration()
    with engine.connect() as db, db.begin():
        db.exec_driver_sql("UPDATE alembic_version SET version_num = '9999'")
    engine.dispose()
    with pytest.raises(StoreError, match="written by a newer gear-twin"):
        SqlStore(where)


@pytest.mark.slow
def test_tables_are_those_that_the_program_works_with(where):
    SqlStore(where).close()
    engine = backend_of(where).for_migration()
    with engine.connect() as db:
        differences = compare_metadata(MigrationContext.configure(db, opts={"compare_type": True}), METADATA)
        assert [d for d in differences if not _of_sqlite_alone(d, db)] == []
        assert sa.inspect(db).get_table_names()
    engine.dispose()


def _of_sqlite_alone(difference, db):
    """SQLite's INTEGER has 64 bits, whatever it is declared as; a key says nothing of NULL; all checks can wait."""
    kind = difference[0][0] if isinstance(difference, list) else difference[0]
    alone = ("modify_type", "modify_nullable", "add_fk", "remove_fk")
    return db.dialect.name == "sqlite" and kind in alone


def test_program_works_with_the_newest_revision():
    script = ScriptDirectory(str(migrate.FOLDER))
    assert script.get_heads() == [REVISION]


@pytest.mark.slow
def test_postgresql_goes_back_and_forth_too(postgresql):
    with SqlStore(postgresql) as store:
        store.keep("unsw", rig={"name": "ü"})
    migrate.downgrade(backend_of(postgresql))
    with SqlStore(postgresql) as store:
        assert store.asset("unsw").rig == {"name": "ü"}


@pytest.mark.slow
def test_events_that_repeat_a_window_refer_to_it_and_get_its_record_back(where):
    record = {"index": 0, "start_time": "now", "rms_measured": 1.5}
    given = {"state": {}, "report": None, "assembly": {}, "quality": {}, "received_ns": 1}
    with SqlStore(where) as store:
        for start_ns in (7, 8):
            own = {**record, "index": start_ns - 7}
            events = [("window", own), ("update", {"index": start_ns})]
            assert store.commit("unsw", start_ns, record=own, events=events, **given)
        before = store.events("unsw", 0)
        assert [(e.kind, e.data) for e in before[:2]] == [("window", record), ("update", {"index": 7})]
        with store.database.transaction() as db:
            kept = db.execute(select(EVENTS.c.start_ns, sa.func.length(EVENTS.c.data)).order_by(EVENTS.c.id)).all()
            assert [row[0] for row in kept] == [7, None, 8, None] and kept[0][1] < 30
            db.execute(sa.delete(WINDOWS).where(WINDOWS.c.start_ns == 8))  # it was thinned
        left = store.events("unsw", 0)
        assert left == (*before[:2], before[3]) and store.events("unsw", 0, 3) == left
    migrate.downgrade(backend_of(where), "0004")
    migrate.upgrade(backend_of(where))
    with SqlStore(where) as store:
        assert store.events("unsw", 0) == left
