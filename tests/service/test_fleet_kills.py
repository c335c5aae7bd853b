"""A fleet on Ray through kills drawn from a seed: a part of what `make chaos` draws, and the commands beside it."""

from __future__ import annotations

import json
import os

import pytest
from fleet_up import FleetProcess
from service_streams import free_port, wait_until

from service.cli import run
from tests.chaos import fleet

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
without_cores = pytest.mark.skipif(
    not os.environ.get("GEAR_TWIN_TEST_ENGINE"), reason="GEAR_TWIN_TEST_ENGINE is not set: see the marker `engine`"
)


@pytest.fixture(autouse=True)
def environment():
    """What joining the engine sets stays with the test."""
    before = dict(os.environ)
    yield
    os.environ.clear()
    os.environ.update(before)


@pytest.mark.engine
@without_cores
def test_nothing_is_lost_or_counted_twice_whatever_is_killed(tmp_path):
    kinds = ("worker", "node", "database", "router", "suspended")
    outcome = fleet.attack(4, 11, tmp_path, print, assets=12, partitions=3, kinds=kinds)
    assert outcome.faults == [] and outcome.schedules == 4 and outcome.windows == 96


def status(capsys, database):
    capsys.readouterr()
    ended = run(["fleet", "status", "--database", database, "--json", "-"])
    return ended, json.loads(capsys.readouterr().out)


def nodes(capsys, database):
    """The nodes of the partitions; none while a partition is not served."""
    ended, found = status(capsys, database)
    return [] if ended else sorted({row["node"] for row in found["partitions"]})


@pytest.mark.engine
@without_cores
def test_a_fleet_is_started_scaled_drained_and_ended_by_its_commands(tmp_path, empty_postgresql, capsys):
    ports = {"LISTEN": json.dumps([f"tcp/127.0.0.1:{free_port()}"]), "HTTP": f"127.0.0.1:{free_port()}"}
    running = FleetProcess(tmp_path, empty_postgresql, FLEET_PARTITIONS="3", **ports).start()
    here = ["--database", empty_postgresql, "--data", str(running.data)]
    try:
        wait_until(lambda: status(capsys, empty_postgresql)[0] == 0, 120)
        assert run(["fleet", "scale", "2", *here]) == 0
        wait_until(lambda: len(nodes(capsys, empty_postgresql)) == 2, 120)
        first = nodes(capsys, empty_postgresql)[0]
        assert run(["fleet", "drain", first, *here]) == 0
        assert "serves no partition any more" in capsys.readouterr().out
        ended, found = status(capsys, empty_postgresql)
        assert ended == 0 and first not in {row["node"] for row in found["partitions"]}
        assert run(["fleet", "down", "--data", str(running.data)]) == 0
        assert running.process is not None and running.process.wait(30) == 0
        assert status(capsys, empty_postgresql)[0] == 1
    finally:
        running.end(9)


def test_commands_without_a_fleet_say_so(tmp_path, empty_postgresql, capsys):
    assert run(["fleet", "status", "--database", empty_postgresql]) == 2
    assert "the database holds no fleet: gear-twin fleet up makes one" in capsys.readouterr().err
    assert run(["fleet", "down", "--data", str(tmp_path)]) == 2
    assert "no fleet runs with the folder" in capsys.readouterr().err
    assert run(["fleet", "status"]) == 2
    assert "a fleet needs a PostgreSQL database" in capsys.readouterr().err
    assert run(["fleet", "status", "--database", "postgresql://twin@127.0.0.1:9/none"]) == 2
    assert "cannot be used now (connection lost)" in capsys.readouterr().err
