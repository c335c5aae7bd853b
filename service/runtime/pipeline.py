"""The one loop: frames of any source → whole windows → the twin → the results.

    pipeline = Pipeline(rig_of, twin, sink)
    for frame in source:
        pipeline.feed(frame)
    pipeline.flush()

The sink commits each window with everything that a restart needs, and publishes it afterwards. An asset advances to
the state after a window only once that window has been committed. No threads, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

from service.contract.base import iso_time
from service.contract.slow_channels import slow_channels
from service.contract.status import with_status_since
from service.contract.window import refused_record
from service.errors import FrameError
from service.files.rig import assembly_for, expected_channels, window_of_rig
from service.runtime.twin_port import Events, Twin
from service.settings import Settings
from service.stream.assembly import DEFAULT, Assembler, AssemblySettings
from service.stream.frames import Frame
from service.stream.quality import Quality
from service.stream.wire.topics import Channel
from twin.errors import NotAvailable, TwinError
from twin.fallen_count import CountFellError
from twin.rig import Rig
from twin.tracing.decisions import Decision
from twin.windows import Window


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowOutcome:
    """What one window led to; all but `window` and `state` is JSON-safe."""

    asset: str
    index: int  # of the window, from 0, counting refused ones
    window: Window
    record: Mapping[str, Any]  # the contract's `windows[]`, with `quality` and `faults`
    state: Any  # twin.step.State after the window
    report: Mapping[str, Any] | None  # the twin's newest answer; None before its first window
    events: Events
    assembly: Mapping[str, Any]  # Assembler.to_dict() as of this window
    quality: Mapping[str, Any]  # the section `data_quality`


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """Where an asset's windows ended: the newest outcome, as a store gives it back."""

    index: int
    state: Any  # twin.step.State
    report: Mapping[str, Any] | None
    assembly: Mapping[str, Any]
    quality: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class DecisionOutcome:
    """What a decision on an effect, or an inspection, led to."""

    asset: str
    state: Any  # twin.step.State after it
    report: Mapping[str, Any]
    events: Events


class Freshness(NamedTuple):
    """How old what is known of an asset is; None where nothing has come yet."""

    last_arrival_ns: int | None  # host's clock when the newest frame came, Unix time [ns]
    last_window_ns: int | None  # end of the newest window by the stream's own clock, Unix time [ns]


class ResultSink(Protocol):
    """Where outcomes go."""

    def commit(self, outcome: WindowOutcome) -> bool:
        """Keeps a window, whole; False, with nothing changed, where it has been committed before."""
        ...

    def publish(self, outcome: WindowOutcome) -> None:
        """Shows a committed window."""
        ...


@dataclass(slots=True)
class _Progress:
    """How far one asset has come."""

    rig: Rig
    expected: tuple[str, ...]  # labels of the channels that the rig file names
    assembler: Assembler
    state: Any
    index: int = 0  # of the next window
    report: Mapping[str, Any] | None = None
    quality: Quality = field(default_factory=Quality)


class Pipeline:
    """Takes frames of any number of assets to committed and published outcomes.

    before_window  called before each window is processed; an exception of it leaves the window unprocessed
    host_clock     Unix time of this host [ns], which frames of a live stream are held against; None for recordings
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
    ):
        self._host_clock = host_clock
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

    def waiting(self, asset: str) -> bool:
        """Whether frames of an asset wait for their window's end."""
        return asset in self._assets and self._assets[asset].assembler.waiting

    def decide(self, asset: str, name: str, verb: str) -> DecisionOutcome:
        """What an engineer's decision on an effect leads to, for `accept`; TwinError where it cannot be followed."""
        if asset not in self._assets:
            raise NotAvailable(f"no window of {asset} has been processed yet")
        progress = self._assets[asset]
        state, answer = self._twin.apply(progress.rig, progress.state, Decision(name=name, verb=verb))
        report = with_status_since(progress.report, answer.report, progress.assembler.closed_until_ns, None)
        return DecisionOutcome(asset=asset, state=state, report=report, events=answer.events)

    def inspect(self, asset: str, inspection: Mapping[str, Any]) -> DecisionOutcome:
        """What a measured wear depth leads to, for `accept`; TwinError where it cannot be used."""
        if asset not in self._assets:
            raise NotAvailable(f"no window of {asset} has been processed yet")
        progress = self._assets[asset]
        state, answer = self._twin.inspected(progress.rig, progress.state, inspection)
        report = progress.report if progress.report is None else {**progress.report, **answer.report}
        return DecisionOutcome(asset=asset, state=state, report=report or answer.report, events=answer.events)

    def accept(self, outcome: DecisionOutcome) -> None:
        """Goes on from a decision or an inspection, once it has been committed."""
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

    def _progress(self, asset: str) -> _Progress:
        if asset not in self._assets:
            rig = self._rig_of(asset)
            expected = expected_channels(rig)
            assembler = Assembler(assembly_for(rig, self._assembly))
            self._assets[asset] = _Progress(rig, expected, assembler, self._twin.new_state())
        return self._assets[asset]

    def _process(self, asset: str, progress: _Progress, window: Window, assembly: Mapping[str, Any]) -> None:
        """One window through the twin to the sink."""
        self._before_window()
        state, report, added = progress.state, progress.report, Events()
        window = window_of_rig(progress.rig, window)
        grade = window.quality
        if grade == "refused":
            record = refused_record("; ".join(f.detail for f in window.faults if f.action == "refused"))
        else:
            try:
                state, answer = self._twin.process(progress.rig, progress.state, window)
            except TwinError as error:
                grade, record = "refused", refused_record(str(error))
                state = error.state if isinstance(error, CountFellError) else state
            else:
                record, report, added = dict(answer.record), answer.report, answer.events
                report = with_status_since(progress.report, report, window.start_time_ns, record.get("revolutions"))
        quality = _copy(progress.quality)
        faults = quality.note_window(progress.index, window, grade)
        record |= {
            "index": progress.index,
            "start_time": iso_time(window.start_time_ns),
            "quality": grade,
            "faults": faults,
            **slow_channels(window),
        }
        events = (
            ("window", record),  # as it is kept, with its number and faults
            *((kind, data) for kind, data in added if kind not in ("window", "data_fault")),
            *(("data_fault", fault) for fault in faults),
        )
        outcome = WindowOutcome(
            asset=asset,
            index=progress.index,
            window=window,
            record=record,
            state=state,
            report=report,
            events=events,
            assembly=assembly,
            quality=quality.to_dict(progress.assembler.counters, progress.expected),
        )
        if self._sink.commit(outcome):
            progress.state, progress.report, progress.quality = state, report, quality
            progress.index += 1
            self._sink.publish(outcome)


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
