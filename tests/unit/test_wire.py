"""The wire format: what goes in comes out, and what breaks the contract is named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from streams import ACCEL, ASSET, CHANNELS, frame

from service.errors import FrameError
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import EncoderFrame, SampleFrame, in_channel
from service.stream.wire import codec
from service.stream.wire import gearbox_pb2 as pb
from service.stream.wire.codec import decode, encode, encoding_of, head_of, quick_head_of, schema_data, schema_fault
from service.stream.wire.topics import Channel, parse_topic, topic_of

VALUES = {
    kind: [field.name for field in dataclasses.fields(kind) if field.name != "payload"]
    for kind in (SampleFrame, EncoderFrame)
}


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda c: c.label)
def test_a_frame_survives_encoding_to_the_last_bit(channel):
    sent = frame(channel, 3, 0.75)
    payload = encode(sent)
    assert payload == _parsed(channel, payload).SerializeToString()  # as protobuf writes it
    received = decode(channel, payload)
    for name in VALUES[type(sent)]:
        before, after = getattr(sent, name), getattr(received, name)
        assert np.array_equal(before, after), name
    assert encode(received) is payload  # as it came, without a copy
    assert encode(in_channel(received, channel._replace(asset="press-7"))) is payload  # under another name, too
    assert encode(dataclasses.replace(received, sequence=4)) == encode(dataclasses.replace(sent, sequence=4)) != payload


def test_field_numbers_and_types_are_those_of_the_contract():
    fields = {
        (message.name, field.name): (field.number, field.type)
        for message in pb.DESCRIPTOR.message_types_by_name.values()
        for field in message.fields
    }
    double, float_, uint64, uint32, fixed64 = 1, 2, 4, 13, 6
    assert fields == {
        ("SampleFrame", "start_time_ns"): (1, fixed64),
        ("SampleFrame", "sample_rate_hz"): (2, double),
        ("SampleFrame", "sequence"): (3, uint64),
        ("SampleFrame", "values"): (4, float_),
        ("EncoderFrame", "start_time_ns"): (1, fixed64),
        ("EncoderFrame", "edges_per_rev"): (2, uint32),
        ("EncoderFrame", "sequence"): (3, uint64),
        ("EncoderFrame", "first_edge_index"): (4, uint64),
        ("EncoderFrame", "edge_offset_ns"): (5, double),
    }


def test_topics_round_trip_with_any_prefix():
    for channel in CHANNELS:
        for prefix in ("gearbox", "plant/hall-3"):
            assert parse_topic(topic_of(channel, prefix), prefix) == channel


@pytest.mark.parametrize(
    "topic", ["gearbox/a/twin/state", "other/a/accel/y6", "gearbox/a/accel", "gearbox/a/b/accel/y6"]
)
def test_other_topics_are_not_measurements(topic):
    assert parse_topic(topic) is None


@pytest.mark.parametrize(
    ("topic", "named"),
    [
        ("gearbox/a/torque/motor", "shaft = 'motor'"),
        ("gearbox/a b/accel/y6", "asset = 'a b'"),
        (f"gearbox/a/accel/{'x' * 65}", "sensor"),
        ("gearbox//accel/y6", "asset = ''"),
    ],
)
def test_a_topic_that_breaks_the_contract_is_named(topic, named):
    with pytest.raises(FrameError, match=named):
        parse_topic(topic)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"start_time_ns": 0}, "start_time_ns = 0"),
        ({"sample_rate_hz": 0.0}, "sample_rate_hz = 0"),
        ({"sample_rate_hz": float("nan")}, "sample_rate_hz = nan"),
        ({"values": []}, "values = nothing"),
        ({"values": [1.0]}, "must cover 0.01 to 10 s"),
        ({"sample_rate_hz": 1.0}, "= 250 s must cover"),
    ],
)
def test_a_sample_frame_outside_the_limits_is_refused_with_topic_field_and_value(changes, named):
    given = {"start_time_ns": 10**18, "sample_rate_hz": 1000.0, "sequence": 1, "values": [0.0] * 250}
    with pytest.raises(FrameError, match=f"gearbox/{ASSET}/accel/y6: .*{named}"):
        decode(ACCEL, pb.SampleFrame(**{**given, **changes}).SerializeToString())


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"edges_per_rev": 0}, "edges_per_rev = 0"),
        ({"edge_offset_ns": [-1.0]}, "edge_offset_ns = -1 ns"),
        ({"edge_offset_ns": [1.0, float("nan")]}, "edge_offset_ns = nan"),
        ({"edge_offset_ns": [1e18]}, "seconds or Unix time"),
    ],
)
def test_an_encoder_frame_outside_the_limits_is_refused(changes, named):
    given = {"start_time_ns": 10**18, "edges_per_rev": 64, "sequence": 1, "edge_offset_ns": [1.0, 2.0]}
    with pytest.raises(FrameError, match=named):
        decode(Channel(ASSET, "encoder", "pinion"), pb.EncoderFrame(**{**given, **changes}).SerializeToString())


def test_an_encoder_frame_may_hold_no_edge():
    message = pb.EncoderFrame(start_time_ns=10**18, edges_per_rev=1, sequence=1)
    assert decode(Channel(ASSET, "encoder", "gear"), message.SerializeToString()).edge_offsets_ns.size == 0


def test_bytes_that_are_no_message_are_refused():
    with pytest.raises(FrameError, match="payload of 3 bytes is no gearbox"):
        decode(ACCEL, b"\xff\xff\xff")


@pytest.mark.parametrize("sequence", [0, 1, 127, 128, 300, 2**35, 2**64 - 1])
@pytest.mark.parametrize("channel", CHANNELS)
def test_the_head_of_a_frame_is_read_without_decoding_it(channel, sequence):
    payload = encode(dataclasses.replace(frame(channel, 3, 2.0), sequence=sequence))
    assert quick_head_of(channel, payload) == head_of(channel, payload)
    for end in range(0, len(payload), 7):
        quick_head_of(channel, payload[:end])  # never an exception
    assert quick_head_of(channel, b"\xff\xff") is None and quick_head_of(channel, b"") is None


def test_the_encoding_names_the_message():
    assert encoding_of(ACCEL) == "application/protobuf;gearbox.v1.SampleFrame"


def test_a_schema_is_accepted_only_as_the_contract_has_it():
    name = CHANNEL_KINDS["accel"].schema
    assert schema_fault(name, "protobuf", schema_data(), name) is None
    assert "must be 'gearbox.v1.SampleFrame'" in schema_fault("foo.Bar", "protobuf", schema_data(), name)
    assert "(jsonschema)" in schema_fault(name, "jsonschema", b"{}", name)
    assert "\n" not in schema_fault(name, "proto\nbuf", b"{}", name)  # one line, whatever a damaged file holds
    assert "no FileDescriptorSet" in schema_fault(name, "protobuf", b"\xff\xff", name)
    assert "field sequence must have number 3" in schema_fault(
        name, "protobuf", schema_data().replace(b"\x0a\x08sequence\x18\x03", b"\x0a\x08sequence\x18\x07"), name
    )


def _fate(read, channel, payload):
    """The values of all fields of a frame as bytes, or why there is none."""
    try:
        found = read(channel, payload)
    except FrameError as error:
        return str(error)
    return [np.asarray(getattr(found, name)).tobytes() for name in VALUES[type(found)] if name != "channel"]


def _parsed(channel, payload):
    return getattr(pb, CHANNEL_KINDS[channel.kind].schema.rpartition(".")[2]).FromString(payload)


def _by_protobuf(channel, payload):
    return codec._decoded(CHANNEL_KINDS[channel.kind], channel, payload)


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda c: c.label)
def test_a_message_of_any_layout_is_what_protobuf_says_it_is(channel):
    sent = frame(channel, 300, 0.75)
    payload = encode(sent)
    assert codec._quickly(CHANNEL_KINDS[channel.kind], channel, payload).sequence == sent.sequence
    head, rng = payload[:40], np.random.default_rng(1)
    unusual = [
        payload[:9] + payload,
        payload + payload[:9],
        payload + b"\x78\x01",
        payload[9:],
        payload[:-3],
        head,
        b"",
    ]
    unusual += [payload[:9] + payload[18:], payload[:18] + payload[20:], payload.replace(b"\x18", b"\x18\x80", 1)]
    for _ in range(3000):
        damaged = bytearray(payload)
        for at in rng.integers(0, len(head), rng.integers(1, 4)):
            damaged[at] = rng.choice([0, 1, 0x7F, 0x80, 0xFF, rng.integers(256), *head])
        unusual.append(bytes(damaged))
    for message in unusual:
        assert _fate(decode, channel, message) == _fate(_by_protobuf, channel, message)


@pytest.mark.parametrize("sequence", [0, 1, 127, 128, 2**32, 2**63 - 1, 2**63, 2**64 - 1])
@pytest.mark.parametrize("channel", CHANNELS, ids=lambda c: c.label)
def test_numbers_of_any_size_are_read(channel, sequence):
    payload = encode(dataclasses.replace(frame(channel, 3, 0.75), sequence=sequence))
    assert decode(channel, payload).sequence == sequence
    assert _fate(decode, channel, payload) == _fate(_by_protobuf, channel, payload)


def test_edges_per_turn_beyond_32_bits_are_what_protobuf_makes_of_them():
    channel = next(c for c in CHANNELS if c.kind == "encoder")
    payload = encode(frame(channel, 3, 0.75))
    assert payload[9] == 0x10
    number = next(i + 1 for i in range(10, 20) if payload[i] < 0x80)
    message = payload[:10] + b"\x80\xc0\x80\x80\x10" + payload[number:]  # 2^32 + 2^13
    assert decode(channel, message).edges_per_rev == _by_protobuf(channel, message).edges_per_rev == 2**13
