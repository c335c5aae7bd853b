"""A recording with the results written back into it, for players of recordings such as Foxglove.

The frames of the source are copied as they are. Beside them are topics of JSON messages, each with its schema:

    {prefix}/{asset}/twin/window        a message a measurement window: every number of its record, units in the names
    {prefix}/{asset}/twin/log           foxglove.Log: status, effects with their onset, notes
    {prefix}/{asset}/signal/{channel}   {"value": …}: the signal over time, thinned to its extremes in every interval

A layout file beside the recording shows them in Foxglove.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import FrameError, InputError
from service.file_faults import whole_file
from service.json_text import json_text, write_text
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import NS, Frame, SampleFrame
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import JsonTopic, RecordingWriter
from service.stream.wire.codec import decode
from service.stream.wire.topics import PREFIX

INTERVAL = 0.004  # of which a drawn signal shows the two extremes [s]
LEVELS = {"normal": 2, "no_verdict": 2, "watch": 3, "alarm": 4, "end_of_life": 5}  # severities of foxglove.Log
TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer", "minimum": 0}},
}
LOG = {
    "title": "foxglove.Log",
    "type": "object",
    "properties": {
        "timestamp": TIME,
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
}
PANELS = (
    ("Vibration level [m/s²]", ("rms_measured", "rms_predicted")),
    ("Wear depth [µm]", ("wear_depth_um", "wear_depth_p05_um", "wear_depth_p95_um")),
)


def write_results(
    answer: Mapping[str, Any],
    source: Path,
    out: Path,
    prefix: str = PREFIX,
    progress: Callable[[float, str], None] = lambda share, note: None,
) -> Path:
    """Writes the recording with the results, and a layout file for Foxglove; the path of the latter.

    answer  of `assess` about the recording `source`
    """
    asset = answer["asset"]
    if out.resolve() == source.resolve():
        raise InputError(f"{out}: is the recording itself; the results are written into a copy, give another name")
    records = sorted(_timed(answer["windows"]), key=lambda timed: timed[0])
    signals: dict[str, str] = {}  # topic → unit
    with Recording(source, prefix) as recording:
        about = {**recording.metadata, "results": "gear-twin assess"}
        with (
            whole_file(out) as part,
            RecordingWriter(part, rig_text=recording.rig_text, metadata=about, prefix=prefix) as writer,
        ):
            for raw in recording.messages():
                if raw.channel.asset != asset:
                    continue
                writer.write(raw.channel, raw.log_time_ns, raw.payload)
                try:
                    frame = decode(raw.channel, raw.payload)
                except FrameError:
                    continue  # copied as it is; there is nothing to draw
                for topic, time_ns, value in _drawn(frame, f"{prefix}/{asset}/signal"):
                    signals[topic.name] = topic.about["unit"]
                    writer.write_json(topic, time_ns, {"value": value})
                progress(recording.bytes_read / max(recording.size, 1), "")
            window = _window_topic(f"{prefix}/{asset}/twin/window", [record for _, record in records])
            for time_ns, record in records:
                writer.write_json(window, time_ns, record)
            log = JsonTopic(name=f"{prefix}/{asset}/twin/log", schema_name="foxglove.Log", schema=LOG)
            for time_ns, level, name, message in sorted(_log(answer, records)):
                at = {"sec": time_ns // NS, "nsec": time_ns % NS}
                said = {"timestamp": at, "level": level, "message": message, "name": name, "file": "", "line": 0}
                writer.write_json(log, time_ns, said)
    layout = out.with_suffix(".foxglove.json")
    keys = {key for _, record in records for key in record}
    write_text(layout, json_text(_layout(f"{prefix}/{asset}", keys, signals)))
    return layout


def _timed(windows: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, dict[str, float]]]:
    """Start of every window [Unix ns] with the numbers of its record."""
    for window in windows:
        time_ns = window.get("start_time_ns")
        if time_ns is not None:
            yield time_ns, {key: float(v) for key, v in window.items() if _is_number(v) and key != "start_time_ns"}


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _window_topic(name: str, records: Sequence[Mapping[str, float]]) -> JsonTopic:
    keys = sorted({key for record in records for key in record})
    schema = {"title": "gear_twin.Window", "type": "object", "properties": {key: {"type": "number"} for key in keys}}
    return JsonTopic(name=name, schema_name="gear_twin.Window", schema=schema)


def _log(
    answer: Mapping[str, Any], records: Sequence[tuple[int, Mapping[str, float]]]
) -> Iterator[tuple[int, int, str, str]]:
    """Time, severity, source and text of what happened."""
    if not records:
        return
    for effect in answer["effects"]:
        onset = effect.get("onset_revolutions") or 0.0
        since = next((t for t, record in records if record.get("revolutions", -1.0) >= onset), records[-1][0])
        name = effect["name"].replace("_", " ")
        yield since, LEVELS["watch"], "effects", f"{name} begins" if onset else f"{name} from the start"
    for window in answer["windows"]:
        if window.get("start_time_ns") is not None:
            for note in window.get("notes") or ():
                yield window["start_time_ns"], LEVELS["normal"], f"window {window['index']}", str(note)
    status = answer.get("status") or {}
    if status.get("level") in LEVELS:
        text = " ".join([status["level"].replace("_", " "), *status.get("reasons", ())])
        yield records[-1][0], LEVELS[status["level"]], "status", text


def _drawn(frame: Frame, folder: str) -> Iterator[tuple[JsonTopic, int, float]]:
    """A sampled frame as points over time: the least and the largest value of every interval, where they are."""
    if not isinstance(frame, SampleFrame):
        return
    kind = CHANNEL_KINDS[frame.channel.kind]
    about = {"quantity": kind.quantity, "unit": kind.unit}
    schema = {
        "title": "gear_twin.Signal", "type": "object",
        "properties": {"value": {"type": "number", "description": f"{kind.quantity} [{kind.unit}]"}},
    }  # fmt: skip
    name = f"{folder}/{frame.channel.label}"
    topic = JsonTopic(name=name, schema_name="gear_twin.Signal", schema=schema, about=about)
    values = frame.doubles
    length = max(2, round(INTERVAL * frame.sample_rate))
    for start in range(0, values.size, length):
        piece = values[start : start + length]
        known = np.flatnonzero(np.isfinite(piece))
        if known.size:
            ends = {int(known[np.argmin(piece[known])]), int(known[np.argmax(piece[known])])}
            for place in sorted(ends):
                time_ns = frame.start_time_ns + round((start + place) / frame.sample_rate * NS)
                yield topic, time_ns, float(piece[place])


def _layout(folder: str, keys: set[str], signals: Mapping[str, str]) -> dict[str, Any]:
    """A Foxglove layout: every signal, the trends of the results, and the log, one above the other."""
    start = f"{folder}/signal/"
    plots = [(f"{t.removeprefix(start)} [{unit}]", [f'"{t}".value']) for t, unit in signals.items()]
    for title, names in PANELS:
        found = [f'"{folder}/twin/window".{name}' for name in names if name in keys]
        if found:
            plots.append((title, found))
    panels: dict[str, Any] = {}
    for number, (title, paths) in enumerate(plots):
        panels[f"Plot!gear-twin-{number}"] = {
            "foxglovePanelTitle": title,
            "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths],
            "xAxisVal": "timestamp", "isSynced": True, "showLegend": True, "showXAxisLabels": True,
            "showYAxisLabels": True, "legendDisplay": "floating",
        }  # fmt: skip
    panels["Log!gear-twin"] = {"topicToRender": f"{folder}/twin/log", "minLogLevel": 1, "searchTerms": []}
    return {
        "configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1},
        "layout": _column(list(panels)),
    }  # fmt: skip


def _column(names: Sequence[str]) -> Any:
    """Panels one above the other, of equal height."""
    if len(names) == 1:
        return names[0]
    return {
        "direction": "column", "first": names[0], "second": _column(names[1:]),
        "splitPercentage": 100 / len(names),
    }  # fmt: skip
