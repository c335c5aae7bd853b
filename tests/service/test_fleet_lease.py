"""Which host serves which partitions: each its share, and what a host that has ended had is another's."""

from __future__ import annotations

import pytest
import sqlalchemy as sa

from service.fleet.databases import fleet_tables
from service.fleet.layout import PARTITIONS, Layout
from service.fleet.lease import GIVE_WAIT, HOST, SILENT, Leases
from service.results import roles
from service.results.roles import INGEST, OwnRole

pytestmark = pytest.mark.slow


class Plant:
    """Hosts over one database with a clock of the test's own; those that live look once a second."""

    def __init__(self, url):
        self.now, self.url, self.open = 0.0, url, []
        self.hosts, self.has, self.database = {}, {}, self.tables()

    def tables(self, partition=None):
        self.open.append(fleet_tables(self.url, Layout(3), "gear-twin test", partition))
        return self.open[-1]

    def close(self):
        for database in self.open:
            database.close()

    def add(self, *names):
        for name in names:
            ident = f"{HOST} {name}"
            own = OwnRole(self.database, HOST, name, ident)
            self.hosts[name] = Leases(self.database, ident, lambda: self.now), own

    def run(self, seconds=3.0):
        end = self.now + seconds
        while self.now < end:
            for name, (leases, own) in self.hosts.items():
                own.say({})
                self.has[name] = leases.look().partitions
            self.now += 1.0
        return {name: len(self.has[name]) for name in self.hosts}

    def leased(self):
        """What each host is to serve; all of it once."""
        mine = sorted(number for name in self.hosts for number in self.has[name])
        assert mine == [0, 1, 2]
        rows = self.database.rows(sa.select(PARTITIONS.c.number, PARTITIONS.c.host))
        assert all(number in self.has[host.removeprefix(f"{HOST} ")] for number, host in rows)
        return {name: self.has[name] for name in self.hosts}


@pytest.fixture
def plant(fleet):
    made = Plant(fleet)
    yield made
    made.close()


def test_one_host_has_all_partitions_and_a_second_one_gets_its_share(plant):
    plant.add("a")
    assert plant.run() == {"a": 3}
    plant.add("b")
    plant.run(GIVE_WAIT + 5.0)
    assert {name: len(has) for name, has in plant.leased().items()} == {"a": 2, "b": 1}
    plant.add("c", "d")
    plant.run(GIVE_WAIT + 5.0)
    assert sorted(len(has) for has in plant.leased().values()) == [0, 1, 1, 1]
    before = plant.leased()
    plant.run(30.0)
    assert plant.leased() == before


def test_a_partition_is_given_back_once_nobody_serves_it_here(plant):
    plant.add("a")
    plant.run()
    serving = [OwnRole(plant.tables(number), INGEST) for number in range(3)]
    for role in serving:
        role.say({})
    plant.add("b")
    plant.run(4.0)
    (given,) = {0, 1, 2} - set(plant.has["a"])
    assert plant.has["b"] == ()
    serving[given].gone()
    plant.run(2.0)
    assert plant.leased()["b"] == (given,)


def test_what_a_host_had_that_has_ended_is_the_others_within_seconds_and_its_row_goes(plant):
    plant.add("a", "b")
    plant.run(GIVE_WAIT + 5.0)
    assert len(plant.leased()["a"]) == 2
    del plant.hosts["a"]
    plant.run(SILENT - 1.0)
    assert len(plant.has["b"]) == 1
    plant.run(4.0)
    assert plant.leased() == {"b": (0, 1, 2)}
    assert plant.database.rows(sa.text("SELECT id FROM roles")) == [(f"{HOST} b",)]


def test_a_host_that_is_started_again_under_its_name_has_its_partitions_at_once(plant):
    plant.add("a")
    plant.run()
    plant.add("a")
    plant.run(1.0)
    assert plant.leased() == {"a": (0, 1, 2)}


def test_a_host_that_could_not_look_for_long_takes_nothing_that_is_another_s(plant):
    """The database was away for all, and the first that can look again has heard nothing of the others since."""
    plant.add("a", "b")
    plant.run(GIVE_WAIT + 5.0)
    before = plant.leased()
    plant.now += 3600.0
    for name, (leases, _) in plant.hosts.items():  # nobody has said anything since
        plant.has[name] = leases.look().partitions
    assert plant.leased() == before
    plant.run(SILENT + 5.0)
    assert plant.leased() == before


def test_a_host_has_whoever_serves_begin_anew(plant):
    plant.add("a")
    before = plant.database.rows(sa.select(PARTITIONS.c.token))
    plant.hosts["a"][0].begin_anew()
    after = plant.database.rows(sa.select(PARTITIONS.c.token))
    assert [new for (new,) in after] == [old + 1 for (old,) in before]


def test_a_host_that_ends_in_good_order_leaves_its_partitions_to_the_others_at_once(plant):
    plant.add("a", "b")
    plant.run(GIVE_WAIT + 5.0)
    assert len(plant.leased()["a"]) == 2
    plant.hosts.pop("a")[0].leave(5.0)
    plant.run(1.0)
    assert plant.leased() == {"b": (0, 1, 2)}
    assert plant.database.rows(sa.text("SELECT id FROM roles")) == [(f"{HOST} b",)]


@pytest.mark.parametrize("ahead", [0, -3600 * 10**9])
@pytest.mark.parametrize("first_looks_first", [True, False])
def test_of_two_hosts_of_one_name_the_newcomer_ends(plant, ahead, first_looks_first, monkeypatch):
    """Whatever their clocks say, which were once compared, and however they take turns."""
    plant.add("a")
    plant.run()
    elder = plant.hosts["a"][1]
    monkeypatch.setattr(roles, "later_time_ns", lambda: elder.began_ns + ahead + 1)
    plant.add("a")
    newcomer = plant.hosts["a"][1]
    assert newcomer.elder() is None  # the row may be that of a host that has ended
    for _ in range(3):
        for own in (elder, newcomer) if first_looks_first else (newcomer, elder):
            assert elder.elder() is None
            if own is newcomer and own.elder():
                return
            own.say({})
    pytest.fail("the newcomer goes on")
