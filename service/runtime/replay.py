"""A recording published as it was recorded: `gear-twin replay`.

Every frame is delivered or the replay fails. Publishers are reliable and hold back when a subscriber is
slow; frames count as delivered once a query sent after them on the same link has been answered. What was
not confirmed when a link broke is sent again; the receiver knows duplicates by their sequence numbers.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import zenoh
import zenoh.ext

from service.errors import DeliveryError
from service.stream.frames import NS
from service.stream.sources.mcap import RawFrame, Recording
from service.stream.sources.zenoh import open_session
from service.stream.wire.codec import encoding_of
from service.stream.wire.topics import PREFIX, Channel, topic_of

_CONFIRM_EVERY = 256  # frames
_ANSWER = 300.0  # time for the subscribers to take what was sent [s]
_CACHE = 512  # frames a key kept for subscribers that join late or were away
_HEARTBEAT = 0.5  # [s]

Progress = Callable[[float, int], None]  # share of the file read, frames delivered so far


class Publisher:
    """Publishes frames of any channels on one session, and knows when they have arrived."""

    def __init__(self, session: zenoh.Session, prefix: str = PREFIX, wait: float = 30.0):
        self._session, self._prefix, self._wait = session, prefix, wait
        self._stack = ExitStack()
        self._keys: dict[Channel, tuple[zenoh.ext.AdvancedPublisher, zenoh.Publisher]] = {}
        self._unconfirmed: list[RawFrame] = []
        self._routers = self._session.info.routers_zid()
        self._rigs: dict[str, bytes] = {}
        self.delivered = 0

    def __enter__(self) -> Publisher:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def declare(self, channels: Iterable[Channel]) -> None:
        """Announces keys and waits until each has a subscriber."""
        for channel in channels:
            topic = topic_of(channel, self._prefix)
            publisher = zenoh.ext.declare_advanced_publisher(
                self._session,
                topic,
                encoding=encoding_of(channel),
                reliability=zenoh.Reliability.RELIABLE,
                congestion_control=zenoh.CongestionControl.BLOCK,
                cache=zenoh.ext.CacheConfig(max_samples=_CACHE),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=_HEARTBEAT, sporadic_heartbeat=None),
                publisher_detection=True,
            )
            probe = self._session.declare_publisher(topic)  # only this kind tells whether anyone listens
            self._stack.callback(publisher.undeclare)
            self._stack.callback(probe.undeclare)
            self._keys[channel] = (publisher, probe)
        for channel in self._keys:
            self._await_subscriber(channel)
        for key, text in self._rigs.items():
            self._session.put(key, text, encoding="application/toml", congestion_control=zenoh.CongestionControl.BLOCK)

    def offer_rig(self, asset: str, text: bytes) -> None:
        """Answers whoever asks for the asset's rig file while this publisher is open, and publishes it once.

        Published after `declare` has found the subscribers: who is busy now may ask when this has ended.
        """
        key = f"{self._prefix}/{asset}/rig"

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(key, text, encoding="application/toml")

        self._rigs[key] = text
        queryable = self._session.declare_queryable(key, answer)
        self._stack.callback(queryable.undeclare)

    def publish(self, frame: RawFrame) -> None:
        """Sends one frame; may block while subscribers are busy."""
        if not _matching(self._keys[frame.channel][1]):
            self._resend()
        self._put(frame)
        self._unconfirmed.append(frame)
        if len(self._unconfirmed) >= _CONFIRM_EVERY:
            self.confirm()

    def confirm(self) -> None:
        """Returns once everything sent has reached the subscribers; DeliveryError where it cannot."""
        while self._unconfirmed:
            channel = self._unconfirmed[-1].channel
            self._barrier(channel.asset)
            if self._link_held():
                self.delivered += len(self._unconfirmed)
                self._unconfirmed.clear()
            else:
                self._resend()

    def _put(self, frame: RawFrame) -> None:
        self._keys[frame.channel][0].put(frame.payload, encoding=encoding_of(frame.channel))

    def _barrier(self, asset: str) -> None:
        """A query travels behind the frames: once it is answered, or has no answer, they have arrived."""
        asked = time.monotonic()
        key = f"{self._prefix}/{asset}/twin/state"
        list(self._session.get(key, timeout=_ANSWER, congestion_control=zenoh.CongestionControl.BLOCK))
        if time.monotonic() - asked >= _ANSWER:
            raise DeliveryError(f"frames sent {_ANSWER:g} s ago have not been taken; is the service stuck?")

    def _link_held(self) -> bool:
        """Whether subscribers and router are the same as when the first unconfirmed frame was sent."""
        matching = all(_matching(probe) for _, probe in self._keys.values())
        return matching and self._session.info.routers_zid() == self._routers

    def _resend(self) -> None:
        """Waits for the subscribers to come back, then repeats what may not have reached them."""
        for each in self._keys:
            self._await_subscriber(each)
        self._routers = self._session.info.routers_zid()
        for frame in self._unconfirmed:
            self._put(frame)

    def _await_subscriber(self, channel: Channel) -> None:
        deadline = time.monotonic() + self._wait
        probe = self._keys[channel][1]
        while not _matching(probe):
            if time.monotonic() > deadline:
                raise DeliveryError(
                    f"no subscriber for {topic_of(channel, self._prefix)} within {self._wait:g} s; "
                    "is the service running, and is the prefix the same?"
                )
            time.sleep(0.01)


def _matching(publisher: zenoh.Publisher) -> bool:
    """Whether any subscriber listens to a publisher's key."""
    status: Any = publisher.matching_status
    return status.matching


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
) -> int:
    """Publishes a whole recording; answers how many frames were delivered.

    `on_fault` is told, in one line, what of the file was damaged; `disturb` may repeat or reorder frames.
    """
    with (
        Recording(path, prefix) as recording,
        open_session(connect=connect, wait=wait) as session,
        Publisher(session, prefix, wait) as publisher,
    ):
        if recording.rig_text is not None:
            for asset in recording.assets:
                publisher.offer_rig(asset, recording.rig_text)
        publisher.declare(sorted(set(recording.channels.values())))
        for frame in paced(disturb(recording.messages()), speed, max_pause):
            publisher.publish(frame)
            progress(recording.bytes_read / recording.size, publisher.delivered)
        publisher.confirm()
        progress(1.0, publisher.delivered)
        if recording.fault_line:
            on_fault(recording.fault_line)
        return publisher.delivered
