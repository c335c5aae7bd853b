"""`gear-twin import`: measured columns into a recording by the contract, with a rig file of what is known.

Values come out in the contract's unit of their kind (m/s², N·m). Where a column's unit is not known its values are
kept as they are and the metadata record `import` says so; columns that are no acceleration, torque or encoder (a
microphone's pressure, unit Pa) are checked and left out, because the contract has no key for them, and
that is said too. A slowly varying quantity is written as one mean value a second.

A quadrature encoder is read by its fourfold counts, and the edges are written that the shaft passes forward: an edge is
written when the count comes farther than ever in the sense in which the shaft turns on the whole, so that what is
taken back in a reversal and passed again is not written twice. Both encoders of an external pair count up by this,
though the shafts turn in opposite senses. A transition in which both levels change counts two where the counts before
and behind it have one sense, else none. How many reversals and such transitions there were, and which sense is
forward, stands in `import`. A frame without an edge says that the shaft stood still.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from service.errors import InputError
from service.files.import_columns import read_columns
from service.files.import_mapping import QUADRATURE, ChannelMapping, ImportMapping, load_import_mapping
from service.stream.channels import CHANNEL_KINDS, Layout
from service.stream.frames import NS, EncoderFrame, Frame, SampleFrame
from service.stream.wire.codec import encode, schema_data
from service.stream.wire.topics import Channel, topic_of
from twin.encoder_pair.motion import forward_edges, quadrature
from twin.errors import WindowError

FRAME_LENGTH = 0.5  # [s]
SLOW_INTERVAL = 1.0  # over which a slow channel's column is averaged to one value [s]
CLOCK_START = datetime(2000, 1, 1, tzinfo=UTC)  # of a recording whose start is not known

Progress = Callable[[int, int], None]


def import_recording(
    mapping_path: str | Path,
    out_path: str | Path,
    progress: Progress | None = None,
    source: str | Path | None = None,
) -> dict[str, Any]:
    """Writes the recording that a mapping file describes; returns what was written and what was left out.

    progress  called with the frames written and their total
    source    data file in place of the mapping's `file.path`
    """
    mapping = load_import_mapping(mapping_path)
    data_file = Path(source) if source is not None else mapping.path
    mapping, columns = read_columns(mapping, data_file)
    imported = [c for c in mapping.channels if not c.left_out]
    if not imported:
        kinds = ", ".join(kind.quantity for kind in CHANNEL_KINDS.values())
        raise InputError(f"{mapping.where}: channels: none is imported; quantities with a channel are {kinds}")
    started = mapping.started or CLOCK_START
    counted = _counted(mapping, columns)
    frames = _all_frames(
        mapping, columns, imported, counted, round(started.timestamp()) * NS + started.microsecond * 1000
    )
    notes = _notes(mapping, data_file, counted)
    metadata = {"asset": mapping.asset, "description": mapping.description, "started": started.isoformat()}
    write_recording(out_path, frames, metadata, notes, to_toml(mapping.rig), progress)
    return {
        "recording": str(out_path),
        "asset": mapping.asset,
        "source": str(data_file),
        "frames": len(frames),
        "duration": max(f.end_time_ns for f in frames) / NS - min(f.start_time_ns for f in frames) / NS,
        "channels": {c.label: c.unit for c in imported},
        "left_out": {c.label: c.left_out for c in mapping.channels if c.left_out},
        "encoders": {label: counts.figures for label, counts in counted.items()},
        "notes": notes,
    }


@dataclass(frozen=True, slots=True, eq=False)
class _Counted:
    """What a quadrature encoder's levels came to."""

    times: np.ndarray  # of the edges passed forward (m,) [s]
    length: float  # of the record [s]
    figures: dict[str, int]


def _counted(mapping: ImportMapping, columns: Mapping[str, np.ndarray]) -> dict[str, _Counted]:
    """The edges of the quadrature encoders by channel label; InputError where one does not turn on."""
    out = {}
    for channel in mapping.channels:
        if channel.unit != QUADRATURE:
            continue
        found = quadrature(*columns[channel.label])
        try:
            forward = forward_edges(found.counts, mapping.sample_rate)
        except WindowError as error:
            raise InputError(f"{mapping.where}: channels.{channel.name}: {error}") from None
        figures = {
            "edges": forward.times.size,
            "sense": forward.sense,
            "reversals": found.reversals,
            "counts_taken_back": forward.reversed_counts,
            "illegal_transitions": found.illegal,
            "illegal_counted_as_two": found.filled,
        }
        out[channel.label] = _Counted(forward.times, found.counts.size / mapping.sample_rate, figures)
    return out


