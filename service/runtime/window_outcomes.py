"""What a window led to, as it is committed: its record, state, report, events and counters."""

from __future__ import annotations

from service.contract.base import iso_time
from service.contract.status import with_status_since
from service.contract.window import refused_record, slow_channels
from service.runtime.computing import Made
from service.runtime.outcomes import Outcome
from service.runtime.place import Place
from service.runtime.twin_port import Events
from twin.windows import Fault, Window

SHED = "shed"  # kind of the fault of a window whose frames are left out
LEFT_OUT = (SHED, "all")  # kind and channel of that fault where the window had been received whole


def without_room(reason: str) -> Fault:
    """Why a window is refused whose frames are left out."""
    return Fault(kind=SHED, channel="all", count=1, action="refused", detail=reason)


def left_out(start_ns: int, reason: str) -> Made:
    """What is made of a window that had no room to wait."""
    window = Window(start_time_ns=start_ns, faults=(without_room(reason),), quality="refused")
    return Made(window=window, refused=reason, signals=False)


def given_up(start_ns: int, reason: str) -> Made:
    """What is made of a window that has ended those who carried it out: nothing, and its file is kept."""
    return Made(window=Window(start_time_ns=start_ns, quality="refused"), refused=reason)


def outcome_of(place: Place, made: Made) -> Outcome:
    """The outcome of a window."""
    window = made.window
    assert window is not None
    refused, answer, index = made.refused, made.answer, place.index
    report, events, grade = place.report, Events(), "refused"
    if refused is not None or answer is None:
        record = refused_record(refused or "")
    else:
        record, events, grade = dict(answer.record), answer.events, window.quality
        report = with_status_since(place.report, answer.report, window.start_time_ns, record.get("revolutions"), index)
    counts = place.counts.copy()
    faults = counts.note_window(index, window, grade, made.found)
    record |= {
        "index": index,
        "start_time": iso_time(window.start_time_ns),
        "quality": grade,
        "faults": faults,
        **slow_channels(window),
    }

    return Outcome(
        asset=place.asset,
        index=index,
        window=window,
        record=record,
        state=place.state if made.state is None else made.state,
        report=report,
        events=(
            ("window", record),  # as it is kept, with its number and faults
            *((kind, data) for kind, data in events if kind not in ("window", "data_fault")),
            *(("data_fault", fault) for fault in faults),
        ),
        before=place.encoders.to_dict(),
        making={**(made.encoders or place.encoders).to_dict(), **counts.to_dict()},
        signals=made.signals,
    )
