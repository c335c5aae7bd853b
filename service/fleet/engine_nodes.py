"""The nodes of the engine, as far as the fleet knows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from service.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineNode:
    """One node that may serve partitions."""

    id: str
    name: str
    host: str
    room: int  # partitions that it may serve
    alive: bool


def find_node(nodes: Sequence[EngineNode], wanted: str) -> EngineNode:
    """A node by its name, host or the begin of its number; InputError with those that there are."""
    alive = [node for node in nodes if node.alive]
    found = [node for node in alive if wanted in (node.name, node.host) or (wanted and node.id.startswith(wanted))]
    if len(found) != 1:
        known = ", ".join(f"{node.name} ({node.id[:12]})" for node in alive) or "none"
        which = "names several nodes" if found else "is no node of the fleet"
        raise InputError(f"{wanted} {which}; there are {known}")
    return found[0]
