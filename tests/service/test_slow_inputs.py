"""Slow values of a plant's topics: what becomes a frame, and what is left out and counted by its cause."""

from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path

import pytest
import service_fakes as fakes
from mqtt_broker import broker_at_work, reading, wait_until

from service.bridges import slow_inputs
from service.bridges.bridge import BridgeThread
from service.bridges.kept import KeptNumbers
from service.bridges.mqtt import MqttBridge
from service.bridges.slow_inputs import CAUSES, SlowInputs, _Message, load_inputs
from service.errors import InputError
from service.settings import Settings
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import NS
from service.stream.inbox import Inbox
from service.stream.wire.codec import decode

NOW = 1_780_000_000 * NS
OIL = {"topic": "plant/oil", "asset": "unsw", "channel": "temperature/oil"}


def written(tmp_path, *rows):
    """A file of inputs."""
    lines = ['schema = "gear-inputs/1"']
    for row in rows:
        lines += ["[[inputs]]", *(f"{key} = {json.dumps(value)}" for key, value in row.items())]
    path = tmp_path / "inputs.toml"
    path.write_text("\n".join(lines))
    return path


class Clock:
    now = NOW

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def inbox():
    return Inbox(frames=100)


@pytest.fixture
def inputs_of(tmp_path, inbox, clock):
    def made(*rows):
        kept = KeptNumbers(tmp_path / "kept.json")
        return SlowInputs(load_inputs(written(tmp_path, *rows)), inbox.offer, kept, "gearbox", clock)

    return made


def send(inputs, clock, payload, *, topic="plant/oil", after=10.0, retained=False):
    clock.now += round(after * NS)
    text = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
    inputs.take([_Message(topic, text, clock.now, retained)])


def frames(inbox):
    """The frames in an inbox."""
    found = []
    while (arrival := inbox.take(0)) is not None:
        found.append(decode(arrival.channel, arrival.payload))
    return found


def left_out(inputs):
    """The causes for which values were left out, with their counts."""
    counts = inputs.figures()["inputs_left_out"]
    assert set(counts) == set(CAUSES)
    return {cause: count for cause, count in counts.items() if count}


def test_plain_number_becomes_a_frame_of_the_slow_channel_at_the_time_of_receipt(inputs_of, inbox, clock):
    inputs = inputs_of(OIL)
    send(inputs, clock, 61.5)
    send(inputs, clock, 62)
    first, second = frames(inbox)
    assert first.channel.label == "temperature/oil" and first.channel.asset == "unsw"
    assert first.values.tolist() == [61.5] and second.values.tolist() == [62.0]
    assert (first.start_time_ns, second.start_time_ns) == (NOW + 10 * NS, NOW + 20 * NS)
    assert (first.sequence, second.sequence) == (0, 1)
    assert left_out(inputs) == {} and inputs.figures()["inputs_values"] == 2


@pytest.mark.parametrize(
    ("row", "payload", "value"),
    [
        ({"unit": "degF"}, 212.0, 100.0),
        ({"unit": "K"}, 300.0, 26.85),
        ({"channel": "load/motor", "unit": "fraction"}, 0.75, 75.0),
        ({"factor": 0.1, "offset": -40.0}, 1000, 60.0),
        ({"factor": 0.1, "unit": "K"}, 3000, 26.85),
        ({"value": "sensors.1.oil"}, {"sensors": [{}, {"oil": 55.5}]}, 55.5),
    ],
)
def test_value_is_found_and_converted_as_the_file_says(inputs_of, inbox, clock, row, payload, value):
    inputs = inputs_of({**OIL, **row})
    send(inputs, clock, payload)
    assert frames(inbox)[0].values[0] == pytest.approx(value, abs=1e-4)


@pytest.mark.parametrize(
    ("form", "time"),
    [
        ("iso", "2026-05-28T20:26:40Z"),
        ("iso", "2026-05-28T22:26:40+02:00"),
        ("s", 1_780_000_000),
        ("s", 1_780_000_000.0),
        ("ms", 1_780_000_000_000),
        ("us", 1_780_000_000_000_000),
        ("ns", 1_780_000_000_000_000_000),
    ],
)
def test_time_of_the_payload_is_the_values_time(inputs_of, inbox, clock, form, time):
    inputs = inputs_of({**OIL, "value": "v", "time": "t", "time_format": form})
    send(inputs, clock, {"v": 60.0, "t": time}, retained=True)  # its age is known
    assert frames(inbox)[0].start_time_ns == NOW


