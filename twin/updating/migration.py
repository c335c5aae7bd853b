"""Serialised memory of schema version 1, brought to the keys of the present version.

Version 1 kept the update by RMS under "paper", the non-gear content of a window under "beside", and of every segment
only the depth at its start: the profile there is computed again, segment by segment, with the first window after it.
`Memory.from_dict` and `WindowInput.from_dict` accept the present keys only; whoever opens an older state calls these
functions first.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def _renamed(data: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    return {names.get(key, key): value for key, value in data.items()}


def migrate_memory_v1(data: Mapping[str, Any]) -> dict[str, Any]:
    """The dictionary of a `Memory` of version 1 with the keys of the present version; an empty one stays empty."""
    if not data:
        return {}
    segments = [{**segment, "start_profile": None} for segment in data["segments"]]
    return {**_renamed(data, {"paper": "rms_track"}), "segments": segments}


def migrate_window_input_v1(data: Mapping[str, Any]) -> dict[str, Any]:
    """The dictionary of a `WindowInput` of version 1 with the keys of the present version."""
    return _renamed(data, {"beside": "non_gear"})
