"""What the fleet asks of Ray: an actor for each partition, placed where there is room, restarted and moved.

Placement, restarts and the knowledge of which nodes live are Ray's; nothing of it is kept here.
"""

from __future__ import annotations

import logging
import math
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any

import ray
from ray.actor import ActorHandle
from ray.exceptions import GetTimeoutError, RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from service.errors import DeliveryError, InputError
from service.fleet.actor import END_WAIT, PartitionActor
from service.fleet.cluster import NAMESPACE, ROOM, said_by
from service.fleet.engine_nodes import EngineNode
from service.fleet.layout import Layout
from service.settings import Settings

log = logging.getLogger(__name__)

CORES = 0.001  # of a core that the placement counts for a partition: room is counted in partitions
ASK_WAIT = 2.0  # for an actor's answer [s]


def join(address: str) -> None:
    """Connects this process to Ray at an address; DeliveryError where it is not reached."""
    try:
        ray.init(address=address, namespace=NAMESPACE, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError, RayError) as error:
        line = str(error).strip().split("\n")[0]
        raise DeliveryError(f"the engine at {address} cannot be reached: {line}") from None


class Engine:
    """The partitions of one fleet on a cluster of Ray that this process has joined."""

    def __init__(self, settings: Settings, layout: Layout, twin_from: str | None = None) -> None:
        self._settings, self._layout, self._twin_from = settings, layout, twin_from

    def place(self) -> None:
        """Has an actor for each partition; those that are there stay."""
        for partition in self._layout.all:
            self._actor(partition)

    def nodes(self) -> list[EngineNode]:
        """The nodes that have room for partitions, those that have ended as well."""
        found = []
        for node in ray.nodes():
            room = int(node["Resources"].get(ROOM, 0))
            found.append(
                EngineNode(
                    id=node["NodeID"], name=said_by(node), host=node["NodeManagerHostname"], room=room,
                    alive=bool(node["Alive"]),
                )
            )  # fmt: skip
        return [node for node in found if node.room or not node.alive]

    def room(self) -> int:
        """Partitions that all nodes that live may serve together."""
        return sum(node.room for node in self.nodes() if node.alive)

    def drain(self, node: EngineNode, served: Mapping[int, str], address: str) -> list[int]:
        """Moves the partitions of a node to others, and lets the engine place nothing there any more; which they were.

        served  the node's number by partition, as the partitions say it
        Raises InputError where the other nodes have no room for them.
        """
        here = sorted(partition for partition, on in served.items() if node.id.startswith(on))
        left = sum(other.room for other in self.nodes() if other.alive and other.id != node.id)
        if left < self._layout.partitions:
            raise InputError(
                f"{node.name} cannot be drained: the other nodes have room for {left} of the fleet's "
                f"{self._layout.partitions} partitions; add a node first"
            )
        _close(node, address)
        for partition in here:
            self.move(partition)
        return here

    def spread(self, served: Mapping[int, str]) -> list[tuple[int, str]]:
        """Partitions that are to be moved so that no node serves more than its share, each with the node that has room.

        served  the node's number by partition, as the partitions say it
        """
        nodes = [node for node in self.nodes() if node.alive and node.room]
        here = {node.id: sorted(p for p, on in served.items() if on and node.id.startswith(on)) for node in nodes}
        share = math.ceil(self._layout.partitions / max(len(nodes), 1))
        surplus = [partition for own in here.values() for partition in own[share:]]
        moves = []
        for partition in surplus:
            least = min(here, key=lambda id: len(here[id]))
            here[least].append(partition)
            moves.append((partition, least))
        return moves

    def move(self, partition: int, to: str | None = None) -> None:
        """Ends the work on a partition in good order; it goes on where there is room.

        to  number of the node that is preferred
        """
        actor = self._actor(partition)
        try:
            ray.get(actor.end.remote(), timeout=END_WAIT + ASK_WAIT)
        except (RayError, GetTimeoutError) as error:
            log.warning("partition %d did not end in good order: %s", partition, str(error).split("\n")[0])
        if to is None:
            ray.kill(actor, no_restart=False)
            return
        ray.kill(actor)
        end = time.monotonic() + END_WAIT
        while self._find(partition) is not None and time.monotonic() < end:
            time.sleep(0.05)
        self._actor(partition, NodeAffinitySchedulingStrategy(to, soft=True))

    def end(self) -> None:
        """Ends all partitions, in good order."""
        actors = [actor for partition in self._layout.all if (actor := self._find(partition)) is not None]
        ending: list[Any] = [actor.end.remote() for actor in actors]
        ray.wait(ending, num_returns=len(ending), timeout=END_WAIT + ASK_WAIT)
        for actor in actors:
            ray.kill(actor)

    def leave(self) -> None:
        """Ends the connection to Ray."""
        ray.shutdown()

    def _find(self, partition: int) -> ActorHandle | None:
        try:
            return ray.get_actor(_name(partition), NAMESPACE)
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
        remote = ray.remote(PartitionActor).options(**options)
        return remote.remote(self._settings, partition, self._layout, self._twin_from)


def _name(partition: int) -> str:
    return f"partition-{partition:03d}"


def _close(node: EngineNode, address: str) -> None:
    """Lets the engine place nothing on a node any more."""
    command = [
        sys.executable, "-m", "ray.scripts.scripts", "drain-node", f"--address={address}", f"--node-id={node.id}",
        "--reason=DRAIN_NODE_REASON_PREEMPTION", "--reason-message=gear-twin fleet drain",
    ]  # fmt: skip
    begun = time.monotonic()
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        line = (done.stderr or done.stdout).strip().splitlines()[-1:]
        raise DeliveryError(f"{node.name} could not be drained: {' '.join(line)}")
    log.info("%s is closed for new partitions (%.1f s)", node.name, time.monotonic() - begun)
