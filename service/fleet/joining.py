"""Joining the engine: Ray reads its environment when it is imported; nothing that imports it is loaded before."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from service.fleet.cluster import environment, environment_to_join

if TYPE_CHECKING:
    from service.fleet.engine import Engine


def joined(folder: Path, address: str, *, alone: bool) -> type[Engine]:
    """Connects this process to Ray at an address, with the token of the fleet's folder where there is one.

    Ray reads its environment when it is imported, and is not imported before.

    alone  whether the cluster is of this machine alone, as `LocalCluster` starts it
    """
    os.environ.update(environment(folder) if alone else environment_to_join(folder))
    from service.fleet.engine import Engine, join

    join(address)
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):  # Ray prints where the program was, before it hands them on
            signal.signal(number, signal.getsignal(number))
    return Engine