def _all_frames(
    mapping: ImportMapping,
    columns: Mapping[str, np.ndarray],
    imported: list[ChannelMapping],
    counted: Mapping[str, _Counted],
    start_ns: int,
) -> list[Frame]:
    """The frames of all channels in order of their ends."""
    frames: list[Frame] = []
    for channel in imported:
        address = Channel(mapping.asset, channel.kind, channel.name)
        if channel.label in counted:
            found = counted[channel.label]
            frames += _edge_frames(mapping, channel, address, found.times, start_ns, found.length)
        elif CHANNEL_KINDS[channel.kind].layout is Layout.EDGES:
            frames += _edge_frames(mapping, channel, address, columns[channel.label], start_ns)
        elif CHANNEL_KINDS[channel.kind].slow:
            frames += _slow_frames(mapping, address, columns[channel.label], start_ns)
        else:
            frames += _sample_frames(mapping, channel, address, columns[channel.label], start_ns)
    return sorted(frames, key=lambda f: (f.end_time_ns, f.channel))


def _sample_frames(
    mapping: ImportMapping, channel: ChannelMapping, address: Channel, values: np.ndarray, start_ns: int
) -> Iterator[SampleFrame]:
    rate = mapping.sample_rate
    count = max(1, round(values.size / (FRAME_LENGTH * rate)))
    cuts = [round(i * values.size / count) for i in range(count + 1)]
    if values.size / rate / count < 0.01:
        raise InputError(
            f"{mapping.where}: channels.{channel.name}: {values.size} samples at {rate:g} Hz are only "
            f"{values.size / rate:.3g} s; is file.sample_rate_hz right?"
        )
    for sequence, (a, b) in enumerate(pairwise(cuts)):
        yield SampleFrame(
            channel=address,
            start_time_ns=start_ns + round(a / rate * NS),
            sequence=sequence,
            sample_rate=rate,
            values=values[a:b].astype(np.float32),
        )


def _slow_frames(mapping: ImportMapping, address: Channel, values: np.ndarray, start_ns: int) -> Iterator[SampleFrame]:
    """One value a second, the mean of the finite ones of that second."""
    rate = mapping.sample_rate
    for sequence, number in enumerate(range(max(1, int(values.size / (rate * SLOW_INTERVAL))))):
        second = values[round(number * SLOW_INTERVAL * rate) : round((number + 1) * SLOW_INTERVAL * rate)]
        finite = second[np.isfinite(second)]
        if finite.size:
            yield SampleFrame(
                channel=address,
                start_time_ns=start_ns + round((number + 0.5) * SLOW_INTERVAL * NS),
                sequence=sequence,
                sample_rate=1 / SLOW_INTERVAL,
                values=np.array([finite.mean()], dtype=np.float32),
            )


def _edge_frames(
    mapping: ImportMapping,
    channel: ChannelMapping,
    address: Channel,
    times: np.ndarray,
    start_ns: int,
    length: float | None = None,
) -> Iterator[EncoderFrame]:
    """The frames of an encoder; also those without an edge where the record's length [s] is known."""
    if times[0] < 0:
        raise InputError(f"{mapping.where}: channels.{channel.name}: edge times begin at {times[0]:g} s, before 0")
    number = np.floor(times / FRAME_LENGTH).astype(int)
    numbers = np.unique(number) if length is None else np.arange(max(1, round(length / FRAME_LENGTH)))
    number = np.minimum(number, numbers[-1])  # less than half a frame at the end goes with the last
    for sequence, n in enumerate(numbers):
        first, last = np.searchsorted(number, (n, n + 1))
        begin = n * FRAME_LENGTH
        yield EncoderFrame(
            channel=address,
            start_time_ns=start_ns + round(begin * NS),
            sequence=sequence,
            edges_per_rev=channel.edges_per_rev,
            first_edge_index=channel.first_edge_index + int(first),
            edge_offsets_ns=(times[first:last] - begin) * NS,
        )


