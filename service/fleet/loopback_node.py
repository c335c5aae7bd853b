"""`ray start` with all ports on the loopback interface, for head and nodes on one machine; run as a module.

Ray replaces 127.0.0.1 by the address of another interface, unless it takes itself for a cluster of one machine; another
node is refused then. Both are decided by constants of Ray, which are set here for this process; the processes that it
starts are told by their environment.

Ray gives a node up whose agents have not chosen their ports within 15 s, which they do not on a busy machine. They need
not choose where they are given; the raylet is given one of these ports here, which `ray start` does not hand on.
"""

from __future__ import annotations

import sys
from typing import Any

from ray._private import ray_constants, services
from ray.scripts.scripts import main

LOOPBACK = "127.0.0.1"
LISTEN = "--dashboard-agent-listen-port"
start_ray_process = services.start_ray_process


def here(address: str | None = None) -> str:
    """The address of this machine, as all nodes of the cluster are to know it."""
    return LOOPBACK


def started(command: list[str], process_type: str, *given: Any, **named: Any) -> Any:
    """As Ray starts a process; the raylet is told where its agent listens."""
    if process_type == ray_constants.PROCESS_TYPE_RAYLET:
        ports = [word.partition("=")[2] for word in sys.argv if word.startswith(f"{LISTEN}=")]
        command = [*command, *(f"--dashboard_agent_listen_port={port}" for port in ports)]
    return start_ray_process(command, process_type, *given, **named)


if __name__ == "__main__":
    ray_constants.ENABLE_RAY_CLUSTER = True
    services.get_node_ip_address = here
    services.start_ray_process = started
    sys.argv[0] = "ray"
    main()
