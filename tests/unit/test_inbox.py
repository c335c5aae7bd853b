"""Queues between the network and the loop: bounded, fair, and whole stretches are left out where there is no room."""

from __future__ import annotations

import random

import pytest
from streams import ACCEL, ASSET, CHANNELS, bursts, content, unbroken

from service.stream.frames import NS
from service.stream.inbox import BAD_KEY, MOST_STREAMS, Arrival, Inbox, Marker, Shed
from service.stream.left_out import MANY_STREAMS, NO_ROOM, Missing
from service.stream.windows import Windows
from service.stream.wire.codec import encode, start_time_of
from service.stream.wire.topics import topic_of


def offer(inbox, frame, asset=ASSET):
    return inbox.offer(topic_of(frame.channel._replace(asset=asset)), encode(frame))


def taken(inbox):
    items = []
    while (item := inbox.take(0.0)) is not None:
        items.append(item)
    return items


def test_a_stream_that_floods_its_queue_delays_no_other():
    """One queue for all once gave a flooding asset 243 windows in the time in which four others had none."""
    inbox = Inbox(frames=10_000)
    for frame in unbroken(200.0):
        offer(inbox, frame, "flood")
    for frame in bursts(1):
        offer(inbox, frame, "calm")
    before = 0
    for item in taken(inbox):
        before += item.size if item.stream == "flood" else 0
        if item.stream == "calm":
            assert before < 2 * 2**18
    assert inbox.depth == inbox.bytes == 0 and inbox.empty


def test_what_finds_no_room_is_left_out_at_once_the_oldest_first_from_the_stream_with_most():
    inbox, frames = Inbox(frames=100), unbroken(40.0)
    for frame in bursts(1)[:20]:
        offer(inbox, frame, "calm")
    for frame in frames:
        assert offer(inbox, frame)  # never waits, never fails
    assert inbox.depth <= 100
    items = taken(inbox)
    assert sum(item.stream == "calm" for item in items) == 20
    (shed,) = (item for item in items if isinstance(item, Shed))
    kept = [start_time_of(i.channel, i.payload) for i in items if isinstance(i, Arrival) and i.stream == ASSET]
    missing = shed.missing
    assert missing.begin_ns == frames[0].start_time_ns and missing.end_ns <= min(kept)
    assert sum(missing.frames.values()) == len(frames) - len(kept) == inbox.refused[NO_ROOM]
    assert items[20] is shed or items[0] is shed or items.index(shed) < 21  # before the frames that were kept
    assert min(kept) - missing.end_ns < NS


def test_room_is_bounded_in_bytes_even_for_one_frame():
    inbox, frame = Inbox(max_bytes=1000), bursts(1)[0]
    assert len(encode(frame)) > 500
    offer(inbox, frame)
    (item,) = taken(inbox)
    assert isinstance(item, Shed) and inbox.bytes == 0


@pytest.mark.parametrize("start", [0, 2**63, 2**64 - 1])
def test_a_time_that_no_frame_can_have_makes_no_window_of_what_is_left_out(start):
    inbox, assembler = Inbox(max_bytes=1000), Windows()
    payload = encode(bursts(1)[0])
    inbox.offer(topic_of(ACCEL), payload[:1] + start.to_bytes(8, "little") + payload[9:])
    (item,) = taken(inbox)
    assert isinstance(item, Shed) and item.missing.end_ns <= 2**63
    assembler.leave_out(item.missing)
    assert assembler.flush() == []


@pytest.mark.slow
def test_nothing_that_names_key_grows_with_the_names():
    """Every topic that was refused was once remembered for good."""
    inbox = Inbox()
    for n in range(3000):
        inbox.offer(f"gearbox/a/torque/motor{n}", b"")
        inbox.offer(f"gearbox/asset-{n}/accel/y6", encode(bursts(1)[0]))
    assert inbox.refused == {BAD_KEY: 3000, MANY_STREAMS: 3000 - MOST_STREAMS}
    assert len(taken(inbox)) == MOST_STREAMS and not inbox._queues and not inbox._turns


def test_announced_channels_are_those_whose_publishers_are_there():
    inbox = Inbox()
    for there in (True, True, False):
        inbox.announce("gearbox/a/accel/y6", there=there)
    inbox.announce("gearbox/a/torque/motor", there=True)
    inbox.announce("gearbox/b/torque/pinion", there=False)
    assert (inbox.announced("a"), inbox.announced("b")) == (("accel/y6",), ())
    inbox.announce("gearbox/a/accel/y6", there=False)
    assert inbox.announced("a") == () and not inbox._announced
    for n in range(3000):
        inbox.announce(f"gearbox/a/accel/s{n}", there=True)
        inbox.announce(f"gearbox/asset-{n}/accel/y6", there=True)
    assert len(inbox._announced) == MOST_STREAMS and len(inbox.announced("a")) == 256


