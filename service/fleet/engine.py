"""What the fleet asks of Ray: an actor for each node, which is a host. Placing and restarting it is Ray's."""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import replace
from typing import Any

from service.errors import DeliveryError
from service.fleet.host import Host
from service.fleet.layout import END_WAIT
from service.fleet.ray_session import NAMESPACE, ROOM

log = logging.getLogger(__name__)

CORES = 0.001  # of a core that the placement counts for a host: how much it computes is a setting of it
ASK_WAIT = 1.0  # for an answer of Ray [s]


class Engine:
    """The hosts of one fleet on Ray.

    ray  as `ray_session` gives it
    """

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self._begun: set[str] = set()

    def look(self, host: Host) -> None:
        """Has each node that is to be one be a host like this, by a name of its own.

        Raises DeliveryError where the engine is lost, or the node of this machine: whoever runs this starts it again.
        """
        nodes = self._nodes()
        for node in nodes - self._begun:
            self._begin(node, host)
        self._begun = nodes

    def end(self) -> None:
        """Ends all hosts, in good order."""
        actors = [actor for node in self._nodes() if (actor := self._found(node)) is not None]
        try:
            self._ray.get([actor.end.remote() for actor in actors], timeout=END_WAIT + ASK_WAIT)
        except self._ray.exceptions.RayError as error:
            log.warning("a host has not ended in good order: %s", str(error).splitlines()[0])
        for actor in actors:
            self._ray.kill(actor)

    def _nodes(self) -> set[str]:
        """The numbers of the nodes that live and are to be hosts."""
        try:
            living = [node for node in self._ray.nodes() if node["Alive"]]
        except (self._ray.exceptions.RayError, RuntimeError) as error:
            raise DeliveryError(f"the engine does not answer: {str(error).splitlines()[0]}") from None
        if self._ray.get_runtime_context().get_node_id() not in [node["NodeID"] for node in living]:
            raise DeliveryError("the engine's node on this machine has ended: start gear-twin fleet up again")
        return {node["NodeID"] for node in living if node["Resources"].get(ROOM, 0) >= 1}

    def _found(self, node: str) -> Any | None:
        with suppress(ValueError):
            return self._ray.get_actor(_name(node), NAMESPACE)
        return None

    def _begin(self, node: str, host: Host) -> None:
        there = self._ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy(node, soft=False)
        options: dict[str, Any] = {
            "name": _name(node),
            "namespace": NAMESPACE,
            "lifetime": "detached",
            "get_if_exists": True,
            "max_restarts": -1,
            "max_concurrency": 2,
            "num_cpus": CORES,
            "resources": {ROOM: 1},
            "scheduling_strategy": there,
        }
        from service.fleet.actor import HostActor

        self._ray.remote(HostActor).options(**options).remote(replace(host, name=node[:12]))


def _name(node: str) -> str:
    return f"host-{node}"
