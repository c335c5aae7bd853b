"""Windows are a function of the set of frames, and every fault of the data is seen and counted."""

from __future__ import annotations

import dataclasses
import json
import random
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import ACCEL, CHANNELS, GEAR, LENGTH, PINION, T0, TORQUE, bursts, content, frame, signal, unbroken

from service.stream.assembly import DEFAULT, AssemblySettings
from service.stream.edge_counts import EncoderCounts
from service.stream.frames import NS
from service.stream.windows import Windows
from twin.features.end_of_range import samples_at_end_of_range as held


def assembled(frames, chosen=DEFAULT):
    """The windows of frames in a given order, and the assembler."""
    assembler = Windows(chosen)
    windows = [window for each in frames for window in assembler.add(each)]
    return windows + assembler.flush(), assembler


def changed(frames, channel, number, **changes):
    """Frames with one frame of a channel replaced."""
    target = [f for f in frames if f.channel == channel][number]
    return [dataclasses.replace(f, **changes) if f is target else f for f in frames]


def without(frames, channel, *numbers):
    """Frames with some frames of a channel lost."""
    targets = {id([f for f in frames if f.channel == channel][n]) for n in numbers}
    return [f for f in frames if id(f) not in targets]


def faults(windows):
    return [(i, f.kind, f.channel, f.count, f.action) for i, w in enumerate(windows) for f in w.faults]


def test_each_burst_is_one_window_with_every_sample_and_edge_in_its_place():
    windows, _ = assembled(bursts(3))
    assert [w.start_time_ns for w in windows] == [T0 + round(i * 6.5 * NS) for i in range(3)]
    assert [w.quality for w in windows] == ["good"] * 3
    for i, window in enumerate(windows):
        accel = window.accelerations["y6"]
        assert (accel.rate, accel.start, accel.values.size) == (1000.0, 0.0, 1500)
        assert np.array_equal(accel.values, signal(ACCEL, 6.5 * i + accel.times).astype(float))
        edges = window.encoders["pinion"]
        expected = (edges.first_index - 1000 + np.arange(edges.times.size)) / 640.0 - 6.5 * i
        assert edges.times == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), horizon=st.sampled_from([2, 8, 30, 10**6]), copies=st.integers(1, 3))
def test_any_order_and_any_number_of_copies_give_the_same_windows(seed, horizon, copies):
    frames = bursts(4)
    rng = random.Random(seed)
    order = sorted(list(range(len(frames))) * copies, key=lambda i: i + rng.uniform(0, horizon))
    windows, assembler = assembled([frames[i] for i in order])
    assert content(windows) == content(assembled(frames)[0])
    duplicates = sum(kinds.get("duplicate", 0) for kinds in assembler.counters.values())
    assert duplicates == (copies - 1) * len(frames)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), drop=st.integers(1, 22))
def test_lost_frames_become_the_same_gaps_in_any_order(seed, drop):
    frames = without(bursts(4), TORQUE, drop)
    rng = random.Random(seed)
    mixed = sorted(frames, key=lambda f: f.start_time_ns + rng.uniform(0, 20e9))
    windows, assembler = assembled(mixed)
    assert content(windows) == content(assembled(frames)[0])
    assert assembler.counters["torque/pinion"]["lost"] == 1


def test_a_window_closes_as_soon_as_all_keys_go_on_beyond_it():
    frames = bursts(6)
    assembler = Windows(AssemblySettings(settle=4))
    closed_at = [i for i, each in enumerate(frames) for _ in assembler.add(each)]
    assert closed_at == [4 * 6 * n + 3 for n in range(1, 6)]  # at the first frame of the last key of the next burst


def test_an_unbroken_stream_is_cut_on_the_clock_whatever_the_delivery():
    frames = unbroken(7.0)
    chosen = AssemblySettings(length=1.1)
    windows, _ = assembled(frames, chosen)
    assert all(w.start_time_ns % round(1.1 * NS) == 0 for w in windows[1:])
    assert all(1.1 <= w.duration <= 2.2 + 1e-9 for w in (windows[0], windows[-1]))
    whole = np.concatenate([w.accelerations["y6"].values for w in windows])
    assert np.array_equal(whole, signal(ACCEL, np.arange(7000) / 1000.0).astype(float))
    indices = [(w.encoders["gear"].first_index, w.encoders["gear"].times.size) for w in windows]
    assert all(a + n == b for (a, n), (b, _) in pairwise(indices))
    mixed = sorted(frames, key=lambda f: f.start_time_ns + random.Random(f.sequence).uniform(0, 3e9))
    assert content(assembled(mixed, chosen)[0]) == content(windows)


