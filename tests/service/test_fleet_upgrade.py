"""A fleet is brought to a newer release: its tables in one transaction, the partitions by whoever takes them."""

from __future__ import annotations

import threading

import httpx
import pytest
import service_fakes as fakes
import sqlalchemy as sa
from fleets import PARTITIONS, front, taken, windows

from service.errors import NewerTables, StorageUnavailable, StoreError
from service.fleet import layout
from service.fleet.databases import Partitions, engine_of, made
from service.fleet.fence import Fenced
from service.fleet.front_store import FleetStore
from service.fleet.layout import Layout, create, layout_of, partition_of
from service.fleet.partition import of_this_release
from service.results.schema import REVISION
from service.results.sql_store import SqlStore
from service.settings import Settings

pytestmark = pytest.mark.slow

OWN = partition_of("unsw", PARTITIONS)


STEPS = layout.STEPS
PRESENT = layout.revision()


def add_a_column(db):
    db.exec_driver_sql("ALTER TABLE fleet.partitions ADD COLUMN site text")


def fail(db):
    db.exec_driver_sql("ALTER TABLE fleet.partitions ADD COLUMN lost text")
    raise RuntimeError("on the way")


@pytest.fixture
def tables(fleet):
    engine = engine_of(fleet, poolclass=sa.NullPool)
    for partition in range(PARTITIONS):
        made(fleet, partition, PARTITIONS)
    yield engine
    engine.dispose()


def columns(engine):
    return {column["name"] for column in sa.inspect(engine).get_columns("partitions", schema="fleet")}


def test_the_tables_of_all_are_upgraded_whole_or_not_at_all(monkeypatch, fleet, tables):
    monkeypatch.setattr(layout, "STEPS", (*STEPS, add_a_column, fail))
    with pytest.raises(RuntimeError, match="on the way"):
        create(tables, PARTITIONS)
    assert not columns(tables) & {"site", "lost"}
    with pytest.raises(
        StorageUnavailable,
        match=f"revision {PRESENT}, this program needs {PRESENT + 2}: gear-twin fleet up of this release",
    ):
        layout_of(tables)
    monkeypatch.setattr(layout, "STEPS", (*STEPS, add_a_column))
    with pytest.raises(StoreError, match="this fleet was created with 3"):
        create(tables, 4)
    assert "site" not in columns(tables)
    assert create(tables, PARTITIONS) == create(tables, PARTITIONS) == layout_of(tables) == Layout(PARTITIONS)
    assert "site" in columns(tables)


def test_who_is_older_writes_nothing_once_the_tables_are_upgraded(monkeypatch, fleet, tables):
    with taken(fleet, OWN) as old, FleetStore(fleet, Layout(PARTITIONS)) as old_front:
        fakes.take(old, None, "unsw", 0, 100.0)
        monkeypatch.setattr(layout, "STEPS", (*STEPS, add_a_column))
        create(tables, PARTITIONS)
        monkeypatch.setattr(layout, "STEPS", STEPS)
        with pytest.raises(Fenced):
            fakes.take(old, None, "unsw", 1, 200.0)
        with pytest.raises(NewerTables, match=f"revision {PRESENT + 1}, this program knows up to {PRESENT}: they were"):
            old_front.add_decision("unsw", "crack", "confirm")
        with pytest.raises(NewerTables), old_front.database.transaction():
            pass
        with pytest.raises(NewerTables):
            old_front.fleet.look()
        with pytest.raises(StoreError, match="written by a newer gear-twin") as found:
            taken(fleet, OWN)
        assert isinstance(found.value.__cause__, NewerTables)
        with pytest.raises(NewerTables, match="install that release here, too"):
            layout_of(tables)
        with pytest.raises(NewerTables):
            create(tables, PARTITIONS)
    monkeypatch.setattr(layout, "STEPS", (*STEPS, add_a_column))
    assert len(windows(fleet, OWN)) == 1


def test_a_newer_worker_waits_until_the_tables_are_upgraded(monkeypatch, fleet, tables, tmp_path):
    from service.fleet.partition import _begun

    monkeypatch.setattr(layout, "STEPS", (*STEPS, add_a_column))
    begun, stop = threading.Event(), threading.Event()

    def serve():
        with _begun(Settings(data=tmp_path), lambda: taken(fleet, OWN), stop) as found:
            if found is not None:
                begun.set()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        assert not begun.wait(1.0)
        create(tables, PARTITIONS)
        assert begun.wait(20)
    finally:
        stop.set()
        thread.join(20)


def test_a_front_end_answers_nothing_from_an_older_partition_and_all_of_the_others(tmp_path, fleet, tables):
    with FleetStore(fleet, Layout(PARTITIONS)) as store:
        store.note("unsw", [("added", {})])
        other = next(name for n in range(99) if partition_of(name := f"gb-{n}", PARTITIONS) != OWN)
        store.note(other, [("added", {})])
    with tables.begin() as db:
        db.exec_driver_sql(f"UPDATE p{OWN:03d}.alembic_version SET version_num = '0008'")
    with (
        front(fleet, tmp_path / "front", anonymous="read") as address,
        httpx.Client(base_url=address, timeout=60) as ask,
    ):
        refused = ask.get("/v1/assets/unsw/windows")
        assert refused.status_code == 503
        assert f"the tables of partition {OWN} have revision 0008, this program needs {REVISION}" in refused.text
        assert ask.get(f"/v1/assets/{other}/windows").status_code == 200
        assert {each["asset"] for each in ask.get("/v1/assets").json()} == {"unsw", other}
    with pytest.raises(StoreError, match="tables from before the first release"):
        taken(fleet, OWN)


def test_a_front_end_leaves_a_partition_of_a_newer_release_alone(fleet, tables):
    shared = Partitions(fleet, PARTITIONS)
    with SqlStore(shared.backend(OWN)) as store, FleetStore(fleet, Layout(PARTITIONS)) as front_end:
        with tables.begin() as db:
            db.exec_driver_sql(f"UPDATE p{OWN:03d}.alembic_version SET version_num = '9999'")
        with pytest.raises(StorageUnavailable, match="written by a newer gear-twin; install it here, too"):
            fakes.decide(store, "unsw", "crack", "confirm")
        front_end.fleet.look()
        assert OWN not in front_end.fleet.usable and len(front_end.fleet.usable) == PARTITIONS - 1
        with pytest.raises(StorageUnavailable, match="revision 9999"):
            front_end.decisions("unsw")
    shared.close()


def test_settings_of_another_release_get_the_defaults_of_what_it_did_not_know():
    settings = Settings(prefix="plant/gearbox", fleet_partitions=5)
    del vars(settings)["idle_timeout"]
    vars(settings)["of_a_later_release"] = 1
    found = of_this_release(settings)
    assert (found.prefix, found.fleet_partitions, found.idle_timeout) == ("plant/gearbox", 5, 3.0)
    assert not hasattr(found, "of_a_later_release")


def test_a_database_that_cannot_hold_all_characters_is_refused(postgresql_server):
    with postgresql_server.new_database(encoding="SQL_ASCII") as url:
        engine = engine_of(url, poolclass=sa.NullPool)
        with pytest.raises(StoreError, match="has the encoding SQL_ASCII: a fleet needs one with ENCODING 'UTF8'"):
            create(engine, PARTITIONS)
        assert "fleet" not in sa.inspect(engine).get_schema_names()
        engine.dispose()
