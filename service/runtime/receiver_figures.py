"""Figures of whoever receives frames for /metrics, read by other threads while it works."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.results.asset_table import AssetTable
from service.runtime.backlogs import NOTHING, Backlogs
from service.runtime.followed import Followed
from service.runtime.intake import Intake
from service.runtime.reception import Reception
from service.runtime.spool import Spool
from service.runtime.storage_watch import StorageWatch
from service.runtime.streams import Streams
from service.runtime.window_outcomes import LEFT_OUT
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


def waiting_figures(
    table: AssetTable, followed: Followed | None, backlogs: Backlogs | None, reception: Reception | None
) -> dict[str, Any]:
    """Of the windows that wait, all together and by asset."""
    every = {} if backlogs is None else backlogs.all
    known = dict.fromkeys(table.known(), NOTHING) | dict(every)
    shed = {(asset, "processing"): shed_of(table, asset) for asset in known}
    if reception is not None:
        shed |= {(asset, "reception"): count for asset, count in reception.shed().items()}
    return {
        "program_faults": 0 if followed is None else followed.faults,
        "windows_waiting": sum(waits.all_windows for waits in every.values()),
        "windows_waiting_bytes": sum(waits.bytes for waits in every.values()),
        "lag_seconds": {asset: waits.lag for asset, waits in known.items()},
        "backlog_windows": {asset: waits.windows for asset, waits in known.items()},
        "held_windows": {asset: waits.held for asset, waits in known.items()},
        "windows_shed": shed,
    }


def shed_of(table: AssetTable, asset: str) -> int:
    """How many windows of an asset were left out because too many waited."""
    shown = table.latest(asset)
    return 0 if shown is None else shown.fault_totals.get((*LEFT_OUT, "refused"), (0, 0))[1]
