"""A window is closed in silence, and without a channel only where that channel is really late."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from service_streams import Sink
from streams import ACCEL, ASSET, CHANNELS, LENGTH, TORQUE, bursts, content, frame

from service.runtime.pipeline import Pipeline
from service.runtime.positions import ClosedWindows, Positions
from service.runtime.pump import Pump, _Rhythm
from service.runtime.routes import Routes
from service.runtime.streams import Streams
from service.runtime.twin_port import Answer, Twin
from service.stream.assembly import AssemblySettings
from service.stream.inbox import Inbox
from service.stream.windows import Windows
from service.stream.wire.codec import encode
from service.stream.wire.topics import topic_of
from twin.rig import Rig

LABELS = [c.label for c in CHANNELS]
WAIT = 10.0


def rhythm_of(frames, idle=0.2, pace=0.01):
    """The rhythm of frames that came one after another."""
    rhythm, now = _Rhythm(idle, WAIT, 0.0), 100.0
    for f in frames:
        rhythm.note(f, now, now)
        now += pace
    return rhythm, now


def stream(bursts, but=()):
    return [frame(c, n, n * LENGTH) for n in range(bursts) for c in CHANNELS if (n, c) not in but]


def test_a_whole_window_is_closed_after_the_idle_timeout():
    rhythm, now = rhythm_of(stream(20))
    assert rhythm.limit < 1.0
    assert not rhythm.is_over(rhythm.awaited(LABELS, now), now)
    assert rhythm.is_over(rhythm.awaited(LABELS, now + 1.0), now + 1.0)


def test_a_channel_that_the_others_go_on_without_is_waited_for_once():
    rhythm, now = rhythm_of(stream(20, but={(n, TORQUE) for n in range(12, 20)}))
    assert rhythm.awaited(LABELS, now) == {TORQUE.label}
    assert not rhythm.is_over(rhythm.awaited(LABELS, now + WAIT - 0.1), now + WAIT - 0.1)
    now += WAIT + 0.1
    assert rhythm.is_over(rhythm.awaited(LABELS, now), now) and rhythm.ended == {TORQUE.label}
    for f in stream(40, but={(n, TORQUE) for n in range(40)})[60:]:
        rhythm.note(f, now, now)
    assert rhythm.awaited(LABELS, now) == set()  # it has ended
    rhythm.note(frame(TORQUE, 13, 13 * LENGTH), now, now)
    assert rhythm.awaited(LABELS, now) == {TORQUE.label}  # and sends again


def test_a_stream_that_has_just_been_joined_may_have_more_channels():
    rhythm = _Rhythm(0.2, WAIT, 50.0)
    for f in stream(3, but={(n, TORQUE) for n in range(3)}):
        rhythm.note(f, 50.1, 50.1)
    assert not rhythm.is_over(rhythm.awaited((), 51.0), 51.0)
    assert rhythm.is_over(rhythm.awaited((), 54.0), 54.0)


def test_one_interruption_does_not_delay_the_windows_of_all_days_to_come():
    rhythm, now = _Rhythm(0.2, WAIT, 0.0), 100.0
    frames = [frame(ACCEL, number, number * LENGTH) for number in range(10_000)]
    for number, f in enumerate(frames):
        now += 9.0 if number == 100 else 0.05
        rhythm.note(f, now, now)
        if number == 101:
            assert rhythm.limit > 20.0
    assert rhythm.limit < 0.5


def test_how_long_a_sender_waits_for_answers_says_nothing_of_the_silence_between_frames():
    rhythm, now = _Rhythm(0.2, WAIT, 0.0), 100.0
    for number in range(100):
        if number == 50:
            for _ in range(90):
                now += 0.1
                rhythm.look(now, waits=True)
        now += 0.05
        rhythm.note(frame(ACCEL, number, number * LENGTH), now, now)
        rhythm.look(now, waits=False)
    assert rhythm.limit < 0.5


# -- the pump ------------------------------------------------------------------------------------------


class Driven:
    """A pump over an inbox and a pipeline, turned by hand on a clock of its own."""

    def __init__(self, inbox=None):
        self.now, self.outcomes, self.routes = 1000.0, [], {}
        self.inbox = inbox or Inbox()
        twin = Twin(
            step=lambda r, s, w, o: (s, Answer(record={}, report={}, events=())), new_state=dict, load_state=dict
        )
        pipeline = self.pipeline = Pipeline(
            lambda asset: Rig.from_mapping({}), twin, Sink(self.outcomes), assembly=AssemblySettings(clocked=True)
        )
        self.backlog = 0
        self.positions = Positions(
            self.inbox, None, None, pending=lambda stream: ClosedWindows(waiting=self.backlog), clock=lambda: self.now
        )
        self.known = Routes(SimpleNamespace(routes=lambda: dict(self.routes)))
        self.streams = Streams(self.known, pipeline, lambda asset: False)
        self.pump = Pump(
            self.inbox,
            self.streams,
            0.7,
            waits=self.positions.waits,
            asset_of=self.known.asset_of,
            clock=lambda: self.now,
        )

    def rename(self, asset, name):
        """An asset has another name: frames under that are its, too."""
        self.routes[name] = asset
        self.known.reload()

    def send(self, frames, source=None):
        for f in frames:
            self.inbox.offer(topic_of(f.channel), encode(f), source)

    def run(self, seconds, step=0.1):
        for _ in range(round(seconds / step)):
            self.now += step
            while self.inbox.depth:
                self.pump.turn(self.inbox.take(0.0))
            self.pump.turn(None)

    @property
    def windows(self):
        return [o.window for o in self.outcomes]


def undisturbed(frames):
    assembler = Windows()
    return content([w for f in frames for w in assembler.add(f)] + assembler.flush())


def test_channels_of_a_publisher_that_comes_back_may_begin_one_after_the_other():
    """Zenoh hands on a late publisher's keys one by one, as its cache answers; encoders once came too late so."""
    driven, frames = Driven(), bursts(8, frames=8)
    driven.send(frames[: 4 * 8 * 4])
    driven.run(10.0)
    assert len(driven.outcomes) == 4
    later = frames[4 * 8 * 4 :]
    early = [f for f in later if f.channel in (ACCEL, TORQUE)]
    driven.send(early[:40])
    driven.run(2.0)
    driven.send(early[40:])
    driven.run(2.0)
    assert len(driven.outcomes) == 4
    driven.send([f for f in later if f not in early])
    driven.run(2.0)
    assert content(driven.windows) == undisturbed(frames)


