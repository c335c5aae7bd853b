"""Channels whose first frames stand late in a recording are in all windows, whoever reads it."""

from __future__ import annotations

from dataclasses import replace

import fake_twin
import pytest
from service_streams import write_recording
from streams import ACCEL, ASSET, CHANNELS, bursts

from service.files.rig import rig_of
from service.fleet.segments import Segments
from service.results.stored_recordings import stored_recordings
from service.runtime.assess import assess, assess_source
from service.signals.recorded import recorded_subject
from service.stream.assembly import DEFAULT
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode
from service.stream.wire.topics import PREFIX

WINDOWS = 4
SECOND = "y9"  # an accelerometer that the rig file does not name


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """The second accelerometer's frames stand behind others that are up to 9.5 s younger: the file is not sorted."""
    folder = tmp_path_factory.mktemp("late")
    path = folder / ASSET / "1700000000000000000.mcap"
    path.parent.mkdir()
    frames = bursts(WINDOWS, frames=10)
    seconds = [replace(f, channel=f.channel._replace(name=SECOND)) for f in frames if f.channel == ACCEL]
    early = len(CHANNELS) * 18
    with (
        Recording(write_recording(folder / "plain.mcap", 1)) as plain,
        RecordingWriter(path, rig_text=plain.rig_text) as writer,
    ):
        for frame in frames[:early] + seconds[:18] + sorted(frames[early:] + seconds[18:], key=lambda f: f.end_time_ns):
            writer.write(frame.channel, frame.end_time_ns, encode(frame))
    return path


def noting(sensors):
    """A twin that notes the accelerometers of each window."""

    def step(rig, state, window, options):
        sensors.append(set(window.accelerations))
        return fake_twin.step(rig, state, window, options)

    return replace(fake_twin.TWIN, step=step)


def test_in_a_file_that_is_assessed(recording):
    sensors = []
    assess(recording, twin=noting(sensors))
    assert sensors == [{"y6", SECOND}] * WINDOWS


def test_in_segments_that_are_assessed(recording):
    sensors = []
    (found,) = stored_recordings([str(recording.parent)])
    with Segments("segments", found.parts, PREFIX, any_rig=False) as source:
        assess_source(source, ASSET, rig_of(source, None), noting(sensors))
    assert sensors == [{"y6", SECOND}] * WINDOWS


def test_in_a_window_that_is_looked_at(recording):
    subject = recorded_subject(recording, 0, rig_path=None, asset=None, prefix=PREFIX, assembly=DEFAULT, modelled=False)
    assert set(subject.window.accelerations) == {"y6", SECOND}
