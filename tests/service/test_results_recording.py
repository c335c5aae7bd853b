"""A recording with the results in it: frames unchanged, results over time with units, a layout of what is there."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from mcap.reader import make_reader
from service_streams import write_recording

from service.cli import run
from service.contract.base import iso_time
from service.errors import InputError
from service.files.results_recording import INTERVAL, write_results
from service.stream.sources.mcap import Recording, read_windows

START_NS = 1_700_000_000 * 10**9


def answer_of(path, **parts):
    """An answer about the windows of a recording, such as `assess` gives."""
    _, _, windows = read_windows(path)
    records = [
        {
            "index": i, "kind": "measurement", "start_time_ns": w.start_time_ns,
            "start_time": iso_time(w.start_time_ns),
            "revolutions": 100.0 * i, "rms_measured": 1.0 + i, "rms_predicted": None, "wear_depth_um": 2.0 * i,
            "updated": False, "notes": ["a note"] if i == 1 else [],
        }
        for i, w in enumerate(windows)
    ]  # fmt: skip
    effect = {"name": "tooth_crack", "onset_revolutions": 100.0}
    status = {"level": "alarm", "reasons": ["A cracked tooth was found."]}
    return {"asset": "unsw", "windows": records, "effects": [effect], "status": status} | parts


def messages(path):
    """topic → (unit, [(time, message)]) of the JSON topics of a recording."""
    out = {}
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if channel.message_encoding == "json":
                _, found = out.setdefault(channel.topic, (channel.metadata.get("unit"), []))
                found.append((message.log_time, json.loads(message.data)))
    return out


@pytest.fixture
def written(tmp_path):
    source, out = write_recording(tmp_path / "source.mcap", 3), tmp_path / "results.mcap"
    layout = write_results(answer_of(source), source, out)
    return source, out, layout


def test_the_frames_and_the_rig_file_are_those_of_the_source(written):
    source, out, _ = written
    with Recording(source) as before, Recording(out) as after:
        assert list(before.messages()) == list(after.messages())
        assert before.rig_text == after.rig_text and after.metadata["asset"] == "unsw"


def test_every_channel_states_its_unit(written):
    _, out, _ = written
    with out.open("rb") as stream:
        channels = make_reader(stream).get_summary().channels.values()
    units = {c.topic.removeprefix("gearbox/unsw/"): c.metadata.get("unit") for c in channels}
    assert units["accel/y6"] == units["signal/accel/y6"] == "m/s²"
    assert units["torque/pinion"] == "N·m" and units["encoder/gear"] == "edges"


def test_the_results_are_numbers_over_time(written):
    _, out, _ = written
    _, windows = messages(out)["gearbox/unsw/twin/window"]
    assert [w["wear_depth_um"] for _, w in windows] == [0.0, 2.0, 4.0]
    assert all("rms_predicted" not in w and "updated" not in w for _, w in windows)  # neither missing nor yes or no
    assert [t for t, _ in windows] == sorted(t for t, _ in windows)


def test_status_effects_and_notes_are_a_log(written):
    _, out, _ = written
    _, said = messages(out)["gearbox/unsw/twin/log"]
    assert [(m["name"], m["level"], m["message"]) for _, m in said] == [
        ("window 1", 2, "a note"),
        ("effects", 3, "tooth crack begins"),
        ("status", 4, "alarm A cracked tooth was found."),
    ]
    for time_ns, message in said:
        assert message["timestamp"]["sec"] * 10**9 + message["timestamp"]["nsec"] == time_ns


def test_a_drawn_signal_keeps_its_extremes_where_they_are(written):
    source, out, _ = written
    _, _, windows = read_windows(source)
    first = windows[0].accelerations["y6"]
    unit, points = messages(out)["gearbox/unsw/signal/accel/y6"]
    drawn = [(t, m["value"]) for t, m in points if t < windows[0].start_time_ns + 2 * 10**9]
    values = [v for _, v in drawn]
    assert unit == "m/s²"
    assert min(values) == np.nanmin(first.values) and max(values) == np.nanmax(first.values)
    at = next(t for t, v in drawn if v == max(values))
    expected = windows[0].start_time_ns + (first.start + np.nanargmax(first.values) / first.rate) * 1e9
    assert at == pytest.approx(expected, abs=1e9 / first.rate)
    assert len(drawn) <= 2 * (first.duration / INTERVAL + 8)


def test_the_layout_names_only_what_is_in_the_recording(written):
    _, out, layout = written
    found = json.loads(layout.read_text())
    paths = [p["value"] for panel in found["configById"].values() for p in panel.get("paths", ())]
    there = messages(out)
    assert paths
    for path in paths:
        topic, key = re.fullmatch(r'"([^"]+)"\.(\w+)', path).groups()
        assert any(key in message for _, message in there[topic][1]), path
    listed = re.findall(r"\w+!gear-twin[-\d]*", json.dumps(found["layout"]))
    assert sorted(listed) == sorted(found["configById"])


def test_the_recording_itself_is_not_overwritten(tmp_path):
    source = write_recording(tmp_path / "source.mcap", 1)
    with pytest.raises(InputError, match="is the recording itself"):
        write_results(answer_of(source), source, source)


@pytest.mark.slow
def test_the_command_writes_recording_and_layout(tmp_path, capsys):
    out = tmp_path / "results.mcap"
    assert run(["assess", "recordings/short-campaign.mcap", "--no-trace", "--mcap", str(out)]) == 0
    assert "results.foxglove.json" in capsys.readouterr().err
    depth = [m["wear_depth_um"] for _, m in messages(out)["gearbox/unsw-short/twin/window"][1]]
    assert depth == sorted(depth) and depth[-1] > 40
