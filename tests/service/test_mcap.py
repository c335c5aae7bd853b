"""Recordings: read as written, salvaged where damaged, refused with one clear line where unusable."""

from __future__ import annotations

import json
import random

import pytest
from mcap.writer import Writer
from streams import ASSET, CHANNELS, bursts, content

from service.errors import InputError
from service.stream.sources.mcap import Recording, read_windows
from service.stream.sources.mcap_scan import scan
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.windows import Windows
from service.stream.wire.codec import encode, schema_data
from service.stream.wire.topics import topic_of

RIG = b'schema = "gear-rig/1"\nname = "small"\n'


def written(path, frames, chunk_every=12, **given):
    """A recording of frames with a new chunk every so many."""
    with RecordingWriter(path, rig_text=RIG, metadata={"asset": ASSET}, **given) as writer:
        for i, frame in enumerate(frames):
            writer.write(frame.channel, frame.end_time_ns, encode(frame))
            if i % chunk_every == chunk_every - 1:
                writer.flush()
    return path


def windows_of(frames):
    assembler = Windows()
    return [w for f in frames for w in assembler.add(f)] + assembler.flush()


def count_frames(path):
    with Recording(path) as recording:
        return sum(1 for _ in recording.frames(lambda channel, error: None)), recording.faults


def test_a_written_recording_gives_its_windows_rig_and_metadata_back(tmp_path):
    frames = bursts(3)
    rig, metadata, windows = read_windows(written(tmp_path / "a.mcap", frames))
    assert rig == {"schema": "gear-rig/1", "name": "small"}
    assert metadata == {"asset": ASSET}
    assert content(windows) == content(windows_of(frames))


def test_any_mcap_reader_finds_the_contract_in_it(tmp_path):
    from mcap.reader import make_reader

    with written(tmp_path / "a.mcap", bursts(1)).open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert {c.topic for c in summary.channels.values()} == {topic_of(c) for c in CHANNELS}
        assert {c.message_encoding for c in summary.channels.values()} == {"protobuf"}
        assert {(s.name, s.encoding) for s in summary.schemas.values()} == {
            ("gearbox.v1.SampleFrame", "protobuf"),
            ("gearbox.v1.EncoderFrame", "protobuf"),
        }
        assert {c.compression for c in summary.chunk_indexes} == {"zstd"}
        messages = [m for _, _, m in reader.iter_messages()]
        assert len(messages) == 24 and all(m.log_time == m.publish_time for m in messages)
        assert [a.name for a in reader.iter_attachments()] == ["rig.toml"]


@pytest.mark.parametrize("order", ["by channel", "shuffled"])
def test_a_file_in_any_order_of_writing_gives_the_same_windows(tmp_path, order):
    frames = bursts(6, pause=20.0)
    mixed = list(frames)
    if order == "by channel":
        mixed.sort(key=lambda f: (f.channel, f.start_time_ns))
    else:
        random.Random(1).shuffle(mixed)
    assert content(read_windows(written(tmp_path / "a.mcap", mixed))[2]) == content(windows_of(frames))


