"""A fleet whose database fails over to a server that lags: it is said, and what is sent again makes all of it equal."""

from __future__ import annotations

import json
import shutil
import threading
import urllib.error
import urllib.request
from contextlib import ExitStack, contextmanager

import fake_twin
import pytest
from fleet_partition import PartitionProcess
from fleets import front, routed
from postgresql_server import PostgresqlServer, programs
from service_streams import wait_until, write_recording
from test_stepped_back import _owned_as

from service.fleet.databases import engine_of
from service.fleet.layout import Layout, create
from service.json_text import plain
from service.runtime.assess import assess
from service.runtime.replay import replay

WINDOWS = 6
LAYOUT = Layout(2)
LONG = 120.0  # that a step may take on a machine whose cores are busy [s]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900), pytest.mark.serve_only("has a fleet and a server of its own")]


@contextmanager
def started_again(processes):
    """Starts each process anew that ends, as the engine does; how often it was."""
    ended, counts = threading.Event(), dict.fromkeys(processes, 0)

    def look():
        while not ended.wait(0.1):
            for process in processes:
                if process.process.poll() is not None:
                    counts[process] += 1
                    process.start()

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield counts
    finally:
        ended.set()
        thread.join()
        for process in processes:
            process.end()


def asked(address, path):
    """Status and answer of a front end; None where it has none."""
    try:
        with urllib.request.urlopen(address + path, timeout=10) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, None


def beats(server, url):
    """How often those who receive have said how they are, by partition."""
    return dict(server.sql("SELECT share, beat FROM fleet.roles WHERE role = 'ingest'", url.rpartition("/")[2]))


def all_have_said_more(server, url, before):
    now = beats(server, url)
    return now.keys() == before.keys() and all(now[partition] > before[partition] + 1 for partition in before)


@pytest.mark.parametrize("idle", [False, True])
def test_two_partitions_whose_server_fails_over_to_one_that_lags_go_on_from_what_is_there(tmp_path, monkeypatch, idle):
    if programs() is None:
        pytest.skip("PostgreSQL is not installed (Debian's package postgresql)")
    first = "unsw"
    second = next(f"m{i}" for i in range(9) if LAYOUT.partition_of(f"m{i}") != LAYOUT.partition_of(first))
    recordings = {
        asset: write_recording(tmp_path / f"{asset}.mcap", WINDOWS, asset, seed=seed)
        for seed, asset in enumerate((first, second))
    }
    expected = {asset: plain(assess(path, twin=fake_twin.TWIN))["windows"] for asset, path in recordings.items()}
    monkeypatch.setenv("FAKE_TWIN_SECONDS", "1.0")
    with ExitStack() as stack:
        server = stack.enter_context(PostgresqlServer())
        url = stack.enter_context(server.new_database())
        engine = engine_of(url)
        create(engine, 2)
        engine.dispose()
        endpoint = stack.enter_context(routed())
        workers = {
            asset: PartitionProcess(
                tmp_path / asset,
                url,
                endpoint,
                partition=LAYOUT.partition_of(asset),
                partitions=2,
                DATA=str(tmp_path / "data"),
            ).start()
            for asset in recordings
        }
        counts = stack.enter_context(started_again(tuple(workers.values())))
        address = stack.enter_context(front(url, tmp_path / "front"))

        def send():
            for asset, path in recordings.items():
                prefix = LAYOUT.prefix_of(LAYOUT.partition_of(asset))
                replay(path, [endpoint], 0, prefix=prefix, recorded="gearbox", wait=LONG)

        def windows(asset):
            return asked(address, f"/v1/assets/{asset}/windows?limit=100")[1] or []

        def ready():
            return asked(address, "/readyz")[0] == 200

        wait_until(ready, LONG)
        send()
        wait_until(lambda: all(len(windows(asset)) >= 2 for asset in recordings), LONG)
        copied = beats(server, url)
        server.stop("immediate")
        shutil.copytree(server.data, server.folder / "lagging")
        _owned_as(server.folder / "lagging", server.data)
        server.start()
        wait_until(lambda: all_have_said_more(server, url, copied), LONG)  # each has something to lose
        if idle:
            wait_until(lambda: all(windows(asset) == expected[asset] for asset in recordings), LONG)
        else:
            wait_until(lambda: all(len(windows(asset)) >= 4 for asset in recordings), LONG)
        server.stop("immediate")
        server.data.rename(server.folder / "first")
        (server.folder / "lagging").rename(server.data)
        wait_until(lambda: not ready(), LONG)
        before = dict(counts)
        server.start()
        wait_until(lambda: all(counts[w] > before[w] for w in workers.values()), LONG)
        monkeypatch.setenv("FAKE_TWIN_SECONDS", "0")
        wait_until(ready, LONG)
        send()
        wait_until(lambda: all(windows(asset) == expected[asset] for asset in recordings), LONG)
        for worker in workers.values():
            said = "".join(path.read_text() for path in sorted(worker.folder.glob("complained-*.txt")))
            assert "does not have what it had confirmed" in said
