"""Figures of the worker for /metrics, read by other threads while it works."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.runtime.intake import Intake
from service.runtime.lanes import Lanes
from service.runtime.reception import Reception
from service.runtime.spool import Spool
from service.runtime.storage_watch import StorageWatch
from service.runtime.streams import Streams
from service.stream.inbox import Inbox

CAUSES = ("no_room", "bad_key", "too_many_streams", "closed", "retired", "unopened")


def stream_figures(
    inbox: Inbox, network: Mapping[str, int], streams: Streams | None, intake: Intake | None
) -> dict[str, Any]:
    """Of what is received."""
    causes = dict.fromkeys(CAUSES, 0) | dict(inbox.refused)
    causes["retired"] = 0 if streams is None else sum(list(streams.left_out.values()))
    causes["unopened"] = 0 if intake is None else intake.left_out
    return {
        "queue_frames": inbox.depth,
        "queue_bytes": inbox.bytes,
        "received_frames": inbox.received,
        "frames_left_out": causes,
        "missed_frames": network.get("missed_frames", 0),
        "callback_errors": inbox.errors + network.get("callback_errors", 0),
    }


def storage_figures(storage: StorageWatch, data: Path, spool: Spool | None) -> dict[str, Any]:
    """Of where results are kept."""
    found = {
        "storage_unavailable": float(storage.reason is not None),
        "storage_failures": storage.failures,
        "windows_in_memory_bytes": 0 if spool is None else spool.held_bytes,
    }
    try:
        return {**found, "storage_free_bytes": shutil.disk_usage(data).free}
    except OSError:
        return found


def lane_figures(lanes: Lanes | None, reception: Reception | None) -> dict[str, Any]:
    """Of the windows that wait, all together and by asset."""
    every = [] if lanes is None else lanes.all()
    shed = {(lane.asset, "processing"): lane.shed for lane in every}
    if reception is not None:
        shed |= {(asset, "reception"): count for asset, count in reception.shed().items()}
    return {
        "program_faults": 0 if lanes is None else lanes.faults,
        "windows_waiting": sum(len(lane.entries) for lane in every),
        "windows_waiting_bytes": sum(lane.bytes for lane in every),
        "lag_seconds": {lane.asset: lane.lag for lane in every},
        "backlog_windows": {lane.asset: max(len(lane.entries) - lane.held, 0) for lane in every},
        "held_windows": {lane.asset: lane.held for lane in every},
        "windows_shed": shed,
    }