def test_a_burst_shorter_than_two_lengths_is_never_cut():
    windows, _ = assembled(unbroken(3.75), AssemblySettings(length=2.0))
    assert len(windows) == 1


def test_a_lost_frame_is_nan_and_the_window_repaired():
    windows, assembler = assembled(without(bursts(2), ACCEL, 3))
    values = windows[0].accelerations["y6"].values
    assert np.flatnonzero(np.isnan(values)).tolist() == list(range(750, 1000))
    assert faults(windows) == [(0, "gap", "accel/y6", 1, "repaired")]
    assert windows[0].quality == "repaired"
    assert assembler.counters["accel/y6"]["lost"] == 1


def test_many_lost_frames_degrade_the_window():
    windows, _ = assembled(without(bursts(2), ACCEL, 2, 3, 4))
    assert windows[0].quality == "degraded"


def test_lost_edges_are_nan_and_the_count_goes_on():
    windows, _ = assembled(without(bursts(1), PINION, 2))
    edges = windows[0].encoders["pinion"]
    assert int(np.isnan(edges.times).sum()) == 160
    known = ~np.isnan(edges.times)
    index = edges.first_index - 1000 + np.arange(edges.times.size)
    assert edges.times[known] == pytest.approx(index[known] / 640.0, abs=1e-9)


def test_a_signalling_nan_is_one_like_any_other():
    values = frame(ACCEL, 2, 0.5).values.copy()
    values.view(np.uint32)[10] = 0x7F800001
    windows, _ = assembled(changed(bursts(1), ACCEL, 2, values=values))
    assert faults(windows) == [(0, "nan", "accel/y6", 1, "repaired")]


def test_samples_that_are_not_finite_are_counted():
    values = frame(ACCEL, 2, 0.5).values.copy()
    values[10:13] = [np.nan, np.inf, -np.inf]
    windows, assembler = assembled(changed(bursts(1), ACCEL, 2, values=values))
    assert faults(windows) == [(0, "nan", "accel/y6", 3, "repaired")]
    assert np.isnan(windows[0].accelerations["y6"].values[510:513]).all()
    assert assembler.counters["accel/y6"]["nan"] == 3


def test_clipped_peaks_degrade_the_window():
    frames = bursts(1)
    for i in range(6):
        values = np.clip([f for f in frames if f.channel == ACCEL][i].values, -4.0, 4.0)
        frames = changed(frames, ACCEL, i, values=values.astype(np.float32))
    windows, _ = assembled(frames)
    assert [(f.kind, f.action) for f in windows[0].faults] == [("clipping", "degraded")]


def test_a_dead_sensor_is_called_stuck():
    frames = bursts(1)
    for i in range(6):
        frames = changed(frames, ACCEL, i, values=np.zeros(250, np.float32))
    assert [f.kind for f in assembled(frames)[0][0].faults] == ["stuck"]


def test_a_change_of_rate_within_a_channel_is_seen():
    frames = changed(bursts(1), ACCEL, 3, sample_rate=2000.0)
    windows, _ = assembled(frames)
    assert next((f.kind, f.count, f.action) for f in windows[0].faults) == ("rate_change", 1, "degraded")
    assert int(np.isnan(windows[0].accelerations["y6"].values).sum()) == 250


@pytest.mark.parametrize("how", ["offsets fall", "count falls"])
def test_an_encoder_that_runs_backwards_is_not_used(how):
    frames = bursts(1)
    sixth = [f for f in frames if f.channel == GEAR][3]
    if how == "offsets fall":
        changes = {"edge_offsets_ns": sixth.edge_offsets_ns[::-1].copy()}
    else:
        changes = {"first_edge_index": sixth.first_edge_index - 300}
    windows, assembler = assembled(changed(frames, GEAR, 3, **changes))
    assert set(windows[0].encoders) == {"pinion"}
    assert [(f.kind, f.channel, f.action) for f in windows[0].faults] == [("reversed", "encoder/gear", "degraded")]
    assert assembler.counters["encoder/gear"]["reversed"] >= 1


