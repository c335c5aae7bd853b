"""Frames that the service leaves out in the midst of a burst tear no window: it is whole, or refused with the reason.

An asset that is retired and reinstated, one that is adopted, frames for which the storage has no room, and floods.
"""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from types import SimpleNamespace

import pytest
from segments import made
from streams import ACCEL, ASSET, CHANNELS, T0, bursts, content, frame

from service.errors import StorageUnavailable
from service.results.unknown_assets import ON_THE_WAY, UnknownAssets
from service.runtime.intake import Intake
from service.runtime.learning_phase import LearningPhase
from service.runtime.pump import Pump
from service.runtime.reception import Reception
from service.runtime.routes import Routes
from service.runtime.storage_watch import StorageWatch
from service.runtime.streams import Streams
from service.stream.assembly import AssemblySettings
from service.stream.inbox import Inbox
from service.stream.windows import Windows
from service.stream.wire.codec import encode
from service.stream.wire.topics import topic_of
from twin.rig import Rig

FRAMES = 12  # of each channel in a burst: 3 s


class Plant:
    """From the inbox to closed windows, as in the service, turned by hand on a clock of its own."""

    def __init__(self, asks=False, held_bytes=2**20, storage=None, **room):
        self.now, self.windows, self.retired, self.known = 1000.0, [], False, not asks
        self.unknown = UnknownAssets(asks=asks, clock=lambda: self.now)
        self.inbox = Inbox(admits=self.unknown.admits, **room)
        reception = Reception(
            lambda asset: Rig.from_mapping({}),
            lambda closed: self.windows.append(made(closed.segment)),
            assembly=AssemblySettings(clocked=True),
        )
        self.reception = reception
        self.intake = Intake(
            reception, lambda asset: None, clock=lambda: self.now, storage=storage, held_bytes=held_bytes,
            learning=LearningPhase(wait=0.0),
        )  # fmt: skip
        names = SimpleNamespace(routes=dict)
        retired, clock = (lambda asset: self.retired), (lambda: self.now)
        routes = Routes(names)
        self.streams = Streams(routes, self.intake, retired, unknown=self.unknown, clock=clock)
        self.unknown.begin(lambda stream: self.known, ())
        self.pump = Pump(self.inbox, self.streams, 0.7, asset_of=routes.asset_of, clock=lambda: self.now)

    def send(self, frames):
        for each in frames:
            self.inbox.offer(topic_of(each.channel), encode(each))
            self.now += 0.02
            self.turn()

    def turn(self):
        while not self.inbox.empty:
            self.pump.turn(self.inbox.take(0.0))
        self.pump.turn(None)

    def rest(self, seconds):
        for _ in range(round(seconds / 0.1)):
            self.now += 0.1
            self.turn()

    @property
    def refused(self):
        return [w for w in self.windows if w.quality == "refused"]

    def no_window_is_torn(self, frames, kind="left_out"):
        """Each window is one of the undisturbed stream, or refused with the reason."""
        undisturbed = {w.start_time_ns: w for w in whole(frames)}
        used = [w for w in self.windows if w.quality != "refused"]
        assert content(used) == content([undisturbed[w.start_time_ns] for w in used])
        for window in self.refused:
            assert any(f.kind == kind and "frames left out: " in f.detail for f in window.faults), window.faults
        return used


def whole(frames):
    assembler = Windows()
    return [w for f in frames for w in assembler.add(f)] + assembler.flush()


def divided(frames, *times):
    """The frames between shares of the stream."""
    marks = [0, *(round(t * len(frames)) for t in times), len(frames)]
    return [frames[a:b] for a, b in itertools.pairwise(marks)]


# -- retired and reinstated --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("paused", [False, True])
def test_retired_and_reinstated_at_any_time_makes_no_torn_window(seed, paused):
    """The first half of a burst was once used as a whole window, and so was the second half of another one."""
    frames, rng = bursts(5, frames=FRAMES), random.Random(seed)
    before, during, after = divided(frames, *sorted((rng.random(), rng.random())))
    plant = Plant()
    plant.send(before)
    plant.retired = True
    plant.send(during)
    if paused:
        plant.rest(8.0)
    plant.retired = False
    plant.send(after)
    plant.rest(8.0)
    used = plant.no_window_is_torn(frames)
    assert len(used) <= 5 and len(plant.refused) <= 2
    touched = sum(any(f in during for f in frames[b * 48 : b * 48 + 48]) for b in range(5))
    assert len(used) == 5 - touched


def test_reinstated_within_the_same_burst_refuses_that_burst_alone_and_says_why():
    frames = bursts(3, frames=FRAMES)
    before, during, after = frames[:60], frames[60:76], frames[76:]
    plant = Plant()
    plant.send(before)
    plant.retired = True
    plant.send(during)
    plant.retired = False
    plant.send(after)
    plant.rest(8.0)
    assert [w.quality for w in plant.windows] == ["good", "refused", "good"]
    (fault,) = (f for f in plant.windows[1].faults if f.kind == "left_out")
    assert fault.count == 16 and fault.detail == "16 frames left out: they came while the asset was retired"
    assert plant.streams.left_out == {ASSET: 16}


def test_frames_of_the_time_of_retirement_that_are_sent_again_make_the_window_whole():
    frames = bursts(3, frames=FRAMES)
    plant = Plant()
    plant.send(frames[:60])
    plant.retired = True
    plant.send(frames[60:76])
    plant.rest(10.0)  # a publisher that keeps its frames waits meanwhile
    plant.retired = False
    plant.send(frames[48:])
    plant.rest(8.0)
    assert content(plant.windows) == content(whole(frames)) and not plant.refused
    assert plant.intake.position(ASSET).unsettled_from_ns is None


