"""Which stream belongs to which asset; frames of a retired asset are left out.

A stream is what a publisher calls an asset. It is the asset that began under this name, unless people have said
otherwise: after an asset was given another name, or after the data of its stream were found to be another machine's.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

from service.contract.position import why_retired
from service.errors import FrameError
from service.results.names import Names
from service.results.unknown_assets import UnknownAssets
from service.runtime.pump import FrameConsumer
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import Frame
from service.stream.left_out import RETIRED, Growing, Missing
from service.stream.position import Position
from service.stream.wire.topics import Channel

log = logging.getLogger(__name__)

HELD_OPEN = 60.0  # how long the window in progress of an asset that is retired waits for it to be reinstated [s]


class AssetConsumer(FrameConsumer, Protocol):
    """Who takes the frames of assets, and knows how far each has come."""

    def position(self, asset: str) -> Position | None: ...


@dataclass(slots=True)
class _Retirement:
    """What has come of an asset since it was retired, which may be reinstated in the midst of a burst."""

    since: float  # on the monotonic clock [s]
    missing: Growing = field(default_factory=lambda: Growing(RETIRED))


class Streams:
    """A `FrameConsumer` before another, which knows assets alone.

    retired      whether an asset is retired
    unavailable  why nothing can be stored at present, or None
    unknown      the assets that are not known, and whether they are let in
    """

    def __init__(
        self,
        names: Names,
        consumer: AssetConsumer,
        retired: Callable[[str], bool],
        unavailable: Callable[[], str | None] = lambda: None,
        unknown: UnknownAssets | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._unavailable, self._unknown = unavailable, unknown or UnknownAssets()
        self._names, self._consumer, self._retired = names, consumer, retired
        self.moved: Callable[[str], None] = lambda stream: None  # called with a stream of which something has come
        self.fed: Callable[[Channel, str], None] = lambda channel, asset: None  # called with each frame's
        self.holds: Callable[[str], bool] = lambda stream: False  # whether what has come waits for what was before it
        self._routes = names.routes()
        self._clock = clock
        self._retirements: dict[str, _Retirement] = {}
        self.left_out: dict[str, int] = {}  # frames of retired assets

    def reload(self) -> None:
        """Reads again which streams belong to which assets, after that has been changed."""
        self._routes = self._names.routes()

    def asset_of(self, stream: str) -> str:
        """The asset that a stream belongs to."""
        return self._routes.get(stream, stream)

    def streams_of(self, asset: str) -> list[str]:
        """The streams that belong to an asset."""
        return streams_of(asset, self._routes)

    @property
    def routed(self) -> tuple[str, ...]:
        """The streams whose asset began under another name."""
        return tuple(self._routes)

    def feed(self, frame: Frame) -> None:
        """Hands one frame on to its asset."""
        stream = frame.channel.asset
        asset = self.asset_of(stream)
        self.moved(stream)
        if self._is_retired(asset):
            self._leave_out_retired(asset, frame)
            return
        self._consumer.feed(frame if asset == stream else replace(frame, channel=frame.channel._replace(asset=asset)))
        self.fed(frame.channel, asset)

    def reject(self, channel: Channel, error: FrameError) -> None:
        """Hands on that a frame breaks the contract."""
        asset = self.asset_of(channel.asset)
        self.moved(channel.asset)
        if not self._is_retired(asset):
            self._consumer.reject(channel._replace(asset=asset), error)

    def leave_out(self, stream: str, missing: Missing) -> None:
        """Hands on that frames of a stretch of time were left out."""
        asset = self.asset_of(stream)
        if self._is_retired(asset):
            self._retirement(asset).missing.join(missing)
            return
        if missing.for_room:
            frames = sum(missing.frames.values())
            log.warning("%s: %d frames left out: they come faster than they can be used", asset, frames)
        self.moved(stream)
        self._consumer.leave_out(asset, missing)

    def note_publishers(self, stream: str, label: str, two: tuple[str, str]) -> None:
        """Hands on that two publishers send on a channel's key in turn."""
        asset = self.asset_of(stream)
        log.warning("%s: two publishers send on the key of %s: %s and %s", asset, label, *two, extra={"asset": asset})
        if not self._is_retired(asset):
            self._consumer.note_publishers(asset, label, two)

    def note_recorded(self, stream: str, recorded: bool) -> None:
        """Hands on whether the frames that follow are of a recording."""
        self._consumer.note_recorded(self.asset_of(stream), recorded)

    def _is_retired(self, asset: str) -> bool:
        """Whether an asset is retired; one that is so no longer is told what has been left out."""
        if self._retired(asset):
            self._retirement(asset)
            return True
        if asset in self._retirements:
            self._say_missing(asset)
            del self._retirements[asset]
        return False

    def _retirement(self, asset: str) -> _Retirement:
        return self._retirements.setdefault(asset, _Retirement(self._clock()))

    def _is_over(self, asset: str) -> bool:
        """Whether the window in progress waits no longer for its asset to be reinstated."""
        return self._clock() - self._retirement(asset).since > HELD_OPEN

    def _leave_out_retired(self, asset: str, frame: Frame) -> None:
        self.left_out[asset] = self.left_out.get(asset, 0) + 1
        if not CHANNEL_KINDS[frame.channel.kind].slow:
            self._retirement(asset).missing.add(frame.channel.label, frame.sequence, frame.start_time_ns)
        if self._is_over(asset) and self._consumer.waiting(asset):
            self._say_missing(asset)
            self._consumer.flush(asset)

    def _say_missing(self, asset: str) -> None:
        """Hands on what was left out while the asset was retired."""
        retirement = self._retirements[asset]
        if retirement.missing.frames:
            self._consumer.leave_out(asset, retirement.missing.missing)
            retirement.missing = Growing(RETIRED)

    def flush(self, stream: str) -> None:
        """Closes the window in progress, after silence."""
        asset = self.asset_of(stream)
        self.moved(stream)
        if asset in self._retirements:
            self._say_missing(asset)
        self._consumer.flush(asset)

    def position(self, stream: str) -> Position | None:
        """How far a stream has come; None where nothing is known of it."""
        return self._consumer.position(self.asset_of(stream))

    def refusal(self, stream: str) -> str | None:
        """Why no frames of a stream are used at present, or None."""
        unknown, asset = self._unknown.refusal(stream), self.asset_of(stream)
        if unknown is not None:
            return unknown
        return why_retired(stream) if self._retired(asset) else self._unavailable()

    def waiting(self, stream: str) -> bool:
        """Whether frames wait for their window's end."""
        asset = self.asset_of(stream)
        if self.holds(stream):
            return False
        return self._consumer.waiting(asset) and (not self._is_retired(asset) or self._is_over(asset))

    def channels(self, stream: str) -> Collection[str]:
        """The channels that windows wait for."""
        return self._consumer.channels(self.asset_of(stream))

    def expect(self, stream: str, labels: Iterable[str]) -> None:
        """Waits for these channels too."""
        asset = self.asset_of(stream)
        if not self._is_retired(asset):
            self._consumer.expect(asset, labels)

    def wait_only_for(self, stream: str, labels: Iterable[str]) -> None:
        """Lets windows close without the channels that have fallen silent."""
        self._consumer.wait_only_for(self.asset_of(stream), labels)


def streams_of(asset: str, routes: Mapping[str, str]) -> list[str]:
    """The streams that belong to an asset, that under whose name it began first.

    routes  streams whose asset began under another name, with that asset
    """
    own = [] if asset in routes else [asset]
    return own + [stream for stream, of in routes.items() if of == asset]
