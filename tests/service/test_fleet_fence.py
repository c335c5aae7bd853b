"""One worker commits a partition's results: the one that took it last."""

from __future__ import annotations

import signal
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import service_fakes as fakes
import sqlalchemy as sa
from fleet_partition import PartitionProcess
from fleets import routed, row, taken, windows, worker
from service_streams import wait_until, write_recording

from service.errors import StorageUnavailable, StoreError
from service.fleet.databases import Partitions, engine_of, made
from service.fleet.fence import Fenced
from service.fleet.layout import PARTITIONS, Layout, create, layout_of, partition_of
from service.fleet.partition import FENCED
from service.json_text import plain
from service.results.asset_list import area_of
from service.results.sql_store import SqlStore
from service.runtime.assess import assess
from service.runtime.replay import replay

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


def test_the_number_of_partitions_stays(fleet):
    engine = engine_of(fleet)
    assert layout_of(engine) == Layout(3) and create(engine, 3) == Layout(3)
    with pytest.raises(StoreError, match="this fleet was created with 3, and the number stays"):
        create(engine, 4)
    engine.dispose()


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
    shared = Partitions(fleet, 3)
    with SqlStore(shared.backend(0)) as store, store.database.transaction() as db:
        assert confirms(db) == "on"
    shared.close()


def test_a_window_outlives_a_server_that_is_killed_right_after_its_commit(fleet, postgresql_server):
    with taken(fleet) as store:
        assert fakes.take(store, None, "unsw", 0, 100.0)
        postgresql_server.kill()
    wait_until(lambda: starts(postgresql_server), 30)
    shared = Partitions(fleet, 3)
    with SqlStore(shared.backend(0)) as store:
        assert len(store.windows("unsw")) == 1
    shared.close()


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
            with pytest.raises(Fenced, match="partition 0 has been given to another worker"):
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


def _waits(engine):
    """Whether a worker waits for a lock."""
    with engine.connect() as db:
        own = "application_name LIKE 'gear-twin p000%%' AND wait_event_type = 'Lock'"
        return db.exec_driver_sql(f"SELECT count(*) FROM pg_stat_activity WHERE {own}").scalar_one() == 1


def test_partitions_share_no_row_and_no_number(fleet):
    with taken(fleet, 0) as first, taken(fleet, 2) as third:
        for store, asset in ((first, "a"), (third, "b")):
            fakes.take(store, None, asset, 0, 100.0)
        both = 3 * [(first, "a"), (third, "b")]
        numbers = [fakes.decide(store, asset, "misalignment", "accept") for store, asset in both]
        assert len(set(numbers)) == 6
        assert [Layout(3).partition_of_number(n) for n in numbers] == 3 * [0, 2]
        assert first.assets() == ("a",) and third.assets() == ("b",)
    with taken(fleet, 0) as first:  # the counters go on
        assert fakes.decide(first, "a", "misalignment", "accept") == numbers[-2] + 3


def test_front_ends_read_and_add_to_the_tables_of_any_partition(fleet):
    for partition in range(3):
        made(fleet, partition, 3)
    with taken(fleet, 1) as store:
        fakes.take(store, None, "a", 0, 100.0)
        shared = Partitions(fleet, 3)
        with SqlStore(shared.backend(1)) as front:
            assert len(front.windows("a")) == 1
            number = fakes.decide(front, "a", "misalignment", "accept")
        assert [d.id for d in fakes.jobs_of(store).pending()] == [number]
        shared.close()


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
    wait_until(lambda: len(windows(fleet, process.partition)) == 6)
    assert windows(fleet, process.partition) == assessed["windows"]
    wait_until(lambda: row(fleet) is not None and row(fleet)["summary"]["windows"] == 6)
    assert row(fleet)["partition"] == process.partition


def test_a_suspended_worker_commits_nothing_more_and_ends(work, fleet, tmp_path):
    process, recording, assessed, endpoint, prefix = work
    process.process.send_signal(signal.SIGSTOP)
    other = PartitionProcess(
        tmp_path / "other", fleet, endpoint, partition=process.partition, partitions=3, DATA=process.given["DATA"]
    ).start()
    try:
        replay(recording, [endpoint], 0, prefix=prefix, recorded="gearbox")
        wait_until(lambda: len(windows(fleet, process.partition)) == 6)
        process.process.send_signal(signal.SIGCONT)
        assert process.process.wait(30) == FENCED
        assert windows(fleet, process.partition) == assessed["windows"]
    finally:
        other.end()
        print(other.err.read_text())
