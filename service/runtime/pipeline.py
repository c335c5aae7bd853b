"""The one loop: frames of any source → whole windows → the twin → the results.

    pipeline = Pipeline(rig_of, twin, sink)
    for frame in source:
        pipeline.feed(frame)
    pipeline.flush()

The sink commits each window with everything that a restart needs, and publishes it afterwards. An asset advances to
the state after a window only once that window has been committed. No threads, no clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from service.contract.base import iso_time
from service.contract.slow_channels import slow_channels
from service.contract.status import with_status_since
from service.contract.window import refused_record
from service.errors import FrameError
from service.files.rig import assembly_for, expected_channels, window_of_rig
from service.runtime.outcomes import (
    Checkpoint,
    DecisionOutcome,
    Freshness,
    HeldWindow,
    ResultSink,
    WaitingPlace,
    WindowOutcome,
)
from service.runtime.questions import ALL_WAIT, COUNT_FELL, REPEATED, count_fell, frames_repeat
from service.runtime.twin_port import Events, Twin
from service.settings import Settings
from service.stream.assembly import DEFAULT, Assembler, AssemblySettings
from service.stream.frames import Frame
from service.stream.quality import Quality
from service.stream.wire.topics import Channel
from twin.errors import NotAvailable, TwinError
from twin.fallen_count import CountFellError
from twin.machine_change import MachineChange
from twin.rig import Rig
from twin.tracing.decisions import Decision
from twin.windows import Window

ONE_DISTURBED = (
    "the revolution count of this window alone lies far below that of the windows before and after it: it is taken for "
    "a disturbance of the counter"
)


@dataclass(slots=True)
class _Progress:
    """How far one asset has come."""

    rig: Rig
    expected: tuple[str, ...]  # labels of the channels that the rig file names
    assembler: Assembler
    twin: Twin
    state: Any
    index: int = 0  # of the next window
    report: Mapping[str, Any] | None = None
    quality: Quality = field(default_factory=Quality)
    question: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What the twin made of one window."""

    state: Any
    report: Mapping[str, Any] | None
    record: Mapping[str, Any]
    events: Events = ()
    grade: str

    @classmethod
    def refusal(cls, progress: _Progress, reason: str, state: Any = None) -> Result:
        """A window that was not used."""
        return cls(
            state=progress.state if state is None else state,
            report=progress.report,
            record=refused_record(reason),
            grade="refused",
        )


