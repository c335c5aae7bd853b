"""Raw recordings moved to an object store: named by machine and time, bounded, and waited for by nobody."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from dataclasses import replace

import fake_twin
import pytest
from memory_transport import MemoryNetwork
from service_streams import Service, wait_until, write_recording
from streams import ASSET, bursts

from service.cli import run
from service.errors import StoreError
from service.fleet.assess_task import Work, assess_one
from service.json_text import plain
from service.results.object_store import ObjectStore
from service.results.raw_recordings import RawLimits, RawRecordings
from service.results.raw_segments import SegmentSender
from service.results.stored_recordings import stored_recordings
from service.runtime.assess import assess
from service.runtime.raw_recorder import keep_recording
from service.runtime.recorder import Recorded
from service.runtime.replay import replay
from service.settings import Settings
from service.stream.assembly import DEFAULT
from service.stream.sources.mcap import Recording
from service.stream.wire.codec import encode
from service.stream.wire.topics import topic_of

ROOM = RawLimits(roll_bytes=10**9, roll_seconds=3600.0, keep_bytes=10**9, keep_seconds=10**9, spare_bytes=0)


class Store:
    """A folder as an object store, which can be away."""

    def __init__(self, folder, **limits):
        self.folder, self.away, self.now = folder / "store", False, time.time()
        self.spool = RawRecordings(
            folder / "spool", RawLimits(**{f: getattr(ROOM, f) for f in ROOM.__slots__} | limits)
        )
        self.spool.begin()

    def open(self):
        if self.away:
            raise StoreError("the store is away")
        return ObjectStore(f"file://{self.folder}", make=True)

    def sender(self, keep_bytes=10**9, keep_seconds=10**9):
        return SegmentSender(
            self.spool.folder, self.open, keep_bytes=keep_bytes, keep_seconds=keep_seconds, prefix="gearbox",
            pauses=(0.05, 0.1), now=lambda: self.now,
        )  # fmt: skip

    def record(self, frames):
        for frame in frames:
            self.spool.write(frame.channel, frame.start_time_ns, frame.end_time_ns, encode(frame))
        self.spool.close()

    @property
    def objects(self):
        return sorted(str(path.relative_to(self.folder)) for path in self.folder.rglob("*.mcap"))

    @property
    def waiting(self):
        return sorted(self.spool.folder.glob("*/*"))


def test_completed_recordings_are_moved_under_their_machine_and_time(tmp_path):
    store, frames = Store(tmp_path), bursts(2)
    store.record(frames)
    sender = store.sender()
    try:
        wait_until(lambda: not store.waiting, 10.0)
        assert store.objects == [f"rig/{ASSET}/{frames[0].start_time_ns}.mcap"]
        assert sender.figures()["raw_segments_stored"] == 1
        assert store.spool.files == 1
        wait_until(lambda: sender.turn(store.spool) or store.spool.files == 0, 10.0)
        assert (store.spool.files, store.spool.size, store.spool.deleted) == (0, 0, 0)
    finally:
        sender.end()
    assert not sender.thread.is_alive()
    with Recording(store.folder / store.objects[0]) as recording:
        assert sum(1 for _ in recording.messages()) == len(frames)


def test_a_machine_whose_name_states_an_area_is_kept_under_it(tmp_path):
    store = Store(tmp_path)
    with Recording(write_recording(tmp_path / "a.mcap", 1, "hall-2.press.gearbox")) as recording:
        store.record(recording.frames(lambda channel, error: pytest.fail(str(error))))
    store.sender().end()
    assert store.objects == ["hall-2.press/hall-2.press.gearbox/1700000000000000000.mcap"]


def test_recordings_wait_while_the_store_is_away_and_the_spool_is_bounded(tmp_path, caplog):
    caplog.set_level("INFO")
    store, frames = Store(tmp_path, keep_bytes=20_000), bursts(1)
    store.away = True
    sender = store.sender()
    try:
        for number in range(20):
            store.record([frames[number]])
            store.spool.turn()
        store.spool._delete_old()
        assert 0 < len(store.waiting) < 20 and store.spool.size <= 20_000 and store.spool.deleted
        left = len(store.waiting)
        wait_until(lambda: sender.figures()["raw_segments_failed"] > 2, 10.0)
        wait_until(lambda: sender.figures()["raw_store_unavailable"] == 1.0, 10.0)
        assert "cannot be moved to the object store: the store is away" in caplog.text
        store.away = False
        wait_until(lambda: not store.waiting and sender.figures()["raw_store_unavailable"] == 0.0, 10.0)
        assert len(store.objects) == left and sender.figures()["raw_segments_waiting"] == 0
        assert "are moved to" in caplog.text
    finally:
        sender.end()


def test_a_recording_that_was_moved_before_a_kill_is_not_kept_twice_and_another_of_its_time_is(tmp_path):
    store, frames = Store(tmp_path), bursts(2)
    store.record(frames)
    (path,) = store.waiting
    content = path.read_bytes()
    store.sender().end()
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    store.sender().end()
    assert len(store.objects) == 1 and not store.waiting
    store.record(frames[:10])
    store.sender().end()
    stem = f"rig/{ASSET}/{frames[0].start_time_ns}"
    assert store.objects == [f"{stem}.mcap", f"{stem}_2.mcap"] and not store.waiting


def test_what_holds_no_frame_is_deleted_and_said(tmp_path, caplog):
    store = Store(tmp_path)
    (store.spool.folder / ASSET).mkdir()
    (store.spool.folder / ASSET / "x.mcap").write_bytes(b"no recording")
    store.sender().end()
    assert not store.waiting and not store.objects and "holds no frame" in caplog.text


def test_the_store_is_bounded_by_age_and_size_and_other_objects_stay(tmp_path):
    store, frames = Store(tmp_path), bursts(5)
    for begin in range(0, 50, 10):
        store.record(frames[begin : begin + 10])
    store.sender().end()
    (store.folder / "other.json").write_bytes(b"x" * 10**6)
    paths = [store.folder / name for name in store.objects]
    assert len(paths) == 5
    for age, path in enumerate(reversed(paths)):
        os.utime(path, (store.now - 3600 * age,) * 2)
    size = sum(path.stat().st_size for path in paths[3:])
    sender = store.sender(keep_bytes=size)
    sender.end()
    assert [store.folder / name for name in store.objects] == paths[3:]
    assert sender.figures()["raw_segments_deleted"] == 3
    store.sender(keep_seconds=1800.0).end()
    assert [store.folder / name for name in store.objects] == paths[4:]
    assert (store.folder / "other.json").exists()


def test_a_url_of_no_object_store_is_refused(capsys, monkeypatch):
    monkeypatch.setenv("GEAR_TWIN_RAW_URL", "ftp://host/raw")
    assert run(["config"]) == 2
    assert "such as s3://bucket/raw" in capsys.readouterr().err


@pytest.mark.slow
def test_the_settings_make_a_recorder_whose_recordings_are_moved(tmp_path):
    settings = Settings(data=tmp_path / "data", raw_url=f"file://{tmp_path}/store", raw_spare_gb=0)
    network, stop, done = MemoryNetwork(), threading.Event(), []
    recording = threading.Thread(target=lambda: done.append(keep_recording(settings, network.open, stop=stop)))
    recording.start()
    assert network.subscribed.wait(10)
    for frame in bursts(1):
        network.inbox.offer(topic_of(frame.channel), encode(frame))
    stop.set()
    recording.join(30)
    assert done == [Recorded(frames=len(bursts(1)))]
    assert [path.parent.name for path in (tmp_path / "store").rglob("*.mcap")] == [ASSET]
    assert not list((tmp_path / "data" / "raw").rglob("*.mcap*"))


def frames_of(path):
    with Recording(path) as recording:
        return list(recording.messages())


@pytest.mark.slow
def test_a_service_s_segments_are_assessed_as_one_recording(tmp_path):
    recording = write_recording(tmp_path / "a.mcap", 4)
    expected = plain(assess(recording, twin=fake_twin.TWIN))
    url = f"file://{tmp_path}/store"
    running = Service(tmp_path / "data", RAW_URL=url, RAW_SPARE_GB="0").start()
    try:
        wait_until(lambda: "gear_twin_raw_recording_stopped 0.0" in running.text("/metrics"))
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(4)
        sent = len(frames_of(recording))
        wait_until(lambda: f"gear_twin_raw_frames_recorded_total {sent}.0" in running.text("/metrics"))
        assert "gear_twin_raw_store_unavailable 0.0" in running.text("/metrics")
    finally:
        running.end(signal.SIGTERM)
    (found,) = stored_recordings([url])
    work = Work(
        results=f"{tmp_path}/results", options=None, assembly=DEFAULT, prefix="gearbox", given={}, twin=fake_twin.TWIN
    )
    outcome = assess_one(work, found)
    answer = json.loads((tmp_path / "results" / outcome.result).read_text())
    assert answer["windows"] == expected["windows"]


@pytest.mark.parametrize("asset", ["a", "m", "z"])
def test_a_recording_that_cannot_be_moved_is_named_and_neither_holds_up_others_nor_makes_the_store_unavailable(
    tmp_path, monkeypatch, caplog, asset
):
    store, put = Store(tmp_path), SegmentSender._put

    def refusing(self, path, name, start):
        if name == asset:
            raise ValueError("such a name cannot be kept")
        put(self, path, name, start)

    monkeypatch.setattr(SegmentSender, "_put", refusing)
    for name in ("a", "b", "m", "z"):
        store.record(replace(frame, channel=frame.channel._replace(asset=name)) for frame in bursts(1))
    sender = store.sender()
    try:
        wait_until(lambda: len(store.objects) == 3 and sender.figures()["raw_segments_failed"], 10.0)
        assert len(store.waiting) == 1 and sender.figures()["raw_segments_waiting"] == 1
        store.record(replace(frame, channel=frame.channel._replace(asset="later")) for frame in bursts(1))
        wait_until(lambda: len(store.objects) == 4, 10.0)
        assert sender.figures()["raw_store_unavailable"] == 0.0
        assert caplog.text.count("stays in the spool") == 1 and str(store.waiting[0]) in caplog.text
    finally:
        sender.end()
