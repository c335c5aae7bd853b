"""Frames of any source → closed measurement windows: what the service does with an asset's stream.

    reception = Reception(rig_of, close)
    for frame in source:
        reception.feed(frame)
    reception.flush()

What becomes of a window that has closed is the work of `close`: it is processed at once, or kept until its asset's turn
comes. No threads, and no clock but the one that is given.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from service.errors import FrameError
from service.files.rig import assembly_for, expected_channels
from service.runtime.outcomes import ClosedWindow
from service.settings import Settings
from service.steady_clock import later_time_ns
from service.stream.assembly import DEFAULT, Assembler, AssemblySettings, Closed
from service.stream.frames import Frame
from service.stream.left_out import ANOTHERS, Missing
from service.stream.position import Position
from service.stream.publishers import two_publishers
from service.stream.quality import RECENT, outside_windows, received_quality
from service.stream.repeats import Repeats
from service.stream.wire.topics import Channel
from twin.rig import Rig
from twin.windows import Fault


@dataclass(slots=True)
class _Received:
    """What has been received of one asset."""

    rig: Rig
    expected: tuple[str, ...]  # labels of the channels that the rig file names
    assembler: Assembler
    faults: list[dict[str, Any]] = field(default_factory=list)  # the newest that belong to no window


class Reception:
    """Takes frames of any number of assets to closed windows.

    rig_of      the rig of an asset, looked up with its first frame
    close       called with each window that has closed, in the order of an asset's windows
    noticed     called with an asset and its repeated frames, after each frame
    host_clock  Unix time of this host [ns], which frames of a live stream are held against; None for recordings
    """

    def __init__(
        self,
        rig_of: Callable[[str], Rig],
        close: Callable[[ClosedWindow], None],
        *,
        noticed: Callable[[str, Repeats], None] = lambda asset, repeats: None,
        assembly: AssemblySettings = DEFAULT,
        host_clock: Callable[[], int] | None = None,
    ):
        self._rig_of, self._close, self._noticed = rig_of, close, noticed
        self._assembly, self._host_clock = assembly, host_clock
        self._assets: dict[str, _Received] = {}

    @property
    def assets(self) -> list[str]:
        """The assets seen so far."""
        return sorted(self._assets)

    # -- frames --------------------------------------------------------------------------------------

    def open(self, asset: str) -> None:
        """Prepares for an asset's first frame: its rig file is looked up now."""
        self._of(asset)

    def feed(self, frame: Frame) -> None:
        """Takes one frame in."""
        asset = frame.channel.asset
        received = self._of(asset)
        now_ns = None if self._host_clock is None else self._host_clock()
        self._closed(asset, received.assembler.assemble(frame, now_ns))
        self._noticed(asset, received.assembler.repeats)

    def flush(self, asset: str | None = None) -> None:
        """Closes the windows in progress, of one asset or of all: at the end of a file, or after silence."""
        for name in [asset] if asset is not None else self.assets:
            self._closed(name, self._of(name).assembler.finish())

    def reject(self, channel: Channel, error: FrameError) -> None:
        """Counts a frame that breaks the contract; its sequence number will be missing."""
        received = self._of(channel.asset)
        received.assembler.count(channel.label, "invalid")
        fault = Fault(kind="invalid", channel=channel.label, count=1, action="refused", detail=str(error))
        received.faults = [*received.faults, outside_windows(fault)][-RECENT:]

    def leave_out(self, asset: str, missing: Missing) -> None:
        """Frames of a stretch of time were left out before they came here."""
        self._of(asset).assembler.leave_out(missing)

    def note_publishers(self, asset: str, label: str, two: tuple[str, str]) -> None:
        """Two publishers send on a channel's key in turn: a fault of the next window."""
        self._of(asset).assembler.note(two_publishers(label, two))

    def note_recorded(self, asset: str, recorded: bool) -> None:
        """The frames that follow are of a recording, or of a live stream."""
        self._of(asset).assembler.recorded = recorded

    def expect(self, asset: str, labels: Iterable[str]) -> None:
        """Waits for these channels too before the asset's first window."""
        self._of(asset).assembler.expect(labels)

    def wait_only_for(self, asset: str, labels: Iterable[str]) -> None:
        """Lets an asset's windows close without the channels that have fallen silent."""
        self._of(asset).assembler.wait_only_for(labels)

    def hold(self, asset: str, label: str, on: bool) -> None:
        """Lets the frames of a channel that lie behind a gap wait for those before it; or no longer."""
        if asset in self._assets:
            self._assets[asset].assembler.hold(label, on)

    def first_gap(self, asset: str, label: str) -> tuple[int, int] | None:
        """The numbers that the frames of a channel wait for first; None where they wait for none."""
        return self._assets[asset].assembler.first_gap(label) if asset in self._assets else None

    def channels(self, asset: str) -> Collection[str]:
        """The channels that an asset's windows wait for."""
        return self._assets[asset].assembler.channels if asset in self._assets else ()

    def waiting(self, asset: str) -> bool:
        """Whether frames of an asset wait for their window's end."""
        return asset in self._assets and self._assets[asset].assembler.waiting

    def _closed(self, asset: str, windows: Iterable[Closed]) -> None:
        for segment, assembly in list(windows):
            self._close(ClosedWindow(asset=asset, segment=segment, assembly=assembly))

    # -- what is known -------------------------------------------------------------------------------

    def rig(self, asset: str) -> Rig:
        """The rig that an asset's frames are held against."""
        return self._assets[asset].rig if asset in self._assets else self._rig_of(asset)

    def quality(self, asset: str) -> dict[str, Any]:
        """What is known of an asset's frames as of now."""
        received = self._assets.get(asset) or self._new(asset)
        return received_quality(received.assembler.counters, received.expected, received.faults)

    def position(self, asset: str) -> Position | None:
        """How far an asset's stream has come; None where nothing is known of it."""
        return self._assets[asset].assembler.position if asset in self._assets else None

    def shed(self) -> dict[str, int]:
        """Windows by asset that were left out for want of room, since the service was started; for any thread."""
        return {asset: received.assembler.shed for asset, received in list(self._assets.items())}

    def last_arrival_ns(self, asset: str) -> int | None:
        """When the newest frame of an asset came, by the host's clock, Unix time [ns]; None before the first."""
        return self._assets[asset].assembler.last_arrival_ns if asset in self._assets else None

    def ended_ns(self, asset: str) -> int:
        """End of the newest window on the stream's own clock, else the host's time; Unix time [ns]."""
        ended_ns = self._assets[asset].assembler.closed_until_ns if asset in self._assets else 0
        return ended_ns or (self._host_clock or later_time_ns)()

    # -- changes -------------------------------------------------------------------------------------

    def resume(self, asset: str, assembly: Mapping[str, Any], quality: Mapping[str, Any]) -> None:
        """Goes on after the newest window of an earlier run."""
        received = self._of(asset)
        received.assembler = Assembler.from_dict(assembly, received.assembler.settings)
        received.faults = list(quality.get("faults", ()))

    def ignore_repeats(self, asset: str) -> None:
        """Asks no more about the frames that are left out at present."""
        self._of(asset).assembler.repeats.ignored = True

    def split(self, asset: str, name: str, *, fresh: bool) -> None:
        """A new asset takes over the stream of another one, which keeps what it has seen.

        fresh  whether the new asset has not used any of the stream so far
        """
        old, new = self._of(asset), self._of(name)
        if not fresh:
            kept = Assembler.from_dict(old.assembler.to_dict(), old.assembler.settings)
            new.assembler, old.assembler = old.assembler, kept
        else:
            new.assembler.leave_out_all_so_far(old.assembler, ANOTHERS)

    def reopen(self, asset: str) -> None:
        """Goes on with the rig file that the asset has now."""
        received = self._of(asset)
        received.rig = self._rig_of(asset)
        received.expected = expected_channels(received.rig)
        received.assembler.settings = assembly_for(received.rig, self._assembly)

    def _of(self, asset: str) -> _Received:
        if asset not in self._assets:
            self._assets[asset] = self._new(asset)
        return self._assets[asset]

    def _new(self, asset: str) -> _Received:
        rig = self._rig_of(asset)
        return _Received(rig, expected_channels(rig), Assembler(assembly_for(rig, self._assembly)))


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
