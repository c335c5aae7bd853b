"""`gear-twin fleet router`: the network's router as a process of its own, which nothing else ends.

It keeps nothing: publishers hold their frames until they are stored, and connect again after it was away.
"""

from __future__ import annotations

from collections.abc import Callable

from service.errors import InputError
from service.operation.systemd import READY, STOPPING, notify
from service.runtime.admission import demand_protected_links
from service.settings import Settings
from service.termination import until_told
from service.transport.zenoh_session import open_session


def route(settings: Settings, announce: Callable[[str], None] = print) -> None:
    """Routes at the endpoints of the settings until SIGINT or SIGTERM.

    Raises InputError where everybody could publish without that being meant.
    """
    if settings.connect:
        raise InputError("connect must be empty: the router is what others connect to, at its endpoints of listen")
    demand_protected_links(settings)
    with until_told() as stop, open_session(settings.listen, links=settings.zenoh_links):
        announce(f"routing at {', '.join(settings.listen)}")
        notify(READY)
        stop.wait()
        notify(STOPPING)