def test_a_file_without_chunks_is_read_too(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        schemas = {
            n: writer.register_schema(f"gearbox.v1.{n}", "protobuf", schema_data())
            for n in ("SampleFrame", "EncoderFrame")
        }
        ids = {
            c: writer.register_channel(
                topic_of(c), "protobuf", schemas["EncoderFrame" if c.kind == "encoder" else "SampleFrame"]
            )
            for c in CHANNELS
        }
        for f in bursts(2):
            writer.add_message(ids[f.channel], f.end_time_ns, encode(f), f.end_time_ns)
        writer.finish()
    assert content(read_windows(path)[2]) == content(windows_of(bursts(2)))


def test_a_truncated_file_gives_all_its_whole_chunks(tmp_path):
    path = written(tmp_path / "a.mcap", bursts(4))
    data = path.read_bytes()
    with path.open("rb") as file:
        blocks = scan(file, "a").blocks
    assert len(blocks) == 8
    for cut in (blocks[5].offset + 500, blocks[5].offset + 3, blocks[7].offset):
        path.write_bytes(data[:cut])
        whole = sum(b.offset < cut for b in blocks) - (cut != blocks[7].offset)
        frames, faults = count_frames(path)
        assert frames == 12 * whole
        assert len(faults) == 1 and "truncated" in faults[0]
    path.write_bytes(data[:-20])  # only the summary is hurt
    assert count_frames(path)[0] == 96


def test_a_channel_that_begins_late_is_in_all_windows(tmp_path):
    frames = bursts(6, frames=10)
    assert content(read_windows(written(tmp_path / "a.mcap", ahead(frames)))[2]) == content(windows_of(frames))


def test_a_channel_that_begins_late_is_found_in_a_truncated_file(tmp_path):
    path = written(tmp_path / "a.mcap", ahead(bursts(6)), chunk_every=6)
    with path.open("rb") as file:
        blocks = scan(file, "a").blocks
    data = path.read_bytes()[: blocks[-1].offset]
    path.write_bytes(data)
    frames, faults = count_frames(path)
    assert frames == 6 * (len(blocks) - 1) == 138 and len(faults) == 1
    spoiled = bytearray(data)
    spoiled[blocks[3].offset + 200] ^= 0x10  # the first chunk of the channels that begin late
    path.write_bytes(spoiled)
    frames, faults = count_frames(path)
    with Recording(path) as recording:
        left = sum(1 for raw in recording.messages())
        assert frames == left and {channel.kind for channel in recording.channels.values()} == {"accel"}
    assert any(fault.endswith("messages left out: the definition of their channel is lost") for fault in faults)


def test_no_flipped_bit_of_the_summary_gives_a_channel_another_name(tmp_path):
    path = written(tmp_path / "a.mcap", ahead(bursts(6)), chunk_every=6)
    data, known = path.read_bytes(), {topic_of(channel) for channel in CHANNELS}
    with path.open("rb") as file:
        last = scan(file, "a").blocks[-1].offset
    for topic in known:  # the summary repeats the definitions: their last place in the file
        place = data.rindex(topic.encode())
        assert place > last
        for at in range(place, place + len(topic)):
            spoiled = bytearray(data)
            spoiled[at] ^= 1
            path.write_bytes(spoiled)
            with Recording(path) as recording:
                assert {topic_of(channel) for channel in recording.channels.values()} == known
                assert recording.faults == ["summary damaged (CRC) and left out"]


def ahead(frames):
    """The frames of the accelerometer's first windows first: as they come from a publisher that is linked by and by."""
    first = [f for f in frames if f.channel.kind == "accel"][:18]
    return first + [f for f in frames if all(f is not each for each in first)]


def test_a_flipped_bit_costs_its_own_chunk_only_and_is_told(tmp_path):
    path = written(tmp_path / "a.mcap", bursts(4))
    data = path.read_bytes()
    with path.open("rb") as file:
        blocks = scan(file, "a").blocks
    spoiled = bytearray(data)
    spoiled[blocks[3].offset + 200] ^= 0x10
    path.write_bytes(spoiled)
    frames, faults = count_frames(path)
    assert frames == 84
    assert faults == [f"1 of 8 chunks damaged and left out: at byte {blocks[3].offset}, " + faults[0].split(", ")[1]]


def test_no_flipped_bit_crashes_the_reader_or_passes_for_data(tmp_path):
    path = written(tmp_path / "a.mcap", bursts(4))
    data = path.read_bytes()
    good = {encode(f) for f in bursts(4)}
    rng = random.Random(5)
    for _ in range(300):
        spoiled = bytearray(data)
        spoiled[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(spoiled)
        try:
            with Recording(path) as recording:
                payloads = [raw.payload for raw in recording.messages()]
        except InputError as error:
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
        else:
            assert len(payloads) >= 72 and set(payloads) <= good


def refused(path) -> str:
    with pytest.raises(InputError) as caught:
        read_windows(path)
    message = str(caught.value)
    assert message.startswith(str(path)) and "\n" not in message
    return message


def test_what_is_no_recording_is_refused_with_what_it_is(tmp_path):
    assert "no such file" in refused(tmp_path / "none.mcap")
    assert "is a directory" in refused(tmp_path)
    (tmp_path / "empty.mcap").touch()
    assert "is empty" in refused(tmp_path / "empty.mcap")
    (tmp_path / "text.mcap").write_text("time,value\n0,1\n")
    assert "not an MCAP recording" in refused(tmp_path / "text.mcap")


def other_recording(path, topic, message_encoding, schema_name, schema_encoding, data=b"{}"):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(schema_name, schema_encoding, data)
        channel = writer.register_channel(topic, message_encoding, schema)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("topic", "encoding", "schema", "schema_encoding", "named"),
    [
        ("gearbox/a/accel/y6", "json", "foo", "jsonschema", "message encoding 'json', must be 'protobuf'"),
        ("gearbox/a/accel/y6", "protobuf", "foo.Bar", "protobuf", "schema 'foo.Bar'"),
        ("gearbox/a/accel/y6", "protobuf", "gearbox.v1.EncoderFrame", "protobuf", "must be 'gearbox.v1.SampleFrame'"),
        ("/imu/data", "protobuf", "foo.Bar", "protobuf", "no channel gearbox/"),
        ("plant/a/accel/y6", "protobuf", "foo.Bar", "protobuf", "begin with 'plant', not 'gearbox'"),
    ],
)
def test_a_wrong_schema_encoding_or_topic_is_named(tmp_path, topic, encoding, schema, schema_encoding, named):
    message = refused(other_recording(tmp_path / "a.mcap", topic, encoding, schema, schema_encoding))
    assert named in message


def test_a_frame_that_breaks_the_contract_is_handed_over_not_lost(tmp_path):
    path, frames = tmp_path / "a.mcap", bursts(2)
    with RecordingWriter(path) as writer:
        for i, f in enumerate(frames):
            writer.write(f.channel, f.end_time_ns, b"" if i == 8 else encode(f))
    errors = []
    with Recording(path) as recording:
        good = list(recording.frames(lambda channel, error: errors.append((channel, str(error)))))
    assert len(good) == len(frames) - 1
    assert errors == [(frames[8].channel, errors[0][1])] and "start_time_ns = 0" in errors[0][1]


def test_a_crash_while_recording_keeps_what_was_flushed(tmp_path):
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path)
    for i, f in enumerate(bursts(2)):
        writer.write(f.channel, f.end_time_ns, encode(f))
        if i == 31:
            writer.flush()
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(path.read_bytes())  # as a crash leaves it
    assert count_frames(copy)[0] == 32
    writer.close()
    assert count_frames(path) == (48, [])


@pytest.mark.shared
@pytest.mark.parametrize("number", range(14))
def test_the_windows_of_the_reference_campaigns_are_those_that_were_measured(shared, number):
    truth = json.loads((shared / "campaigns" / "truth" / f"D{number:02d}.json").read_text())
    rig, metadata, windows = read_windows(shared / "campaigns" / f"D{number:02d}.mcap")
    assert len(windows) == len(truth["windows"])
    assert rig["schema"] == "gear-rig/1" and metadata["asset"] == truth["asset"]
    for window, true in zip(windows, truth["windows"], strict=True):
        edges = window.encoders["pinion"]
        middle = (edges.first_index + edges.times.size / 2) / edges.per_rev
        turns = edges.times.size / edges.per_rev
        assert middle == pytest.approx(true["revolutions"], abs=0.02 * turns)
    kinds = {f.kind for w in windows for f in w.faults}
    assert kinds == ({"gap"} if number == 1 else set())  # D01 says that it has lost a frame; the others are whole
