"""A recording published as it was recorded: `gear-twin replay`.

Every frame is stored by the service or the replay fails, and says how many are not and why: see `delivery`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from threading import Timer

from service.errors import DeliveryError, InputError
from service.operation.state_catalogue import FAULTS
from service.runtime.delivery import Delivery
from service.stream.frames import NS
from service.stream.sources.mcap import RawFrame, Recording
from service.stream.wire.codec import quick_head_of
from service.stream.wire.topics import NAME, PREFIX, Channel
from service.transport.protocol import FramePublisher
from service.transport.zenoh import open_publisher

Progress = Callable[[float, int], None]  # share of the file read, frames stored so far
SILENT = 1.0  # that nobody receives the frames is said after this time [s]


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


def _demand_before(until: float, frame: RawFrame, path: str | Path) -> None:
    """InputError where a frame begins in the future: every recording that is made until then would lie before it."""
    head = quick_head_of(frame.channel, frame.payload)
    if head is not None and head[1] > until * NS:
        begins = f"{datetime.fromtimestamp(head[1] // NS, UTC):%Y-%m-%d %H:%M:%S} UTC"
        raise InputError(
            f"{path}: a frame of {frame.channel.label} begins at {begins}, which is in the future; correct the date of "
            "the recording or the clock of this computer, or give --future where that is meant"
        )


@contextmanager
def _told_after(seconds: float, tell: Callable[[str], None], line: str) -> Iterator[Callable[[], None]]:
    """Says a line after a time, if neither what is given has been called nor the block been left by then."""
    timer = Timer(seconds, tell, (line,))
    timer.daemon = True
    timer.start()
    try:
        yield timer.cancel
    finally:
        timer.cancel()


def _unstored(delivery: Delivery, left_out: dict[str, int]) -> DeliveryError:
    """What of a recording is not stored, and why."""
    sent = delivery.settled + delivery.invalid
    number = min(sum(left_out.values()), sent)
    causes = "; ".join(f"{count} {cause}: {FAULTS[cause].meaning}" for cause, count in left_out.items())
    return DeliveryError(f"{number} of {sent} frames are not stored ({causes})")


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
    until: float = float("inf"),
) -> int:
    """Publishes a whole recording; answers how many frames are stored.

    on_fault    receives, in one line each, what of the file was damaged, and what is waited for
    disturb     may repeat or reorder frames
    publish_to  opens a publisher, given endpoints, prefix and the time to wait for subscribers [s]
    asset       the name to publish under in place of the recording's own; None: the recording's
    recorded    first part of the recording's topics; None: `prefix`, too
    until       Unix time at which frames begin at the latest [s]
    """
    if asset is not None and not NAME.fullmatch(asset):
        raise InputError(f"asset = {asset!r} must be 1 to 64 letters, digits, '_', '-' or '.'")
    with (
        Recording(path, recorded or prefix) as recording,
        _told_after(SILENT, on_fault, f"no service at {', '.join(connect)} yet: waiting up to {wait:g} s") as met,
        publish_to(connect, prefix, wait) as publisher,
    ):
        if asset is not None and len(recording.assets) > 1:
            known = ", ".join(recording.assets)
            raise InputError(f"{path}: holds the assets {known}: only a recording of one can have another name")
        if recording.metadata.get("started") == "":
            raise InputError(f"{path}: when it was recorded is not known; import it again with --started, or --zone")
        if recording.rig_text is not None:
            for name in recording.assets if asset is None else [asset]:
                publisher.offer_rig(name, recording.rig_text)
        channels = sorted({_named(channel, asset) for channel in recording.channels.values()})
        publisher.declare(channels)
        met()
        delivery = Delivery(publisher, wait=wait, note=on_fault)
        delivery.begin(sorted({channel.asset for channel in channels}))
        for frame in paced(disturb(recording.messages()), speed, max_pause):
            _demand_before(until, frame, path)
            delivery.send(frame._replace(channel=_named(frame.channel, asset)))
            progress(recording.bytes_read / recording.size, delivery.settled)
        delivery.finish()
        progress(1.0, delivery.settled)
        if recording.fault_line:
            on_fault(recording.fault_line)
        if delivery.unassessed:
            on_fault(f"the frames are stored and cannot be assessed now: {delivery.unassessed}")
        if left_out := delivery.left_out():
            raise _unstored(delivery, left_out)
        return delivery.settled
