"""One worker commits a partition's results: the one that took it last."""

from __future__ import annotations

import signal
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import service_fakes as fakes
import sqlalchemy as sa
from fleet_partition import PartitionProcess
from fleets import at_front, routed, row, taken, windows, worker
from service_streams import wait_until, write_recording

from service.errors import StorageUnavailable, StoreError
from service.fleet.databases import engine_of
from service.fleet.fence import FENCED, Fenced
from service.fleet.layout import PARTITIONS, Layout, create, layout_of, partition_of
from service.fleet.partition import settings_of
from service.fleet.up import prepared
from service.json_text import plain
from service.results.alarm_store import AlarmStore
from service.results.asset_list import area_of
from service.results.jobs import Jobs
from service.results.names import Names
from service.results.window_jobs import WindowJobs
from service.runtime.assess import assess
from service.runtime.replay import replay
from service.settings import Settings

pytestmark = pytest.mark.slow


def test_an_asset_belongs_to_the_same_partition_everywhere():
    assert [partition_of(name, 16) for name in ("unsw", "press-1", "plant.line.gb7")] == [8, 15, 11]
    counts = [0] * 16
    for number in range(10_000):
        counts[partition_of(f"gearbox-{number}", 16)] += 1
    assert min(counts) > 500 and max(counts) < 750  # 625 ± 5 standard deviations


@pytest.mark.parametrize(
    ("asset", "area"),
    [("unsw", ""), ("press-1", "press"), ("plant.line-2.gb_7", "plant.line-2"), ("a_b-c", "a_b"), (".x", "")],
)
def test_the_area_is_what_the_name_states(asset, area):
    assert area_of(asset) == area


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"partitions": 4}, "partitions = 4: this fleet was created with 3, which stays, because the assets"),
        (
            {"prefix": "plant"},
            "prefix = plant: this fleet was created with gearbox, which stays, because its publishers",
        ),
    ],
)
def test_partitions_and_prefix_stay(fleet, given, said):
    """A host with another prefix took partitions, said that it served them, and received nothing."""
    engine = engine_of(fleet)
    assert layout_of(engine) == Layout(3) and create(engine, 3, "gearbox") == create(engine) == Layout(3)
    with pytest.raises(StoreError, match=said):
        create(engine, **given)
    engine.dispose()


def test_a_host_has_the_prefix_of_its_fleet_where_none_is_set(empty_postgresql):
    engine = engine_of(empty_postgresql)
    layout = create(engine, 2, "plant/gears")
    engine.dispose()
    settings = Settings(database=empty_postgresql)
    assert prepared(settings) == layout and settings_of(settings, 1, layout).prefix == "fleet/001/plant/gears"
    with pytest.raises(StoreError, match="prefix = gearbox: this fleet was created with plant/gears"):
        prepared(Settings(database=empty_postgresql, prefix="gearbox"))


def confirms(db):
    return db.exec_driver_sql("SHOW synchronous_commit").scalar_one()


def test_what_is_committed_outlives_a_server_that_confirms_before_it_has_written(fleet):
    """A worker's first connection did not ask for it: a window that had been acknowledged went with a killed server."""
    engine = engine_of(fleet)
    with engine.connect() as db:
        assert confirms(db) == "off"  # of the server
    engine.dispose()
    with taken(fleet) as store, store.database.transaction() as db:
        assert confirms(db) == "on"
    with at_front(fleet) as store, store.database.transaction() as db:
        assert confirms(db) == "on"


def test_a_window_outlives_a_server_that_is_killed_right_after_its_commit(fleet, postgresql_server):
    with taken(fleet) as store:
        assert fakes.take(store, None, "unsw", 0, 100.0)
        postgresql_server.kill()
    wait_until(lambda: starts(postgresql_server), 30)
    assert len(windows(fleet)) == 1


def starts(server):
    try:
        server.start()
    except AssertionError:
        return False
    return True


def test_a_worker_whose_partition_was_taken_commits_nothing_more(fleet):
    lost = []
    with taken(fleet, lost=lambda: lost.append(1)) as old:
        fakes.take(old, None, "unsw", 0, 100.0)
        with taken(fleet) as new:
            with pytest.raises(Fenced, match="partition 0 has been taken by another process"):
                fakes.take(old, None, "unsw", 1, 200.0)
            assert lost and fakes.take(new, None, "unsw", 1, 200.0)
            assert len(new.windows("unsw")) == 2
        with pytest.raises(Fenced):  # also once nobody has it
            fakes.take(old, None, "unsw", 2, 300.0)


def test_a_transaction_that_has_begun_is_whole_or_ended(fleet):
    with taken(fleet) as old:
        with pytest.raises(StorageUnavailable, match="connection lost"), old.database.transaction():
            begun = time.monotonic()
            with taken(fleet) as new:  # ends the session of the old one
                assert time.monotonic() - begun < 9
                fakes.take(new, None, "unsw", 0, 100.0)
            old.keep("unsw", quality={"level": "lost"})
        with taken(fleet) as new:
            assert new.asset("unsw").quality != {"level": "lost"}