def test_a_question_waits_behind_the_frames_of_its_stream_alone():
    inbox, frames = Inbox(frames=100_000), unbroken(400.0)
    for frame in frames:
        offer(inbox, frame)
    inbox.ask("other", lambda: None)
    inbox.ask(ASSET, lambda: None)
    for frame in frames[:4]:
        offer(inbox, frame)
    items = [item for item in taken(inbox) if item.stream == ASSET]
    places = [n for n, item in enumerate(items) if isinstance(item, Marker)]
    assert places == [len(frames)]
    assert not all(inbox.ask(ASSET, lambda: None) for _ in range(1000))  # bounded too


def test_frames_that_cannot_be_read_do_not_keep_others_out():
    inbox = Inbox(frames=40)
    for _ in range(200):
        inbox.offer(topic_of(ACCEL), b"\xff" * 40)
    for frame in bursts(1)[:8]:
        offer(inbox, frame)
    assert sum(isinstance(i, Arrival) and start_time_of(i.channel, i.payload) is not None for i in taken(inbox)) == 8


# -- what becomes of the windows -----------------------------------------------------------------------


def windows_of(items):
    """The windows of frames, among which stretches (begin, end, frames by channel) were left out."""
    assembler, windows = Windows(), []
    for item in items:
        if isinstance(item, tuple):
            assembler.leave_out(Missing(*item))
        else:
            windows += assembler.add(item)
    return windows + assembler.flush(), assembler


@pytest.mark.parametrize("seed", range(24))
def test_no_window_is_made_of_what_is_left_of_it(seed):
    """Frames dropped one by one once tore windows, whose rest was used."""
    rng = random.Random(seed)
    frames = rng.choice([lambda: bursts(8, frames=8), lambda: unbroken(60.0), lambda: bursts(3, frames=50)])()
    whole = {w.start_time_ns: w for w in windows_of(frames)[0]}
    left, gone = list(frames), []
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(left))
        begin = left[at].start_time_ns
        end = begin + round(rng.choice([0.2, 1.0, 4.0, 9.0, 21.0]) * NS)
        lost = [f for f in left if begin <= f.start_time_ns < end]
        by_channel = {c.label: sum(f.channel == c for f in lost) for c in CHANNELS}
        left = [f for f in left if f not in lost]
        gone.append((begin, max(f.start_time_ns for f in lost) + 1, by_channel))
    items = sorted([*left, *gone], key=lambda x: x[0] if isinstance(x, tuple) else x.start_time_ns)
    windows, assembler = windows_of(items)
    used = [w for w in windows if w.quality != "refused"]
    assert content(used) == content([whole[w.start_time_ns] for w in used])
    refused = [w for w in windows if w.quality == "refused"]
    assert refused and all(any(f.kind == "shed" for f in w.faults) for w in refused)
    assert assembler.left_out["shed"] == sum(sum(by.values()) for _, _, by in gone)
    assert assembler.position.shed == len(refused)
    starts = [w.start_time_ns for w in windows]
    assert starts == sorted(set(starts))


def test_windows_that_are_left_out_whole_are_refused_windows():
    frames = bursts(5, frames=8)
    lost = [f for f in frames if 32 * 1 <= frames.index(f) < 32 * 3]
    stretch = (lost[0].start_time_ns, lost[-1].start_time_ns + 1, {ACCEL.label: len(lost)})
    windows, _ = windows_of([*frames[:32], stretch, *frames[96:]])
    assert [w.quality for w in windows] == ["good", "refused", "good", "good"]
    (fault,) = (f for f in windows[1].faults if f.kind == "shed")
    assert fault.count == len(lost) and "their queue was full" in fault.detail


def test_position_is_where_the_earliest_frame_in_memory_starts():
    assembler, frames = Windows(), bursts(3, frames=8)
    assert assembler.position.unsettled_from_ns is None
    for frame in frames[:40]:
        assembler.add(frame)
        found = assembler.position
        assert found.unsettled_from_ns in {frames[0].start_time_ns, frames[32].start_time_ns}
    assert frames[0].start_time_ns == assembler.position.unsettled_from_ns  # settles once the order is certain
    for frame in frames[40:]:
        assembler.add(frame)
    assert assembler.position.unsettled_from_ns > frames[0].start_time_ns
    assembler.flush()
    found = assembler.position
    assert found.unsettled_from_ns is None and found.settled_until_ns >= frames[-1].start_time_ns
    newest = found.channels[ACCEL.label]
    assert (newest.sequence, newest.start_ns) == (frames[-4].sequence, frames[-4].start_time_ns)
    restored = Windows.from_dict(assembler.to_dict()).position
    assert restored.channels == found.channels and restored.unsettled_from_ns is None