def test_a_new_stream_waits_for_all_channels_that_its_publisher_has_announced():
    driven, frames = Driven(), bursts(4, frames=8)
    for channel in CHANNELS:
        driven.inbox.announce(topic_of(channel), there=True)
    driven.send([f for f in frames if f.channel == ACCEL])
    driven.run(5.0)
    assert driven.outcomes == []
    driven.send([f for f in frames if f.channel != ACCEL])
    driven.run(2.0)
    assert content(driven.windows) == undisturbed(frames)


def test_a_publisher_that_waits_for_an_answer_in_the_midst_of_a_burst_is_not_silent():
    """A gateway asks how far another of its streams is stored; what it was sending ended as half a window."""
    driven, frames = Driven(), bursts(1, frames=8)
    driven.send(frames[:16], "gateway/1")
    driven.backlog = 99  # so that the answer is held back
    driven.positions.ask("another", lambda text: None, "gateway")
    driven.run(8.0)
    assert driven.outcomes == []
    driven.positions._close(1, lambda stream: "")
    driven.run(0.5)
    driven.send(frames[16:], "gateway/1")
    driven.run(2.0)
    assert content(driven.windows) == undisturbed(frames)


def test_a_gateway_that_goes_on_with_other_machines_does_not_hold_a_window_open():
    """It asks every two seconds how far its streams are stored; a window was once closed by the next one only."""
    driven, frames = Driven(Inbox(clock=lambda: driven.now)), bursts(1, frames=8)
    others = [replace(f, channel=f.channel._replace(asset="other")) for f in bursts(40, frames=4)]
    driven.send(frames, "gateway/1")
    for number in range(1, 4):
        driven.positions.ask("other", lambda text: None, "gateway")
        driven.run(0.2)
        driven.positions._close(number, lambda stream: "")
        driven.run(0.2)
        for _ in range(4):
            driven.send(others[:4], "gateway/2")
            del others[:4]
            driven.run(0.4)
    assert ASSET in [o.asset for o in driven.outcomes]
    assert content([o.window for o in driven.outcomes if o.asset == ASSET]) == undisturbed(frames)


def test_a_publisher_that_stays_away_in_a_burst_ends_its_window():
    driven, (frames, after) = Driven(), (bursts(1, frames=8), bursts(2, frames=8))
    driven.send(frames[:16])
    driven.run(5.0)
    assert len(driven.outcomes) == 1
    driven.send(after[16:])
    driven.run(5.0)
    assert [w.faults for w in driven.windows] == [(), (), ()]
    assert driven.windows[1].start_time_ns == frames[16].start_time_ns


