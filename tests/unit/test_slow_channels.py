"""A slow channel gives each window one value, and changes nothing else."""

from __future__ import annotations

import json

import numpy as np
import pytest
from streams import ASSET, T0, bursts, content, unbroken

from service.contract.window import slow_channels
from service.errors import FrameError
from service.stream.assembly import AssemblySettings
from service.stream.frames import NS, SampleFrame
from service.stream.windows import Windows
from service.stream.wire.codec import decode, encode
from service.stream.wire.topics import Channel, parse_topic, topic_of

OIL = Channel(ASSET, "temperature", "oil")


def oil(start, *values, rate=1.0, sequence=0):
    """A frame of the oil temperature [°C] that starts so long after T0 [s]."""
    return SampleFrame(
        channel=OIL,
        start_time_ns=T0 + round(start * NS),
        sequence=sequence,
        sample_rate=rate,
        values=np.array(values, dtype=np.float32),
    )


def merged(frames, temperatures):
    """Frames in the order in which they end."""
    return sorted([*frames, *temperatures], key=lambda f: f.end_time_ns)


def assembled(frames, settings=None):
    assembler = Windows(settings or AssemblySettings())
    windows = [w for f in frames for w in assembler.add(f)] + assembler.flush()
    return windows, assembler


def shown(window):
    return slow_channels(window)["temperatures"]["oil"]


def test_the_key_of_a_temperature_is_that_of_the_contract():
    assert parse_topic("gearbox/rig-1/temperature/oil") == OIL and topic_of(OIL) == "gearbox/rig-1/temperature/oil"
    sent = oil(0.0, 60.5, 61.0, rate=0.2)
    assert np.array_equal(decode(OIL, encode(sent)).values, sent.values)


def test_a_window_shows_the_mean_of_its_values_in_kelvin_within_and_celsius_outside():
    windows, _ = assembled(merged(bursts(1), [oil(0.25, 60.0), oil(0.75, 62.0, sequence=1)]))
    assert windows[0].slow["temperature/oil"].value == pytest.approx(273.15 + 61.0)
    assert shown(windows[0]) == {"value": pytest.approx(61.0), "unit": "°C", "values": 2, "age_s": pytest.approx(0.75)}


def test_a_window_without_a_value_shows_the_last_known_one_with_its_age():
    windows, _ = assembled(merged(bursts(2), [oil(0.5, 60.0), oil(3.0, 64.0, sequence=1)]))
    assert shown(windows[0])["value"] == pytest.approx(60.0)
    assert shown(windows[1]) == {"value": pytest.approx(64.0), "unit": "°C", "values": 0, "age_s": pytest.approx(5.0)}


def test_temperatures_that_go_on_between_bursts_neither_join_nor_hold_up_nor_change_windows():
    frames = bursts(4)
    steady = [oil(0.1 * i, 60.0, rate=10.0, sequence=i) for i in range(260)]
    with_oil, assembler = assembled(merged(frames, steady))
    plain, _ = assembled(frames)
    assert content(with_oil) == content(plain)
    assert all(shown(w)["values"] > 0 for w in with_oil)
    assert set(assembler.counters["temperature/oil"]) == {"frames"}


def test_a_temperature_that_the_rig_file_names_and_that_never_comes_is_not_waited_for():
    chosen = AssemblySettings(settle=4, expected=("temperature/oil",))
    assembler = Windows(chosen)
    assert [w for f in bursts(3) for w in assembler.add(f)]


def test_each_value_of_an_unbroken_stream_is_used_in_one_window():
    values = np.arange(70.0)
    slow = [oil(10 * i, *values[10 * i : 10 * i + 10], rate=1.0, sequence=i) for i in range(7)]
    windows, _ = assembled(merged(unbroken(70.0), slow), AssemblySettings(length=10.0))
    assert sum(shown(w)["values"] for w in windows) == 70
    assert sum(shown(w)["value"] * shown(w)["values"] for w in windows) == pytest.approx(values.sum())


def test_frames_given_again_change_nothing_and_are_counted():
    slow = [oil(0.25, 60.0), oil(0.75, 62.0, sequence=1)]
    windows, assembler = assembled(merged(bursts(1), [*slow, *slow]))
    assert shown(windows[0])["values"] == 2
    assert assembler.counters["temperature/oil"] == {"frames": 4, "duplicate": 2}


def test_the_last_known_value_outlives_a_restart():
    assembler = Windows(AssemblySettings())
    for frame in merged(bursts(1), [oil(0.5, 60.0)]):
        assembler.add(frame)
    ((_, saved),) = assembler.finish()
    again = Windows.from_dict(json.loads(json.dumps(saved)))
    windows = [w for f in bursts(2)[24:] for w in again.add(f)] + again.flush()
    assert shown(windows[0]) == {"value": pytest.approx(60.0), "unit": "°C", "values": 0, "age_s": pytest.approx(7.5)}


def test_a_value_that_no_temperature_can_have_is_left_out_and_counted():
    windows, assembler = assembled(merged(bursts(1), [oil(0.25, 60.0, 3e38, np.nan, -400.0, rate=10.0)]))
    assert shown(windows[0])["values"] == 1 and shown(windows[0])["value"] == pytest.approx(60.0)
    assert [(f.kind, f.count, f.action) for f in windows[0].faults] == [("out_of_range", 3, "repaired")]
    assert assembler.counters["temperature/oil"]["out_of_range"] == 3


def test_one_value_may_stand_for_any_time_but_a_frame_no_longer_than_the_contract_allows():
    assert oil(0.0, 60.0, rate=1e-3).end_time_ns == T0
    with pytest.raises(FrameError, match="must cover 0 to 10 s"):
        oil(0.0, 60.0, 61.0, rate=1e-3)


@pytest.mark.slow
def test_temperatures_alone_make_no_window_and_are_bounded():
    assembler = Windows(AssemblySettings())
    for i in range(20_000):
        assert assembler.add(oil(float(i), 60.0, sequence=i)) == []
    assert not assembler.waiting and assembler.flush() == []
    assert sum(c.bytes for c in assembler._slow._channels.values()) <= 2**20
