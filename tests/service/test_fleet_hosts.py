"""Any number of hosts share a fleet: whichever is killed, the others go on with what it had, and nothing is missing."""

from __future__ import annotations

import os
import signal
import threading
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace

import fake_twin
import pytest
from fleet_hosts import HostProcess
from fleets import PARTITIONS, at_front, routed, windows
from forked_processes import is_alive, started_by
from service_streams import wait_until, write_recording
from test_workers import without_pid

from service.fleet.census import census, partitions
from service.fleet.layout import Layout, partition_of
from service.fleet.lease import HOST
from service.json_text import plain
from service.results.roles import INGEST, Roles
from service.runtime.assess import assess
from service.runtime.ingest import _Sayer
from service.runtime.replay import replay
from service.runtime.role_process import Context, Others

WINDOWS = 6
LONG = 60.0  # that a step may take on a machine whose cores are busy [s]
LAYOUT = Layout(PARTITIONS)
ASSETS = [next(n for n in (f"m{i}" for i in range(99)) if partition_of(n, PARTITIONS) == p) for p in range(PARTITIONS)]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600), pytest.mark.serve_only("has hosts of its own")]


class Plant:
    """Hosts by name, and what they have stored."""

    def __init__(self, folder, database, endpoint, store):
        self.folder, self.database, self.endpoint = folder, database, endpoint
        self.store, self.roles, self.hosts = store, Roles(store.database), {}

    def start(self, *names, **settings):
        for name in names:
            host = HostProcess(
                self.folder / "said", self.folder / "data", self.database, self.endpoint, name, PARTITIONS, **settings
            )
            self.hosts[name] = host.start()
        return [self.hosts[name] for name in names]

    def served(self):
        """By host, the partitions that it serves."""
        found = {}
        for each in partitions(self.roles):
            if each.served and each.not_ready is None:
                found.setdefault(each.ingest.node, []).append(each.number)
        return found

    def all_served(self, *names):
        """Whether all partitions are served, by all of these hosts."""
        found = self.served()
        return sum(map(len, found.values())) == PARTITIONS and set(found) == set(names)

    def send(self, paths, asset, pace):
        replay(
            paths[asset], [self.endpoint], prefix=LAYOUT.prefix_of(partition_of(asset, PARTITIONS)),
            recorded="gearbox", wait=300.0, **pace,
        )  # fmt: skip

    @contextmanager
    def sending(self, paths, **pace):
        """Recordings are sent meanwhile; all of each is stored in the end."""
        threads = [threading.Thread(target=self.send, args=(paths, asset, pace)) for asset in paths]
        for thread in threads:
            thread.start()
        yield
        for thread in threads:
            thread.join(300)
            assert not thread.is_alive()