def test_a_channel_that_has_died_holds_up_the_others_once():
    driven, frames = Driven(), [f for f in bursts(6, frames=8) if f.channel != TORQUE or f.sequence < 316]
    driven.send(frames[: 4 * 16])
    driven.run(5.0)
    assert len(driven.outcomes) == 2
    rest = frames[4 * 16 :]
    driven.send(rest[:24])
    driven.run(8.0)
    assert len(driven.outcomes) == 2
    driven.run(3.5)
    assert len(driven.outcomes) == 3
    driven.send(rest[24:48])
    driven.run(1.5)
    assert len(driven.outcomes) == 4
    assert [w.quality for w in driven.windows] == ["good", "good", "degraded", "degraded"]


def test_a_service_that_was_suspended_has_not_heard_silence():
    driven, frames = Driven(), bursts(1, frames=16)
    driven.send(frames)
    driven.run(4.0)
    driven.outcomes.clear()
    frames = bursts(2, frames=16)[64:]
    driven.send(frames[:32])
    driven.run(0.3)
    driven.now += 25.0
    driven.pump.turn(None)
    driven.run(0.3)
    assert driven.outcomes == []
    driven.send(frames[32:])
    driven.run(2.0)
    assert len(driven.outcomes) == 1 and driven.windows[0].quality == "good"


def test_counts_of_frames_alone_do_not_end_the_wait_for_a_channel_of_a_live_stream():
    driven = Driven()
    frames = bursts(200, frames=8)
    driven.send([f for f in frames[: 4 * 8 * 2]])
    driven.run(4.0)
    early = [f for f in frames[4 * 8 * 2 :] if f.channel in (ACCEL, TORQUE)]
    for f in early:
        driven.send([f])
        driven.pump.turn(driven.inbox.take(0.0))
    assert len(driven.outcomes) == 2 and early[0].channel.asset == ASSET


# -- assets that have several names --------------------------------------------------------------------


def under(name, frames):
    return [replace(f, channel=f.channel._replace(asset=name)) for f in frames]


@pytest.mark.parametrize("names", [("new", "new"), ("new", ASSET), (ASSET, "new")])
def test_a_window_is_whole_whichever_of_its_names_a_renamed_asset_is_sent_under(names):
    """The name that was silent once ended each window that came under the other, within a tenth of a second."""
    driven, frames = Driven(), bursts(3, frames=8)
    driven.send(frames[:32])
    driven.run(4.0)
    driven.rename(ASSET, "new")
    for name, burst in zip(names, (frames[32:64], frames[64:]), strict=True):
        for n in range(0, 32, 4):
            driven.send(under(name, burst[n : n + 4]))
            driven.run(0.3)
        driven.run(4.0)
    assert content(driven.windows) == undisturbed(frames)


def test_an_asset_that_is_renamed_in_the_midst_of_a_window_ends_it_in_silence():
    driven, frames = Driven(), bursts(3, frames=8)
    driven.send(frames[:80])
    driven.run(0.3)
    driven.rename(ASSET, "new")
    driven.send(frames[80:88])  # the publisher has not heard of it
    driven.run(0.3)
    driven.send(under("new", frames[88:]))
    driven.run(0.5)
    assert len(driven.outcomes) == 2
    driven.run(4.0)
    assert content(driven.windows) == undisturbed(frames)
    driven.rename(ASSET, "newest")
    driven.send(under("new", bursts(4, frames=8)[96:]))
    driven.run(0.3)
    driven.rename(ASSET, "last")  # nothing comes after that
    driven.run(4.0)
    assert content(driven.windows) == undisturbed(bursts(4, frames=8))


def test_channels_of_one_asset_may_come_under_several_of_its_names():
    driven, frames = Driven(), bursts(8, frames=8)
    driven.rename(ASSET, "old")
    for n in range(0, len(frames), 32):
        driven.send([f for f in frames[n : n + 32] if f.channel != TORQUE])
        driven.run(2.0)
        driven.send(under("old", [f for f in frames[n : n + 32] if f.channel == TORQUE]))
        driven.run(2.0)
    assert content(driven.windows) == undisturbed(frames)


@pytest.mark.parametrize("name", [ASSET, "new"])
def test_a_renamed_asset_is_known_to_send_seldom(name):
    """Its next frame came before anybody had looked, and what had been learned of its silence was lost."""
    driven, frames = Driven(Inbox(clock=lambda: driven.now)), bursts(1, frames=64)
    for n in range(0, 256, 32):  # a logger that sends 2 s of its data at a time
        packet = frames[n : n + 32]
        if n == 128:
            driven.rename(ASSET, "new")
        driven.send(under(name, packet) if n >= 128 else packet)
        for _ in packet:
            driven.pump.turn(driven.inbox.take(0.0))
        driven.run(2.0 if n < 96 else 4.0)
    driven.run(15.0)
    assert content(driven.windows) == undisturbed(frames)