@pytest.mark.parametrize(
    ("payload", "cause"),
    [
        (b"", "malformed"),
        (b"warm", "malformed"),
        (b"\xff\xfe", "malformed"),
        (b"NaN", "malformed"),
        (b"1e999", "malformed"),
        (b"1" * 400, "malformed"),
        (b"true", "malformed"),
        (b"[" * 60_000, "malformed"),
        (b" " * 70_000 + b"1", "malformed"),
        (b'{"v": 1}', "malformed"),
        (b"5000", "out_of_range"),
        (b"-300", "out_of_range"),
    ],
)
def test_value_that_cannot_be_used_is_left_out_and_counted(inputs_of, inbox, clock, payload, cause):
    inputs = inputs_of(OIL)
    send(inputs, clock, payload)
    assert frames(inbox) == [] and left_out(inputs) == {cause: 1}
    send(inputs, clock, 60.0)
    assert len(frames(inbox)) == 1


@pytest.mark.parametrize("time", ["yesterday", "2026-05-28T20:26:40", 5, None, "", {"a": 1}])
def test_time_that_cannot_be_used_is_left_out_and_counted(inputs_of, inbox, clock, time):
    inputs = inputs_of({**OIL, "value": "v", "time": "t"})
    send(inputs, clock, {"v": 60.0, "t": time})
    assert frames(inbox) == [] and left_out(inputs) == {"malformed": 1}


def test_values_that_come_too_often_twice_or_of_unknown_age_are_left_out(inputs_of, inbox, clock):
    inputs = inputs_of(
        {**OIL, "interval": 5.0},
        {
            "topic": "timed",
            **{**OIL, "topic": "timed", "channel": "temperature/air"},
            "value": "v",
            "time": "t",
            "time_format": "ns",
        },
    )
    send(inputs, clock, 60.0, retained=True)
    send(inputs, clock, 60.0)
    send(inputs, clock, 61.0, after=1.0)
    at = clock.now
    send(inputs, clock, {"v": 20.0, "t": at}, topic="timed")
    send(inputs, clock, {"v": 20.0, "t": at}, topic="timed")
    send(inputs, clock, {"v": 20.0, "t": clock.now + 3600 * NS}, topic="timed")
    assert len(frames(inbox)) == 2
    assert left_out(inputs) == {"retained": 1, "too_soon": 1, "not_newer": 1, "ahead": 1}


def test_clock_of_this_machine_that_was_ahead_blinds_no_channel(inputs_of, inbox, clock):
    inputs = inputs_of(OIL)
    clock.now += 3650 * 86_400 * NS
    send(inputs, clock, 60.0)
    clock.now = NOW
    send(inputs, clock, 61.0)
    assert [f.values[0] for f in frames(inbox)] == [60.0, 61.0]


def test_sequence_numbers_go_on_after_a_restart_and_a_value_kept_by_the_broker_is_used_once(inputs_of, inbox, clock):
    row = {**OIL, "value": "v", "time": "t", "time_format": "ns"}
    for index in range(3):
        inputs = inputs_of(row)
        if index:
            send(inputs, clock, {"v": 60.0, "t": clock.now}, retained=True)  # it was used before the restart
        send(inputs, clock, {"v": 60.0, "t": clock.now + 10 * NS})
    assert [f.sequence for f in frames(inbox)] == [0, 1, 2]


def test_two_inputs_of_one_topic_and_the_prefix_of_the_keys(tmp_path, clock):
    inbox = Inbox(prefix="plant/gears")
    rows = [{**OIL, "value": "oil"}, {**OIL, "channel": "temperature/housing", "value": "housing"}]
    inputs = SlowInputs(
        load_inputs(written(tmp_path, *rows)), inbox.offer, KeptNumbers(tmp_path / "k.json"), "plant/gears", clock
    )
    assert inputs.topics == ("plant/oil",)
    send(inputs, clock, {"oil": 60.0, "housing": 50.0})
    send(inputs, clock, {"oil": 60.0})
    assert [f.channel.name for f in frames(inbox)] == ["oil", "housing", "oil"]
    assert left_out(inputs) == {"malformed": 1} and inbox.refused_frames == 0


