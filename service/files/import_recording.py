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

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.file_faults import whole_file
from service.files.dates import EXAMPLE, in_zone, moment_in, without_zone
from service.files.import_columns import Counted, DataFile, Measured, counted_edges, read_columns
from service.files.import_mapping import PULSES, QUADRATURE, ChannelMapping, ImportMapping, load_import_mapping
from service.files.rig import age_of
from service.files.units import UNITS
from service.stream.channels import CHANNEL_KINDS, Layout
from service.stream.frames import NS, EncoderFrame, Frame, SampleFrame
from service.stream.sources.mcap import Recording, windows_of
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode
from service.stream.wire.topics import PREFIX, Channel
from service.toml_text import document_text
from twin.features.level import USABLE
from twin.gear_age import NEW, UNKNOWN
from twin.plausibility import mistakes_of
from twin.rig import Rig

FRAME_LENGTH = 0.5  # [s]
SLOW_INTERVAL = 1.0  # over which a slow channel's column is averaged to one value [s]
UNKNOWN_AGE = (
    'the age of the gears is not stated, so only what wears from here on can be known: `age = "new"` in the mapping, '
    "or --age (new, such as 5000 rev, such as 1200 h, or unknown) states it"
)
CLOCK_START = datetime(1970, 1, 2, tzinfo=UTC)  # of a recording whose date is not known: no service takes it
AGREES = 60.0  # difference of two statements of one start [s]
EXAMINED = 3  # windows, from the first: a mistake of the installation is in all of them
SAME = 0.01  # relative difference of two factors that are one

Progress = Callable[[float, float], None]


@np.errstate(all="ignore")  # of values that are none: what is wrong with them is said
def import_recording(
    mapping_path: str | Path,
    out_path: str | Path,
    progress: Progress = lambda done, whole: None,
    source: str | Path | None = None,
    prefix: str = PREFIX,
    age: str | None = None,
    started: str | None = None,
    zone: str | None = None,
    ask: Callable[[str], str | None] | None = None,
) -> dict[str, Any]:
    """Writes the recording that a mapping file describes; returns what was written and what was left out.

    progress  called with the length of what is written, and of the whole [s]
    source    data file in place of the mapping's `file.path`
    prefix    first part of the recording's topics
    age       of the gears when the file begins: `new`, "5000 rev", "1200 h" or `unknown`; None for what the mapping
              states of its own file
    started   when the file begins, in place of what mapping and file state
    zone      of a date that is a local time; None for the mapping's
    ask       for the zone of a local time for which nobody states one
    """
    mapping = load_import_mapping(mapping_path, source)
    data_file = mapping.path if source is None else Path(source)
    if data_file.resolve() != mapping.path.resolve():
        mapping = replace(mapping, started=None, age=None)  # the mapping's are those of its own file
    if started is not None:
        if (moment := moment_in(started)) is None:
            raise InputError(f"--started = {started!r} must be a date with a time of day, such as {EXAMPLE}")
        mapping = replace(mapping, started=moment)
    if age is not None:
        mapping = replace(mapping, age=age_of("--age", age, mapping.rig.get("operating", {}).get("pinion_speed_hz")))
    data = read_columns(replace(mapping, zone=zone or mapping.zone), data_file)
    mapping = data.mapping
    imported = [c for c in mapping.channels if not c.left_out]
    if not imported:
        kinds = ", ".join(kind.quantity for kind in CHANNEL_KINDS.values())
        raise InputError(f"{mapping.where}: channels: none is imported; quantities with a channel are {kinds}")
    began, undated = _began(data, data_file, ask)
    first = began or CLOCK_START
    counted = counted_edges(data)
    frames = _all_frames(data, imported, counted, int(first.timestamp()) * NS + first.microsecond * 1000)
    rig, of_age = with_age(mapping)
    notes = _notes(data, data_file, counted) | {k: v for k, v in (("started", undated), ("age", of_age)) if v}
    metadata = {
        "asset": mapping.asset,
        "description": mapping.description,
        "started": began.isoformat() if began else "",
    }
    rig_text = document_text(with_sensors(rig, imported, data)).encode()
    whole = max((m.start + m.values.shape[-1] / m.rate for m in data.channels.values() if m.rate > 0), default=0.0)
    with (
        whole_file(out_path) as part,
        RecordingWriter(part, rig_text=rig_text, metadata=metadata, imported=notes, prefix=prefix) as writer,
    ):
        count, seconds = _write_frames(writer, frames, lambda done: progress(done, whole))
    return {
        "recording": str(out_path),
        "asset": mapping.asset,
        "source": str(data_file),
        "frames": count,
        "duration": seconds,
        "channels": {c.label: c.unit for c in imported},
        "left_out": {c.label: c.left_out for c in mapping.channels if c.left_out},
        "encoders": {label: counts.figures for label, counts in counted.items()},
        "notes": notes,
        "told": list(data.notes),
        "mistakes": [
            *_dates_contradict(data, began),
            *contradicted_units(mapping.channels, data.units),
            *likely_mistakes(Path(out_path), prefix),
        ],
    }