class Pipeline:
    """Takes frames of any number of assets to committed and published outcomes.

    before_window  called before each window is processed; an exception of it leaves the window unprocessed
    host_clock     Unix time of this host [ns], which frames of a live stream are held against; None for recordings
    waiting        where windows wait for an answer by people; None where nobody answers, and they are refused
    twin_of        the twin of an asset with this rig; None where all have the same
    """

    def __init__(
        self,
        rig_of: Callable[[str], Rig],
        twin: Twin,
        sink: ResultSink,
        *,
        assembly: AssemblySettings = DEFAULT,
        before_window: Callable[[], None] = lambda: None,
        host_clock: Callable[[], int] | None = None,
        waiting: WaitingPlace | None = None,
        twin_of: Callable[[str, Rig], Twin] | None = None,
    ):
        self._host_clock, self._waiting = host_clock, waiting
        self._twin_of = twin_of or (lambda asset, rig: twin)
        self._rig_of, self._twin, self._sink, self._assembly = rig_of, twin, sink, assembly
        self._before_window = before_window
        self._assets: dict[str, _Progress] = {}

    @property
    def assets(self) -> list[str]:
        """The assets seen so far."""
        return sorted(self._assets)

    def open(self, asset: str) -> None:
        """Prepares for an asset's first frame: its rig file is looked up now."""
        self._progress(asset)

    def feed(self, frame: Frame) -> None:
        """Takes one frame in."""
        asset = frame.channel.asset
        progress = self._progress(asset)
        now_ns = None if self._host_clock is None else self._host_clock()
        for window, assembly in list(progress.assembler.assemble(frame, now_ns)):
            self._process(asset, progress, window, assembly)
        self._look_for_repeats(asset, progress)

    def flush(self, asset: str | None = None) -> None:
        """Closes the windows in progress, of one asset or of all: at the end of a file, or after silence."""
        for name in [asset] if asset is not None else self.assets:
            progress = self._progress(name)
            for window, assembly in list(progress.assembler.finish()):
                self._process(name, progress, window, assembly)

    def reject(self, channel: Channel, error: FrameError) -> None:
        """Counts a frame that breaks the contract; its sequence number will be missing."""
        progress = self._progress(channel.asset)
        progress.assembler.count(channel.label, "invalid")
        progress.quality.note("invalid", channel.label, 1, "refused", str(error))

    def expect(self, asset: str, labels: Iterable[str]) -> None:
        """Waits for these channels too before the asset's first window."""
        self._progress(asset).assembler.expect(labels)

    def wait_only_for(self, asset: str, labels: Iterable[str]) -> None:
        """Lets an asset's windows close without the channels that have fallen silent."""
        self._progress(asset).assembler.wait_only_for(labels)

    def channels(self, asset: str) -> Collection[str]:
        """The channels that an asset's windows wait for."""
        return self._progress(asset).assembler.channels

    def waiting(self, asset: str) -> bool:
        """Whether frames of an asset wait for their window's end."""
        return asset in self._assets and self._assets[asset].assembler.waiting

    def decide(self, asset: str, name: str, verb: str) -> DecisionOutcome:
        """What an engineer's decision on an effect leads to, for `accept`; TwinError where it cannot be followed."""
        if asset not in self._assets:
            raise NotAvailable(f"no window of {asset} has been processed yet")
        progress = self._assets[asset]
        state, answer = progress.twin.apply(progress.rig, progress.state, Decision(name=name, verb=verb))
        report = with_status_since(progress.report, answer.report, progress.assembler.closed_until_ns, None)
        return DecisionOutcome(asset=asset, state=state, report=report, events=answer.events)

    def inspect(self, asset: str, inspection: Mapping[str, Any]) -> DecisionOutcome:
        """What a measured wear depth leads to, for `accept`; TwinError where it cannot be used."""
        if asset not in self._assets:
            raise NotAvailable(f"no window of {asset} has been processed yet")
        progress = self._assets[asset]
        state, answer = progress.twin.inspected(progress.rig, progress.state, inspection)
        report = progress.report if progress.report is None else {**progress.report, **answer.report}
        return DecisionOutcome(asset=asset, state=state, report=report or answer.report, events=answer.events)

    def follow(self, asset: str, made: MachineChange) -> DecisionOutcome:
        """What a change of the machine leads to, for `accept`; TwinError where it cannot be followed."""
        if asset not in self._assets:
            raise NotAvailable(f"no window of {asset} has been processed yet: there is nothing that the change ends")
        progress = self._assets[asset]
        state, answer = progress.twin.follow(progress.rig, progress.state, made)
        report = with_status_since(progress.report, answer.report, self._ended_ns(progress), None)
        return DecisionOutcome(asset=asset, state=state, report=report, events=answer.events)

    def accept(self, outcome: DecisionOutcome) -> None:
        """Goes on from a decision, an inspection or a change, once it has been committed."""
        progress = self._assets[outcome.asset]
        progress.state, progress.report = outcome.state, outcome.report

    def quality(self, asset: str) -> dict[str, Any]:
        """The section `data_quality` as of now."""
        progress = self._progress(asset)
        return progress.quality.to_dict(progress.assembler.counters, progress.expected)

    def freshness(self, asset: str) -> Freshness:
        """When the newest frame of an asset came, and when its newest window ended."""
        assembler = self._progress(asset).assembler
        return Freshness(assembler.last_arrival_ns, assembler.closed_until_ns or None)

    def restore(self, asset: str, checkpoint: Checkpoint) -> None:
        """Goes on where an earlier run committed its last window of an asset."""
        progress = self._progress(asset)
        progress.assembler = Assembler.from_dict(checkpoint.assembly, progress.assembler.settings)
        progress.state, progress.report = checkpoint.state, checkpoint.report
        progress.index = checkpoint.index + 1
        progress.quality = Quality.from_dict(checkpoint.quality)
        progress.question = checkpoint.question

    # -- questions -----------------------------------------------------------------------------------

    def question(self, asset: str) -> Mapping[str, Any] | None:
        """The question about an asset that is open."""
        return self._assets[asset].question if asset in self._assets else None

    def ask(self, asset: str, question: Mapping[str, Any] | None) -> None:
        """Opens a question, once it has been committed, or ends it."""
        self._progress(asset).question = question

    def ignoring(self, asset: str) -> Any:
        """The state that refuses windows of the fallen count without asking again."""
        return self._twin.ignore(self._progress(asset).state)

    def forgotten(self, asset: str) -> Any:
        """The state without the fallen count: its windows are another machine's; None where the asset has none."""
        return self._twin.forget(self._assets[asset].state) if asset in self._assets else None

    def set_state(self, asset: str, state: Any) -> None:
        """Goes on from another state, once it has been committed."""
        self._progress(asset).state = state

    def next_index(self, asset: str) -> int:
        """The index that the asset's next window will have."""
        return self._progress(asset).index

    def ended_ns(self, asset: str) -> int:
        """End of the newest window on the stream's own clock, else the host's time; Unix time [ns]."""
        return self._ended_ns(self._progress(asset))

    def use_waiting(self, asset: str) -> None:
        """Processes the windows that waited for an answer; those that raise another question go on waiting."""
        if self._waiting is None:
            return
        progress = self._progress(asset)
        for number, window in self._waiting.waiting(asset):
            if progress.question is not None and progress.question["kind"] in ALL_WAIT:
                return
            self._process(asset, progress, window, progress.assembler.to_dict(), waited=number)

    def refuse_waiting(self, asset: str, reason: str) -> None:
        """Commits the windows that waited as refused, for a reason."""
        if self._waiting is None:
            return
        progress = self._progress(asset)
        for number, window in self._waiting.waiting(asset):
            self._commit(
                asset, progress, window, progress.assembler.to_dict(), Result.refusal(progress, reason), number
            )

    def ignore_repeats(self, asset: str) -> None:
        """Asks no more about the frames that are left out at present."""
        self._progress(asset).assembler.repeats.ignored = True

    def _look_for_repeats(self, asset: str, progress: _Progress) -> None:
        """Asks where nothing but frames of passed times is received, and ends that question where others come."""
        repeats = progress.assembler.repeats
        if self._waiting is None or (progress.question is not None and progress.question["kind"] != REPEATED):
            return
        frames = repeats.suspicious()
        if frames and progress.question is None:
            question = frames_repeat(asset, frames, bool(repeats.other), self._ended_ns(progress))
            progress.question = self._waiting.ask(asset, question)
        elif progress.question is not None and not repeats.run:
            progress.question = self._waiting.ask(asset, None)

    # -- life ----------------------------------------------------------------------------------------

    def rename(self, asset: str, name: str) -> None:
        """Goes on under another name, once that has been committed."""
        if asset in self._assets:
            self._assets[name] = self._assets.pop(asset)

    def split(self, asset: str, name: str, *, fresh: bool) -> None:
        """A new asset takes over the stream of another one, which keeps its state and what it has seen.

        fresh  whether the new asset has not used any of the stream so far
        """
        old, new = self._progress(asset), self._progress(name)
        if not fresh:
            kept = Assembler.from_dict(old.assembler.to_dict(), old.assembler.settings)
            new.assembler, old.assembler = old.assembler, kept

    def reopen(self, asset: str) -> None:
        """Goes on with the rig file that the asset has now."""
        progress = self._progress(asset)
        progress.rig = self._rig_of(asset)
        progress.expected = expected_channels(progress.rig)
        progress.assembler.settings = assembly_for(progress.rig, self._assembly)
        progress.twin = self._twin_of(asset, progress.rig)

    def renew_twin(self, asset: str) -> None:
        """Goes on with the options that the asset has now."""
        if asset in self._assets:
            progress = self._assets[asset]
            progress.twin = self._twin_of(asset, progress.rig)

    def _progress(self, asset: str) -> _Progress:
        if asset not in self._assets:
            rig = self._rig_of(asset)
            expected = expected_channels(rig)
            assembler = Assembler(assembly_for(rig, self._assembly))
            self._assets[asset] = _Progress(rig, expected, assembler, self._twin_of(asset, rig), self._twin.new_state())
        return self._assets[asset]

    def _process(
        self,
        asset: str,
        progress: _Progress,
        window: Window,
        assembly: Mapping[str, Any],
        waited: int | None = None,
    ) -> None:
        """One window through the twin to the sink, or to where it waits for an answer by people."""
        self._before_window()
        raw, window = window, window_of_rig(progress.rig, window)
        open_question = progress.question
        if open_question is not None and open_question["kind"] in ALL_WAIT and window.quality != "refused":
            self._hold(asset, progress, raw, assembly, progress.state, open_question, waited)
            return
        try:
            result = self._result(progress, window)
        except CountFellError as error:
            if self._waiting is not None and not error.ignored:
                question = open_question or count_fell(asset, error.seen, error.fallen, window.start_time_ns)
                self._hold(asset, progress, raw, assembly, error.state, question, waited)
                return
            result = Result.refusal(progress, str(error), error.state)
        disturbed = open_question is not None and open_question["kind"] == COUNT_FELL and open_question["waiting"] == 1
        ends = (
            disturbed and waited is None and result.grade != "refused" and result.record.get("revolutions") is not None
        )
        if ends:
            progress.question = None
        self._commit(asset, progress, window, assembly, result, waited)
        if ends:
            self.refuse_waiting(asset, ONE_DISTURBED)

    def _result(self, progress: _Progress, window: Window) -> Result:
        """What the twin says of a window; CountFellError where its count has fallen."""
        if window.quality == "refused":
            return Result.refusal(progress, "; ".join(f.detail for f in window.faults if f.action == "refused"))
        try:
            state, answer = progress.twin.process(progress.rig, progress.state, window)
        except CountFellError:
            raise
        except TwinError as error:
            return Result.refusal(progress, str(error))
        record = dict(answer.record)
        report = with_status_since(progress.report, answer.report, window.start_time_ns, record.get("revolutions"))
        return Result(state=state, report=report, record=record, events=answer.events, grade=window.quality)

    def _hold(
        self,
        asset: str,
        progress: _Progress,
        window: Window,
        assembly: Mapping[str, Any],
        state: Any,
        question: Mapping[str, Any],
        waited: int | None,
    ) -> None:
        """A window to where it waits for an answer."""
        assert self._waiting is not None
        new = progress.question is None
        held = HeldWindow(
            asset=asset,
            window=window,
            state=state,
            question=question,
            assembly=assembly,
            quality=progress.quality.to_dict(progress.assembler.counters, progress.expected),
            events=(("question", dict(question)),) if new else (),
            waited=waited,
        )
        progress.question = self._waiting.hold(held)
        progress.state = state

    def _commit(
        self,
        asset: str,
        progress: _Progress,
        window: Window,
        assembly: Mapping[str, Any],
        result: Result,
        waited: int | None = None,
    ) -> None:
        """One window with its result to the sink."""
        record, quality = dict(result.record), _copy(progress.quality)
        faults = quality.note_window(progress.index, window, result.grade)
        record |= {
            "index": progress.index,
            "start_time": iso_time(window.start_time_ns),
            "quality": result.grade,
            "faults": faults,
            **slow_channels(window),
        }
        events = (
            ("window", record),  # as it is kept, with its number and faults
            *((kind, data) for kind, data in result.events if kind not in ("window", "data_fault")),
            *(("data_fault", fault) for fault in faults),
        )
        outcome = WindowOutcome(
            asset=asset,
            index=progress.index,
            window=window,
            record=record,
            state=result.state,
            report=result.report,
            events=events,
            assembly=assembly,
            quality=quality.to_dict(progress.assembler.counters, progress.expected),
            waited=waited,
            question=progress.question,
        )
        if self._sink.commit(outcome):
            progress.state, progress.report, progress.quality = result.state, result.report, quality
            progress.index += 1
            self._sink.publish(outcome)

    def _ended_ns(self, progress: _Progress) -> int:
        return progress.assembler.closed_until_ns or (self._host_clock or time.time_ns)()


def _copy(quality: Quality) -> Quality:
    return replace(quality, windows=dict(quality.windows), faults=list(quality.faults))


def assembly_settings(settings: Settings) -> AssemblySettings:
    """The assembly settings of the service's settings."""
    return AssemblySettings(
        length=settings.window_length,
        gap=settings.window_gap,
        patience=settings.patience,
        settle=settings.settle,
        max_bytes=settings.buffer_bytes,
        window_bytes=settings.window_bytes,
    )
