"""What a publisher is told to be stored is stored, through losses, kills and disorder; nothing is counted twice."""

from __future__ import annotations

import json
import random
from dataclasses import replace

import numpy as np
import pytest
from service_streams import Sink, go_on
from streams import ACCEL, ASSET, bursts, content, unbroken

from service.contract.position import position_of
from service.errors import DeliveryError
from service.runtime.delivery import ASKED_TOGETHER, Delivery, Ranges
from service.runtime.pipeline import Pipeline
from service.runtime.positions import HELD_BACK, MOST_BACKLOG, ClosedWindows, Positions
from service.runtime.pump import Pump
from service.runtime.twin_port import Answer, Twin
from service.stream.assembly import AssemblySettings
from service.stream.frames import NS
from service.stream.inbox import Inbox
from service.stream.sources.mcap import RawFrame
from service.stream.windows import Windows
from service.stream.wire.codec import encode
from service.stream.wire.topics import topic_of
from twin.rig import Rig

TWIN = Twin(step=lambda r, s, w, o: (s, Answer(record={}, report={}, events=())), new_state=dict, load_state=dict)


class Stand:
    """A service and the link to it, on a clock of its own: a `FramePublisher` for whoever publishes.

    What is committed outlives the service; all else is gone when it is killed.
    """

    def __init__(self, rng=None, *, loss=0.0, kill=0.0, shuffle=0.0):
        self.rng, self.loss, self.killing, self.shuffle = rng or random.Random(0), loss, kill, shuffle
        self.now, self.committed, self.answers, self.published = 100.0, [], [], []
        self.backlog, self.refused, self.kills, self.lost, self.up = 0, None, 0, 0, True
        self.on_the_way, self.pipeline = [], None
        self.late = False
        self.overtaken = 0  # questions that come before the frames that were sent before them
        self.start()

    def start(self):
        self.inbox, before = Inbox(), self.pipeline
        self.pipeline = Pipeline(
            lambda asset: Rig.from_mapping({}),
            TWIN,
            Sink(self.committed),
            assembly=AssemblySettings(clocked=True, settle=24),
        )
        self.pipeline.refusal = lambda stream: self.refused
        if self.committed:
            last = self.committed[-1]
            assembly, making = json.loads(json.dumps([before.assemblies[ASSET], last.making]))
            go_on(self.pipeline, replace(last, making=making), assembly)
        self.positions = Positions(
            self.inbox,
            self,
            self.pipeline,
            pending=lambda stream: ClosedWindows(waiting=self.backlog),
            clock=lambda: self.now,
        )
        self.pump = Pump(
            self.inbox, self.pipeline, 0.7, self.positions, clock=lambda: self.now,
            holding=lambda: self.refused is not None,
        )  # fmt: skip
        self.broken = False

    def run(self, seconds=0.1):
        for _ in range(max(round(seconds / 0.1), 1)):
            self.now += 0.1
            while (item := self.inbox.take(0.0)) is not None:
                self.pump.turn(item)
            self.pump.turn(None)
            self.positions()

    # -- the network ---------------------------------------------------------------------------------

    def publish_position(self, stream, text):
        self.published.append((self.now, text))

    def answer_positions(self, ask):
        raise AssertionError("asked by hand here")

    # -- a FramePublisher ----------------------------------------------------------------------------

    def publish(self, frame):
        if self.kills < 4 and self.rng.random() < self.killing:
            self.kills += 1
            self.start()
            self.on_the_way, self.up = [], False
            return
        if self.rng.random() < self.loss:
            self.lost += 1
            return
        self.on_the_way.append(frame)
        if len(self.on_the_way) > 12 * self.shuffle and not self.overtaken:
            self.arrive(self.on_the_way.pop(0))

    def arrive(self, frame):
        self.inbox.offer(topic_of(frame.channel), frame.payload)
        self.positions.moved(ASSET)

    def linked(self, channel=None):
        return self.up

    def relink(self, seconds):
        self.up = True

    def ask(self, stream, seconds, *, sending=False):
        if not self.up:
            self.now += seconds
            return []
        if self.overtaken:
            self.overtaken, self.late = self.overtaken - 1, True
        else:
            self._all_arrive()
        texts = []
        self.positions.ask(stream, texts.append)
        for _ in range(round(seconds / 0.1)):
            self.run()
            if texts:
                break
        return texts

    def _all_arrive(self):
        for channel in self.rng.sample(
            sorted({f.channel for f in self.on_the_way}), k=len({f.channel for f in self.on_the_way})
        ):
            for frame in [f for f in self.on_the_way if f.channel == channel]:  # the order of one key is kept
                self.arrive(frame)
        self.on_the_way = []

    def sleep(self, seconds):
        if self.late and not self.overtaken:
            self._all_arrive()
        self.run(seconds)


