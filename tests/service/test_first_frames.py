"""What publishers hold is asked for once more where a key does not go on at what is stored of it."""

from __future__ import annotations

import zenoh
import zenoh.ext
from segments import made
from service_streams import free_port, wait_until
from streams import ACCEL, ASSET, CHANNELS, bursts

from service.runtime import first_frames
from service.runtime.first_frames import ANSWER_WAIT, BEHIND_OTHERS, SENT_AGAIN_WITHIN, FirstFrames
from service.runtime.reception import Reception
from service.stream.inbox import Inbox, Marker
from service.stream.wire.codec import decode, encode
from service.stream.wire.topics import topic_of
from service.transport.zenoh import ZenohTransport, open_session
from twin.rig import Rig

LOOK = 1.0  # [s]
SHORT = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=3)


class Began:
    """A reception that goes on after the first of three bursts, and publishers that are asked."""

    def __init__(self):
        self.now, self.asked, self.closed, self.behind, self.called = 0.0, [], [], [], ASSET
        self.frames = bursts(3, frames=40)
        earlier = self._reception()
        third = len(self.frames) // 3
        for frame in self.frames[:third]:
            earlier.feed(frame)
        earlier.flush()
        checkpoint = self.closed.pop()
        self.reception = self._reception()
        self.reception.resume(ASSET, checkpoint.assembly, {"windows": {}, "faults": []})
        self.rest = self.frames[third:]
        self.first = FirstFrames(
            self.reception,
            self,
            lambda stream, call: self.behind.append(call),
            asset_of=lambda stream: self.called,
            clock=lambda: self.now,
        )

    def _reception(self):
        return Reception(lambda asset: Rig.from_mapping({}), self.closed.append)

    def ask_again(self, channel, seconds, done):
        self.asked.append((channel, done))

    def feed(self, frames):
        for frame in frames:
            self.reception.feed(frame)
            self.first.fed(frame.channel, ASSET)
        self.first()

    def qualities(self):
        self.reception.flush()
        return [made(closed.segment).quality for closed in self.closed]

    @property
    def lost(self):
        return {fault.channel for closed in self.closed for fault in made(closed.segment).faults if fault.kind == "gap"}


def test_nothing_is_asked_where_every_key_goes_on():
    began = Began()
    began.feed(began.rest)
    assert began.asked == [] and began.qualities() == ["good", "good"]


def test_what_lies_behind_a_gap_waits_until_the_publishers_have_answered():
    began = Began()
    early = [f for f in began.rest if f.channel == ACCEL][:20]
    began.feed([f for f in began.rest if not any(f is e for e in early)])
    assert [channel for channel, _ in began.asked] == [ACCEL] and began.closed == []
    began.feed(early)  # from a cache
    began.asked[0][1]()
    began.behind[0]()
    assert began.qualities() == ["good", "good"] and began.lost == set()


def test_what_no_publisher_has_any_more_is_a_fault_of_its_window():
    began = Began()
    gone = [f for f in began.rest if f.channel == ACCEL][:2]
    began.feed([f for f in began.rest if not any(f is g for g in gone)])
    began.asked[0][1]()
    began.behind[0]()
    began.feed([])
    assert began.first.holds(ASSET)  # who keeps frames may not have noticed the start yet
    began.now += SENT_AGAIN_WITHIN + 0.1
    began.feed([])
    assert not began.first.holds(ASSET)
    qualities = began.qualities()
    assert began.lost == {"accel/y6"} and qualities[0] != "good" and qualities[1] == "good"


def test_a_key_that_others_have_gone_on_without_is_asked_for():
    began = Began()
    began.feed([f for f in began.rest if f.channel != ACCEL])
    assert began.asked == []
    began.now += BEHIND_OTHERS + 0.1
    began.feed([])
    began.feed([])
    assert [channel for channel, _ in began.asked] == [ACCEL]
    began.feed([f for f in began.rest if f.channel == ACCEL])
    assert began.qualities() == ["good", "good"] and len(began.asked) == 1


def test_few_keys_are_asked_for_at_the_same_time(monkeypatch):
    monkeypatch.setattr(first_frames, "MOST_ASKED", 1)
    began = Began()
    late = {channel: [f for f in began.rest if f.channel == channel][:20] for channel in CHANNELS[:2]}
    began.feed([f for f in began.rest if not any(f is e for frames in late.values() for e in frames)])
    assert len(began.asked) == 1 and began.closed == []
    for _ in CHANNELS[:2]:
        channel, done = began.asked[-1]
        began.feed(late[channel])
        done()
        began.behind[-1]()
        began.now += LOOK
        began.first()
    assert len(began.asked) == 2 and began.qualities() == ["good", "good"] and began.lost == set()


def test_an_answer_that_is_lost_holds_nothing_for_good():
    began = Began()
    gone = next(f for f in began.rest if f.channel == ACCEL)
    frames = [f for f in began.rest if f is not gone]
    began.feed(frames[:-80])
    assert began.closed == []
    began.now += 2 * ANSWER_WAIT + 1
    began.feed([])
    began.feed(frames[-80:])
    assert len(began.closed) == 1


def test_windows_that_only_caches_hold_are_whole_although_the_first_answer_was_short(monkeypatch):
    """With thousands of keys in a session, the first answer ends early and says nothing."""
    monkeypatch.setattr(zenoh.ext, "HistoryConfig", lambda **given: SHORT)
    began = Began()
    with open_session(listen=[f"tcp/127.0.0.1:{free_port()}"]) as session:
        publishers = {
            channel: zenoh.ext.declare_advanced_publisher(
                session, topic_of(channel), cache=zenoh.ext.CacheConfig(max_samples=4096), publisher_detection=True
            )
            for channel in CHANNELS
        }
        for frame in began.rest:
            publishers[frame.channel].put(encode(frame))
        inbox, transport = Inbox(), ZenohTransport(session)
        began.first = FirstFrames(began.reception, transport, inbox.ask)
        with transport.subscribe(inbox):
            newest = {f.channel.label: f.sequence for f in began.rest}

            def all_come():
                while (item := inbox.take(0.0)) is not None:
                    if isinstance(item, Marker):
                        item.reached()
                    else:
                        began.feed([decode(item.channel, item.payload)])
                began.first()
                found = began.reception.position(ASSET).channels
                return {label: each.sequence for label, each in found.items()} == newest and not began.first._held

            wait_until(all_come)
            assert began.qualities() == ["good", "good"] and began.lost == set()
        for publisher in publishers.values():
            publisher.undeclare()
