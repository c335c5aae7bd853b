"""Samples that no sensor can have measured change neither depth nor life, and are counted."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path

import numpy as np
import pytest

from service.runtime.assess import assess
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import decode, encode
from twin.options import Options

ROOT = Path(__file__).resolve().parents[2]
SHORT = ROOT / "recordings" / "short-campaign.mcap"
DAMAGED = 5  # window of the campaign, from 0: calibrations are the first


def damaged(out, channel, change, window=DAMAGED, rig_text=None):
    """The short campaign with the frames of one channel changed in one window."""
    with Recording(SHORT) as source, RecordingWriter(out, rig_text=rig_text or source.rig_text) as writer:
        number, newest = -1, {}
        for message in source.messages():
            frame = decode(message.channel, message.payload)
            if message.channel.label == channel:
                if frame.start_time_ns - newest.get(channel, 0) > 10**9:
                    number += 1
                    first = True
                newest[channel] = frame.end_time_ns
                if number == window:
                    values = change(frame.values.copy(), first)
                    frame, first = dataclasses.replace(frame, values=values.astype(np.float32)), False
            writer.write(message.channel, message.log_time_ns, encode(frame))
    return out


def one(value):
    """A change of one sample of the first frame."""

    def change(values, first):
        if first:
            values[len(values) // 2] = value
        return values

    return change


def judged(recording):
    """The answer without attribution: depth and life do not rest on it here."""
    return assess(recording, options=Options(trace=False))


@pytest.fixture(scope="module")
def sound():
    return judged(SHORT)


def figures(answer):
    return [answer["wear"]["max_depth_um"]["combined"][q] for q in ("median", "p05", "p95")] + [
        answer["rul"]["revolutions"][q] for q in ("median", "p05", "p95")
    ]


@pytest.mark.slow
@pytest.mark.parametrize("value", [1e6, 300.0, 3e38])
def test_one_damaged_torque_sample_changes_neither_depth_nor_life(tmp_path, sound, value):
    answer = judged(damaged(tmp_path / "spike.mcap", "torque/pinion", one(value)))
    assert figures(answer) == pytest.approx(figures(sound), rel=2e-3)
    faults = [f for f in answer["data_quality"]["faults"] if f["window"] == DAMAGED]
    assert [(f["channel"], f["count"], f["action"]) for f in faults] == [("torque/pinion", 1, "repaired")]
    assert faults[0]["kind"] == ("out_of_range" if abs(value) > 1e7 else "spike")
    assert answer["windows"][DAMAGED]["quality"] == "repaired"


@pytest.mark.slow
@pytest.mark.parametrize("value", [1e5, 3e38])
def test_one_damaged_acceleration_sample_changes_neither_level_nor_depth(tmp_path, sound, value):
    answer = judged(damaged(tmp_path / "spike.mcap", "accel/y6", one(value)))
    assert figures(answer) == pytest.approx(figures(sound), rel=1e-2)
    level = answer["windows"][DAMAGED]["rms_measured"]
    assert level == pytest.approx(sound["windows"][DAMAGED]["rms_measured"], rel=1e-2)


@pytest.mark.slow
def test_a_torque_of_another_unit_degrades_the_window_and_does_not_update_the_twin(tmp_path, sound):
    answer = judged(damaged(tmp_path / "unit.mcap", "torque/pinion", lambda values, _: 100 * values))
    record = answer["windows"][DAMAGED]
    assert record["quality"] == "degraded" and not record["updated"]
    assert any("times the largest that the rig file states" in note for note in record["notes"])
    kinds = [(f["kind"], f["action"]) for f in record["faults"]]
    assert kinds == [("operating_range", "degraded")]
    assert figures(answer)[:4] == pytest.approx(figures(sound)[:4], rel=0.05)
    life, whole = answer["rul"]["revolutions"], sound["rul"]["revolutions"]
    assert whole["p05"] - life["p05"] < 0.5 * (whole["p95"] - whole["p05"])  # one window fewer says less of the rate
    assert whole["p95"] == pytest.approx(life["p95"], rel=0.05)


@pytest.mark.slow
def test_a_range_in_the_rig_file_finds_what_lasts_for_several_samples(tmp_path):
    with Recording(SHORT) as source:
        rig = source.rig_text.decode().replace("[sensors]", "[sensors.ranges]\naccel = 500.0\ntorque = 50.0\n[sensors]")

    def change(values, first):
        if first:
            values[10:40] = 1e4
        return values

    answer = judged(damaged(tmp_path / "range.mcap", "torque/pinion", change, rig_text=rig.encode()))
    faults = [f for f in answer["windows"][DAMAGED]["faults"]]
    assert [(f["kind"], f["count"], f["action"]) for f in faults] == [("out_of_range", 30, "repaired")]
    assert "outside [-55, 55] N·m" in faults[0]["detail"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("channel", "rest"), [("torque/pinion", np.nan), ("torque/pinion", 0.0), ("accel/y6", -3e38), ("accel/y6", np.nan)]
)
def test_absurd_values_with_nothing_else_warn_of_nothing_and_are_graded(tmp_path, channel, rest):
    def change(values, first):
        values[:] = rest
        if first:
            values[7] = 3e38
        return values

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        answer = judged(damaged(tmp_path / "absurd.mcap", channel, change))
    assert answer["windows"][DAMAGED]["quality"] == "degraded"
    assert answer["wear"]["max_depth_um"]["combined"]["p95"] < 1000