def _began(data: DataFile, data_file: Path, ask: Callable[[str], str | None] | None) -> tuple[datetime | None, str]:
    """When the recording begins, as stated by a person, else by the file, and what is not sure of it."""
    mapping = data.mapping
    stated = mapping.started or data.started
    if stated is None:
        return None, _undated(data_file)
    where, zone = mapping.where if mapping.started else str(data_file), mapping.zone
    if stated.tzinfo is None and zone is None and ask is not None:
        zone = ask(without_zone(where, stated))
    began, unsure = in_zone(where, stated, zone)
    if began > datetime.now(UTC) + timedelta(seconds=AGREES):
        cure = unsure or f"{data_file}: correct its date"
        raise InputError(f"{data_file}: begins at {began.isoformat()}, which is in the future; {cure}")
    return began, unsure


def _undated(data_file: Path) -> str:
    """What is told of a file without a date; its own time is offered only: copies have that of their copying."""
    written = datetime.fromtimestamp(data_file.stat().st_mtime, UTC).isoformat(timespec="seconds")
    return (
        f"unknown: {data_file.name} states no date, so no service takes the recording; give --started {EXAMPLE}, or "
        f"--started {written} if it was recorded when the file was last written"
    )


def _dates_contradict(data: DataFile, began: datetime | None) -> list[str]:
    """A date that a person states and the file contradicts."""
    given, stated = data.mapping.started, data.started
    if began is None or given is None or stated is None:
        return []
    stated = stated if stated.tzinfo else stated.replace(tzinfo=began.tzinfo)
    if abs((stated - began).total_seconds()) <= AGREES:
        return []
    return [f"started = {began.isoformat()} is given, but the file states {stated.isoformat()}: the given one is used"]


def with_age(mapping: ImportMapping) -> tuple[dict[str, Any], str]:
    """The rig file to attach, with what is known of the gears' age where its edges begin to count, and a note on it.

    A file has no counter of its own: its edges count from 0, or from a `first_edge_index` that is one since new.
    """
    encoders = [c for c in mapping.channels if CHANNEL_KINDS[c.kind].layout is Layout.EDGES]
    if not encoders:
        return mapping.rig, ""
    if any(c.first_edge_index is not None for c in encoders):
        age: str | float = NEW
        said = "edges count from new gears: first_edge_index is stated"
    elif mapping.age is None or mapping.age == UNKNOWN:
        age, said = UNKNOWN, UNKNOWN_AGE if mapping.age is None else "the age of the gears is not known"
    else:
        age = mapping.age
        said = "new gears" if age == NEW else f"the gears have made {age:,.0f} revolutions when the file begins"
    gears = {**mapping.rig.get("gears", {}), "age": age}
    return {**mapping.rig, "gears": gears}, said


def with_sensors(rig: dict[str, Any], channels: Iterable[ChannelMapping], data: DataFile) -> dict[str, Any]:
    """The rig file to attach, with what the data file says of its sensors.

    Channels whose values are raw are named, so that nobody reads them in a unit; the band of the level ends where the
    sample rate ends it, unless the rig file states a band.
    """
    sensors = dict(rig.get("sensors", {}))
    if raw := [channel.label for channel in channels if channel.unit == "unknown"]:
        sensors["uncalibrated"] = raw
    low, high = Rig.from_mapping({}).band
    rates = [data.channels[channel.label].rate for channel in channels if channel.kind == "accel"]
    if "band_hz" not in sensors and rates and USABLE * min(rates) < high:
        sensors["band_hz"] = [low, USABLE * min(rates)]
    return {**rig, "sensors": sensors} if sensors else rig


def _all_frames(
    data: DataFile, imported: list[ChannelMapping], counted: Mapping[str, Counted], start_ns: int
) -> Iterator[Frame]:
    """The frames of all channels in order of their ends."""
    each = [_frames_of(data, channel, counted.get(channel.label), start_ns) for channel in imported]
    return heapq.merge(*each, key=lambda frame: (frame.end_time_ns, frame.channel))


