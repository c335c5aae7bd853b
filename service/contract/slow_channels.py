"""Values of slow channels in a window's record: by the kind's key (`temperatures`), then by name."""

from __future__ import annotations

from typing import Any

from service.stream.channels import kind_of
from twin.windows import Window


def slow_channels(window: Window) -> dict[str, dict[str, Any]]:
    """What a window's record says of its slow channels, in the contract's units; no key where there are none.

    Each entry has `value`, `unit`, `values` (how many of the window it summarises; 0 where it is an older one) and
    `age_s` (of the newest value at the window's end).
    """
    out: dict[str, dict[str, Any]] = {}
    for label, slow in window.slow.items():
        kind, name = kind_of(label), label.partition("/")[2]
        out.setdefault(kind.record_key, {})[name] = {
            "value": slow.value - kind.si_offset,
            "unit": kind.unit,
            "values": slow.count,
            "age_s": slow.age,
        }
    return out