def sent(stand, frames, **given):
    """All frames delivered; the delivery."""
    delivery = Delivery(stand, clock=lambda: stand.now, sleep=stand.sleep, **given)
    for n, frame in enumerate(frames):
        stand.now += 0.002
        delivery.send(RawFrame(frame.channel, frame.end_time_ns, encode(frame)))
        if n % 7 == 0:
            stand.run()
    delivery.finish()
    return delivery


def undisturbed(frames):
    assembler = Windows()
    return content([w for f in frames for w in assembler.add(f)] + assembler.flush())


def stored(stand):
    return content([o.window for o in stand.committed])


CASES = {
    "nothing": {},
    "losses": {"loss": 0.01},
    "kills": {"kill": 0.01},
    "disorder": {"shuffle": 1.0},
    "all": {"loss": 0.01, "kill": 0.005, "shuffle": 1.0},
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", range(6))
def test_all_that_is_said_to_be_stored_is_stored_and_nothing_twice(case, seed):
    rng = random.Random(f"{case} {seed}")
    frames = bursts(rng.randint(4, 9), frames=rng.choice([8, 20]))
    stand = Stand(rng, **CASES[case])
    delivery = sent(stand, frames)
    assert delivery.settled == len(frames)
    starts = [o.window.start_time_ns for o in stand.committed]
    assert starts == sorted(set(starts))
    lost = delivery.left_out().get("lost", 0) + delivery.left_out().get("late", 0)
    if not lost:
        assert stored(stand) == undisturbed(frames)
    else:  # a transport that loses frames without a word: each of them is said, and all others are stored
        assert "loss" in CASES[case] and lost <= stand.lost
        missing = sum(f.count for o in stand.committed for f in o.window.faults if f.kind == "gap")
        assert missing <= lost


def test_a_stream_without_a_pause_is_settled_as_it_is_cut():
    frames = unbroken(60.0)
    stand = Stand()
    delivery = Delivery(stand, clock=lambda: stand.now, sleep=stand.sleep)
    most = 0
    for frame in frames:
        delivery.send(RawFrame(frame.channel, frame.end_time_ns, encode(frame)))
        most = max(most, len(delivery._kept))
    delivery.finish()
    assert stored(stand) == undisturbed(frames) and delivery.settled == len(frames)
    assert most < len(frames) and stand.published


def test_frames_beyond_the_memory_are_said_and_lost_only_with_the_service():
    frames, notes = bursts(6, frames=20), []
    stand = Stand()
    delivery = sent(stand, frames, most_bytes=20_000, note=notes.append)
    assert delivery.settled == len(frames) and "not stored yet: the oldest are kept no longer" in notes[0]
    stand = Stand()
    with pytest.raises(DeliveryError, match=r"^\d+ frames are not stored: the service was lost while more than"):
        delivery = Delivery(stand, most_bytes=20_000, clock=lambda: stand.now, sleep=stand.sleep)
        for n, frame in enumerate(unbroken(20.0)):
            delivery.send(RawFrame(frame.channel, frame.end_time_ns, encode(frame)))
            if n == 200:
                stand.start()
        delivery.finish()


def test_why_frames_are_not_stored_is_the_reason_of_the_service():
    stand = Stand()
    stand.refused = "asset rig-1 is retired: its frames are left out"
    with pytest.raises(DeliveryError, match=r"^\d+ frames are not stored: asset rig-1 is retired"):
        sent(stand, bursts(1, frames=8))


def test_a_service_that_cannot_store_for_a_while_is_waited_for_and_not_sent_all_again():
    """Frames were once sent five times while the disk was full, and then given up after nine seconds."""
    stand, published, frames = Stand(), [], bursts(4, frames=20)
    publish, run = stand.publish, stand.run

    def full_for_a_while(seconds=0.1):
        stand.refused = "no space" if 102.0 < stand.now < 127.0 else None
        run(seconds)

    stand.run = full_for_a_while
    stand.publish = lambda frame: published.append(frame) or publish(frame)
    sent(stand, frames)
    assert stored(stand) == undisturbed(frames) and stand.now > 127.0
    assert len(published) <= 2 * len(frames)


def test_a_service_that_begins_anew_is_sent_everything_once_however_many_streams_find_that_out():
    """A gateway of 50 machines sent all of its frames 50 times."""
    frames, published, instance = bursts(1, frames=8), [], ["first"]

    class Service:
        def publish(self, frame):
            published.append(frame.channel.asset)

        def linked(self, channel=None):
            return True

        def relink(self, seconds):
            """The link is up."""

        def ask(self, stream, seconds, *, sending=False):
            here = {f.channel.label: f for f in frames}
            channels = {k: {"sequence": f.sequence, "start_time_ns": f.start_time_ns} for k, f in here.items()}
            unsettled = 0 if instance == ["first"] else None
            said = {"asset": stream, "accepting": True, "channels": channels, "unsettled_from_ns": unsettled}
            return [json.dumps({**said, "instance": instance[0]})]

    delivery = Delivery(Service(), clock=lambda: 0.0, sleep=lambda seconds: None)
    for number in range(20):
        for frame in frames:
            channel = frame.channel._replace(asset=f"machine-{number}")
            delivery.send(RawFrame(channel, frame.end_time_ns, encode(frame)))
    assert len(published) == 20 * len(frames)
    instance[0] = "second"
    delivery.finish()
    assert len(published) == 2 * 20 * len(frames)


def test_streams_are_asked_about_together_at_first_and_whenever_it_is_asked_what_is_stored():
    """A gateway of 56 machines was silent for 5 s when it began again: it asked about one after the other."""
    happened, streams = [], [f"machine-{number}" for number in range(ASKED_TOGETHER + 10)]
    frame = bursts(1, frames=1)[0]

    class Service:
        def publish(self, frame):
            """Nobody has it."""

        def linked(self, channel=None):
            return True

        def ask(self, stream, seconds, *, sending=False):
            happened.append("asked")
            return self.answers(stream)

        def answers(self, stream):
            happened.append("read")
            newest = {frame.channel.label: {"sequence": frame.sequence, "start_time_ns": frame.start_time_ns}}
            yield json.dumps({"asset": stream, "accepting": True, "instance": "first", "channels": newest})

    delivery = Delivery(Service(), clock=lambda: 0.0, sleep=lambda seconds: None)
    together = ["asked"] * ASKED_TOGETHER + ["read", "asked"] * 10 + ["read"] * ASKED_TOGETHER
    delivery.begin(streams)
    assert happened == together
    for stream in streams:
        delivery.send(RawFrame(frame.channel._replace(asset=stream), frame.end_time_ns, encode(frame)))
    assert happened == together
    delivery.finish()
    assert happened == 3 * together and delivery.settled == len(streams)  # once more: all of it was there before


def test_a_service_that_never_answers_is_given_up_in_time():
    stand = Stand()
    stand.ask = lambda stream, seconds, sending: stand.run(seconds) or []
    begun = stand.now
    with pytest.raises(DeliveryError, match="nobody has answered for 30 s"):
        sent(stand, bursts(1, frames=8))
    assert stand.now - begun < 60.0


def test_frames_that_are_left_out_are_counted_by_cause():
    frames = bursts(4, frames=8)
    stand = Stand()
    sent(stand, frames)
    delivery = Delivery(stand, clock=lambda: stand.now, sleep=stand.sleep)
    for frame in frames:
        delivery.send(RawFrame(frame.channel, frame.end_time_ns, encode(frame)))
    delivery.send(RawFrame(ACCEL, 0, b"\xff\xff"))
    delivery.finish()
    assert delivery.left_out() == {"invalid": 1}  # frames that came again are none
    assert len(stand.committed) == 4


@pytest.mark.parametrize("overtaken", [0, 1])
def test_frames_of_used_times_are_counted_also_where_questions_overtake_them(overtaken):
    """Their newest one is what came last already; a recording of another content was once said to be stored."""
    frames = bursts(4, frames=8)
    stand = Stand()
    sent(stand, frames)
    delivery = Delivery(stand, clock=lambda: stand.now, sleep=stand.sleep)
    stand.overtaken = 99 * overtaken
    for frame in frames:
        louder = replace(frame, values=frame.values * np.float32(3)) if frame.channel == ACCEL else frame
        delivery.send(RawFrame(frame.channel, frame.end_time_ns, encode(louder)))
    stand.overtaken = overtaken
    delivery.finish()
    assert delivery.left_out() == {"conflict": sum(frame.channel == ACCEL for frame in frames)}


@pytest.mark.parametrize("seed", range(20))
def test_numbers_sent_are_kept_as_few_ranges(seed):
    rng = random.Random(seed)
    numbers = [rng.randrange(40) for _ in range(60)]
    ranges = Ranges()
    for number in numbers:
        ranges.add(number)
    held = {n for first, last in ranges.ranges for n in range(first, last + 1)}
    assert held == set(numbers) and ranges.ranges == sorted(ranges.ranges)
    assert ranges.holes == max(numbers) - min(numbers) + 1 - len(held)


# -- positions -----------------------------------------------------------------------------------------


def test_answers_wait_while_too_many_windows_do_and_always_come():
    stand, texts = Stand(), []
    for frame in bursts(1):
        stand.arrive(RawFrame(frame.channel, 0, encode(frame)))
    stand.backlog = MOST_BACKLOG + 1
    stand.positions.ask(ASSET, texts.append)
    stand.run(5.0)
    assert texts == []
    stand.backlog = 0
    stand.run(0.3)
    assert position_of(texts[0]).behind is False
    stand.backlog = MOST_BACKLOG + 1
    with_thread = Positions(
        stand.inbox, Quiet(), stand.pipeline, pending=lambda s: ClosedWindows(waiting=99), clock=lambda: stand.now
    )
    with with_thread:
        with_thread.ask(ASSET, texts.append)
        stand.run(1.0)
        stand.now += HELD_BACK
        wait_for(lambda: len(texts) == 2)
        with_thread.ask(ASSET, texts.append)
    assert len(texts) == 3 and all(position_of(text).behind for text in texts[1:])


def test_positions_are_published_as_windows_are_stored_and_at_most_once_a_second_else():
    stand = Stand()
    frames = bursts(3, frames=20)
    for frame in frames:
        stand.arrive(RawFrame(frame.channel, 0, encode(frame)))
        stand.run()
    said = [(at, position_of(text)) for at, text in stand.published]
    ends = [p.settled_until_ns for _, p in said]
    assert len(set(ends)) >= 3 and ends[-1] == max(e for e in ends if e)
    assert len(said) <= stand.now - 100.0 + 5


def test_windows_that_are_not_stored_yet_are_no_part_of_what_is():
    stand = Stand()
    frames = bursts(2, frames=20)
    for frame in frames:
        stand.arrive(RawFrame(frame.channel, 0, encode(frame)))
    stand.run(4.0)
    assert position_of(stand.positions._text(ASSET)).unsettled_from_ns is None
    begun = frames[80].start_time_ns
    positions = Positions(stand.inbox, stand, stand.pipeline, pending=lambda stream: ClosedWindows(begun, 1, 3))
    found = position_of(positions._text(ASSET))
    assert (found.backlog, found.shed) == (1, 3)
    assert found.settled_until_ns == begun and begun - 10 * NS <= found.unsettled_from_ns < begun


class Quiet:
    """A network on which nobody asks."""

    def publish_position(self, stream, text): ...

    def answer_positions(self, ask):
        from contextlib import nullcontext

        return nullcontext()


def wait_for(condition):
    from service_streams import wait_until

    wait_until(condition, 10.0)
