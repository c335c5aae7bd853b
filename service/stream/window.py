"""One window from the pieces of its frames: channels laid out in time, faults named and counted."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from service.stream.channels import CHANNEL_KINDS, Layout, kind_of
from service.stream.edges import lay_edges, note_reset
from service.stream.faults import grade_of
from service.stream.pieces import Piece
from service.stream.samples import MOST_SAMPLES, Span, lay_samples
from twin.features.plausible import torque_contradiction
from twin.rig import Rig
from twin.windows import Fault, Samples, SlowValue, Window

_NOTHING_LEFT = "neither an accelerometer nor an encoder is left"


def build_window(
    span: Span,
    pieces: Mapping[str, Sequence[Piece]],
    known: Collection[str] = (),
    counted: Mapping[str, int] | None = None,
    slow: Mapping[str, SlowValue] | None = None,
    faults: Sequence[Fault] = (),
    rig: Rig | None = None,
    most: int = MOST_SAMPLES,
) -> Window:
    """The window of pieces by channel label.

    known    channels that earlier windows had
    counted  edges that each encoder had counted by their end
    slow     values of the slow channels
    faults   found before the window was laid out
    rig      whose sensor ranges and operating points the values are held against
    most     samples of all channels together
    """
    fields: dict[str, dict[str, Any]] = {k.window_field: {} for k in CHANNEL_KINDS.values() if not k.slow}
    found = list(faults)
    usable = False
    for label in sorted(pieces):
        kind, name = kind_of(label), label.partition("/")[2]
        parts = sorted(pieces[label], key=lambda p: (p.start_ns, p.frame.sequence))
        channel: Any
        if kind.layout is Layout.EDGES:
            channel = lay_edges(label, parts, span.start_ns, found)
            if channel is not None:
                note_reset(label, channel.first_index, (counted or {}).get(label, 0), found)
        else:
            channel = lay_samples(label, kind, parts, span, found, rig, most)
            most -= 0 if channel is None else channel.values.size
        if channel is not None:
            fields[kind.window_field][name] = channel
            usable |= kind.usable_alone
    for label in sorted(set(known) - set(pieces)):
        detail = "was there before"
        found.append(Fault(kind="missing_channel", channel=label, count=1, action="degraded", detail=detail))
    if not usable:
        still = any(f.kind == "standstill" for f in found)
        detail = "no edge passed: the machine stands still" if still else _NOTHING_LEFT
        found.append(Fault(kind="nothing_usable", channel="", count=1, action="refused", detail=detail))
    if rig is not None:
        _grade_by_operating_points(rig, fields["torques"].get("pinion"), found)
    return Window(
        start_time_ns=span.start_ns, **fields, slow=dict(slow or {}), faults=tuple(found), quality=grade_of(found)
    )


def _grade_by_operating_points(rig: Rig, torque: Samples | None, faults: list[Fault]) -> None:
    """Degrades a window at a torque that the machine does not run at."""
    if torque is None:
        return
    reason = torque_contradiction(rig, float(np.nanmean(torque.values)))
    if reason is not None:
        faults.append(Fault(kind="operating_range", channel="torque/pinion", count=1, action="degraded", detail=reason))