def test_what_is_in_progress_when_an_asset_is_retired_for_good_is_closed():
    frames = bursts(2, frames=FRAMES)
    torn, ended = Plant(), Plant()
    torn.send(frames[:20])
    torn.retired = True
    torn.send(frames[20:])
    ended.send(frames[:48])
    ended.retired = True
    for plant, quality in ((torn, "refused"), (ended, "good")):
        plant.rest(30.0)
        assert plant.windows == [] and plant.intake.position(ASSET).unsettled_from_ns is not None
        plant.rest(60.0)
        assert [w.quality for w in plant.windows] == [quality]
        assert plant.intake.position(ASSET).unsettled_from_ns is None
    endless = Plant()
    endless.send(frames[:20])
    endless.retired = True
    for number in range(5, 900):
        endless.send([frame(c, number, number * 0.25) for c in CHANNELS])
    assert [w.quality for w in endless.windows] == ["refused"]
    endless.rest(8.0)
    assert len(endless.windows) == 1


# -- adopted -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [1, 17, 47, 48, 49, 70])
def test_adoption_in_the_midst_of_a_burst_makes_no_torn_window(at):
    """The rest of the burst in which an asset was adopted was once its first window, graded good."""
    frames = bursts(4, frames=FRAMES)
    plant = Plant(asks=True)
    plant.send(frames[:at])
    plant.known = True
    plant.send(frames[at:])
    plant.rest(8.0)
    used = plant.no_window_is_torn(frames)
    assert len(used) == 4 - -(-at // 48) and len(plant.refused) == (at % 48 > 0)


def test_an_adopted_asset_whose_publisher_sends_again_loses_no_window():
    frames = bursts(4, frames=FRAMES)
    plant = Plant(asks=True)
    plant.send(frames[:70])
    plant.known = True
    assert not plant.unknown.asked(ASSET)  # frames that were sent before may still be on their way
    plant.rest(ON_THE_WAY)
    assert plant.unknown.asked(ASSET)
    plant.send(frames)
    plant.rest(8.0)
    assert content(plant.windows) == content(whole(frames))


def test_what_is_known_of_frames_of_unknown_assets_is_bounded():
    plant = Plant(asks=True)
    for number in range(2000):
        plant.inbox.offer(f"gearbox/name-{number}/accel/y6", encode(frame(ACCEL, number, number * 0.25)))
    assert len(plant.inbox._growing) <= 64
    for number in range(5000):
        plant.inbox.offer(f"gearbox/{ASSET}/accel/y6", encode(frame(ACCEL, number, number * 0.25)))
    assert len(plant.inbox._growing[ASSET].starts) <= 2048


@pytest.mark.parametrize("at", [10, 48])
def test_a_stream_that_is_said_to_be_another_machines_in_the_midst_of_a_burst_makes_no_torn_window(at):
    frames, windows = bursts(3, frames=FRAMES), []
    reception = Reception(lambda asset: Rig.from_mapping({}), windows.append)
    for each in frames[:at]:
        reception.feed(each)
    reception.split(ASSET, "other", fresh=True)
    for each in frames[at:]:
        reception.feed(replace(each, channel=each.channel._replace(asset="other")))
    reception.flush("other")
    graded = [made(closed.segment).quality for closed in windows if closed.asset == "other"]
    assert graded == (["refused", "good", "good"] if at % 48 else ["good", "good"])


# -- no room -----------------------------------------------------------------------------------------------


def test_first_frames_of_a_new_asset_beyond_the_room_while_the_storage_is_away_tear_no_window():
    storage = StorageWatch("here")
    frames = bursts(3, frames=FRAMES)
    plant = Plant(storage=storage, held_bytes=40_000)
    opened, plant.intake._reception.open = plant.intake._reception.open, unavailable
    plant.send(frames[:60])
    assert 0 < plant.intake.left_out < 60
    plant.intake._reception.open = opened
    storage.worked()
    plant.send(frames[60:])
    plant.rest(8.0)
    used = plant.no_window_is_torn(frames)
    assert len(plant.refused) == 2 and [w.start_time_ns for w in used] == [whole(frames)[2].start_time_ns]


def unavailable(asset):
    raise StorageUnavailable("locked", reason="locked")


@pytest.mark.parametrize("length", [0.25, 2.0, 8.0])
def test_window_that_begins_one_frame_after_a_flood_is_refused_however_long_frames_are(length):
    """What is known of a frame without room is its start: its end was once taken for that."""
    frames = [stretched(f, length / 0.25) for f in bursts(1, frames=4)]
    assembler = Windows(AssemblySettings(length=10_000.0))
    lost = [f for f in frames if f.sequence - frames[CHANNELS.index(f.channel)].sequence < 2]
    inbox = Inbox(frames=100)
    for each in frames:
        inbox.offer(topic_of(each.channel), encode(each))
    inbox._queues[ASSET].shed(ASSET)
    item = inbox.take(0.0)
    assembler.leave_out(item.missing)
    rest = [f for f in frames if f.start_time_ns >= item.missing.end_ns]
    assert len(rest) < len(frames) and lost
    windows = [w for f in rest for w in assembler.add(f)] + assembler.flush()
    assert windows and all(w.quality == "refused" for w in windows)


def stretched(f, factor):
    """The same values, each frame so many times as long."""
    start = T0 + round((f.start_time_ns - T0) * factor)
    if f.channel.kind == "encoder":
        return replace(f, start_time_ns=start, edge_offsets_ns=f.edge_offsets_ns * factor)
    return replace(f, start_time_ns=start, sample_rate=f.sample_rate / factor)