def _notes(mapping: ImportMapping, data_file: Path, counted: Mapping[str, _Counted]) -> dict[str, str]:
    """What a reader of the recording must know of where it comes from."""
    notes = {"source": data_file.name, "sample_rate_hz": f"{mapping.sample_rate:g}"}
    for channel in mapping.channels:
        said = _conversion_note(channel)
        if channel.label in counted:
            said = _quadrature_note(channel, counted[channel.label].figures)
        notes[channel.label] = f"{said}; {channel.note}" if channel.note else said
    senses = [c.figures["sense"] for c in counted.values()]
    if len(senses) == 2:
        how = "opposite senses, as an external pair must"
        if senses[0] == senses[1]:
            how = "the same sense: no external pair, or one encoder has a and b exchanged"
        notes["senses"] = f"by their counts the shafts turn in {how}"
    if mapping.started is None:
        notes["started"] = f"unknown: the clock starts at {CLOCK_START.isoformat()}"
    for i, note in enumerate(mapping.notes, start=1):
        notes[f"note {i}"] = note
    return notes


def _conversion_note(channel: ChannelMapping) -> str:
    """How the values of a column became the channel's."""
    kind = CHANNEL_KINDS[channel.kind]
    if channel.left_out:
        return f"{channel.left_out}: left out"
    if channel.unit == "unknown":
        return f"unit unknown: raw values, gain unknown, no level in {kind.unit} can be had from them"
    if channel.factor == 1 and channel.offset == 0:
        return f"as recorded, {channel.unit}"
    shifted = f" plus {channel.offset:.6g}" if channel.offset else ""
    return f"was in {channel.unit}, times {channel.factor:.6g}{shifted}"


def _quadrature_note(channel: ChannelMapping, figures: Mapping[str, int]) -> str:
    """What was made of a quadrature encoder's levels."""
    ahead, behind = channel.columns[::-1] if figures["sense"] > 0 else channel.columns
    illegal, filled = figures["illegal_transitions"], figures["illegal_counted_as_two"]
    said = (
        f"fourfold counts of two levels, {channel.edges_per_rev} a turn; {figures['edges']} edges forward, where "
        f"{ahead} leads {behind}; {figures['reversals']} reversals, {figures['counts_taken_back']} counts taken "
        f"back; {illegal} illegal transitions"
    )
    return f"{said}, in which both levels changed: {filled} counted as two" if illegal else said


def write_recording(
    out_path: str | Path,
    frames: list[Frame],
    metadata: Mapping[str, str],
    notes: Mapping[str, str],
    rig_toml: str,
    progress: Progress | None = None,
) -> None:
    """An MCAP file by the contract, section 2; written under another name and renamed when complete."""
    out_path = Path(out_path)
    partial = out_path.with_name(out_path.name + ".part")
    try:
        with partial.open("wb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start(profile="", library="gear-twin import")
            writer.add_metadata("recording", dict(metadata))
            writer.add_metadata("import", dict(notes))
            first = min(f.start_time_ns for f in frames)
            writer.add_attachment(
                create_time=first,
                log_time=first,
                name="rig.toml",
                media_type="application/toml",
                data=rig_toml.encode(),
            )
            _write_frames(writer, frames, progress)
            writer.finish()
        partial.replace(out_path)
    except OSError as error:
        reason = (error.strerror or "fault").lower()
        raise InputError(f"{out_path}: the recording cannot be written: {reason}") from None
    finally:
        partial.unlink(missing_ok=True)


def _write_frames(writer: Writer, frames: list[Frame], progress: Progress | None) -> None:
    schemas = {
        name: writer.register_schema(name=name, encoding="protobuf", data=schema_data())
        for name in sorted({CHANNEL_KINDS[f.channel.kind].schema for f in frames})
    }
    channels = {
        channel: writer.register_channel(
            topic=topic_of(channel),
            message_encoding="protobuf",
            schema_id=schemas[CHANNEL_KINDS[channel.kind].schema],
        )
        for channel in sorted({f.channel for f in frames})
    }
    for number, frame in enumerate(frames, start=1):
        writer.add_message(
            channel_id=channels[frame.channel],
            log_time=frame.end_time_ns,
            publish_time=frame.end_time_ns,
            sequence=frame.sequence,
            data=encode(frame),
        )
        if progress:
            progress(number, len(frames))


def to_toml(mapping: Mapping[str, Any], path: str = "") -> str:
    """A mapping of text, numbers, lists and tables as TOML."""
    own = [f"{key} = {_toml_value(value)}" for key, value in mapping.items() if not isinstance(value, Mapping)]
    head = [f"[{path}]"] if path and own else []
    lines = ["\n".join(head + own)] if own else []
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            lines.append(to_toml(value, f"{path}.{key}" if path else key).rstrip("\n"))
    return "\n\n".join(part for part in lines if part) + "\n"


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_toml_value(v) for v in value)}]"
    return repr(value)
