"""The one loop: frames of any source → whole windows → the twin → the store → the board.

    pipeline = Pipeline(rig_lookup, options, commit, publish)
    for frame in source:
        pipeline.feed(frame)
    pipeline.flush()

`commit` is called once a window, before `publish`, with everything that a restart needs.
No threads, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from service.contract.answer import iso_time, refused_record
from service.contract.slow_channels import slow_channels
from service.errors import FrameError
from service.files.rig import expected_channels
from service.json_text import plain
from service.settings import Settings
from service.stream.assembly import DEFAULT, Assembler, AssemblySettings
from service.stream.frames import Frame
from service.stream.quality import Quality
from service.stream.wire.topics import Channel
from twin.errors import NotAvailable, TwinError
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
    events: tuple[tuple[str, Mapping[str, Any]], ...]
    assembly: Mapping[str, Any]  # Assembler.to_dict() as of this window
    quality: Mapping[str, Any]  # the section `data_quality`


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """Where an asset's windows ended: the newest Outcome, as a store gives it back."""

    index: int
    state: Any  # twin.step.State
    report: Mapping[str, Any] | None
    assembly: Mapping[str, Any]
    quality: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Decided:
    """What a decision on an effect led to."""

    asset: str
    state: Any  # twin.step.State after it
    report: Mapping[str, Any]
    events: tuple[tuple[str, Mapping[str, Any]], ...]


@dataclass(slots=True)
class _Line:
    """One asset's place in the loop."""

    rig: Rig
    expected: tuple[str, ...]
    assembler: Assembler
    state: Any
    index: int = 0
    report: Mapping[str, Any] | None = None
    quality: Quality = field(default_factory=Quality)


