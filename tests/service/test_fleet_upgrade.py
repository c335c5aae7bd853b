"""A fleet whose tables another program made: nothing is written there, and the one sentence says why."""

from __future__ import annotations

import pytest
import service_fakes as fakes
import sqlalchemy as sa
from fleets import PARTITIONS, at_front, taken, windows

from service.errors import NewerTables, StoreError
from service.fleet.databases import engine_of
from service.fleet.layout import Layout, create, layout_of, look, partition_of
from service.results.schema import REVISION

pytestmark = pytest.mark.slow

OWN = partition_of("unsw", PARTITIONS)


@pytest.fixture
def tables(fleet):
    engine = engine_of(fleet, poolclass=sa.NullPool)
    yield engine
    engine.dispose()


def stamp(engine, revision):
    with engine.begin() as db:
        db.exec_driver_sql(f"UPDATE fleet.alembic_version SET version_num = '{revision}'")


@pytest.mark.parametrize(
    ("other", "kind", "why"),
    [
        ("9999", NewerTables, f"revision 9999, this program knows up to {REVISION}: they were written by a newer"),
        ("2", StoreError, "the fleet's tables are from before the first release, which no program reads any more"),
    ],
)
def test_who_is_of_another_release_writes_nothing_and_says_why(fleet, tables, other, kind, why):
    with taken(fleet, OWN) as worker, at_front(fleet) as front_end:
        fakes.take(worker, None, "unsw", 0, 100.0)
        stamp(tables, other)
        with pytest.raises(kind, match=why):
            fakes.decide(front_end, "unsw", "crack", "confirm")
        with pytest.raises(kind, match=why), front_end.database.transaction():
            pass
        with pytest.raises(kind, match=why):
            look(front_end.database)
        with pytest.raises(StoreError, match=why):
            taken(fleet, OWN)
        with pytest.raises(kind, match=why):
            layout_of(tables)
        with pytest.raises(kind, match=why):
            create(tables, PARTITIONS)
    stamp(tables, REVISION)
    assert len(windows(fleet)) == 1 and create(tables, PARTITIONS) == layout_of(tables) == Layout(PARTITIONS)


def test_a_database_that_cannot_hold_all_characters_is_refused(postgresql_server):
    with postgresql_server.new_database(encoding="SQL_ASCII") as url:
        engine = engine_of(url, poolclass=sa.NullPool)
        with pytest.raises(StoreError, match="has the encoding SQL_ASCII: a fleet needs one with ENCODING 'UTF8'"):
            create(engine, PARTITIONS)
        assert "fleet" not in sa.inspect(engine).get_schema_names()
        engine.dispose()


def test_a_fleet_with_a_schema_for_each_partition_is_refused_with_what_to_do(empty_postgresql):
    engine = engine_of(empty_postgresql, poolclass=sa.NullPool)
    with engine.begin() as db:
        db.exec_driver_sql("CREATE SCHEMA fleet")
        db.exec_driver_sql("CREATE TABLE fleet.facts (name text PRIMARY KEY, value text)")
        db.exec_driver_sql("CREATE TABLE fleet.partitions (number integer PRIMARY KEY)")
    for call in (lambda: create(engine, PARTITIONS), lambda: layout_of(engine)):
        with pytest.raises(StoreError, match="before the first release, which no program reads any more: begin with"):
            call()
    engine.dispose()
