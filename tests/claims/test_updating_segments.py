"""Operating conditions that change often: the profile at the start of a segment is all that the past leaves behind."""

from __future__ import annotations

import inspect
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.dynamics_cases import RIG
from tests.updating_cases import TEN, curve, model, seen
from twin.model import Condition
from twin.serial import from_plain, to_plain
from twin.updating.history import UpdateOptions, WindowInput, update_window
from twin.updating.memory import KEPT_SEGMENTS, Memory, Segment, StoredProfile
from twin.updating.model_cache import curve_of, profile_of, with_profiles
from twin.updating.tracker import WearTrack
from twin.wear.curve import MasterCurve
from twin.wear.profile import WornProfile

CURVE = curve()
OPTIONS = UpdateOptions(threshold=0.05, update="fused", update_until=float("inf"))


def chain(changes: int) -> Memory:
    """A memory whose condition has changed often, with segments as schema version 1 kept them: depth alone."""
    segments = [Segment(speed_hz=10.0, torque=10.0, start_depth=0.0, start_work=0.0)]
    for i in range(1, changes + 1):
        speed, depth = (10.0, 14.0)[i % 2], 2e-6 + 0.01e-6 * i
        segments.append(
            Segment(
                speed_hz=speed, torque=10.0, start_depth=depth, start_work=CURVE.work_at(depth), start_revolutions=i
            )
        )
    return Memory(segments=tuple(segments))


def test_forty_changes_of_condition_need_no_deep_stack():
    """The profile at the start of each segment was computed within that of the next: 400 changes ended the program."""
    memory, limit = chain(40), sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack()) + 80)
    try:
        found = curve_of(RIG, with_profiles(RIG, memory))
    finally:
        sys.setrecursionlimit(limit)
    assert found.start_depth == pytest.approx(memory.segments[-1].start_depth, rel=1e-3)


def test_a_memory_keeps_few_segments_however_often_the_condition_changes():
    memory = with_profiles(RIG, chain(12))
    assert len(memory.segments) == KEPT_SEGMENTS
    assert all(s.start_profile is not None for s in memory.segments)
    assert with_profiles(RIG, memory) is memory


def test_a_segment_from_a_stored_profile_is_that_of_the_chain():
    """As the memory of version 1 had it: the profile of the curve before, at the depth of the change."""
    first, *_ = memory = chain(1).segments
    resolved = with_profiles(RIG, Memory(segments=memory)).segments[-1]
    before = MasterCurve.build(model(), TEN, model().unworn, 10e-6)
    expected = MasterCurve.build(
        model(), Condition(speed_hz=14.0, torque=10.0), before.profile(resolved.start_depth), 5e-6
    )
    stored = curve_of(RIG, Memory(segments=(first, resolved)))
    assert stored.work_at(5e-6) == pytest.approx(expected.work_at(5e-6), rel=1e-6)


def test_a_stored_profile_comes_back_to_the_bit():
    profile = CURVE.profile(31e-6)
    stored = StoredProfile.of(profile)
    again = from_plain(StoredProfile, json.loads(json.dumps(to_plain(stored))))
    assert again == stored and hash(again) == hash(stored)
    assert np.array_equal(again.on(model().unworn).depth, profile.depth)


def test_the_flanks_before_the_segments_that_are_kept_are_as_deep_as_they_were():
    memory = with_profiles(RIG, chain(12))
    early = profile_of(RIG, memory, 0.0, 1e-6)
    assert early.max_depth == pytest.approx(1e-6, rel=1e-6)


def test_a_pair_that_is_aligned_wears_on_from_flanks_that_wore_slice_by_slice():
    """It raised `operands could not be broadcast together with shapes (0,) (3072,)`."""
    sliced = CURVE.profile(10e-6).across(13)
    after = MasterCurve.build(model(), TEN, sliced, 12e-6)
    whole = MasterCurve.build(model(), TEN, CURVE.profile(10e-6), 12e-6)
    assert after.profile(12e-6).depth == pytest.approx(whole.profile(12e-6).depth, abs=1e-12)


def worn(revolutions: float) -> Memory:
    return replace(Memory(), track=replace(WearTrack.unworn(1e-6), revolutions=revolutions, work=1e-3, windows=3))


def taken(memory: Memory, revolutions: float) -> Memory:
    window = WindowInput(index=9, features=seen(WornProfile.unworn(model().mesh.pair), revolutions=revolutions))
    return update_window(RIG, memory, window, OPTIONS).memory


def test_a_window_that_arrives_a_little_late_is_used():
    assert taken(worn(300.0), 250.0).track.revolutions == 300.0
