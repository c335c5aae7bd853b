"""`ray start` with all ports on the loopback interface, for head and nodes on one machine; run as a module.

Ray replaces 127.0.0.1 by the address of another interface, unless it takes itself for a cluster of one machine; another
node is refused then. Both are decided by constants of Ray, which are set here for this process; the processes that it
starts are told by their environment.
"""

from __future__ import annotations

import sys

from ray._private import ray_constants, services
from ray.scripts.scripts import main

LOOPBACK = "127.0.0.1"


def here(address: str | None = None) -> str:
    """The address of this machine, as all nodes of the cluster are to know it."""
    return LOOPBACK


if __name__ == "__main__":
    ray_constants.ENABLE_RAY_CLUSTER = True
    services.get_node_ip_address = here
    sys.argv[0] = "ray"
    main()
