"""`gear_twin.assess`, `gear-twin assess` and the service say the same of one recording under the same settings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import service_streams
from service_streams import FRAME_S, NS, Service
from typer.testing import CliRunner

import gear_twin
from service.cli.commands import app
from service.configuration.load import load
from service.runtime.by_settings import options_of, twin_of
from service.runtime.reception import assembly_settings
from service.runtime.replay import replay
from service.stream.assembly import DEFAULT
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode

LATE = {  # by asset: number of the frame of a channel's kind, and how many of its key come before it: 17 to 23
    "level": {"accel": (3, 20)},
    "torque": {"torque": (1, 18)},
    "edges-and-level": {"encoder": (5, 22), "accel": (8, 18)},
}
FRAMES = 36  # of one window of 9 s
RIG = (
    b'schema = "gear-rig/1"\nname = "small"\n[gears]\npinion.teeth = 19\ngear.teeth = 52\n'
    b'[sensors]\naccelerometer = "y6"\nband_hz = [0.0, 800.0]\n'
)

pytestmark = pytest.mark.slow


def recording_of(path: Path, asset: str, moved: dict[str, tuple[int, int]]) -> Path:
    """One window; frame `number` of a channel's kind comes `by` frames of that channel later than in order."""
    rng, frames = np.random.default_rng(3), []
    for number in range(FRAMES):
        at = 1_700_000_000 * NS + round(number * FRAME_S * NS)
        frames.append(list(service_streams._frames(asset, at, number, 10.0, rng, 0)))
    with RecordingWriter(path, rig_text=RIG, metadata={"asset": asset}) as writer:
        for i in range(len(frames[0])):
            number, by = moved.get(frames[0][i].channel.kind, (0, 0))
            keyed = [each[i] for each in frames]
            keyed.insert(number + by, keyed.pop(number))
            for each, frame in zip(frames, keyed, strict=True):
                each[i] = frame
        for number, each in enumerate(frames, start=1):
            for frame in each:
                writer.write(frame.channel, 1_700_000_000 * NS + round(number * FRAME_S * NS), encode(frame))
    return path


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(service_streams, "WINDOW_S", FRAMES * FRAME_S)
        return {asset: recording_of(folder / f"{asset}.mcap", asset, moved) for asset, moved in LATE.items()}


@pytest.fixture(scope="module")
def served(recordings, tmp_path_factory):
    """What a service answers that was sent the recordings."""
    running = Service(tmp_path_factory.mktemp("service"))
    running.program = service_streams.HERE / "twin_by_settings.py"
    running.start()
    try:
        for path in recordings.values():
            replay(path, [running.endpoint], 0)
        return {
            asset: {"windows": running.wait_for_windows(1, asset, seconds=240), **running.get(f"/v1/assets/{asset}")}
            for asset in recordings
        }
    finally:
        running.end()


@pytest.mark.parametrize("asset", LATE)
def test_a_frame_that_comes_twenty_late_is_judged_alike_in_python_by_command_and_by_the_service(
    recordings, served, tmp_path, asset
):
    path, out = recordings[asset], tmp_path / "answer.json"
    in_python = gear_twin.assess(path).json
    done = CliRunner().invoke(app, ["assess", str(path), "--json", str(out)])
    assert done.exit_code == 0, done.output
    by_command = json.loads(out.read_text())
    assert in_python["windows"] == by_command["windows"] == served[asset]["windows"]
    assert [w["quality"] for w in in_python["windows"]] == ["good"]
    assert in_python["status"]["level"] == by_command["status"]["level"] == served[asset]["status"]["level"]


def test_status_limits_rate_of_false_alarms_and_update_of_the_settings_hold_for_all_three(tmp_path, monkeypatch):
    for name, value in (("LIFE_HORIZON_HOURS", "7"), ("FALSE_ALARM_RATE", "0.002"), ("UPDATE", "rms")):
        monkeypatch.setenv(f"GEAR_TWIN_{name}", value)
    path, seen = recording_of(tmp_path / "plain.mcap", "unsw", {}), []
    from service.runtime import assess as assessing

    monkeypatch.setattr(assessing, "gear_twin", noting(seen, assessing.gear_twin))
    gear_twin.assess(path)
    assert CliRunner().invoke(app, ["assess", str(path), "--json", str(tmp_path / "a.json")]).exit_code == 0
    served_by = twin_of(load()).options
    assert seen == [served_by, served_by] and len(seen) == 2
    assert (served_by.status_limits.horizon, served_by.false_alarm_rate) == (7 * 3600.0, 0.002)
    assert served_by.update == "rms"


def noting(seen: list, make):
    """`make`, whose options are noted."""

    def made(options):
        seen.append(options)
        return make(options)

    return made


def test_options_given_to_a_command_are_used_in_place_of_the_settings():
    settings = load(false_alarm_rate=0.002, update="rms")
    chosen = options_of(settings, update="fused", false_alarm_rate=0.05, trace=False)
    assert (chosen.update, chosen.false_alarm_rate, chosen.trace) == ("fused", 0.05, False)
    assert options_of(settings).update == "rms"


def test_windows_are_cut_alike_with_and_without_settings():
    assert assembly_settings(load()) == DEFAULT