def test_an_edge_count_that_falls_between_windows_is_seen_once():
    frames = [
        dataclasses.replace(f, first_edge_index=f.first_edge_index - 3500)
        if f.channel == PINION and f.start_time_ns > T0 + 6 * NS
        else f
        for f in bursts(3)
    ]
    windows, assembler = assembled(frames)
    assert faults(windows) == [(1, "counter_reset", "encoder/pinion", 1, "none")]
    assert assembler.counters["encoder/pinion"]["counter_reset"] == 1


def test_an_edge_out_of_order_by_noise_is_left_out():
    offsets = [f for f in bursts(1) if f.channel == PINION][2].edge_offsets_ns.copy()
    offsets[7] = offsets[6]
    windows, _ = assembled(changed(bursts(1), PINION, 2, edge_offsets_ns=offsets))
    assert faults(windows) == [(0, "edge_order", "encoder/pinion", 1, "repaired")]


def test_overlapping_frames_are_seen_and_no_sample_is_used_twice():
    start = T0 + round(0.7 * NS)
    windows, _ = assembled(changed(bursts(1), ACCEL, 3, start_time_ns=start))
    kinds = {f.kind: f.count for f in windows[0].faults}
    assert kinds["overlap"] == 50
    assert windows[0].accelerations["y6"].values.size == 1500


def test_a_channel_that_was_there_before_is_missed():
    frames = [f for f in bursts(3) if not (f.channel == GEAR and f.start_time_ns > T0 + 6 * NS)]
    windows, _ = assembled(frames)
    assert faults(windows) == [(i, "missing_channel", "encoder/gear", 1, "degraded") for i in (1, 2)]


def test_a_frame_after_its_window_is_late_and_dropped():
    frames = bursts(4)
    target = [f for f in frames if f.channel == TORQUE][2]
    assembler = Windows(AssemblySettings(settle=2, patience=4))
    windows = [w for f in frames if f is not target for w in assembler.add(f)]
    assert assembler.add(target) == []
    windows += assembler.flush()
    assert assembler.counters["torque/pinion"]["late"] == 1
    assert faults(windows) == [(0, "gap", "torque/pinion", 1, "repaired")]


def test_a_publisher_that_starts_again_goes_on():
    frames = bursts(4)
    again = [
        dataclasses.replace(f, sequence=f.sequence - FIRST_OF_THIRD[f.channel])
        if f.start_time_ns >= T0 + 13 * NS
        else f
        for f in frames
    ]
    windows, assembler = assembled(again)
    assert content(windows) == content(assembled(frames)[0])
    assert not any("lost" in kinds for kinds in assembler.counters.values())


FIRST_OF_THIRD = {f.channel: f.sequence for f in bursts(3)[-24:-20]}


def test_a_clock_that_jumps_years_ahead_costs_one_frame():
    frames = bursts(4)
    wild = changed(frames, ACCEL, 3, start_time_ns=T0 + 10**18)
    windows, assembler = assembled(wild, AssemblySettings(settle=2))
    assert len(windows) == 4
    assert assembler.counters["accel/y6"]["time_jump"] == 1


def test_a_machine_that_is_taken_up_again_after_years_goes_on():
    later = [dataclasses.replace(f, start_time_ns=f.start_time_ns + 10**17) for f in bursts(2)]
    windows, assembler = assembled(bursts(2) + later)
    assert [w.start_time_ns for w in windows[2:]] == [T0 + 10**17, T0 + 10**17 + round(6.5 * NS)]
    reset = [(2, "counter_reset", f"encoder/{shaft}", 1, "none") for shaft in ("gear", "pinion")]
    assert faults(windows) == reset  # its encoders, unlike the clock, began again
    assert "time_jump" not in assembler.counters["accel/y6"]