def test_a_worker_that_waits_for_whoever_takes_its_partition_commits_nothing(fleet):
    """The token is compared as it is once the wait is over, not as it was when the transaction began."""
    engine, lost = engine_of(fleet), []
    with taken(fleet, lost=lambda: lost.append(1)) as old, ThreadPoolExecutor() as pool:
        with engine.begin() as db:
            db.execute(sa.update(PARTITIONS).where(PARTITIONS.c.number == 0).values(token=PARTITIONS.c.token + 1))
            waiting = pool.submit(fakes.take, old, None, "unsw", 0, 100.0)
            wait_until(lambda: _waits(engine), 10)
        with pytest.raises(Fenced):
            waiting.result(30)
        assert lost and old.windows("unsw") == ()
    engine.dispose()


def _waits(engine, name="gear-twin p000"):
    """Whether a worker, or whoever has sessions of the name, waits for a lock."""
    with engine.connect() as db:
        own = f"application_name LIKE '{name}%%' AND wait_event_type = 'Lock'"
        return db.exec_driver_sql(f"SELECT count(*) FROM pg_stat_activity WHERE {own}").scalar_one() == 1


def begun_with(store):
    """The assets of all that a worker reads at its start, or looks for."""
    alarms, jobs, due = AlarmStore(store.database), Jobs(store.database), 2**62
    return {
        "assets": set(store.assets()),
        "all": {stored.asset for stored in store.all_assets()},
        "windows": {*store.last_event_ids()},
        "alarms": set(alarms.open_by_asset()),
        "messages": {len(alarms.due(due)), alarms.waiting()},
        "decisions": set(jobs.decision_counts()),
        "waiting": set(WindowJobs(store.database).all_waiting()),
        "routes": set(Names(store.database).routes().values()),
    }


def test_a_worker_begins_with_its_share_of_the_assets_and_with_nothing_else(fleet, tmp_path):
    kinds = ("assets", "all", "windows", "alarms", "decisions", "waiting", "routes")
    nothing = {kind: set() for kind in kinds}
    with taken(fleet, 0) as first, taken(fleet, 2) as third:
        fakes.fill(first, tmp_path)
        filled = begun_with(first)
        both = {"unsw", "other"}
        assert filled["assets"] == filled["all"] == filled["windows"] == both and filled["messages"] == {1}
        assert {name for name, found in filled.items() if not found} <= {"decisions"}
        assert begun_with(third) == {**nothing, "messages": {0}}
        fakes.take(third, None, "b", 0, 100.0)
        assert begun_with(third) == {**nothing, **{kind: {"b"} for kind in kinds[:3]}, "messages": {0}}
        assert begun_with(first) == filled
        with at_front(fleet) as front:
            assert front.assets() == ("b", "other", "unsw")
            assert {row(fleet, asset)["share"] for asset in both} == {0} and row(fleet, "b")["share"] == 2
            number = fakes.decide(front, "b", "misalignment", "accept")
        assert number in [job.id for job in fakes.jobs_of(third).pending()]
        assert begun_with(first) == filled


def test_a_partition_that_is_held_up_delays_no_decision_on_other_assets(fleet):
    """A transaction of its process that stands still has the locks of the assets that it writes to, and no others."""
    with taken(fleet, 0) as first, at_front(fleet) as front, ThreadPoolExecutor() as pool:
        fakes.take(first, None, "a", 0, 100.0)
        fakes.take(first, None, "b", 0, 100.0)
        with first.database.transaction() as db:
            first.database.update_due(db, "a")
            held_up = pool.submit(fakes.decide, front, "a", "misalignment", "accept")
            engine = engine_of(fleet)
            wait_until(lambda: _waits(engine, "gear-twin front end"), 10)
            engine.dispose()
            assert pool.submit(fakes.decide, front, "b", "misalignment", "accept").result(5)
            assert not held_up.done()
        assert held_up.result(20)


@pytest.fixture
def work(tmp_path, fleet):
    """A partition's process, a recording, and what a plain loop makes of it."""
    import fake_twin

    recording = write_recording(tmp_path / "campaign.mcap", 6)
    assessed = plain(assess(recording, twin=fake_twin.TWIN))
    with routed() as endpoint, worker(tmp_path / "partition", fleet, endpoint) as process:
        yield process, recording, assessed, endpoint, process.prefix


def test_a_partition_is_served_as_by_the_plain_loop(work, fleet):
    process, recording, assessed, endpoint, prefix = work
    assert replay(recording, [endpoint], 0, prefix=prefix, recorded="gearbox") == 192
    wait_until(lambda: len(windows(fleet)) == 6)
    assert windows(fleet) == assessed["windows"]
    wait_until(lambda: row(fleet) is not None and row(fleet)["summary"]["windows"] == 6)
    assert row(fleet)["share"] == process.partition


def test_a_suspended_worker_commits_nothing_more_and_ends(work, fleet, tmp_path):
    process, recording, assessed, endpoint, prefix = work
    process.process.send_signal(signal.SIGSTOP)
    other = PartitionProcess(
        tmp_path / "other", fleet, endpoint, partition=process.partition, partitions=3, DATA=process.given["DATA"]
    ).start()
    try:
        replay(recording, [endpoint], 0, prefix=prefix, recorded="gearbox")
        wait_until(lambda: len(windows(fleet)) == 6)
        process.process.send_signal(signal.SIGCONT)
        assert process.process.wait(30) == FENCED
        assert windows(fleet) == assessed["windows"]
    finally:
        other.end()
        print(other.err.read_text())
