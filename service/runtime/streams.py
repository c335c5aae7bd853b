"""Which stream belongs to which asset; frames of a retired asset are left out.

A stream is what a publisher calls an asset. It is the asset of the same name unless people have said otherwise: after
an asset was renamed, or after the data of its stream were found to be another machine's.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from typing import Protocol

from service.errors import FrameError
from service.results.asset_life import AssetLife
from service.results.unknown_assets import UnknownAssets
from service.runtime.pump import FrameConsumer
from service.stream.frames import Frame
from service.stream.position import Position
from service.stream.wire.topics import Channel

log = logging.getLogger(__name__)


class AssetConsumer(FrameConsumer, Protocol):
    """Who takes the frames of assets, and knows how far each has come."""

    def position(self, asset: str) -> Position | None: ...


class Streams:
    """A `FrameConsumer` before another, which knows assets alone.

    retired      whether an asset is retired
    unavailable  why nothing can be stored at present, or None
    unknown      the assets that are not known, and whether they are let in
    """

    def __init__(
        self,
        life: AssetLife,
        consumer: AssetConsumer,
        retired: Callable[[str], bool],
        unavailable: Callable[[], str | None] = lambda: None,
        unknown: UnknownAssets | None = None,
    ) -> None:
        self._unavailable, self._unknown = unavailable, unknown or UnknownAssets()
        self._life, self._consumer, self._retired = life, consumer, retired
        self.moved: Callable[[str], None] = lambda stream: None  # called with a stream of which something has come
        self._routes = life.routes()
        self.left_out: dict[str, int] = {}  # frames of retired assets

    def reload(self) -> None:
        """Reads the routes again, after they have been changed."""
        self._routes = self._life.routes()

    def asset_of(self, stream: str) -> str:
        """The asset that a stream belongs to."""
        return self._routes.get(stream, stream)

    def streams_of(self, asset: str) -> list[str]:
        """The streams that belong to an asset."""
        own = [asset] if self.asset_of(asset) == asset else []
        return own + [stream for stream, of in self._routes.items() if of == asset and stream != asset]

    @property
    def routed(self) -> tuple[str, ...]:
        """The streams whose asset has another name."""
        return tuple(self._routes)

    def feed(self, frame: Frame) -> None:
        """Hands one frame on to its asset."""
        stream = frame.channel.asset
        asset = self.asset_of(stream)
        self.moved(stream)
        if self._retired(asset):
            self.left_out[asset] = self.left_out.get(asset, 0) + 1
            return
        self._consumer.feed(frame if asset == stream else replace(frame, channel=frame.channel._replace(asset=asset)))

    def reject(self, channel: Channel, error: FrameError) -> None:
        """Hands on that a frame breaks the contract."""
        asset = self.asset_of(channel.asset)
        self.moved(channel.asset)
        if not self._retired(asset):
            self._consumer.reject(channel._replace(asset=asset), error)

    def leave_out(self, stream: str, begin: int, end: int, frames: Mapping[str, int]) -> None:
        """Hands on that frames of a stretch of time were left out, by channel [ns]."""
        asset = self.asset_of(stream)
        if not self._retired(asset):
            log.warning("%s: %d frames left out: they come faster than they can be used", asset, sum(frames.values()))
            self.moved(stream)
            self._consumer.leave_out(asset, begin, end, frames)

    def flush(self, stream: str) -> None:
        """Closes the window in progress, after silence."""
        self.moved(stream)
        self._consumer.flush(self.asset_of(stream))

    def position(self, stream: str) -> Position | None:
        """How far a stream has come; None where nothing is known of it."""
        return self._consumer.position(self.asset_of(stream))

    def refusal(self, stream: str) -> str | None:
        """Why no frames of a stream are used at present, or None."""
        unknown, asset = self._unknown.refusal(stream), self.asset_of(stream)
        if unknown is not None:
            return unknown
        return f"asset {asset} is retired: its frames are left out" if self._retired(asset) else self._unavailable()

    def waiting(self, stream: str) -> bool:
        """Whether frames wait for their window's end."""
        asset = self.asset_of(stream)
        return not self._retired(asset) and self._consumer.waiting(asset)

    def channels(self, stream: str) -> Collection[str]:
        """The channels that windows wait for."""
        return self._consumer.channels(self.asset_of(stream))

    def expect(self, stream: str, labels: Iterable[str]) -> None:
        """Waits for these channels too."""
        asset = self.asset_of(stream)
        if not self._retired(asset):
            self._consumer.expect(asset, labels)

    def wait_only_for(self, stream: str, labels: Iterable[str]) -> None:
        """Lets windows close without the channels that have fallen silent."""
        self._consumer.wait_only_for(self.asset_of(stream), labels)
