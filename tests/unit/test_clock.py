"""No time stamp blinds an asset: one wrong one costs a frame, a clock that was set is followed, copies stay copies."""

from __future__ import annotations

import dataclasses
import json

import pytest
from streams import ACCEL, CHANNELS, T0, bursts, content, frame, unbroken

from service.stream.assembly import AssemblySettings
from service.stream.frames import NS
from service.stream.windows import Windows

HOUR, DAY, YEAR = 3600 * NS, 86400 * NS, 365 * 86400 * NS


def moved(frames, by, renumbered=None):
    """Frames at another time; with numbers that begin at `renumbered`, key by key."""
    first = {}
    out = []
    for f in frames:
        number = f.sequence
        if renumbered is not None:
            number = renumbered + f.sequence - first.setdefault(f.channel, f.sequence)
        out.append(dataclasses.replace(f, start_time_ns=f.start_time_ns + by, sequence=number))
    return out


def live(assembler, frames, drift=0):
    """Frames that arrive when the true time of their end comes; `drift` is what their clock shows over it [ns]."""
    return [w for f in frames for w in assembler.add(f, f.end_time_ns - drift)]


def clock_faults(windows):
    return [(i, f.channel, f.action) for i, w in enumerate(windows) for f in w.faults if f.kind == "clock"]


@pytest.mark.parametrize("ahead", [HOUR, 399 * DAY, 3 * YEAR])
def test_one_frame_a_key_far_ahead_costs_those_frames_and_no_more(ahead):
    """Such frames once made every true frame an overlap until that date came."""
    frames = bursts(6)
    wild = {id(next(f for f in frames[24:] if f.channel == c)) for c in CHANNELS}
    assembler = Windows(AssemblySettings(settle=4))
    windows = []
    for f in frames:
        sent = dataclasses.replace(f, start_time_ns=f.start_time_ns + ahead) if id(f) in wild else f
        windows += assembler.add(sent, f.end_time_ns)
    windows += assembler.flush()
    assert len(windows) == 6
    assert [w.quality for w in windows[2:]] == ["good"] * 4
    assert {i for i, _, _ in clock_faults(windows)} == {0} or {i for i, _, _ in clock_faults(windows)} == {1}
    assert all(assembler.counters[c.label]["clock"] == 1 for c in CHANNELS)
    assert not any("overlap" in kinds for kinds in assembler.counters.values())


def test_a_first_frame_far_ahead_is_left_out():
    frames = bursts(3)
    wild = dataclasses.replace(frame(ACCEL, -1, 0.0), start_time_ns=T0 + YEAR)
    assembler = Windows(AssemblySettings(settle=4))
    windows = assembler.add(wild, T0) + live(assembler, frames) + assembler.flush()
    assert content(windows)[1:] == content(whole(frames))[1:]
    assert [w.start_time_ns for w in windows] == [w.start_time_ns for w in whole(frames)]


def whole(frames):
    assembler = Windows(AssemblySettings(settle=4))
    return [w for f in frames for w in assembler.add(f)] + assembler.flush()


@pytest.mark.parametrize("host", [True, False])
@pytest.mark.parametrize("renumbered", [None, 0])
@pytest.mark.parametrize("back", [HOUR, T0 - 1000 * NS], ids=["an hour back", "restarted in 1970"])
def test_a_clock_set_back_is_followed_with_a_fault(back, renumbered, host):
    """A clock set back once made every frame an overlap, or a duplicate, until it had caught up."""
    frames = unbroken(80.0)
    before, after = frames[:640], moved(frames[640:], -back, renumbered)
    assembler = Windows(AssemblySettings(settle=4, length=5.0))
    windows = []
    for f, sent in zip(frames, [*before, *after], strict=True):
        windows += assembler.add(sent, f.end_time_ns if host else None)
    windows += assembler.flush()
    seconds = sum(w.accelerations["y6"].values.size for w in windows) / 1000
    assert seconds == pytest.approx(80.0, abs=0.5)  # nothing but what was on its way is lost
    later = [w for w in windows if w.start_time_ns < T0]
    assert len(later) >= 6 and all(w.quality == "good" for w in later[1:])
    assert {action for _, _, action in clock_faults(windows)} == {"repaired"}
    (fault, *_) = [f for w in windows for f in w.faults if f.kind == "clock"]
    assert "the stream's clock was set from 2023-11-14" in fault.detail
    assert len({w.start_time_ns for w in windows}) == len(windows)


def test_windows_in_a_time_that_was_passed_before_have_names_of_their_own():
    frames = unbroken(120.0)
    before, after = frames[:960], moved(frames[960:], -30 * NS)
    assembler = Windows(AssemblySettings(settle=4, length=5.0))
    windows = [w for f in [*before, *after] for w in assembler.add(f)] + assembler.flush()
    starts = [w.start_time_ns for w in windows]
    assert len(set(starts)) == len(starts) and sorted(starts) != starts
    assert sum(w.accelerations["y6"].values.size for w in windows) == pytest.approx(120_000, abs=500)


