"""What the fleet asks of Ray: an actor for each partition. Placing and restarting them is Ray's.

Beside that, partitions that do not answer, or say that they hang, are killed, so that Ray restarts them, and each node
gets its share of the partitions when one has been added: Ray does neither.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from service.errors import DeliveryError
from service.fleet.layout import END_WAIT, Condition, Layout
from service.fleet.ray_session import NAMESPACE, ROOM
from service.settings import Settings

log = logging.getLogger(__name__)

CORES = 0.001  # of a core that the placement counts for a partition: room is counted in partitions
ASK_WAIT = 1.0  # for the answers of a look [s]
ALARM_AFTER = 20.0  # time without service after which a partition is an alarm [s]
SPREAD_AFTER = 10.0  # time after a node has come in which Ray has placed what it can [s]


@dataclass(slots=True, eq=False)
class _Partition:
    """A partition's actor, and what is known of it.

    condition  its last answer; None after its process has ended, until the next one answers
    served_at  when it was last known to be served [s]
    asked      the question that it has not answered yet, since when [s]
    """

    actor: Any
    condition: Condition | None
    served_at: float
    asked: Any = None
    since: float = 0.0


class Engine:
    """The partitions of one fleet on Ray.

    ray     as `ray_session` gives it
    report  called with a line when a partition is not served for long, and when it is again
    """

    def __init__(
        self, ray: Any, settings: Settings, layout: Layout, *, twin_from: str | None = None,
        report: Callable[[str], None] = log.error,
    ) -> None:  # fmt: skip
        self._ray, self._settings, self._layout = ray, settings, layout
        self._twin_from, self._report = twin_from, report
        self._partitions: dict[int, _Partition] = {}
        self._reported: set[int] = set()
        self._nodes: set[str] = set()
        self._spread_at = math.inf

    def create(self) -> None:
        """Has an actor for each partition; those that are there stay."""
        for partition in self._layout.all:
            self._partitions[partition] = _Partition(self._actor(partition), None, time.monotonic())

    def find(self) -> None:
        """Finds the actors that are there."""
        for partition in self._layout.all:
            actor = self._found(partition)
            if actor is not None:
                self._partitions[partition] = _Partition(actor, None, time.monotonic())

    def look(self) -> None:
        """One look at all partitions and nodes.

        Raises DeliveryError where the engine is lost, or the node of this machine: whoever runs this starts it again.
        """
        nodes = self._rooms()
        self._ask()
        late = {p for p, it in self._partitions.items() if time.monotonic() - it.served_at > ALARM_AFTER}
        if new := late - self._reported:
            room, of = sum(nodes.values()), self._layout.partitions
            why = f"no worker has begun to serve within {ALARM_AFTER:g} s; the log of its node says what it does"
            if room < of:
                why = f"the nodes have room for {room} of {of} partitions; add a node"
            self._report(f"{_partitions(new)} not served: {why}. Its assets' frames wait with their publishers.")
        if back := self._reported - late:
            self._report(f"{_partitions(back)} served again")
        self._reported = late
        if self._nodes and set(nodes) - self._nodes:
            self._spread_at = time.monotonic() + SPREAD_AFTER
        self._nodes = set(nodes)
        if time.monotonic() >= self._spread_at and not late:
            self._spread_at = math.inf
            self._spread(nodes)

    def end(self) -> None:
        """Ends all partitions, in good order."""
        self._end(list(self._partitions))
        for it in self._partitions.values():
            self._ray.kill(it.actor)

    def _rooms(self) -> dict[str, int]:
        """For how many partitions the nodes that live have room, by the node's number."""
        try:
            living = [node for node in self._ray.nodes() if node["Alive"]]
        except (self._ray.exceptions.RayError, RuntimeError) as error:
            raise DeliveryError(f"the engine does not answer: {str(error).splitlines()[0]}") from None
        if self._ray.get_runtime_context().get_node_id() not in [node["NodeID"] for node in living]:
            raise DeliveryError("the engine's node on this machine has ended: start gear-twin fleet up again")
        return {node["NodeID"]: int(node["Resources"][ROOM]) for node in living if ROOM in node["Resources"]}

    def _ask(self) -> None:
        """Asks each partition how it is; one that hangs is killed, and Ray starts it again."""
        for it in self._partitions.values():
            if it.asked is None:
                it.asked, it.since = it.actor.condition.remote(), time.monotonic()
        asked = [it.asked for it in self._partitions.values()]
        answered = set(self._ray.wait(asked, num_returns=len(asked), timeout=ASK_WAIT)[0]) if asked else set()
        now = time.monotonic()
        for partition, it in self._partitions.items():
            if it.asked not in answered:
                if it.condition is not None and now - it.since > self._settings.loop_limit:
                    self._replace(partition, f"it does not answer for {self._settings.loop_limit:g} s")
                continue
            try:
                it.condition = self._ray.get(it.asked)
            except self._ray.exceptions.RayError:  # its process has ended, and Ray starts it again
                it.condition = None
            it.asked = None
            if it.condition is not None and it.condition.late:
                self._replace(partition, "; ".join(it.condition.late))
            elif it.condition is not None and it.condition.served:
                it.served_at = now

    def _replace(self, partition: int, why: str) -> None:
        self._report(f"partition {partition} hangs, and is started again: {why}")
        it = self._partitions[partition]
        self._ray.kill(it.actor, no_restart=False)
        it.condition = it.asked = None

    def _end(self, partitions: list[int]) -> None:
        """Ends the work on partitions in good order."""
        ending = [self._partitions[partition].actor.end.remote() for partition in partitions]
        try:
            self._ray.get(ending, timeout=END_WAIT + ASK_WAIT)
        except self._ray.exceptions.RayError as error:
            log.warning("%s not ended in good order: %s", _partitions(set(partitions)), str(error).splitlines()[0])

    def _spread(self, nodes: Iterable[str]) -> None:
        """Moves partitions so that no node serves more than its share."""
        on = {p: it.condition.node for p, it in self._partitions.items() if it.condition is not None}
        here = {node: [partition for partition in on if on[partition] == node] for node in nodes}
        share = math.ceil(self._layout.partitions / max(len(here), 1))
        for partition in [partition for own in here.values() for partition in own[share:]]:
            least = min(here, key=lambda node: len(here[node]))
            here[least].append(partition)
            self._move(partition, least)

    def _move(self, partition: int, node: str) -> None:
        """Ends a partition's actor, and has one on another node, or wherever there is room once that has ended."""
        it = self._partitions[partition]
        self._end([partition])
        self._ray.kill(it.actor)
        end = time.monotonic() + END_WAIT
        while self._found(partition) is not None and time.monotonic() < end:
            time.sleep(0.05)
        there = self._ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy(node, soft=True)
        it.actor, it.condition, it.asked = self._actor(partition, there), None, None

    def _found(self, partition: int) -> Any | None:
        try:
            return self._ray.get_actor(_name(partition), NAMESPACE)
        except ValueError:
            return None

    def _actor(self, partition: int, strategy: Any = "SPREAD") -> Any:
        options: dict[str, Any] = {
            "name": _name(partition),
            "namespace": NAMESPACE,
            "lifetime": "detached",
            "get_if_exists": True,
            "max_restarts": -1,
            "max_concurrency": 4,
            "num_cpus": CORES,
            "resources": {ROOM: 1},
            "scheduling_strategy": strategy,
        }
        from service.fleet.actor import PartitionActor  # loads Ray, which reads its environment then

        remote = self._ray.remote(PartitionActor).options(**options)
        return remote.remote(self._settings, partition, self._layout, self._twin_from)


def _name(partition: int) -> str:
    return f"partition-{partition:03d}"


def _partitions(numbers: set[int]) -> str:
    listed = ", ".join(str(number) for number in sorted(numbers))
    return f"partition {listed} is" if len(numbers) == 1 else f"partitions {listed} are"
