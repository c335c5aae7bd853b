"""What a window led to, as it is committed and published: its record, state, report, events and counters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from service.contract.base import iso_time
from service.contract.status import with_status_since
from service.contract.window import refused_record, slow_channels
from service.runtime.computing import Made
from service.runtime.lane import Entry, Lane
from service.runtime.outcomes import Outcome
from service.runtime.twin_port import Events
from service.stream.quality import Quality


def outcome_of(
    lane: Lane,
    entry: Entry,
    made: Made,
    counts: Quality,
    section: Callable[[Quality], Mapping[str, Any]],
) -> Outcome:
    """The outcome of a window; counted in `counts`, of which `section` makes the section `data_quality`."""
    window = made.window
    assert window is not None
    refused, answer, index = made.refused, made.answer, lane.index
    report, events, grade = lane.report, Events(), "refused"
    if refused is not None or answer is None:
        record = refused_record(refused or "")
    else:
        record, events, grade = dict(answer.record), answer.events, window.quality
        report = with_status_since(lane.report, answer.report, window.start_time_ns, record.get("revolutions"), index)
    faults = counts.note_window(index, window, grade, made.found)
    record |= {
        "index": index,
        "start_time": iso_time(window.start_time_ns),
        "quality": grade,
        "faults": faults,
        **slow_channels(window),
    }

    return Outcome(
        asset=lane.asset,
        index=index,
        window=window,
        record=record,
        state=lane.state if made.state is None else made.state,
        report=report,
        events=(
            ("window", record),  # as it is kept, with its number and faults
            *((kind, data) for kind, data in events if kind not in ("window", "data_fault")),
            *(("data_fault", fault) for fault in faults),
        ),
        assembly=lane.assembly,
        quality=section(counts),
        waited=entry.number,
        file=entry.file,
        before=lane.encoders.to_dict(),
        making={**(made.encoders or lane.encoders).to_dict(), "found": counts.found},
        signals=made.signals,
    )
