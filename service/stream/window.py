"""One window from the frames of its segment: channels laid out in time, faults named and counted.

    made = window_of(segment, rig, counts)

A pure function of the segment, the rig and the encoders' counts by the end of the window before, so that whoever has
these makes the same window: the worker that computes it, `gear-twin assess`, views and baselines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from service.stream.channels import CHANNEL_KINDS, Layout, kind_of
from service.stream.edge_counts import EncoderCounts
from service.stream.edges import lay_edges, note_reset
from service.stream.quality import grade_of, totals
from service.stream.samples import lay_samples
from service.stream.segment import Segment
from twin.features.plausible import torque_contradiction
from twin.rig import Rig
from twin.windows import Fault, Samples, Window

_NOTHING_LEFT = "neither an accelerometer nor an encoder is left"


@dataclass(frozen=True, slots=True, kw_only=True)
class MadeWindow:
    """A window, and what its making leaves for the window after it.

    counts  of the encoders by its end
    found   faults that laying it out has found, by channel and kind
    """

    window: Window
    counts: EncoderCounts
    found: Mapping[tuple[str, str], int] = field(default_factory=dict)


def window_of(segment: Segment, rig: Rig, before: EncoderCounts) -> MadeWindow:
    """The window of a segment as the twin uses it: laid out, and the instruments examined."""
    made = laid_out(segment, rig, before)
    return made if segment.left_out else replace(made, window=by_sound_instruments(rig, made.window))


def laid_out(segment: Segment, rig: Rig | None, before: EncoderCounts) -> MadeWindow:
    """The window of a segment as its channels show it.

    rig     whose sensor ranges and operating points the values are held against; None where nothing is known
    before  counts of the encoders by the end of the window before
    """
    if segment.left_out:
        window = Window(
            start_time_ns=segment.start_ns, faults=segment.faults, slow=segment.slow, quality=grade_of(segment.faults)
        )
        return MadeWindow(window=window, counts=before)
    window, counts = before.followed(_as_it_came(segment, rig, before.counted), rig)
    return MadeWindow(window=window, counts=counts, found=totals(window.faults[len(segment.faults) :]))


def by_sound_instruments(rig: Rig, window: Window) -> Window:
    """The window as sound instruments would have shown it, graded anew where a fault of one was found.

    Adds a fault for every encoder whose frames have another number of edges than the rig file.
    """
    from twin.instruments import examined  # loads the twin, which only those do who compute

    sound = examined(rig, window)
    found: list[Fault] = []
    for shaft, edges in window.encoders.items():
        key = f"encoders.{shaft}_edges_per_rev"
        stated = rig.get(key)
        if stated is not None and edges.per_rev != stated:
            detail = f"frames with {edges.per_rev} edges a turn; the rig file's {key} is {stated:g}"
            found.append(
                Fault(kind="edges_per_rev", channel=f"encoder/{shaft}", count=1, action="degraded", detail=detail)
            )
    if sound is window and not found:
        return window
    faults = (*sound.faults, *found)
    return replace(sound, faults=faults, quality=grade_of(faults))


def _as_it_came(segment: Segment, rig: Rig | None, counted: Mapping[str, int]) -> Window:
    """The window with its encoders as they came, which had counted so many edges by the end of the window before."""
    span, pieces, most = segment.span, segment.pieces, segment.most
    fields: dict[str, dict[str, Any]] = {k.window_field: {} for k in CHANNEL_KINDS.values() if not k.slow}
    found = list(segment.faults)
    usable = False
    for label in sorted(pieces):
        kind, name = kind_of(label), label.partition("/")[2]
        parts = sorted(pieces[label], key=lambda p: (p.start_ns, p.frame.sequence))
        channel: Any
        if kind.layout is Layout.EDGES:
            channel = lay_edges(label, parts, span.start_ns, found)
            if channel is not None:
                note_reset(label, channel.first_index, counted.get(label, 0), found)
        else:
            channel = lay_samples(label, kind, parts, span, found, rig, most)
            most -= 0 if channel is None else channel.values.size
        if channel is not None:
            fields[kind.window_field][name] = channel
            usable |= kind.usable_alone
    for label in sorted(set(segment.known) - set(pieces)):
        detail = "was there before"
        found.append(Fault(kind="missing_channel", channel=label, count=1, action="degraded", detail=detail))
    if not usable:
        still = any(f.kind == "standstill" for f in found)
        detail = "no edge passed: the machine stands still" if still else _NOTHING_LEFT
        found.append(Fault(kind="nothing_usable", channel="", count=1, action="refused", detail=detail))
    if rig is not None:
        _grade_by_operating_points(rig, fields["torques"].get("pinion"), found)
    return Window(
        start_time_ns=span.start_ns, **fields, slow=dict(segment.slow), faults=tuple(found), quality=grade_of(found)
    )


def _grade_by_operating_points(rig: Rig, torque: Samples | None, faults: list[Fault]) -> None:
    """Degrades a window at a torque that the machine does not run at."""
    if torque is None:
        return
    reason = torque_contradiction(rig, float(np.nanmean(torque.values)))
    if reason is not None:
        faults.append(Fault(kind="operating_range", channel="torque/pinion", count=1, action="degraded", detail=reason))
