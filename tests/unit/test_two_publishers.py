"""Two publishers on one key, forged and restarted sequence numbers: named, and the first one's windows stay right."""

from __future__ import annotations

import dataclasses
import random

import pytest
from streams import ACCEL, CHANNELS, bursts, content, unbroken

from service.stream.frames import NS
from service.stream.publishers import Publishers, two_publishers
from service.stream.windows import Windows

MOST = 2**64 - 1


def windows_of(frames):
    assembler = Windows()
    return [w for frame in frames for w in assembler.add(frame)] + assembler.flush(), assembler


def same_signals(windows):
    return [c[3:] for c in content(windows)]


def another(frame, *, number, later=0.0, factor=-3.0):
    """What a second publisher sends at about the same time."""
    given = {"sequence": number, "start_time_ns": frame.start_time_ns + round(later * NS)}
    if hasattr(frame, "values"):
        given["values"] = factor * frame.values + 1
    else:
        given["first_edge_index"] = frame.first_edge_index + 77_000
    return dataclasses.replace(frame, **given)


def interleaved(frames, second, rng):
    """Each of the second publisher's frames directly before, or some frames after, the first one's."""
    out = []
    for place, frame in enumerate(frames):
        out.append((place, frame))
        if place in second:
            out.append((place + rng.choice([-0.5, 0.5, 3.5]), second[place]))
    return [frame for _, frame in sorted(out, key=lambda each: each[0])]


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("make", [lambda: bursts(5, frames=12), lambda: unbroken(40.0)], ids=["bursts", "unbroken"])
def test_windows_of_the_first_publisher_stay_right(seed, make):
    """Frames of both were mixed into windows with the first one's, or its own taken for lost."""
    rng, frames = random.Random(seed), make()
    later = rng.choice([0.0, 0.05, 0.11])
    begin = len(CHANNELS) * 40
    numbers = {c: rng.choice([0, 10_000, 2**63]) for c in CHANNELS}
    second = {}
    for place, frame in enumerate(frames):
        if place >= begin and rng.random() < 0.9:
            second[place] = another(frame, number=numbers[frame.channel], later=later)
            numbers[frame.channel] += 1
    windows, assembler = windows_of(interleaved(frames, second, rng))
    assert same_signals(windows) == same_signals(windows_of(frames)[0])
    conflicts = sum(kinds.get("conflict", 0) for kinds in assembler.counters.values())
    assert conflicts > 0.9 * len(second)
    shown = [f for w in windows for f in w.faults if f.kind == "conflict"]
    assert sum(f.count for f in shown) <= conflicts and all("two publishers" in f.detail for f in shown) and shown


def test_the_same_number_with_other_content_is_named_wherever_the_first_is():
    frames = bursts(2, frames=12)
    forged = [another(f, number=f.sequence) for f in frames if f.channel == ACCEL]
    windows, assembler = windows_of([*frames[:40], *forged[:9], *frames[40:], *forged[-4:]])
    assert same_signals(windows) == same_signals(windows_of(frames)[0])
    assert assembler.counters[ACCEL.label]["conflict"] >= 9


@pytest.mark.parametrize("number", [MOST, 0, 2**63])
def test_a_forged_number_costs_no_window_of_the_others(number):
    """2^64 - 1 once made 1.8e19 frames lost."""
    frames = unbroken(40.0)
    at = 4 * 50
    forged = another(frames[at], number=number)
    windows, assembler = windows_of([*frames[:at], forged, *frames[at:]])
    assert same_signals(windows) == same_signals(windows_of(frames)[0])
    counters = assembler.counters[ACCEL.label]
    assert counters["conflict"] == 1 and counters.get("lost", 0) == 0


def test_a_publisher_that_restarts_is_taken_on_soon():
    frames = bursts(6, frames=12)
    before = {f.channel: f.sequence + 1 for f in frames[: 3 * 48]}
    again = [*frames[: 3 * 48]]
    again += [dataclasses.replace(f, sequence=f.sequence - before[f.channel]) for f in frames[3 * 48 :]]
    windows, assembler = windows_of(again)
    assert same_signals(windows) == same_signals(windows_of(frames)[0])
    assert all(kinds.get("conflict", 0) == kinds.get("lost", 0) == 0 for kinds in assembler.counters.values())


# -- by the identity that the network gives ------------------------------------------------------------


def named(sources, pace=0.5):
    """The pairs that are named while frames of some publishers come."""
    publishers, found = Publishers(), []
    for number, source in enumerate(sources):
        two = publishers.note(source, 1000.0 + number * pace)
        found += [two] if two else []
    return found


def test_two_publishers_that_send_in_turn_are_named_with_both_identities():
    assert named("ab" * 20)[0] == ("a", "b")
    assert set(named("aaab" * 40)) == set(named("b" * 40 + "aab" * 40)) == {("a", "b")}


@pytest.mark.parametrize(
    "sources",
    ["a" * 400, "a" * 100 + "b" * 300, "".join(c * 30 for c in "abcdefgh"), "a" * 50 + "abab" + "b" * 300],
    ids=["one", "started anew", "started again and again", "its last frames come late"],
)
def test_a_publisher_that_is_started_anew_is_not_named(sources):
    assert named(sources) == []


def test_frames_on_their_way_in_one_moment_name_nobody():
    assert named("ab" * 200, pace=0.01) == []
    assert named("ab" + "b" * 200 + "ab" + "b" * 2000, pace=0.5) == []


def test_two_that_are_named_are_a_fault_of_the_next_window_that_changes_nothing_else():
    assembler, frames = Windows(), bursts(2)
    undisturbed = windows_of(frames)[0]
    assembler.note(two_publishers(ACCEL.label, ("x/1", "y/2")))
    first, second = [w for frame in frames for w in assembler.add(frame)] + assembler.flush()
    (fault,) = first.faults
    assert (fault.kind, fault.channel, first.quality) == ("two_publishers", "accel/y6", "good")
    assert fault.detail == "x/1 and y/2 send on this key in turn" and second.faults == ()
    assert same_signals([first, second]) == same_signals(undisturbed)
