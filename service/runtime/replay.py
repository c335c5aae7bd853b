"""A recording published as it was recorded: `gear-twin replay`.

Every frame is stored by the service or the replay fails: see `delivery`.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from service.errors import DeliveryError, InputError
from service.runtime.delivery import Delivery
from service.stream.frames import NS
from service.stream.sources.mcap import RawFrame, Recording
from service.stream.wire.topics import NAME, PREFIX, Channel
from service.transport.protocol import FramePublisher
from service.transport.zenoh import open_publisher

Progress = Callable[[float, int], None]  # share of the file read, frames stored so far


def paced(frames: Iterable[RawFrame], speed: float, max_pause: float = float("inf")) -> Iterator[RawFrame]:
    """Frames at `speed` times the pace of the recording; pauses [s of the recording] at most `max_pause`."""
    if speed == 0:
        yield from frames
        return
    due, newest = time.monotonic(), None
    for frame in frames:
        if newest is not None:
            due += min(max(frame.log_time_ns - newest, 0) / NS, max_pause) / speed
        newest = frame.log_time_ns if newest is None else max(newest, frame.log_time_ns)
        time.sleep(max(due - time.monotonic(), 0.0))
        yield frame


def twice(frames: Iterable[RawFrame]) -> Iterator[RawFrame]:
    """Every frame two times in a row."""
    for frame in frames:
        yield frame
        yield frame


def shuffled(frames: Iterable[RawFrame], horizon: int, seed: int = 0) -> Iterator[RawFrame]:
    """Frames in disorder: each taken at random from the next `horizon`."""
    rng, waiting = random.Random(seed), []
    for frame in frames:
        waiting.append(frame)
        if len(waiting) >= horizon:
            yield waiting.pop(rng.randrange(len(waiting)))
    rng.shuffle(waiting)
    yield from waiting


def _named(channel: Channel, asset: str | None) -> Channel:
    return channel if asset is None else channel._replace(asset=asset)


def replay(
    path: str | Path,
    connect: Sequence[str],
    speed: float = 1.0,
    *,
    max_pause: float = float("inf"),
    prefix: str = PREFIX,
    wait: float = 30.0,
    progress: Progress = lambda share, delivered: None,
    on_fault: Callable[[str], None] = lambda line: None,
    disturb: Callable[[Iterable[RawFrame]], Iterable[RawFrame]] = lambda frames: frames,
    publish_to: Callable[[Sequence[str], str, float], AbstractContextManager[FramePublisher]] = open_publisher,
    asset: str | None = None,
    recorded: str | None = None,
) -> int:
    """Publishes a whole recording; answers how many frames are stored.

    on_fault    receives, in one line each, what of the file was damaged, what is waited for, and what was left out
    disturb     may repeat or reorder frames
    publish_to  opens a publisher, given endpoints, prefix and the time to wait for subscribers [s]
    asset       the name to publish under in place of the recording's own; None: the recording's
    recorded    first part of the recording's topics; None: `prefix`, too
    """
    if asset is not None and not NAME.fullmatch(asset):
        raise InputError(f"asset = {asset!r} must be 1 to 64 letters, digits, '_', '-' or '.'")
    with (
        Recording(path, recorded or prefix) as recording,
        publish_to(connect, prefix, wait) as publisher,
    ):
        if asset is not None and len(recording.assets) > 1:
            known = ", ".join(recording.assets)
            raise InputError(f"{path}: holds the assets {known}: only a recording of one can have another name")
        if recording.rig_text is not None:
            for name in recording.assets if asset is None else [asset]:
                publisher.offer_rig(name, recording.rig_text)
        channels = sorted({_named(channel, asset) for channel in recording.channels.values()})
        publisher.declare(channels)
        delivery = Delivery(publisher, wait=wait, note=on_fault)
        delivery.begin(sorted({channel.asset for channel in channels}))
        for frame in paced(disturb(recording.messages()), speed, max_pause):
            delivery.send(frame._replace(channel=_named(frame.channel, asset)))
            progress(recording.bytes_read / recording.size, delivery.settled)
        delivery.finish()
        progress(1.0, delivery.settled)
        if recording.fault_line:
            on_fault(recording.fault_line)
        if delivery.unassessed:
            on_fault(f"the frames are stored and cannot be assessed now: {delivery.unassessed}")
        if left_out := delivery.left_out():
            causes = ", ".join(f"{number} {cause}" for cause, number in left_out.items())
            on_fault(f"the service has left out {sum(left_out.values())} frames: {causes}")
        if shed := left_out.get("shed"):
            raise DeliveryError(f"{shed} frames are not stored: they came faster than the service could use them")
        if lost := left_out.get("lost"):
            raise DeliveryError(f"{lost} frames are not stored: they were lost on the way; repeat the replay")
        return delivery.settled
