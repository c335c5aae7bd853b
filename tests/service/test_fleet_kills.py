"""A fleet on Ray through kills drawn from a seed: a part of what `make chaos` draws, and the commands beside it."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys

import pytest
from fleet_up import FleetProcess
from fleets import routed
from ray_nodes import RayNodes
from service_streams import ROOT, free_port, wait_until

from service.cli import run
from service.fleet.census import census
from service.fleet.databases import front_tables
from service.fleet.layout import Layout
from service.json_text import plain
from service.results.data_folder import only_service_of
from service.results.roles import Roles
from service.results.sql_store import SqlStore
from service.runtime.assess import assess
from service.runtime.replay import replay
from tests.chaos import fleet

LONG = 180.0  # that the engine may take on a machine whose cores are busy [s]
ASSET = "unsw-short"  # of the recording
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
without_cores = pytest.mark.skipif(
    not os.environ.get("GEAR_TWIN_TEST_ENGINE"), reason="GEAR_TWIN_TEST_ENGINE is not set: see the marker `engine`"
)


@pytest.mark.engine
@without_cores
def test_nothing_is_lost_or_counted_twice_whatever_is_killed(tmp_path):
    kinds = ("ingest", "work", "host", "node", "database", "router", "suspended")
    outcome = fleet.attack(4, 11, tmp_path, print, assets=12, partitions=3, kinds=kinds)
    assert outcome.faults == [] and outcome.schedules == 4 and outcome.windows == 96


def status(capsys, database):
    capsys.readouterr()
    ended = run(["fleet", "status", "--database", database, "--json", "-"])
    return ended, json.loads(capsys.readouterr().out)


@pytest.mark.engine
@without_cores
def test_a_fleet_on_one_machine_is_started_replaces_what_hangs_and_is_ended_by_its_commands(
    tmp_path, empty_postgresql, capsys
):
    ports = {"LISTEN": json.dumps([f"tcp/127.0.0.1:{free_port()}"]), "HTTP": f"127.0.0.1:{free_port()}"}
    running = FleetProcess(tmp_path, empty_postgresql, FLEET_PARTITIONS="2", **ports).start()
    try:
        wait_until(lambda: status(capsys, empty_postgresql)[0] == 0, LONG)
        first, second = status(capsys, empty_postgresql)[1]["partitions"]
        os.kill(int(first["worker"].rpartition(":")[2]), signal.SIGSTOP)

        def replaced():
            ended, found = status(capsys, empty_postgresql)
            return ended == 0 and found["partitions"][0]["token"] > first["token"]

        wait_until(replaced, LONG)
        assert status(capsys, empty_postgresql)[1]["partitions"][1]["token"] == second["token"]
        assert (
            "ingest 0: process" in running.err.read_text()
            and "is silent for 10 s: it is killed" in running.err.read_text()
        )
        assert run(["fleet", "down", "--data", str(running.data)]) == 0
        assert running.process is not None and running.process.wait(30) == 0
        assert status(capsys, empty_postgresql)[0] == 1
    finally:
        running.end(9)


@pytest.mark.engine
@without_cores
def test_a_fleet_on_a_cluster_goes_on_without_fleet_up_and_on_the_nodes_that_there_are(
    tmp_path, empty_postgresql, capsys, monkeypatch
):
    def served():
        ended, found = status(capsys, empty_postgresql)
        return {} if ended else {row["node"]: row["token"] for row in found["partitions"]}

    def tokens():
        return [row["token"] for row in status(capsys, empty_postgresql)[1]["partitions"]]

    def command(*words):
        given = ["--address", ray.address, "--database", empty_postgresql]
        done = subprocess.run(
            [sys.executable, "-m", "service", "fleet", *words, *given], cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    with RayNodes(tmp_path / "ray") as ray, routed() as endpoint:
        given = {"CONNECT": json.dumps([endpoint]), "HTTP": f"127.0.0.1:{free_port()}"}
        for name, value in ray.environment.items():
            monkeypatch.setenv(name, value)
        ray.add("one")
        running = FleetProcess(
            tmp_path, empty_postgresql, FLEET_PARTITIONS="3", FLEET_ADDRESS=ray.address, **given
        ).start()
        try:
            wait_until(lambda: len(served()) == 1, LONG)
            ray.add("two")
            wait_until(lambda: len(served()) == 2, LONG)
            before = tokens()
            assert running.end() == 0
            running.start()
            wait_until(lambda: len(served()) == 2, LONG)
            assert tokens() == before
            before = tokens()
            ray.stop("one")
            wait_until(lambda: any(now > was for now, was in zip(tokens(), before, strict=True)) and served(), LONG)
            assert len(served()) == 1
            ray.add("three")
            wait_until(lambda: len(served()) == 2, LONG)
            before = tokens()
            ray.kill("three")
            wait_until(lambda: any(now > was for now, was in zip(tokens(), before, strict=True)) and served(), LONG)
        finally:
            running.end()
        assert command("down").startswith("all that fleet up has started has ended") and not served()


@pytest.mark.engine
@without_cores
def test_the_twin_itself_gives_what_it_gives_in_one_process(tmp_path, empty_postgresql):
    """Bit for bit; with the recording of the tutorial, which is traced from its third window on."""
    recording, layout = ROOT / "recordings" / "short-campaign.mcap", Layout(3)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    ports = {"LISTEN": json.dumps([endpoint]), "HTTP": f"127.0.0.1:{free_port()}"}
    running = FleetProcess(tmp_path, empty_postgresql, "", FLEET_PARTITIONS="3", **ports).start()
    try:
        partition = layout.partition_of(ASSET)
        with SqlStore(front_tables(empty_postgresql, layout)) as store:
            roles = Roles(store.database)
            wait_until(lambda: not census(roles).not_served, 120)
        replay(str(recording), [endpoint], 0, prefix=layout.prefix_of(partition), recorded="gearbox", wait=300.0)
        expected = plain(assess(recording))
        with SqlStore(front_tables(empty_postgresql, layout)) as store:
            wait_until(lambda: len(store.windows(ASSET)) == len(expected["windows"]), 120)
            found = [plain(window.record) for window in store.windows(ASSET)]
            assert [{k: w[k] for k in found[0] if k in w} for w in expected["windows"]] == [
                {k: v for k, v in w.items() if k in expected["windows"][0]} for w in found
            ]
            assert plain(store.asset(ASSET).report)["rul"] == expected["rul"]
    finally:
        running.end()
    said = running.err.read_text().splitlines()
    assert [line for line in said if "info: new assets: " not in line] == []


def test_commands_without_a_fleet_say_so(tmp_path, empty_postgresql, capsys):
    assert run(["fleet", "status", "--database", empty_postgresql]) == 2
    assert "the database holds no fleet: gear-twin fleet up makes one" in capsys.readouterr().err
    assert run(["fleet", "down", "--data", str(tmp_path)]) == 2
    assert "no fleet runs with the folder" in capsys.readouterr().err
    here = socket.gethostname()
    for left in ("", f"{os.getpid()}\n", f"{here} {os.getpid()} 1\n", f"{here} 4194305 1\n"):  # of one that was killed
        (tmp_path / "fleet.pid").write_text(left)  # whatever has that number now, and a service that has the folder
        with only_service_of(tmp_path):
            assert run(["fleet", "down", "--data", str(tmp_path)]) == 2
        assert "no fleet runs with the folder" in capsys.readouterr().err
    (tmp_path / "fleet.pid").write_text(f"elsewhere {os.getpid()} 1\n")
    assert run(["fleet", "down", "--data", str(tmp_path)]) == 2
    assert "runs on elsewhere: it is ended there" in capsys.readouterr().err
    assert run(["fleet", "down", "--database", empty_postgresql, "--address", "127.0.0.1:1"]) == 2
    assert "the database holds no fleet" in capsys.readouterr().err
    assert run(["fleet", "status"]) == 2
    assert "a fleet needs a PostgreSQL database" in capsys.readouterr().err
    assert run(["fleet", "status", "--database", "postgresql://twin@127.0.0.1:9/none"]) == 2
    assert "cannot be used now (connection lost)" in capsys.readouterr().err
