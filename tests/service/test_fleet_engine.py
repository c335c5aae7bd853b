"""What the fleet asks of Ray; with a Ray of the test's own."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

from service.errors import DeliveryError
from service.fleet.engine import Engine
from service.fleet.host import Host
from service.fleet.layout import Layout
from service.settings import Settings


class RayError(Exception):
    """As Ray raises it."""


class FakeRay:
    """Actors by name, and the nodes that live."""

    exceptions = SimpleNamespace(RayError=RayError)
    util = SimpleNamespace(
        scheduling_strategies=SimpleNamespace(NodeAffinitySchedulingStrategy=lambda node, soft: (node, soft))
    )

    def __init__(self, *nodes):
        self.hosts, self.living, self.ended = {}, ["own", *nodes], []

    def get_runtime_context(self):
        return SimpleNamespace(get_node_id=lambda: "own")

    def nodes(self):
        return [
            {"NodeID": id, "Alive": True, "Resources": {} if id == "own" else {"host": 1.0}} for id in self.living
        ]  # fmt: skip

    def get_actor(self, name, namespace):
        if name not in self.hosts:
            raise ValueError(name)
        return SimpleNamespace(name=name, end=SimpleNamespace(remote=lambda: self.ended.append(name)))

    def remote(self, kind):
        def options(*, name, scheduling_strategy, **given):
            assert given["max_restarts"] == -1 and given["lifetime"] == "detached" and given["get_if_exists"]
            assert scheduling_strategy == (name.removeprefix("host-"), False)
            return SimpleNamespace(remote=lambda host: self.hosts.setdefault(name, host))

        return SimpleNamespace(options=options)

    def get(self, given, timeout):
        assert given == [None] * len(self.hosts)

    def kill(self, actor):
        del self.hosts[actor.name]


@pytest.fixture(autouse=True)
def without_ray(monkeypatch):
    monkeypatch.setitem(sys.modules, "service.fleet.actor", SimpleNamespace(HostActor=None))


HOST = Host(settings=Settings(), layout=Layout(2))


def test_each_node_that_is_to_be_a_host_is_one_as_soon_as_it_is_there():
    ray = FakeRay("one")
    engine = Engine(ray)
    engine.look(HOST)
    assert {name: host.name for name, host in ray.hosts.items()} == {"host-one": "one"}
    ray.living.append("two")
    engine.look(HOST)
    assert list(ray.hosts) == ["host-one", "host-two"]
    ray.living.remove("one")
    engine.look(HOST)
    ray.living.append("one")
    Engine(ray).look(HOST)  # of another process, which finds them
    assert list(ray.hosts) == ["host-one", "host-two"]


def test_all_hosts_are_ended_also_those_that_another_process_has_begun():
    ray = FakeRay("one", "two")
    Engine(ray).look(HOST)
    Engine(ray).end()
    assert sorted(ray.ended) == ["host-one", "host-two"] and not ray.hosts


def test_an_engine_that_was_lost_is_said():
    ray = FakeRay("one")
    engine = Engine(ray)
    ray.living.remove("own")
    with pytest.raises(DeliveryError, match="node on this machine has ended: start gear-twin fleet up again"):
        engine.look(HOST)

    def refuse():
        raise RayError("no answer\nat all")

    ray.nodes = refuse
    with pytest.raises(DeliveryError, match=r"^the engine does not answer: no answer$"):
        engine.look(HOST)
