"""Zenoh: the transport of the service, and the publisher of a replay. Sessions are opened by `zenoh_session`.

- `{prefix}/{asset}/{kind}/{name}` carries frames. The subscriber recovers what an advanced publisher still holds, and
  accepts plain publishers as they are.
- `{prefix}/{asset}/twin/state` is published at each change and answers `get`.
- `{prefix}/{asset}/twin/alarms` is the same for the open alarms.
- `{prefix}/{asset}/twin/position` says how far an asset's stream is stored, at each change and as an answer to `get`.
- `{prefix}/{asset}/twin/alive` is a liveliness token, held while the service runs.
- `{prefix}/{asset}/twin/made/{kind}/{name}` carries frames that the service has made of slow values, for who records.
- `{prefix}/{asset}/rig` may carry the machine's rig file (`application/toml`), published or answering `get`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import zenoh
import zenoh.ext

from service.errors import DeliveryError
from service.stream.channels import CHANNEL_KINDS
from service.stream.inbox import Inbox
from service.stream.wire.codec import encoding_of
from service.stream.wire.topics import PREFIX, Channel, topic_of
from service.transport.guard import Guard
from service.transport.protocol import StateSource
from service.transport.topics import (
    alarms_topic,
    alive_topic,
    asset_of_position_topic,
    asset_of_rig_topic,
    made_topic,
    position_topic,
    rig_topic,
    state_topic,
    topic_of_made,
)
from service.transport.zenoh_links import NONE, ZenohLinks
from service.transport.zenoh_session import open_session

if TYPE_CHECKING:  # a service reads no recordings
    from service.stream.sources.mcap import RawFrame

TopicOf = Callable[[str, str], str]  # (asset, prefix) → topic

JSON = zenoh.Encoding.APPLICATION_JSON
TOML = "application/toml"
SENDING = "sending"  # parameter of a question of position: the session that goes on sending after the answer
_HISTORY = 4096  # frames a key that a late subscriber asks a publisher's cache for
_HEARTBEAT = 0.5  # [s]
CLOSED = (zenoh.ZError, RuntimeError)  # what a session raises that is closed, and one that another thread closes now
COME_BACK = 5.0  # how long publishers may take to find the router again: Zenoh tries every 4 s by default [s]


# -- the service's side --------------------------------------------------------------------------------


@contextmanager
def open_zenoh(
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    prefix: str = PREFIX,
    wait: float | None = None,
    links: ZenohLinks = NONE,
    answers_alone: bool = False,
) -> Iterator[ZenohTransport]:
    """The service's connection: a router at `listen`, or a client of `connect`; `links` says how it is protected.

    answers_alone  whether the router lets nobody else publish results and positions, and answer questions of them
    """
    alone = f"{prefix}/*/twin/**" if answers_alone else None
    with (
        open_session(listen, connect, wait, links, alone) as session,
        ZenohTransport(session, prefix, connect) as transport,
    ):
        yield transport


class ZenohTransport:
    """A `Transport` over an open session; `connect`: the routers that it is a client of, if it is one."""

    def __init__(self, session: zenoh.Session, prefix: str = PREFIX, connect: Sequence[str] = ()):
        self._session, self._prefix, self._connect = session, prefix, tuple(connect)
        self._guard = Guard()
        self._inbox: Inbox | None = None  # of the subscription
        self._missed = 0  # samples that a publisher's cache no longer held
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self._looking = threading.Lock()  # at the routers: a session shows them to one thread at a time
        self._routers: frozenset[str] | None = None  # at the latest look
        self._changed = float("-inf")  # when they were last seen to be others, on the monotonic clock [s]

    def __enter__(self) -> ZenohTransport:
        return self

    def __exit__(self, *_: object) -> None:
        while self._tokens:
            self._tokens.popitem()[1].undeclare()

    @contextmanager
    def subscribe(self, inbox: Inbox) -> Iterator[ZenohTransport]:
        """Fills the inbox until left."""

        def received(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                inbox.guarded(lambda: str(sample.key_expr), sample.payload.to_bytes, lambda: _publisher_of(sample))

        def publisher(sample: zenoh.Sample) -> None:
            topic = str(sample.key_expr).partition("/@adv/")[0]
            inbox.announce(topic, there=sample.kind == zenoh.SampleKind.PUT)

        def missed(miss: zenoh.ext.Miss) -> None:
            self._missed += miss.nb

        self._inbox = inbox
        with ExitStack() as stack:
            for kind in CHANNEL_KINDS:
                subscriber = zenoh.ext.declare_advanced_subscriber(
                    self._session,
                    f"{self._prefix}/*/{kind}/*",
                    received,
                    history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=_HISTORY),
                    recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                )
                stack.callback(subscriber.undeclare)
                subscriber.detect_publishers(self._guard(publisher), history=True)
                listener = subscriber.sample_miss_listener(missed)
                stack.callback(listener.undeclare)
            stack.callback(inbox.close)
            yield self

    def publish_made(self, topic: str, payload: bytes) -> None:
        """Publishes a frame that the service has made."""
        self._session.put(made_topic(topic, self._prefix), payload)

    @contextmanager
    def subscribe_made(self, inbox: Inbox) -> Iterator[None]:
        """Puts what services have made into the inbox until left."""

        def received(sample: zenoh.Sample) -> None:
            inbox.guarded(lambda: topic_of_made(str(sample.key_expr), self._prefix), sample.payload.to_bytes)

        subscriber = self._session.declare_subscriber(made_topic(f"{self._prefix}/*/*/*", self._prefix), received)
        try:
            yield
        finally:
            subscriber.undeclare()

    def ask_again(self, channel: Channel, seconds: float, done: Callable[[], None]) -> None:
        """Asks the caches of a key's publishers, as a subscriber does that joins."""
        inbox = self._inbox
        assert inbox is not None

        def received(reply: zenoh.Reply) -> None:
            if (sample := reply.ok) is not None:
                inbox.guarded(lambda: str(sample.key_expr), sample.payload.to_bytes, lambda: _publisher_of(sample))

        try:
            self._session.get(
                f"{topic_of(channel, self._prefix)}/@adv/**?_max={_HISTORY}",
                zenoh.handlers.Callback(received, done),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                timeout=seconds,
            )
        except zenoh.ZError:  # the session has been closed
            done()

    @contextmanager
    def answer_states(self, source: StateSource) -> Iterator[None]:
        """Answers `get` on the assets' states and alarms until left."""

        def answering(topic: TopicOf, text_of: Callable[[str], str | None]) -> Callable[[zenoh.Query], None]:
            def answer(query: zenoh.Query) -> None:
                with query:
                    for asset in source.assets():
                        key = zenoh.KeyExpr(topic(asset, self._prefix))
                        if query.key_expr.intersects(key) and (text := text_of(asset)) is not None:
                            query.reply(key, text, encoding=JSON)

            return answer

        with ExitStack() as stack:
            for topic, text_of in ((state_topic, source.state_text), (alarms_topic, source.alarms_text)):
                answer = self._guard(answering(topic, text_of))
                stack.callback(self._session.declare_queryable(topic("*", self._prefix), answer).undeclare)
            yield

    def publish_state(self, asset: str, text: str) -> None:
        """Publishes an asset's state."""
        self._session.put(state_topic(asset, self._prefix), text, encoding=JSON)

    def publish_alarms(self, asset: str, text: str) -> None:
        """Publishes an asset's open alarms."""
        self._session.put(alarms_topic(asset, self._prefix), text, encoding=JSON)

    def publish_position(self, stream: str, text: str) -> None:
        """Publishes how far a stream is stored."""
        self._session.put(position_topic(stream, self._prefix), text, encoding=JSON)

    @contextmanager
    def answer_positions(self, ask: Callable[[str, Callable[[str], None], str | None], None]) -> Iterator[None]:
        """Passes on questions of one stream each; a question of all is answered by the publications."""

        def asked(query: zenoh.Query) -> None:
            stream = asset_of_position_topic(str(query.key_expr), self._prefix)
            if stream is None:
                query.drop()
                return

            def reply(text: str) -> None:
                try:
                    query.reply(position_topic(stream, self._prefix), text, encoding=JSON)
                finally:
                    query.drop()

            ask(stream, reply, query.parameters.get(SENDING) or None)

        queryable = self._session.declare_queryable(position_topic("*", self._prefix), self._guard(asked))
        try:
            yield
        finally:
            queryable.undeclare()

    def announce(self, asset: str) -> None:
        """Holds a liveliness token for the asset."""
        if asset not in self._tokens:
            self._tokens[asset] = self._session.liveliness().declare_token(alive_topic(asset, self._prefix))

    def withdraw(self, asset: str) -> None:
        """Gives up the asset's liveliness token."""
        if asset in self._tokens:
            self._tokens.pop(asset).undeclare()

    @contextmanager
    def watch_rigs(self, received: Callable[[str, bytes], None]) -> Iterator[None]:
        """Passes published rig files on until left."""

        def put(sample: zenoh.Sample) -> None:
            asset = asset_of_rig_topic(str(sample.key_expr), self._prefix)
            if asset is not None and sample.kind == zenoh.SampleKind.PUT:
                received(asset, sample.payload.to_bytes())

        subscriber = self._session.declare_subscriber(rig_topic("*", self._prefix), self._guard(put))
        try:
            yield
        finally:
            subscriber.undeclare()

    def ask_rig(self, asset: str, seconds: float) -> Iterator[bytes]:
        """The rig files that answer `get` within a time [s]."""
        for reply in self._session.get(rig_topic(asset, self._prefix), timeout=seconds):
            if reply.ok is not None:
                yield reply.ok.payload.to_bytes()

    def lost(self) -> str | None:
        """Why the network cannot be reached at present: the router that it is a client of is gone."""
        if not self._connect:
            return None
        try:
            if self._linked():
                return None
        except CLOSED:
            return "the connection has been closed"
        return f"the link to the router at {', '.join(self._connect)} is lost; it is tried again all the time"

    def interrupted(self) -> bool:
        """Whether the link is lost, or was so lately that publishers may not have come back to the router yet."""
        if not self._connect:
            return False
        try:
            return not self._linked() or time.monotonic() - self._changed < COME_BACK
        except CLOSED:
            return True

    def _linked(self) -> bool:
        """Whether there is a link to a router; notes where it is another one than before."""
        with self._looking:
            now = frozenset(map(str, self._session.info.routers_zid()))
            if self._routers is not None and now != self._routers:
                self._changed = time.monotonic()
            self._routers = now
            return bool(now)

    def counters(self) -> Mapping[str, int]:
        """Frames that were missed, and callbacks that failed."""
        return {"missed_frames": self._missed, "callback_errors": self._guard.errors}


