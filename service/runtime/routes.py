"""Which asset each stream belongs to.

A stream is what a publisher calls an asset. It is the asset that began under this name, unless people have said
otherwise: after an asset was given another name, or after the data of its stream were found to be another machine's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class RouteTable(Protocol):
    """Where it is kept which streams belong to assets that began under another name."""

    def routes(self) -> dict[str, str]: ...


class Routes:
    """The assets of streams, as they were read last."""

    def __init__(self, table: RouteTable) -> None:
        self._table, self._routes = table, table.routes()

    def reload(self) -> None:
        """Reads them again, after that has been changed."""
        self._routes = self._table.routes()

    def asset_of(self, stream: str) -> str:
        """The asset that a stream belongs to."""
        return self._routes.get(stream, stream)

    def streams_of(self, asset: str) -> list[str]:
        """The streams that belong to an asset."""
        return streams_of(asset, self._routes)

    @property
    def routed(self) -> tuple[str, ...]:
        """The streams whose asset began under another name."""
        return tuple(self._routes)


def streams_of(asset: str, routes: Mapping[str, str]) -> list[str]:
    """The streams that belong to an asset, that under whose name it began first.

    routes  streams whose asset began under another name, with that asset
    """
    own = [] if asset in routes else [asset]
    return own + [stream for stream, of in routes.items() if of == asset]