def _frames_of(data: DataFile, channel: ChannelMapping, found: Counted | None, start_ns: int) -> Iterator[Frame]:
    """The frames of one channel."""
    address = Channel(data.mapping.asset, channel.kind, channel.name)
    measured = data.channels[channel.label]
    begin = start_ns + round(measured.start * NS)
    if found is not None:
        first = (channel.first_edge_index or 0) + found.first_index
        return _edge_frames(channel.edges_per_rev, address, found.times, begin, first, found.length)
    if CHANNEL_KINDS[channel.kind].layout is Layout.EDGES:
        if measured.values[0] < 0:
            raise InputError(f"{channel.place}: edge times begin at {measured.values[0]:g} s, before 0")
        first = channel.first_edge_index or 0
        return _edge_frames(channel.edges_per_rev, address, np.asarray(measured.values), start_ns, first)
    if CHANNEL_KINDS[channel.kind].slow:
        return _slow_frames(address, measured, begin)
    return _sample_frames(channel.place, address, measured, begin)


def _sample_frames(where: str, address: Channel, measured: Measured, start_ns: int) -> Iterator[SampleFrame]:
    rate, values = measured.rate, measured.values
    count = max(1, round(values.size / (FRAME_LENGTH * rate)))
    cuts = (round(i * values.size / count) for i in range(count + 1))
    if values.size / rate / count < 0.01:
        raise InputError(
            f"{where}: {values.size} samples at {rate:g} Hz are only {values.size / rate:.3g} s; is the sample rate "
            f"(file.sample_rate_hz) right?"
        )
    for sequence, (a, b) in enumerate(pairwise(cuts)):
        yield SampleFrame(
            channel=address,
            start_time_ns=start_ns + round(a / rate * NS),
            sequence=sequence,
            sample_rate=rate,
            values=values[a:b].astype(np.float32),
        )


def _slow_frames(address: Channel, measured: Measured, start_ns: int) -> Iterator[SampleFrame]:
    """One value a second, the mean of the finite ones of that second."""
    rate, values = measured.rate, measured.values
    per_interval = max(1.0, rate * SLOW_INTERVAL)
    for sequence, number in enumerate(range(max(1, int(values.size / per_interval)))):
        second = values[round(number * per_interval) : round((number + 1) * per_interval)]
        finite = second[np.isfinite(second)]
        if finite.size:
            yield SampleFrame(
                channel=address,
                start_time_ns=start_ns + round((number + 0.5) * per_interval / rate * NS),
                sequence=sequence,
                sample_rate=rate / per_interval,
                values=np.array([finite.mean()], dtype=np.float32),
            )


def _edge_frames(
    per_rev: int, address: Channel, times: np.ndarray, start_ns: int, first: int, length: float | None = None
) -> Iterator[EncoderFrame]:
    """The frames of an encoder; also those without an edge where the record's length [s] is known.

    An edge whose time is not known (NaN) ends a frame: the number of the next frame's first edge shows that it is
    missing.
    """
    known = np.flatnonzero(np.isfinite(times))
    number = np.floor(times[known] / FRAME_LENGTH).astype(int)
    numbers = np.unique(number) if length is None else np.arange(max(1, round(length / FRAME_LENGTH)))
    number = np.minimum(number, numbers[-1])  # less than half a frame at the end goes with the last
    sequence = 0
    for n in numbers:
        begin = n * FRAME_LENGTH
        own = known[slice(*np.searchsorted(number, (n, n + 1)))]
        nearest = own[:0] if own.size else known[np.searchsorted(number, n) :][:1]
        for run in np.split(own, np.flatnonzero(np.diff(own) > 1) + 1):
            at = int(run[0]) if run.size else int(nearest[0]) if nearest.size else times.size
            yield EncoderFrame(
                channel=address,
                start_time_ns=start_ns + round(begin * NS),
                sequence=sequence,
                edges_per_rev=per_rev,
                first_edge_index=first + at,
                edge_offsets_ns=(times[run] - begin) * NS,
            )
            sequence += 1


def _notes(data: DataFile, data_file: Path, counted: Mapping[str, Counted]) -> dict[str, str]:
    """What a reader of the recording must know of where it comes from."""
    mapping = data.mapping
    rates = {m.rate for m in data.channels.values() if m.rate > 0}
    notes = {"source": data_file.name, "sample_rate_hz": ", ".join(f"{r:.9g}" for r in sorted(rates))}
    for channel in mapping.channels:
        said = _conversion_note(channel)
        if channel.label in counted:
            describe = _pulse_note if channel.unit == PULSES else _count_note
            said = describe(channel, counted[channel.label].figures)
        missing = data.channels[channel.label].missing
        if missing:
            said += f"; by the time column {missing} samples are missing"
        notes[channel.label] = f"{said}; {channel.note}" if channel.note else said
    senses = [c.figures["sense"] for c in counted.values() if "sense" in c.figures]
    if len(senses) == 2:
        how = "opposite senses, as an external pair must"
        if senses[0] == senses[1]:
            how = "the same sense: no external pair, or one encoder has a and b exchanged"
        notes["senses"] = f"by their counts the shafts turn in {how}"
    for i, note in enumerate((*mapping.notes, *data.notes), start=1):
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


