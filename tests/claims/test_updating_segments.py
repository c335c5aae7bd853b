"""Operating conditions that change often: the profile at the start of a segment is all that the past leaves behind."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.dynamics_cases import RIG
from tests.updating_cases import TEN, curve, model, seen
from twin.model import Condition
from twin.serial import from_plain, to_plain
from twin.updating.history import UpdateOptions, WindowInput, update_window
from twin.updating.memory import KEPT_SEGMENTS, Memory, Segment, StoredProfile
from twin.updating.model_cache import curve_of, profile_of
from twin.updating.segments import with_segment
from twin.updating.tracker import WearTrack
from twin.wear.curve import MasterCurve
from twin.wear.profile import WornProfile

CURVE = curve()
OPTIONS = UpdateOptions(threshold=0.05, update="fused", update_until=float("inf"))


def changed(times: int) -> Memory:
    """The memory of a pair that wears while its condition changes at every window."""
    memory = Memory(segments=(Segment(speed_hz=10.0, torque=10.0, start_depth=0.0, start_work=0.0),))
    for i in range(1, times + 1):
        track = replace(WearTrack.unworn(1e-6), windows=i, revolutions=float(i), work=CURVE.work_at(2e-6 + 0.01e-6 * i))
        condition = Condition(speed_hz=(10.0, 14.0)[i % 2], torque=10.0)
        memory = with_segment(RIG, replace(memory, track=track), condition, float(i))
    return memory


def test_a_memory_keeps_few_segments_however_often_the_condition_changes():
    memory = changed(12)
    assert len(memory.segments) == KEPT_SEGMENTS
    assert all(s.start_profile is not None for s in memory.segments)


def test_a_segment_begins_with_the_profile_of_the_one_before():
    first, then = changed(1).segments
    before = MasterCurve.build(model(), TEN, model().unworn, 10e-6)
    expected = MasterCurve.build(model(), Condition(speed_hz=14.0, torque=10.0), before.profile(then.start_depth), 5e-6)
    stored = curve_of(RIG, Memory(segments=(first, then)))
    assert stored.work_at(5e-6) == pytest.approx(expected.work_at(5e-6), rel=1e-6)


def test_a_stored_profile_comes_back_to_the_bit():
    profile = CURVE.profile(31e-6)
    stored = StoredProfile.of(profile)
    again = from_plain(StoredProfile, json.loads(json.dumps(to_plain(stored))))
    assert again == stored and hash(again) == hash(stored)
    assert np.array_equal(again.on(model().unworn).depth, profile.depth)


def test_the_flanks_before_the_segments_that_are_kept_are_as_deep_as_they_were():
    memory = changed(12)
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
