"""What is asked of an asset's twin, and what it led to.

    made = carry_out(call)

A window that cannot be used, and a decision that cannot be followed, are results like any other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from service.contract.base import iso_time
from service.errors import StoreError
from service.logs import about
from service.operation.journey import TOTAL
from service.results.segment_file import read_segment
from service.runtime.twin_port import Answer, Twin
from service.stream.edge_counts import EncoderCounts
from service.stream.segment import Segment
from service.stream.window import window_of
from twin.errors import TwinError
from twin.observed import TRACING, PartRefused, observed_by
from twin.rig import Rig
from twin.windows import Fault, Window

UNREADABLE = "stored_window"  # kind of the fault of a window whose file cannot be read


class Ask(NamedTuple):
    """What is asked: `window`, `decide`, `inspect`, `change`, `ignore` or `forget`, and about what."""

    verb: str
    about: Any = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowToUse:
    """A window for the twin: its frames, in memory or in the file in which they were kept.

    before  counts of the encoders by the end of the window before
    refuse  why it is not to be used; None where it is
    """

    start_ns: int
    segment: Segment | None = None
    file: Path | None = None
    before: EncoderCounts = field(default_factory=EncoderCounts)
    refuse: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """One thing asked of one asset's twin.

    hand_back  whether nothing is made of it where it leads to a search for effects, which may take long
    """

    asset: str
    twin: Twin
    rig: Rig
    state: Any
    ask: Ask
    hand_back: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Fell:
    """A revolution count that has fallen: CountFellError as data."""

    reason: str
    seen: float
    fallen: float
    ignored: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """What was made of a call.

    state    the twin's afterwards; None where it has not changed
    answer   what the twin says; None where it was not asked, or refused
    refused  why a window was not used, or anything else not carried out
    window   the window as it was used; without its signals where its frames were read from a file
    encoders counts of the encoders by its end; None where it was not made, or not to be used
    found    faults that its making has found, by channel and kind
    signals  whether it has any, as far as is known
    handed_back  whether nothing was made, since a search for effects is due
    parts    how long it took: `total`, and the parts of the step that the twin names [s]
    """

    state: Any = None
    answer: Answer | None = None
    refused: str | None = None
    fell: Fell | None = None
    window: Window | None = None
    encoders: EncoderCounts | None = None
    found: Mapping[tuple[str, str], int] = field(default_factory=dict)
    signals: bool = True
    handed_back: bool = False
    parts: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Turned:
    """What was done of an asset's jobs.

    job       id of the job that has ended, or waits for people from now on; None where none has
    index     of the window that was committed; -1 where it was none
    search    whether nothing was done, since a search for effects is due
    stopped   why nothing can be done of the asset now
    unstored  why it could not be committed now; what was computed is at hand for the next turn
    """

    asset: str
    job: int | None = None
    kind: str = ""
    index: int = -1
    search: bool = False
    stopped: str | None = None
    unstored: StoreError | OSError | None = None


def carry_out(call: Call) -> Made:
    """What is made of a call."""
    given = call.ask.about
    window = {"window": iso_time(given.start_ns)} if isinstance(given, WindowToUse) else {}
    parts: dict[str, float] = {}

    def watched(name: str) -> AbstractContextManager[None]:
        if call.hand_back and name == TRACING:
            raise PartRefused(name)
        return _timed(parts, name)

    with about(asset=call.asset, **window), observed_by(watched), _timed(parts, TOTAL):
        try:
            made = _VERBS[call.ask.verb](call)
        except PartRefused:
            made = Made(handed_back=True)
    return replace(made, parts=parts)


@contextmanager
def _timed(parts: dict[str, float], name: str) -> Iterator[None]:
    """Adds up how long a part takes [s]."""
    began = time.monotonic()
    try:
        yield
    finally:
        parts[name] = parts.get(name, 0.0) + time.monotonic() - began


def _window(call: Call) -> Made:
    given: WindowToUse = call.ask.about
    segment = given.segment
    if segment is None:
        assert given.file is not None
        try:
            segment = read_segment(given.file)
        except (OSError, ValueError) as error:
            return _unreadable(given, error)
    of_segment = window_of(segment, call.rig, given.before)
    window = of_segment.window
    kept = window if given.file is None else replace(window, accelerations={}, torques={}, encoders={})
    made = Made(
        window=kept,
        encoders=of_segment.counts,
        found=of_segment.found,
        signals=bool(window.accelerations or window.torques or window.encoders),
    )
    if given.refuse is not None:
        return replace(made, refused=given.refuse, encoders=None)
    if window.quality == "refused":
        return replace(made, refused="; ".join(f.detail for f in window.faults if f.action == "refused"))
    try:
        state, answer = call.twin.process(call.rig, call.state, window)
    except TwinError as error:
        from twin.fallen_count import CountFellError  # loads the twin, which only those do who compute

        if isinstance(error, CountFellError):
            fell = Fell(reason=str(error), seen=error.seen, fallen=error.fallen, ignored=error.ignored)
            return replace(made, state=error.state, fell=fell)
        return replace(made, refused=str(error))
    return replace(made, state=state, answer=answer)


def _unreadable(given: WindowToUse, error: Exception) -> Made:
    """A window whose file is damaged or gone is refused, and counted as such."""
    reason = f"the file in which this window was kept cannot be read: {type(error).__name__}: {error}"
    fault = Fault(kind=UNREADABLE, channel="all", count=1, action="refused", detail=reason)
    window = Window(start_time_ns=given.start_ns, faults=(fault,), quality="refused")
    return Made(window=window, refused=reason, signals=False)


def _asked(method: str) -> Callable[[Call], Made]:
    """A verb whose answer changes the twin's state and report."""

    def ask(call: Call) -> Made:
        try:
            state, answer = getattr(call.twin, method)(call.rig, call.state, call.ask.about)
        except TwinError as error:
            return Made(refused=str(error))
        return Made(state=state, answer=answer)

    return ask


_VERBS: Mapping[str, Callable[[Call], Made]] = {
    "window": _window,
    "decide": _asked("apply"),
    "inspect": _asked("inspected"),
    "change": _asked("follow"),
    "ignore": lambda call: Made(state=call.twin.ignore(call.state)),
    "forget": lambda call: Made(state=call.twin.forget(call.state)),
}