def test_frames_given_again_are_duplicates_even_after_the_clock_was_set():
    frames = unbroken(80.0)
    sent = [*frames[:640], *moved(frames[640:], -HOUR, 0)]
    assembler = Windows(AssemblySettings(settle=4, length=5.0))
    first = [w for f in sent for w in assembler.add(f)] + assembler.flush()
    assert len(first) > 10
    counted = {label: dict(kinds) for label, kinds in assembler.counters.items()}
    assert [w for f in sent for w in assembler.add(f)] + assembler.flush() == []
    for label, kinds in assembler.counters.items():
        assert kinds.get("duplicate", 0) - counted[label].get("duplicate", 0) == len(sent) // len(CHANNELS)
        assert kinds.get("clock") == counted[label].get("clock")


def test_a_recording_of_long_ago_is_replayed_as_before_beside_the_hosts_clock():
    frames = bursts(4)
    plain, beside = Windows(), Windows()
    windows = [w for f in frames for w in beside.add(f, T0 + 5 * YEAR)] + beside.flush()
    assert content(windows) == content([w for f in frames for w in plain.add(f)] + plain.flush())
    again = [w for f in frames for w in beside.add(f, T0 + 5 * YEAR)] + beside.flush()
    assert again == []
    assert all(kinds["duplicate"] == 24 for kinds in beside.counters.values())


def test_a_clock_that_runs_ahead_and_stays_ahead_is_accepted_with_a_fault():
    frames = bursts(3, frames=12)
    assembler = Windows(AssemblySettings(settle=4))
    windows = live(assembler, frames, drift=DAY) + assembler.flush()
    assert [w.start_time_ns for w in windows] == [w.start_time_ns for w in whole(frames)]
    assert all(w.accelerations["y6"].values.size == 3000 for w in windows)
    assert clock_faults(windows)[0][2] == "repaired"


@pytest.mark.parametrize("pause", [2.0, 61.0, 3600.0])
@pytest.mark.parametrize("per_burst", [3, 6, 12])
def test_a_recording_from_the_future_loses_nothing_in_its_pauses(pause, per_burst):
    """After each pause of over a minute, frames were left out until eight of a key had come in good order."""
    frames = bursts(6, frames=per_burst, pause=pause)
    assembler = Windows(AssemblySettings(settle=4))
    windows = [w for f in frames for w in assembler.add(f, T0 - YEAR)] + assembler.flush()
    assert [w.start_time_ns for w in windows] == [w.start_time_ns for w in whole(frames)]
    assert [w.accelerations["y6"].values.size for w in windows] == [per_burst * 250] * 6
    assert sorted(clock_faults(windows)) == sorted((0, channel.label, "repaired") for channel in CHANNELS)


def test_a_short_recording_from_the_future_is_not_lost():
    """Fewer frames than show that a clock was set were held, and never given up."""
    frames = bursts(1, frames=3)
    assembler = Windows(AssemblySettings(settle=4))
    windows = [w for f in frames for w in assembler.add(f, T0 - YEAR)] + assembler.flush()
    assert [w.accelerations["y6"].values.size for w in windows] == [750]
    assert sorted(clock_faults(windows)) == sorted((0, channel.label, "repaired") for channel in CHANNELS)


def test_a_clock_that_was_ahead_and_is_set_right_is_followed():
    frames = bursts(8, frames=12)
    sent = [*moved(frames[:192], 399 * DAY), *frames[192:]]
    assembler = Windows(AssemblySettings(settle=4))
    windows = []
    for f, s in zip(frames, sent, strict=True):
        windows += assembler.add(s, f.end_time_ns)
    windows += assembler.flush()
    assert sum(w.accelerations["y6"].values.size for w in windows) == pytest.approx(8 * 3000, abs=500)
    assert sum(w.start_time_ns < T0 + DAY for w in windows) >= 4


def test_one_channel_with_a_wrong_clock_does_not_stop_the_others():
    frames = bursts(6)
    sent = [dataclasses.replace(f, start_time_ns=f.start_time_ns + DAY) if f.channel == ACCEL else f for f in frames]
    assembler = Windows(AssemblySettings(settle=4))
    windows = []
    for f, s in zip(frames, sent, strict=True):
        windows += assembler.add(s, f.end_time_ns)
    assembler.wait_only_for([c.label for c in CHANNELS if c != ACCEL])
    windows += assembler.flush()
    assert len(windows) == 6
    assert all(set(w.encoders) == {"pinion", "gear"} for w in windows)
    assert assembler.counters["accel/y6"]["clock"] >= 30


