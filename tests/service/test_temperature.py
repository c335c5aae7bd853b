"""A temperature channel all the way: imported or replayed, windowed, kept in the store, shown on the page."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import service_fakes as fakes
from service_streams import PAUSE_S, free_port, service, write_recording

from service.files.import_recording import import_recording
from service.runtime.assess import assess
from service.runtime.record import record
from service.runtime.replay import replay
from service.stream.frames import NS, SampleFrame
from service.stream.inbox import Inbox
from service.stream.sources.mcap import Recording, read_windows
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode
from service.stream.wire.topics import Channel
from service.transport.zenoh import ZenohTransport, open_session
from tests.service import fake_twin

WINDOWS = 4


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A campaign with an oil temperature every 10 s: 50 °C at first, 0.1 K a value."""
    folder = tmp_path_factory.mktemp("temperature")
    plain, out = write_recording(folder / "plain.mcap", WINDOWS), folder / "oil.mcap"
    channel, start = Channel("unsw", "temperature", "oil"), 1_700_000_000 * NS
    with Recording(plain) as source, RecordingWriter(out, rig_text=source.rig_text) as writer:
        messages = [(m.log_time_ns, m.channel, m.payload) for m in source.messages()]
        for i in range(int((WINDOWS - 1) * PAUSE_S / 10) + 1):
            frame = SampleFrame(
                channel=channel,
                start_time_ns=start + i * 10 * NS + NS // 2,
                sequence=i,
                sample_rate=0.1,
                values=np.array([50 + 0.1 * i], np.float32),
            )
            messages.append((frame.end_time_ns, channel, encode(frame)))
        for time, target, payload in sorted(messages, key=lambda m: m[0]):
            writer.write(target, time, payload)
    return out


def temperatures(windows):
    return [w["temperatures"]["oil"] for w in windows]


def expected():
    return [{"value": pytest.approx(50 + 0.6 * w, abs=1e-5), "unit": "°C", "values": 1, "age_s": pytest.approx(1.5)}
            for w in range(WINDOWS)]  # fmt: skip


def test_assess_shows_the_temperatures_of_each_window(recording):
    answer = assess(recording, twin=fake_twin.TWIN)
    assert temperatures(answer["windows"]) == expected()
    assert answer["data_quality"]["channels"]["temperature/oil"] == {"frames": 19}


@pytest.mark.slow
def test_a_replayed_temperature_is_in_the_window_records_that_the_store_keeps(recording, tmp_path):
    with service(tmp_path, IDLE_TIMEOUT="5") as running:
        replay(recording, [running.endpoint], 4, max_pause=0.5)  # slow channels are not waited for: at a live pace
        kept = running.wait_for_windows(WINDOWS)
        assert temperatures(kept[1:]) == expected()[1:]  # the first window may end before its key has been heard
    with service(tmp_path) as again:
        assert again.wait_for_windows(WINDOWS) == kept


def test_a_live_temperature_is_recorded(recording, tmp_path):
    endpoint, out = f"tcp/127.0.0.1:{free_port()}", tmp_path / "out.mcap"
    stop, inbox = threading.Event(), Inbox()
    with open_session(listen=[endpoint]) as session:
        thread = threading.Thread(target=lambda: record(ZenohTransport(session), inbox, out, stop=stop))
        thread.start()
        replay(recording, [endpoint], 0)
        stop.set()
        thread.join()
    assert [w.slow for w in read_windows(out)[2]] == [w.slow for w in read_windows(recording)[2]]


@pytest.mark.parametrize(("unit", "factor", "offset"), [("degC", 1, 0), ("K", 1, 273.15), ("degF", 1.8, 32)])
def test_a_column_of_temperatures_is_imported_as_one_value_a_second(tmp_path, unit, factor, offset):
    rate, celsius = 2000.0, 60 + np.arange(8000) / 8000
    vibration = np.random.default_rng(1).standard_normal(8000)
    np.savez(tmp_path / "data.npz", a=vibration, oil=factor * celsius + offset)
    (tmp_path / "mapping.toml").write_text(f"""
schema = "gear-import/1"
asset = "bench"
[file]
path = "data.npz"
sample_rate_hz = {rate:g}
[channels.a]
unit = "m/s2"
[channels.oil]
kind = "temperature"
unit = "{unit}"
""")
    summary = import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")
    assert summary["channels"]["temperature/oil"] == unit
    (window,) = read_windows(tmp_path / "out.mcap")[2]
    oil = window.slow["temperature/oil"]
    assert (oil.count, oil.value) == (4, pytest.approx(273.15 + celsius.mean(), abs=1e-4))


@pytest.mark.slow
def test_the_page_shows_the_latest_temperature_with_its_unit_and_age(open_page, store, board):
    window = {"value": 61.25, "unit": "°C", "values": 0, "age_s": 12.0}
    given = fakes.record(0, 10.0) | {"temperatures": {"oil": window}}
    original = fakes.record
    try:
        fakes.record = lambda *_, **__: dict(given)
        fakes.take(store, board, "unsw", 0, 10.0)
    finally:
        fakes.record = original
    page = open_page("/#/asset/unsw")
    page.wait_for_selector("main[data-windows='1']")
    shown = page.inner_text("main")
    assert "temperature oil" in shown.lower() and "61.3 °C" in shown and "12 s old" in shown
