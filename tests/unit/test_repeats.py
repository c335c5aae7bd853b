"""Frames of times that have passed: the same ones again are left out silently, those of something else are counted."""

from __future__ import annotations

import dataclasses
import json
from itertools import pairwise

import numpy as np
import pytest
from streams import PINION, bursts

from service.stream.assembly import AssemblySettings
from service.stream.repeats import BETWEEN, DEFAULT, EVERY, FIRST, LATEST, Repeats
from service.stream.windows import Windows

SETTINGS = AssemblySettings(settle=4)


def used(frames) -> Windows:
    assembler = Windows(SETTINGS)
    for frame in frames:
        assembler.add(frame)
    assembler.flush()
    return assembler


def altered(frames):
    """Other content at the same times, under the same numbers."""
    for frame in frames:
        if frame.channel.kind == "encoder":
            yield dataclasses.replace(frame, first_edge_index=frame.first_edge_index + 5000)
        else:
            yield dataclasses.replace(frame, values=frame.values + 1)


@pytest.fixture(params=[False, True], ids=["at once", "after a restart"])
def again(request):
    def restored(assembler):
        return Windows.from_dict(json.loads(json.dumps(assembler.to_dict())), SETTINGS) if request.param else assembler

    return restored


def test_a_recording_that_is_sent_again_is_no_sign_of_anything(again):
    frames = bursts(8)
    assembler = again(used(frames))
    for frame in frames:
        assert assembler.add(frame) == []
    assert assembler.repeats.run == len(frames) and assembler.repeats.suspicious() == 0


@pytest.mark.parametrize("begin", [20, 60, 100])
def test_a_part_that_is_sent_again_after_its_link_was_lost_is_no_sign_of_anything(again, begin):
    """People were asked whether the machine was another one: none of the first 64 frames had been remembered."""
    frames = bursts(30)
    assembler = again(used(frames))
    for frame in frames[-begin - DEFAULT.run : -begin]:
        assert assembler.add(frame) == []
    assert assembler.repeats.run == DEFAULT.run and assembler.repeats.suspicious() == 0


@pytest.mark.parametrize("taken", [6, 30], ids=["waiting to be put in order", "in the window in progress"])
def test_frames_that_are_sent_again_before_their_window_has_closed_are_no_sign_of_anything(taken):
    """A publisher sends what is not stored once more whenever a service begins anew; people were asked about it."""
    frames = bursts(1, frames=20)[:taken]
    assembler = Windows(SETTINGS)
    for _ in range(1 + DEFAULT.run // taken + 1):
        for frame in frames:
            assert assembler.add(frame) == []
    assert assembler.repeats.run >= DEFAULT.run and assembler.repeats.suspicious() == 0


def test_other_frames_at_the_times_of_the_window_in_progress_are_seen_to_be_others():
    frames = bursts(1, frames=20)[:30]
    assembler = Windows(SETTINGS)
    for frame in (*frames, *altered(frames), *altered(frames), *altered(frames)):
        assert assembler.add(frame) == []
    assert assembler.repeats.other > 64 and assembler.repeats.suspicious()
    assert sum(kinds.get("conflict", 0) for kinds in assembler.counters.values()) == 90


def test_other_frames_at_the_same_times_are_seen_to_be_others(again):
    """They were dropped as duplicates without a word."""
    frames = bursts(8)
    assembler = again(used(frames))
    for frame in altered(frames):
        assert assembler.add(frame) == []
    assert assembler.repeats.suspicious() == len(frames) and assembler.repeats.other > 0


def test_a_frame_of_a_new_time_ends_the_run():
    frames = bursts(9)
    assembler = used(frames[:-24])
    for frame in altered(frames[:-24]):
        assembler.add(frame)
    assert assembler.repeats.suspicious()
    assembler.add(frames[-24])
    assert assembler.repeats.suspicious() == 0


def test_a_few_copies_and_late_frames_are_no_run():
    frames = bursts(3)
    assembler = Windows(SETTINGS)
    for frame in frames:
        assembler.add(frame)
        assembler.add(frame)
    assert assembler.repeats.run < DEFAULT.run and assembler.repeats.suspicious() == 0


def test_what_is_remembered_is_bounded():
    assembler = used(bursts(80, channels=(PINION,)))
    assert len(json.dumps(assembler.to_dict()["marks"])) < 2500


def test_frames_used_together_leave_the_marks_of_those_used_one_by_one():
    frames = [frame for frame in bursts(2) if frame.channel == PINION]
    frames = [dataclasses.replace(frame, sequence=k) for k, frame in enumerate(50 * frames)]
    for sizes in ((1,) * 400, (30, 2, 300, 1), (400,), (260, 1), (4, 256, 130), (261,)):
        one, many, rest = Repeats(), Repeats(), list(frames)
        for size in sizes:
            many.used("encoder/pinion", rest[:size])
            for frame in rest[:size]:
                one.used("encoder/pinion", [frame])
            rest = rest[size:]
        used = frames[: len(frames) - len(rest)]
        numbers = many.marks["encoder/pinion"][:, 1].tolist()
        between = numbers[FIRST:-LATEST]
        assert np.array_equal(many.marks["encoder/pinion"], one.marks["encoder/pinion"])
        assert Repeats.from_dict(json.loads(json.dumps(many.to_dict()))).to_dict() == many.to_dict()
        assert numbers[:FIRST] == [frame.sequence for frame in used[:FIRST]]
        assert numbers[-LATEST:] == [frame.sequence for frame in used[-LATEST:]]
        assert len(between) <= BETWEEN and all(after - before == EVERY for before, after in pairwise(between))