@pytest.mark.parametrize("stop", range(60, 1280, 97))
def test_a_restart_at_any_frame_around_a_clock_that_is_set_loses_and_doubles_nothing_that_was_committed(stop):
    frames = unbroken(80.0)
    sent = [*frames[:640], *moved(frames[640:], -HOUR)]
    chosen = AssemblySettings(settle=4, length=5.0)
    before, windows, saved = Windows(chosen), [], None
    for f in sent[:stop]:
        if made := before.add(f):
            windows += made
            saved = json.loads(json.dumps(before.to_dict()))
    after = Windows.from_dict(saved, chosen) if saved else Windows(chosen)
    for f in sent:  # all from the start again
        windows += after.add(f)
    windows += after.flush()
    seconds = sum(w.accelerations["y6"].values.size for w in windows) / 1000
    assert seconds == pytest.approx(80.0, abs=0.5)
    starts = [w.start_time_ns for w in windows]
    assert len(set(starts)) == len(starts)


def test_a_sequence_number_at_its_end_does_not_count_as_frames_lost():
    frames = bursts(4)
    wild = next(f for f in frames[24:] if f.channel == ACCEL)
    sent = [dataclasses.replace(f, sequence=2**64 - 1) if f is wild else f for f in frames]
    assembler = Windows(AssemblySettings(settle=4))
    windows = [w for f in sent for w in assembler.add(f)] + assembler.flush()
    assert len(windows) == 4
    assert assembler.counters["accel/y6"].get("lost", 0) <= 1
    assert assembler.counters["accel/y6"]["sequence_jump"] == 1


def test_what_is_remembered_of_used_frames_is_bounded():
    assembler = Windows(AssemblySettings(settle=2, length=1.0))
    saved = [state for f in unbroken(600.0, channels=(ACCEL,)) for _, state in assembler.assemble(f)][-1]
    assert len(json.dumps(saved["timelines"])) < 3000
    assert assembler.add(frame(ACCEL, 17, 4.25)) == []
    assert assembler.counters["accel/y6"]["duplicate"] == 1


def test_when_the_newest_frame_came_is_known_and_outlives_a_restart():
    assembler = Windows(AssemblySettings(settle=4))
    frames = bursts(3)
    saved = [state for f in frames for _, state in assembler.assemble(f, f.end_time_ns + 7 * NS)][-1]
    assert assembler.last_arrival_ns == frames[-1].end_time_ns + 7 * NS
    again = Windows.from_dict(json.loads(json.dumps(saved)))
    assert again.last_arrival_ns > frames[24].end_time_ns and again.closed_until_ns > T0


@pytest.mark.parametrize("ahead", [DAY, 30 * DAY, HOUR])
def test_a_logger_that_asks_what_is_stored_is_followed_when_its_clock_is_set_right(ahead):
    """It was taken for a recording that was made before what is stored, until the time had come that it had shown."""
    frames = bursts(8, frames=12)
    sent = [*moved(frames[:192], ahead), *frames[192:]]
    assembler = Windows(AssemblySettings(settle=4))
    assembler.recorded = True
    windows = [w for f, s in zip(frames, sent, strict=True) for w in assembler.add(s, f.end_time_ns)]
    windows += assembler.flush()
    assert "past" not in assembler.left_out
    assert sum(w.accelerations["y6"].values.size for w in windows) == pytest.approx(8 * 3000, abs=500)
    assert sum(w.start_time_ns < T0 + HOUR / 2 for w in windows) >= 4
    for f in moved(frames[:48], -900 * DAY, 5000):  # a recording of long ago is of the past all the same
        assert assembler.add(f, frames[-1].end_time_ns) == []
    assert assembler.left_out["past"] == 48


@pytest.mark.parametrize("number", [1, 3, 7])
def test_a_recording_of_few_frames_from_the_future_is_not_waited_for_without_end(number):
    """Fewer frames than show that a clock was set were held as long as nothing else came."""
    frames = bursts(2, frames=12)
    assembler = Windows(AssemblySettings(settle=4))
    assembler.recorded = True
    now = frames[-1].end_time_ns
    before = [w for f in frames for w in assembler.add(f, now)] + assembler.flush()
    short = moved([f for f in bursts(1, frames=number)], DAY, 900)
    windows = [w for f in short for w in assembler.add(f, now)]
    assert assembler.waiting
    windows += assembler.flush()
    assert not assembler.waiting
    assert [w.accelerations["y6"].values.size for w in before + windows] == [3000, 3000, 250 * number]
    assert assembler.position.unsettled_from_ns is None
    assert {action for _, _, action in clock_faults(windows)} == {"repaired"}
