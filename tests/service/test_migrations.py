"""The database's schema: all tables in one step, or none; that of another program is refused."""

from __future__ import annotations

import os
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

from service.cli import run
from service.errors import StoreError
from service.results import migrate
from service.results.backends import backend_of
from service.results.data_folder import DATABASE
from service.results.schema import EVENTS, METADATA, REVISION, WINDOWS
from service.results.sql_store import SqlStore

ROOT = Path(__file__).parents[2]


pytestmark = pytest.mark.usefixtures("new_files_are_made")


KILLED = """
import os, sys
from pathlib import Path
from service.results import migrate
made = migrate.make_tables
migrate.make_tables = lambda db: (made(db), os.kill(os.getpid(), 9))  # all is written, and nothing is committed
from service.results.sql_store import SqlStore
SqlStore(Path(sys.argv[1]))
"""


@pytest.mark.slow
def test_tables_that_are_being_made_when_the_program_is_killed_are_made_by_the_next(tmp_path):
    path = tmp_path / "gear-twin.sqlite"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    assert subprocess.run([sys.executable, "-c", KILLED, str(path)], env=environment).returncode == -9
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("SELECT name FROM sqlite_master").fetchall() == []
    with SqlStore(path) as store:
        assert store.assets() == ()


@pytest.mark.parametrize("stamp", [None, "0008"])
def test_database_of_before_the_first_release_is_refused_with_what_to_do_and_stays_as_it_is(tmp_path, stamp, capsys):
    path = tmp_path / DATABASE
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE assets (asset TEXT PRIMARY KEY, rig TEXT)")
        if stamp is not None:
            db.execute("CREATE TABLE alembic_version (version_num TEXT)")
            db.execute("INSERT INTO alembic_version VALUES (?)", (stamp,))
        db.commit()
    with pytest.raises(StoreError, match="assess the recordings anew"):
        SqlStore(path)
    for command in (["db", "check"], ["db", "export", str(tmp_path / "x.csv")], ["serve"]):
        assert run([*command, "--data", str(tmp_path)]) == 2
        said = capsys.readouterr().err.strip()
        assert said.count("\n") == 0 and "tables from before the first release" in said, said
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("SELECT sql FROM sqlite_master WHERE name = 'assets'").fetchone()[0].endswith("rig TEXT)")


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
    """SQLite's INTEGER has 64 bits, whatever it is declared as; a key says nothing of NULL; all checks can wait.

    Of an index it tells the columns, and no expression: the names alone are compared.
    """
    if db.dialect.name != "sqlite":
        return False
    kind = difference[0][0] if isinstance(difference, list) else difference[0]
    if kind in ("add_index", "remove_index"):
        index = difference[1]
        kept = {each["name"] for each in sa.inspect(db).get_indexes(index.table.name)}
        return index.name in kept & {each.name for each in METADATA.tables[index.table.name].indexes}
    return kind in ("modify_type", "modify_nullable", "add_fk", "remove_fk")


def test_program_works_with_the_newest_revision():
    script = ScriptDirectory(str(migrate.FOLDER))
    assert script.get_heads() == [REVISION]


@pytest.mark.slow
def test_events_that_repeat_a_window_refer_to_it_and_get_its_record_back(where):
    record = {"index": 0, "start_time": "now", "rms_measured": 1.5}
    given = {"state": {}, "report": None, "received_ns": 1}
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


def test_a_backup_of_before_the_first_release_is_refused_and_nothing_is_restored(tmp_path, capsys):
    data, archive, empty = tmp_path / "data", tmp_path / "old.zip", tmp_path / "empty"
    empty.mkdir()
    SqlStore(data / DATABASE).close()
    with closing(sqlite3.connect(data / DATABASE)) as db:
        db.execute("UPDATE alembic_version SET version_num = '0008'")
        db.commit()
    assert run(["db", "backup", str(archive), "--data", str(data)]) == 0
    capsys.readouterr()
    assert run(["db", "restore", str(archive), "--data", str(empty)]) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith(f"gear-twin: the database of {archive} has tables from before the first release"), said
    assert not [path for path in empty.iterdir() if path.name != "service.lock"]
