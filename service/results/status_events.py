"""The event `status`: the health of a machine, or the quality of its data, is another than before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.results.snapshot import Snapshot

Events = tuple[tuple[str, Mapping[str, Any]], ...]
NAMED = ("level", "reasons", "action", "since")


def status_events(before: Snapshot | None, status: Mapping[str, Any], data: Mapping[str, Any]) -> Events:
    """The event where the level of `status` or of `data` differs from what was shown before; none where neither does.

    before  the snapshot so far; None where the asset has not been shown yet
    """
    whole = {} if before is None else before.whole
    was, had = (whole.get(key, {}).get("level") for key in ("status", "data"))
    if (was, had) == (status["level"], data["level"]):
        return ()
    told = {**{name: status.get(name) for name in NAMED}, "before": was, "data": dict(data)}
    return (("status", told),)