# -- the replay's side ---------------------------------------------------------------------------------


@contextmanager
def open_publisher(
    connect: Sequence[str], prefix: str = PREFIX, wait: float = 30.0, links: ZenohLinks = NONE
) -> Iterator[ZenohPublisher]:
    """The replay's connection, as a client of `connect`; subscribers are awaited for `wait` [s]."""
    with open_session((), connect, wait, links) as session, ZenohPublisher(session, prefix, wait) as publisher:
        yield publisher


class ZenohPublisher:
    """A `FramePublisher` on an open session."""

    def __init__(self, session: zenoh.Session, prefix: str = PREFIX, wait: float = 30.0):
        self._session, self._prefix, self._wait = session, prefix, wait
        self._stack = ExitStack()
        self._keys: dict[Channel, tuple[zenoh.ext.AdvancedPublisher, zenoh.Publisher]] = {}
        self._routers = self._session.info.routers_zid()
        self._rigs: dict[str, bytes] = {}
        self._left = False  # whether subscribers have been away

    def __enter__(self) -> ZenohPublisher:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def declare(self, channels: Iterable[Channel]) -> None:
        """Announces keys and waits until each has a subscriber."""
        for channel in channels:
            topic = topic_of(channel, self._prefix)
            # Without a cache: what is not stored is sent again from the first frame on. A cache would give a service
            # that comes back its newest frames before those, and the older ones would then come too late.
            publisher = zenoh.ext.declare_advanced_publisher(
                self._session,
                topic,
                encoding=encoding_of(channel),
                reliability=zenoh.Reliability.RELIABLE,
                congestion_control=zenoh.CongestionControl.BLOCK,
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=_HEARTBEAT, sporadic_heartbeat=None),
                publisher_detection=True,
            )
            probe = self._session.declare_publisher(topic)  # only this kind tells whether anyone listens
            self._stack.callback(publisher.undeclare)
            self._stack.callback(probe.undeclare)
            listener = probe.declare_matching_listener(self._note_matching)
            self._stack.callback(listener.undeclare)
            self._keys[channel] = (publisher, probe)
        self.relink(self._wait)
        for key, text in self._rigs.items():
            self._session.put(key, text, encoding=TOML, congestion_control=zenoh.CongestionControl.BLOCK)

    def offer_rig(self, asset: str, text: bytes) -> None:
        """Answers whoever asks for the asset's rig file while this publisher is open, and publishes it once.

        Published after `declare` has found the subscribers: who is busy now may ask when this has ended.
        """
        key = rig_topic(asset, self._prefix)

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(key, text, encoding=TOML)

        self._rigs[key] = text
        queryable = self._session.declare_queryable(key, answer)
        self._stack.callback(queryable.undeclare)

    def publish(self, frame: RawFrame) -> None:
        """Sends one frame; may block for some seconds while the link is busy."""
        self._keys[frame.channel][0].put(frame.payload, encoding=encoding_of(frame.channel))

    def linked(self, channel: Channel | None = None) -> bool:
        """Whether subscribers and router are the same as before, and have been all the time."""
        if self._left:
            return False
        looked_at = self._keys.values() if channel is None else (self._keys[channel],)
        matching = all(_matching(probe) for _, probe in looked_at)
        return matching and self._session.info.routers_zid() == self._routers

    def relink(self, seconds: float) -> None:
        """Waits until each key has a subscriber again."""
        deadline = time.monotonic() + seconds
        self._left = False
        for each in self._keys:
            self._await_subscriber(each, deadline)
        self._routers = self._session.info.routers_zid()

    def ask(self, stream: str, seconds: float, *, sending: bool = False) -> Iterator[bytes]:
        """What those who store the stream say of its position within a time [s]; `sending`: frames follow."""
        key = position_topic(stream, self._prefix)
        selector = f"{key}?{SENDING}={self._session.zid()}" if sending else key
        replies = self._session.get(
            selector,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,  # else the newest answer of a key is the only one
            timeout=seconds,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        return (reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None)

    def _note_matching(self, status: zenoh.MatchingStatus) -> None:
        self._left |= not status.matching  # though another may be there when a frame is sent next

    def _await_subscriber(self, channel: Channel, deadline: float) -> None:
        probe = self._keys[channel][1]
        while not _matching(probe):
            if time.monotonic() > deadline:
                raise DeliveryError(
                    f"no subscriber for {topic_of(channel, self._prefix)} within {self._wait:g} s; "
                    "is the service running, and is the prefix the same?"
                )
            time.sleep(0.01)


def _publisher_of(sample: zenoh.Sample) -> str | None:
    """Session and number of the publisher of a sample; advanced publishers say it, plain ones do not."""
    source = sample.source_info
    return None if source is None else f"{source.source_id.zid}/{source.source_id.eid}"


def _matching(publisher: zenoh.Publisher) -> bool:
    """Whether any subscriber listens to a publisher's key."""
    status: Any = publisher.matching_status
    return status.matching