class Pipeline:
    """Takes frames of any number of assets to committed and published outcomes."""

    def __init__(
        self,
        rig_lookup: Callable[[str], Rig],
        options: Any,  # twin.step.Options
        commit: Callable[[WindowOutcome], None],
        publish: Callable[[WindowOutcome], None] = lambda outcome: None,
        *,
        assembly: AssemblySettings = DEFAULT,
        step: Callable[..., tuple[Any, Any]] | None = None,
        new_state: Callable[[], Any] | None = None,
        decide: Callable[..., tuple[Any, Any]] | None = None,
    ):
        if step is None or new_state is None:
            from twin import step as twin_step

            step, new_state = step or twin_step.step, new_state or twin_step.State
            decide = decide or twin_step.decide
        self._decide = decide
        self._rig_lookup, self._options = rig_lookup, options
        self._commit, self._publish = commit, publish
        self._assembly, self._step, self._new_state = assembly, step, new_state
        self._lines: dict[str, _Line] = {}

    @property
    def assets(self) -> list[str]:
        """The assets seen so far."""
        return sorted(self._lines)

    def feed(self, frame: Frame) -> None:
        """Takes one frame in."""
        asset = frame.channel.asset
        line = self._line(asset)
        for window, assembly in list(line.assembler.assemble(frame)):
            self._take(asset, line, window, assembly)

    def flush(self, asset: str | None = None) -> None:
        """Closes the windows in progress, of one asset or of all: at the end of a file, or after silence."""
        for name in [asset] if asset is not None else self.assets:
            line = self._line(name)
            for window, assembly in list(line.assembler.finish()):
                self._take(name, line, window, assembly)

    def reject(self, channel: Channel, error: FrameError) -> None:
        """Counts a frame that breaks the contract; its sequence number will be missing."""
        line = self._line(channel.asset)
        line.assembler.count(channel.label, "invalid")
        line.quality.note("invalid", channel.label, 1, "refused", str(error))

    def wait_only_for(self, asset: str, labels: Iterable[str]) -> None:
        """Lets an asset's windows close without the channels that have fallen silent."""
        self._line(asset).assembler.wait_only_for(labels)

    def waiting(self, asset: str) -> bool:
        """Whether frames of an asset wait for their window's end."""
        return asset in self._lines and self._lines[asset].assembler.waiting

    def attend(self) -> None:
        """What else is to be done between frames."""

    def decide(self, asset: str, name: str, verb: str) -> Decided:
        """An engineer's decision on an effect; TwinError where it cannot be followed. `accept` it to make it hold."""
        if asset not in self._lines:
            raise NotAvailable(f"no window of {asset} has been taken yet")
        if self._decide is None:
            raise NotAvailable("this twin takes no decisions")
        line = self._lines[asset]
        state, estimate = self._decide(line.rig, line.state, Decision(name=name, verb=verb), self._options)
        events = tuple((kind, plain(data)) for kind, data in estimate.events)
        return Decided(asset=asset, state=state, report=plain(estimate.report), events=events)

    def accept(self, decided: Decided) -> None:
        """Goes on with what a decision has led to, once it has been committed."""
        line = self._lines[decided.asset]
        line.state, line.report = decided.state, decided.report

    def quality(self, asset: str) -> dict[str, Any]:
        """The section `data_quality` as of now."""
        line = self._line(asset)
        return line.quality.to_dict(line.assembler.counters, line.expected)

    def restore(self, asset: str, checkpoint: Checkpoint) -> None:
        """Goes on where an earlier run committed its last window of an asset."""
        line = self._line(asset)
        line.assembler = Assembler.from_dict(checkpoint.assembly, line.assembler.settings)
        line.state, line.report = checkpoint.state, checkpoint.report
        line.index = checkpoint.index + 1
        line.quality = Quality.from_dict(checkpoint.quality)

    def _line(self, asset: str) -> _Line:
        if asset not in self._lines:
            rig = self._rig_lookup(asset)
            expected = expected_channels(rig)
            settings = assembly_for(self._assembly, expected)
            self._lines[asset] = _Line(rig, expected, Assembler(settings), self._new_state())
        return self._lines[asset]

    def _take(self, asset: str, line: _Line, window: Window, assembly: Mapping[str, Any]) -> None:
        """One window through the twin, the store and the board."""
        told: tuple[tuple[str, Mapping[str, Any]], ...] = ()
        grade = window.quality
        if grade == "refused":
            record = refused_record("; ".join(f.detail for f in window.faults if f.action == "refused"))
        else:
            try:
                line.state, estimate = self._step(line.rig, line.state, window, self._options)
            except TwinError as error:
                grade, record = "refused", refused_record(str(error))
            else:
                record, line.report, told = dict(plain(estimate.record)), plain(estimate.report), estimate.events
        index, line.index = line.index, line.index + 1
        faults = line.quality.note_window(index, window, grade)
        record |= {
            "index": index,
            "start_time": iso_time(window.start_time_ns),
            "quality": grade,
            "faults": faults,
            **slow_channels(window),
        }
        events: list[tuple[str, Mapping[str, Any]]] = [("window", record)]  # as it is kept, with its number and faults
        events += [(kind, plain(data)) for kind, data in told if kind not in ("window", "data_fault")]
        events += [("data_fault", fault) for fault in faults]
        outcome = WindowOutcome(
            asset=asset,
            index=index,
            window=window,
            record=record,
            state=line.state,
            report=line.report,
            events=tuple(events),
            assembly=assembly,
            quality=line.quality.to_dict(line.assembler.counters, line.expected),
        )
        self._commit(outcome)
        self._publish(outcome)


def assembly_for(base: AssemblySettings, expected: tuple[str, ...]) -> AssemblySettings:
    """The assembly settings of an asset that should have these channels."""
    return AssemblySettings(
        length=base.length,
        gap=base.gap,
        patience=base.patience,
        settle=base.settle,
        max_bytes=base.max_bytes,
        expected=expected,
    )


def assembly_settings(settings: Settings) -> AssemblySettings:
    """The assembly settings of the service's settings."""
    return AssemblySettings(
        length=settings.window_length,
        gap=settings.window_gap,
        patience=settings.patience,
        settle=settings.settle,
        max_bytes=settings.buffer_bytes,
    )