@pytest.mark.parametrize("stop", range(0, 96, 7))
def test_a_restart_at_any_frame_counts_nothing_twice_and_loses_nothing(stop):
    frames = bursts(4)
    chosen = AssemblySettings(settle=3)
    before, windows, saved = Windows(chosen), [], None
    for each in frames[:stop]:
        if made := before.add(each):
            windows += made
            saved, encoders = json.loads(json.dumps(before.to_dict())), before.encoders
    after = Windows(chosen)
    if saved:
        after = Windows.from_dict(saved, chosen)
        after.encoders = EncoderCounts.from_dict(json.loads(json.dumps(encoders.to_dict())))
    windows += [w for each in frames for w in after.add(each)] + after.flush()
    assert content(windows) == content(assembled(frames)[0])


def test_a_restart_in_an_unbroken_stream_goes_on_within_a_cut_frame():
    frames, chosen = unbroken(8.0), AssemblySettings(length=1.1, settle=3)
    before, windows, saved = Windows(chosen), [], None
    for each in frames[:70]:
        if made := before.add(each):
            windows += made
            saved, encoders = before.to_dict(), before.encoders
    assert windows
    after = Windows.from_dict(saved, chosen)
    after.encoders = encoders
    windows += [w for each in frames[20:] for w in after.add(each)] + after.flush()
    assert content(windows) == content(assembled(frames, chosen)[0])


def test_a_silent_key_is_waited_for_only_so_long():
    chosen = AssemblySettings(expected=("encoder/gear",), patience=4, settle=2)
    assembler = Windows(chosen)
    frames = bursts(6, channels=(ACCEL, TORQUE, PINION))
    first = next(i for i, each in enumerate(frames) if assembler.add(each))
    assert first == (4 * 4 - 1) * 3  # four times the patience of one key's frames
    waiting = Windows(chosen)
    for each in frames[:30]:
        assert waiting.add(each) == []
    waiting.wait_only_for(["accel/y6", "torque/pinion", "encoder/pinion"])
    assert len(waiting.add(frames[30])) == 1


def test_frames_that_wait_are_bounded_in_bytes():
    frames = without(unbroken(200.0), ACCEL, 5)
    assembler = Windows(AssemblySettings(max_bytes=500_000, patience=10**6, settle=10**6))
    most = 0
    for each in frames:
        assembler.add(each)
        most = max(most, sum(lane.pending_bytes for lane in assembler._lanes.values()))
    assert most <= 500_000 + max(f.nbytes for f in frames)
    assert assembler.counters["accel/y6"]["lost"] == 1


def test_channels_may_come_in_frames_of_different_length():
    frames = [f for f in bursts(2) if f.channel != TORQUE]
    for i in range(2):
        start = i * 6.5
        values = signal(TORQUE, start + np.arange(300) / 200.0)
        long = dataclasses.replace(frame(TORQUE, i, start), values=values)
        frames.append(long)
    windows, _ = assembled(frames)
    assert [w.quality for w in windows] == ["good", "good"]
    assert [w.torques["pinion"].duration for w in windows] == [1.5, 1.5]


def test_a_window_needs_an_accelerometer_or_an_encoder():
    windows, _ = assembled(bursts(1, channels=(TORQUE,)))
    assert windows[0].quality == "refused"


def test_every_channel_of_the_test_stream_fills_its_frames():
    assert {f.channel for f in bursts(1)} == set(CHANNELS)
    assert all(f.end_time_ns - f.start_time_ns == round(LENGTH * NS) for f in bursts(1) if f.channel.kind != "encoder")


def test_a_fast_vibration_beyond_the_range_is_clipped_though_no_two_samples_in_a_row_are_held():
    vibration = 30 * np.random.default_rng(4).standard_normal(5000)
    assert held(vibration) == held(np.round(vibration)) == 0  # coarse steps are no clipping
    assert held(np.clip(vibration, -np.inf, 60)) == np.sum(vibration >= 60) > 50
    assert held(np.clip(vibration, -60, 60)) == np.sum(np.abs(vibration) >= 60)


