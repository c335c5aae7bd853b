"""What the fleet asks of Ray, and what it does about the answers; with a Ray of the test's own."""

from __future__ import annotations

import sys
from collections import Counter
from types import SimpleNamespace

import pytest

from service.errors import DeliveryError
from service.fleet import engine as module
from service.fleet.engine import Engine
from service.fleet.layout import Condition, Layout
from service.settings import Settings


class RayError(Exception):
    """As Ray raises it."""


class FakeRay:
    """Actors whose answers the test gives: a condition, an error, or None for none."""

    exceptions = SimpleNamespace(RayError=RayError)
    util = SimpleNamespace(
        scheduling_strategies=SimpleNamespace(NodeAffinitySchedulingStrategy=lambda node, soft: (node, soft))
    )

    def __init__(self, partitions, nodes=("one",), room=8):
        self.answers = {f"partition-{p:03d}": Condition(node=nodes[0], served=True) for p in range(partitions)}
        self.living, self.room = ["own", *nodes], room
        self.killed, self.ended, self.placed = [], [], {}

    def get_runtime_context(self):
        return SimpleNamespace(get_node_id=lambda: "own")

    def nodes(self):
        return [
            {"NodeID": id, "NodeName": f"{id}-name", "NodeManagerHostname": "here", "Alive": True,
             "Resources": {} if id == "own" else {"partition": float(self.room)}}
            for id in self.living
        ]  # fmt: skip

    def get_actor(self, name, namespace):
        if name not in self.answers:
            raise ValueError(name)
        called = SimpleNamespace(remote=lambda: (name, object()))
        ended = SimpleNamespace(remote=lambda: self.ended.append(name))
        return SimpleNamespace(name=name, condition=called, end=ended)

    def remote(self, kind):
        def made(settings, partition, layout, twin_from):
            node, _ = self.placed[f"partition-{partition:03d}"] = self.strategy
            self.answers[f"partition-{partition:03d}"] = Condition(node=node, served=True)
            return self.get_actor(f"partition-{partition:03d}", None)

        def options(*, scheduling_strategy, **given):
            self.strategy = scheduling_strategy
            assert given["max_restarts"] == -1 and given["lifetime"] == "detached"
            return SimpleNamespace(remote=made)

        return SimpleNamespace(options=options)

    def wait(self, asked, *, num_returns, timeout):
        return [each for each in asked if self.answers[each[0]] is not None], []

    def get(self, given, timeout=None):
        if isinstance(given, list):
            return None
        answer = self.answers[given[0]]
        if isinstance(answer, Exception):
            raise answer
        return answer

    def kill(self, actor, no_restart=True):
        self.killed.append((actor.name, no_restart))
        if no_restart:
            del self.answers[actor.name]


@pytest.fixture
def clock(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


def fleet(ray, partitions=2, said=None, **settings):
    engine = Engine(ray, Settings(**settings), Layout(partitions), report=(said if said is not None else []).append)
    engine.find()
    return engine


def test_a_partition_that_does_not_answer_is_killed_and_ray_starts_it_again(clock):
    """It stayed as it was for ever: only its own threads were asked."""
    ray, said = FakeRay(2), []
    engine = fleet(ray, said=said, loop_limit=60.0)
    engine.look()
    ray.answers["partition-001"] = None
    for _ in range(7):
        clock[0] += 10.0
        engine.look()
    assert ray.killed == []
    clock[0] += 10.0
    engine.look()
    assert ray.killed == [("partition-001", False)]
    assert "partition 1 hangs, and is started again: it does not answer for 60 s" in said
    clock[0] += 600.0
    engine.look()  # it is starting: that it does not answer yet is no hang
    assert len(ray.killed) == 1
    ray.answers["partition-001"] = Condition(node="one", served=True)
    engine.look()
    assert said[-1] == "partition 1 is served again"


def test_a_partition_that_says_that_its_loops_hang_is_killed(clock):
    ray, said = FakeRay(2), []
    engine = fleet(ray, said=said)
    ray.answers["partition-000"] = Condition(node="one", served=True, late=("reception: no turn since 130 s",))
    engine.look()
    assert ray.killed == [("partition-000", False)]
    assert said == ["partition 0 hangs, and is started again: reception: no turn since 130 s"]


def test_a_partition_whose_process_has_ended_is_ray_s_to_restart_and_is_said_where_that_takes_long(clock):
    ray, said = FakeRay(2, room=1), []
    engine = fleet(ray, said=said)
    engine.look()
    ray.answers["partition-001"] = RayError("the actor died\nwith much besides")
    engine.look()
    assert ray.killed == said == []
    for _ in range(3):
        clock[0] += 21.0
        engine.look()
    assert ray.killed == [] and len(said) == 1
    assert said[0].startswith("partition 1 is not served: the nodes have room for 1 of 2 partitions; add a node.")


def test_an_engine_that_was_lost_is_said(clock):
    ray = FakeRay(2)
    engine = fleet(ray)
    ray.living.remove("own")
    with pytest.raises(DeliveryError, match="node on this machine has ended: start gear-twin fleet up again"):
        engine.look()

    def refuse():
        raise RayError("no answer\nat all")

    ray.nodes = refuse
    with pytest.raises(DeliveryError, match=r"^the engine does not answer: no answer$"):
        engine.look()


def test_a_node_that_is_added_gets_its_share(clock, monkeypatch):
    monkeypatch.setitem(sys.modules, "service.fleet.actor", SimpleNamespace(PartitionActor=None))
    ray = FakeRay(5)
    engine = fleet(ray, 5)
    engine.look()
    ray.living.append("two")
    engine.look()
    assert ray.killed == []
    clock[0] += 11.0
    engine.look()
    assert Counter(ray.placed.values()) == {("two", True): 2} and ray.ended == list(ray.placed)
    clock[0] += 11.0
    engine.look()
    assert len(ray.placed) == 2