def _pulse_note(channel: ChannelMapping, figures: Mapping[str, float]) -> str:
    """What was made of a tachometer's pulses."""
    said = (
        f"{figures['edges']:.0f} pulses of {channel.columns[0]!r}, {channel.edges_per_rev} a turn, "
        f"{figures['speed_hz']:.6g} turns/s; threshold {figures['threshold']:.4g}, "
        f"hysteresis {figures['hysteresis']:.3g}"
    )
    if not figures["missed"] and not figures["doubled"]:
        return said
    return (
        f"{said}; {figures['missed']:.0f} pulses were missed, of which {figures['interpolated']:.0f} are interpolated, "
        f"and {figures['doubled']:.0f} double ones are left out"
    )


def _count_note(channel: ChannelMapping, figures: Mapping[str, float]) -> str:
    """What was made of an encoder's counts, or of the two levels that were counted."""
    illegal, filled = figures["illegal_transitions"], figures["illegal_counted_as_two"]
    way = "where the counts rise" if figures["sense"] > 0 else "where the counts fall"
    how = f"counts of {channel.columns[0]!r}"
    if channel.unit == QUADRATURE:
        ahead, behind = channel.columns[::-1] if figures["sense"] > 0 else channel.columns
        way, how = f"where {ahead} leads {behind}", "fourfold counts of two levels"
    said = (
        f"{how}, {channel.edges_per_rev} a turn; {figures['edges']} edges forward, {way}; {figures['reversals']} "
        f"reversals, {figures['counts_taken_back']} counts taken back; {illegal} illegal transitions"
    )
    return f"{said}, in which both levels changed: {filled} counted as two" if illegal else said


def _write_frames(
    writer: RecordingWriter, frames: Iterable[Frame], progress: Callable[[float], None]
) -> tuple[int, float]:
    """How many frames were written, and the time from the first start to the last end [s]."""
    count, first, last, seconds = 0, 2**63, 0, 0.0
    for frame in frames:
        writer.write(frame.channel, frame.end_time_ns, encode(frame))
        first, last = min(first, frame.start_time_ns), max(last, frame.end_time_ns)
        count, seconds = count + 1, (last - first) / NS
        progress(seconds)
    return count, seconds


def likely_mistakes(recording: Path, prefix: str) -> list[str]:
    """A line for each fault and each likely mistake of a recording's windows, each once."""
    lines: dict[tuple[str, ...], str] = {}  # windows of one recording repeat a mistake with other figures
    with Recording(recording, prefix) as opened:
        known = Rig.from_mapping(opened.rig() or {})
        for number, window in enumerate(windows_of(opened)):
            for fault in window.faults:
                said = f"{fault.channel}: {fault.kind.replace('_', ' ')}" + (
                    f", {fault.detail}" if fault.detail else ""
                )
                lines.setdefault((fault.channel, fault.kind), said)
            if number < EXAMINED:
                for mistake in mistakes_of(known, window):
                    lines.setdefault((*mistake.channels, mistake.kind), mistake.text)
    return list(lines.values())


def contradicted_units(channels: Iterable[ChannelMapping], units: Mapping[str, str]) -> Iterator[str]:
    """A line for each channel whose unit in the mapping is not the one that the data file states (`units` by label)."""
    for channel in channels:
        stated = units[channel.label]
        known = UNITS.get(stated.strip().lower())
        if known is None or channel.unit in ("V", "unknown", "pulses", "quadrature", "s"):
            continue
        kind, unit, scale = known
        if kind != channel.kind:
            yield (
                f"{channel.key}: the file states {stated} for {channel.columns[0]!r}, which is no {channel.kind}: "
                f"columns exchanged?"
            )
            continue
        ratio = abs(channel.factor) / abs(CHANNEL_KINDS[kind].import_units[unit].factor * scale)
        if abs(ratio - 1) > SAME:
            size = f"{ratio:.4g} times" if ratio > 1 else f"1/{1 / ratio:.4g} of"
            yield (
                f"{channel.key}.unit = {channel.unit!r}: the file states {stated} for {channel.columns[0]!r}, and the "
                f"values come out {size} that; which is right?"
            )