@pytest.fixture
def plant(tmp_path, fleet):
    with ExitStack() as stack:
        endpoint = stack.enter_context(routed())
        made = Plant(tmp_path, fleet, endpoint, stack.enter_context(at_front(fleet)))
        try:
            yield made
        finally:
            for host in made.hosts.values():
                host.end()
                print(host.err.read_text())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording of a machine of each partition, and the windows that a plain loop makes of it."""
    folder = tmp_path_factory.mktemp("recorded")
    paths = {a: write_recording(folder / f"{a}.mcap", WINDOWS, a, seed=i) for i, a in enumerate(ASSETS)}
    return paths, {a: plain(assess(path, twin=fake_twin.TWIN))["windows"] for a, path in paths.items()}


def stored(plant, asset):
    return without_pid(windows(plant.database, asset))


def test_hosts_share_the_partitions_and_one_that_is_killed_is_replaced_by_the_others(plant, recorded):
    paths, expected = recorded
    first, second = plant.start("first", "second")
    wait_until(lambda: plant.all_served("first", "second"), LONG)
    assert sorted(map(len, plant.served().values())) == [1, 2]
    with plant.sending(paths, speed=2.0, max_pause=3.0):
        wait_until(lambda: all(len(windows(plant.database, asset)) >= 1 for asset in ASSETS), LONG)
        started = [second.process.pid, *started_by(second.process.pid)]
        second.end()
        wait_until(lambda: not any(map(is_alive, started)), 10.0)
        wait_until(lambda: plant.all_served("first"), LONG)
    for asset in ASSETS:
        wait_until(lambda asset=asset: len(windows(plant.database, asset)) >= WINDOWS, LONG)
        assert stored(plant, asset) == expected[asset]
    second.start()
    wait_until(lambda: plant.all_served("first", "second"), LONG)
    assert census(plant.roles).not_served == []
    assert first.end(signal.SIGTERM) == 0


@pytest.mark.parametrize("role", ["lease", "ingest", "work"])
def test_a_role_of_a_host_that_is_killed_is_there_again_and_nothing_is_missing(plant, recorded, role):
    paths, expected = recorded
    (host,) = plant.start("alone")
    wait_until(lambda: plant.all_served("alone"), LONG)
    name = f"ingest {partition_of(ASSETS[0], PARTITIONS)}" if role == "ingest" else role
    with plant.sending(paths, speed=4.0, max_pause=2.0):
        wait_until(lambda: all(len(windows(plant.database, asset)) >= 1 for asset in ASSETS), LONG)
        others = {each: host.role(each) for each in ("lease", "work", "ingest 0", "ingest 1", "ingest 2")}
        os.kill(others.pop(name), signal.SIGKILL)
        wait_until(lambda: host.role(name) is not None, LONG)
        wait_until(lambda: plant.all_served("alone"), LONG)
    for asset in ASSETS:
        wait_until(lambda asset=asset: len(windows(plant.database, asset)) >= WINDOWS, LONG)
        assert stored(plant, asset) == expected[asset]
    assert {each: host.role(each) for each in others} == others


def test_a_host_that_does_not_see_the_folder_of_the_fleet_is_refused_and_the_others_go_on(plant, recorded):
    """It once took the windows that waited for lost, and had all others begin anew for each of them."""
    paths, _ = recorded
    plant.start("first")
    wait_until(lambda: plant.all_served("first"), LONG)
    with plant.sending(paths, speed=4.0, max_pause=2.0):
        (other,) = plant.start("other", DATA=str(plant.folder / "not mounted"))
        assert other.process.wait(LONG) != 0 and "is its disk mounted" in other.err.read_text()
    for asset in ASSETS:
        wait_until(lambda asset=asset: len(windows(plant.database, asset)) >= WINDOWS, LONG)
    assert plant.all_served("first") and not (plant.folder / "not mounted").exists()


def test_a_host_that_was_suspended_while_another_took_its_partitions_writes_nothing_more_and_has_its_share_again(
    plant, recorded
):
    paths, expected = recorded
    _, second = plant.start("first", "second")
    wait_until(lambda: plant.all_served("first", "second"), LONG)
    second.process.send_signal(signal.SIGSTOP)
    wait_until(lambda: plant.all_served("first"), LONG)
    with plant.sending(paths, speed=4.0, max_pause=2.0):
        wait_until(lambda: all(len(windows(plant.database, asset)) >= 2 for asset in ASSETS), LONG)
        second.process.send_signal(signal.SIGCONT)
        wait_until(lambda: plant.all_served("first", "second"), LONG)
    for asset in ASSETS:
        wait_until(lambda asset=asset: len(windows(plant.database, asset)) >= WINDOWS, LONG)
        assert stored(plant, asset) == expected[asset]


def test_a_host_without_a_partition_computes_for_those_of_others(plant, recorded):
    paths, expected = recorded
    plant.start("receives", WORKERS="2")
    wait_until(lambda: plant.all_served("receives"), LONG)
    names = [f"h{number}" for number in range(PARTITIONS)]
    plant.start(*names)
    wait_until(lambda: len([row for row in plant.roles.look() if row.role == HOST]) == PARTITIONS + 1, LONG)
    wait_until(lambda: len(plant.served()) == PARTITIONS, LONG)
    (idle,) = {"receives", *names} - set(plant.served())
    with plant.sending({ASSETS[0]: paths[ASSETS[0]]}, speed=0.0):
        pass
    wait_until(lambda: len(windows(plant.database, ASSETS[0])) >= WINDOWS, LONG)
    assert stored(plant, ASSETS[0]) == expected[ASSETS[0]]
    assert plant.hosts[idle].role("work") is not None and plant.hosts[idle].role("ingest 0") is None


@pytest.mark.parametrize("alone", [True, False])
def test_who_receives_says_nothing_more_to_its_supervisor_while_a_loop_hangs_and_nobody_else_would_see_it(alone):
    """In `serve`, /healthz and the watchdog of systemd do."""
    late, beats = [], []
    context = Context(INGEST, threading.Event(), Others())
    context.beat = lambda: beats.append(1)
    says = _Sayer(context, SimpleNamespace(late=lambda: late), alone=alone)
    says.start()
    try:
        wait_until(lambda: len(beats) >= 3)
        late.append("reception: no turn since 130 s")
        before = len(beats) + 1  # one that has begun
        says.join(1.0)  # twenty turns
        assert (len(beats) > before) == (not alone)
    finally:
        says.end()
        says.join(10)