def test_messages_wait_in_a_bounded_queue_that_never_waits_for_the_inbox(inputs_of):
    inputs = inputs_of(OIL)
    for _ in range(slow_inputs.MOST_WAITING + 50):
        inputs.receive("plant/oil", b"60", retained=False)
    assert left_out(inputs) == {"too_many": 50}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"channel": "accel/y6"}, "must be a slow channel: temperature/{place}"),
        ({"channel": "temperature/a b"}, "must be a slow channel"),
        ({"asset": "a/b"}, "asset = 'a/b' must be"),
        ({"topic": "plant/+/oil"}, "without \\+ and #"),
        ({"topic": 3}, "topic = 3 must be text"),
        ({"unit": "V"}, "unit = 'V' must be one of degC, K, degF"),
        ({"time_format": "unix"}, "time_format = 'unix' must be one of iso, s, ms, us, ns"),
        ({"interval": 0}, "interval = 0 s is outside"),
        ({"value": "a..b"}, "has an empty part"),
        ({"factor": "two"}, "factor = 'two' must be a number"),
        ({"colour": "red"}, "colour is not known"),
    ],
)
def test_file_with_a_mistake_is_refused_with_its_place(tmp_path, change, said):
    with pytest.raises(InputError, match=rf"inputs.toml: inputs\[0\]: .*{said}"):
        load_inputs(written(tmp_path, {**OIL, **change}))


def test_file_without_inputs_or_with_one_channel_twice_is_refused(tmp_path):
    with pytest.raises(InputError, match="one or more tables"):
        load_inputs(written(tmp_path))
    with pytest.raises(InputError, match="gearbox/unsw/temperature/oil is given by two inputs"):
        load_inputs(written(tmp_path, OIL, {**OIL, "topic": "other"}))


def test_every_slow_kind_can_be_an_input(tmp_path):
    for kind in CHANNEL_KINDS.values():
        if kind.slow:
            assert load_inputs(written(tmp_path, {**OIL, "channel": f"{kind.segment}/a"}))


@contextmanager
def connected(broker, tmp_path, store, board, inputs):
    settings = Settings(mqtt=broker.url, data=tmp_path)
    thread = BridgeThread(
        MqttBridge(settings, board, store, KeptNumbers(tmp_path / "k.json"), inputs), first_pause=0.05
    )
    inputs.start()
    thread.start()
    try:
        yield thread
    finally:
        thread.end()
        inputs.end()
        assert not inputs.is_alive()


@pytest.mark.slow
def test_values_of_a_broker_reach_the_inbox_also_after_the_broker_was_away(
    tmp_path, store, board, inputs_of, inbox, clock
):
    fakes.campaign(store, board, windows=3)
    inputs = inputs_of(OIL)
    with broker_at_work() as broker, connected(broker, tmp_path, store, board, inputs) as bridge:
        wait_until(lambda: bridge.figures()["mqtt_connected"])
        for degrees in (60.0, 70.0):
            with reading(broker.port) as sender:
                clock.now += 10 * NS

                def received(degrees=degrees, sender=sender):
                    sender.publish("plant/oil", degrees)
                    clock.now += 10 * NS
                    return degrees in {f.values[0] for f in frames(inbox)}

                wait_until(received)
            if degrees == 60.0:
                broker.stop()
                wait_until(lambda: not bridge.figures()["mqtt_connected"])
                broker.start()
                wait_until(lambda: bridge.figures()["mqtt_connected"])
        assert bridge.figures()["mqtt_inputs_values"] >= 2


def test_example_of_the_documentation_can_be_used():
    found = load_inputs(Path(__file__).parents[2] / "docs" / "examples" / "inputs.toml")
    assert [each.channel.label for each in found] == ["temperature/oil", "temperature/housing"]
