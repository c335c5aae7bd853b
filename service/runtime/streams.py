"""Frames of streams are handed to the assets that the streams belong to; those of a retired asset are left out."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from typing import Protocol

from service.contract.position import why_retired
from service.errors import FrameError, NameTaken
from service.results.unknown_assets import UnknownAssets
from service.runtime.pump import FrameConsumer
from service.runtime.routes import Routes
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import Frame, in_channel
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
    """Finds the asset of each stream, and hands frames on to a consumer that knows assets alone.

    routes       which asset each stream belongs to
    retired      whether an asset is retired
    unavailable  why nothing can be stored at present, or None
    unknown      the assets that are not known, and whether they are let in
    moved        called with a stream of which something has come
    fed          called with the channel of each frame, and the asset that has been given it
    holds        whether what has come of a stream waits for what was before it
    """

    def __init__(
        self,
        routes: Routes,
        consumer: AssetConsumer,
        retired: Callable[[str], bool],
        unavailable: Callable[[], str | None] = lambda: None,
        unknown: UnknownAssets | None = None,
        *,
        moved: Callable[[str], object] = lambda stream: None,
        fed: Callable[[Channel, str], object] = lambda channel, asset: None,
        holds: Callable[[str], bool] = lambda stream: False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._unavailable, self._unknown = unavailable, unknown or UnknownAssets()
        self.routes, self._consumer, self._retired = routes, consumer, retired
        self._moved, self._fed, self._held = moved, fed, holds
        self._clock = clock
        self._retirements: dict[str, _Retirement] = {}
        self.left_out: dict[str, int] = {}  # frames of retired assets

    def feed(self, frame: Frame) -> None:
        """Hands one frame on to its asset."""
        stream = frame.channel.asset

        def hand_on(asset: str) -> None:
            if self._is_retired(asset):
                self._leave_out_retired(asset, frame)
                return
            own = frame if asset == stream else in_channel(frame, frame.channel._replace(asset=asset))
            self._consumer.feed(own)
            self._fed(frame.channel, asset)

        self._moved(stream)
        self._of(stream, hand_on)

    def reject(self, channel: Channel, error: FrameError) -> None:
        """Hands on that a frame breaks the contract."""

        def hand_on(asset: str) -> None:
            if not self._is_retired(asset):
                self._consumer.reject(channel._replace(asset=asset), error)

        self._moved(channel.asset)
        self._of(channel.asset, hand_on)

    def leave_out(self, stream: str, missing: Missing) -> None:
        """Hands on that frames of a stretch of time were left out."""

        def hand_on(asset: str) -> None:
            if self._is_retired(asset):
                self._retirement(asset).missing.join(missing)
                return
            if missing.for_room:
                frames = sum(missing.frames.values())
                log.warning("%s: %d frames left out: they come faster than they can be used", asset, frames)
            self._moved(stream)
            self._consumer.leave_out(asset, missing)

        self._of(stream, hand_on)

    def _of(self, stream: str, hand_on: Callable[[str], None]) -> None:
        """Hands something on to the asset of a stream, which may have been given that name a moment ago."""
        try:
            hand_on(self.routes.asset_of(stream))
        except NameTaken:
            self.routes.reload()
            try:
                hand_on(self.routes.asset_of(stream))
            except NameTaken as reason:
                log.warning("%s: what comes of it is left out: %s", stream, reason, extra={"asset": stream})

    def note_publishers(self, stream: str, label: str, two: tuple[str, str]) -> None:
        """Hands on that two publishers send on a channel's key in turn."""
        asset = self.routes.asset_of(stream)
        log.warning("%s: two publishers send on the key of %s: %s and %s", asset, label, *two, extra={"asset": asset})
        if not self._is_retired(asset):
            self._consumer.note_publishers(asset, label, two)

    def note_recorded(self, stream: str, recorded: bool) -> None:
        """Hands on whether the frames that follow are of a recording."""
        self._consumer.note_recorded(self.routes.asset_of(stream), recorded)

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
        asset = self.routes.asset_of(stream)
        self._moved(stream)
        if asset in self._retirements:
            self._say_missing(asset)
        self._consumer.flush(asset)

    def position(self, stream: str) -> Position | None:
        """How far a stream has come; None where nothing is known of it."""
        return self._consumer.position(self.routes.asset_of(stream))

    def refusal(self, stream: str) -> str | None:
        """Why no frames of a stream are used at present, or None."""
        unknown, asset = self._unknown.refusal(stream), self.routes.asset_of(stream)
        if unknown is not None:
            return unknown
        return why_retired(stream) if self._retired(asset) else self._unavailable()

    def waiting(self, stream: str) -> bool:
        """Whether frames wait for their window's end."""
        asset = self.routes.asset_of(stream)
        if self._held(stream):
            return False
        return self._consumer.waiting(asset) and (not self._is_retired(asset) or self._is_over(asset))

    def channels(self, stream: str) -> Collection[str]:
        """The channels that windows wait for."""
        return self._consumer.channels(self.routes.asset_of(stream))

    def expect(self, stream: str, labels: Iterable[str]) -> None:
        """Waits for these channels too."""
        asset = self.routes.asset_of(stream)
        if not self._is_retired(asset):
            self._consumer.expect(asset, labels)

    def wait_only_for(self, stream: str, labels: Iterable[str]) -> None:
        """Lets windows close without the channels that have fallen silent."""
        self._consumer.wait_only_for(self.routes.asset_of(stream), labels)