@pytest.mark.parametrize("steps", [8, 20, 50])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_slow_vibration_in_coarse_steps_is_not_clipped_though_it_stays_at_its_last_step(steps, noise):
    """A dozen samples in a row lie at either extreme of a tone of 7.3 Hz."""
    time, random = np.arange(20_000) / 5000, np.random.default_rng(4)
    tone = steps * np.sin(2 * np.pi * 7.3 * time) + noise * random.standard_normal(time.size)
    assert held(np.round(tone)) == 0
    assert held(np.clip(np.round(tone), -np.inf, 0.7 * steps)) > 1000


def test_a_short_blow_beyond_the_range_is_clipped():
    vibration = np.random.default_rng(4).standard_normal(5000)
    vibration[2000:2005] += 40
    assert held(np.clip(vibration, -30, 30)) == 5


def test_a_torque_beyond_the_range_is_clipped_and_one_that_holds_its_level_is_not():
    from service.stream.samples import samples_of_load_at_limit as held

    random = np.random.default_rng(4)
    time = np.arange(5000) / 1000
    torque = 10 + np.sin(2 * np.pi * 19 * time) + 0.3 * random.standard_normal(time.size)
    for sign in (1, -1):
        assert held(sign * torque) == 0
        assert held(sign * np.minimum(torque, 10.8)) == np.sum(torque >= 10.8) > 500
    assert held(np.round(torque, 1)) == held(np.round(torque)) == 0  # coarse steps
    assert held(np.minimum(torque.round(2), 10.8)) > 500
    ramp = np.minimum(5 * time, 10.0)
    assert held(ramp) == held(np.full(5000, 10.0)) == held(np.where(time < 1, 0.0, torque)) == 0


def test_clipped_torque_degrades_the_window():
    frames = bursts(1)
    torque = 10 + np.random.default_rng(4).standard_normal(6 * 50)
    for i, values in enumerate(np.minimum(torque, 10.5).reshape(6, -1)):
        frames = changed(frames, TORQUE, i, values=values.astype(np.float32))
    windows, _ = assembled(frames)
    assert [(f.kind, f.channel, f.action) for f in windows[0].faults] == [("clipping", "torque/pinion", "degraded")]
    assert "held at 10.5: measuring range exceeded" in windows[0].faults[0].detail


def standing(frames, channels, until, since):
    """Frames of encoders that stand still before and after some seconds since T0."""
    out = []
    for f in frames:
        start = (f.start_time_ns - T0) / NS
        if f.channel in channels and not until <= start < since:
            f = dataclasses.replace(f, edge_offsets_ns=np.empty(0))
        out.append(f)
    return out


def test_a_run_up_and_a_stop_are_one_window_of_two_encoders_alone():
    frames = standing(unbroken(6, channels=(PINION, GEAR)), (PINION, GEAR), 1.0, 4.5)
    (window,), assembler = assembled(frames)
    assert window.quality == "good" and window.accelerations == {} and window.faults == ()
    assert window.start_time_ns == T0
    for shaft in ("pinion", "gear"):
        times = window.encoders[shaft].times
        assert np.isfinite(times).all() and times[0] == pytest.approx(1.0, abs=0.01)
        assert times[-1] == pytest.approx(4.5, abs=0.01)
    assert all(set(kinds) == {"frames"} for kinds in assembler.counters.values())


def test_a_shaft_that_stands_still_is_noted_and_a_machine_that_does_is_said_to():
    frames = unbroken(8, channels=(PINION, GEAR))
    (one,), _ = assembled(standing(frames, (GEAR,), 9.0, 9.0))
    assert set(one.encoders) == {"pinion"} and one.quality == "good"
    assert faults([one]) == [(0, "standstill", "encoder/gear", 1, "none")]
    (none,), _ = assembled(standing(frames, (PINION, GEAR), 9.0, 9.0))
    assert none.quality == "refused" and none.faults[-1].detail == "no edge passed: the machine stands still"


def test_a_standstill_over_a_cut_of_the_stream_is_neither_late_nor_a_gap():
    frames = standing(unbroken(30, channels=(PINION, GEAR)), (PINION, GEAR), 0.0, 8.0)
    windows, assembler = assembled(frames)
    assert [w.quality for w in windows] == ["good", "refused"]
    for label in ("encoder/pinion", "encoder/gear"):
        assert set(assembler.counters[label]) == {"frames", "standstill"}
