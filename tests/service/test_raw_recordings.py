"""Frames that the service uses, kept as rolling MCAP recordings: what `record` writes, bounded, whole after a kill."""

from __future__ import annotations

import errno
import signal
import threading
import time
import tomllib
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import fake_twin
import pytest
import service_fakes as fakes
from mcap.reader import make_reader
from service_streams import Service, wait_until, write_recording
from streams import ASSET, bursts, content, unbroken

from service.cli import run
from service.errors import InputError
from service.json_text import plain
from service.results.raw_recordings import RawLimits, RawRecordings, kept_in
from service.results.stored_recordings import stored_recordings
from service.runtime.assess import assess
from service.runtime.raw_recorder import RawRecorder, rig_texts
from service.runtime.reception import Reception
from service.runtime.replay import replay
from service.setup.toml_text import document_text
from service.stream.sources.mcap import Recording, read_windows
from service.stream.windows import Windows
from twin.rig import Rig

RIG = b'name = "unsw"\n[gears.pinion]\nteeth = 19\n'
ROOM = RawLimits(roll_bytes=10**9, roll_seconds=3600.0, keep_bytes=10**9, keep_seconds=10**9, spare_bytes=0)


class Disk:
    """A folder of recordings on a clock and a disk of its own."""

    def __init__(self, folder, **limits):
        self.now, self.free = 1000.0, 10**12
        given = {f: getattr(ROOM, f) for f in ROOM.__slots__} | limits
        self.folder, self.rig = folder / "raw", RIG
        self.recordings = RawRecordings(
            self.folder, RawLimits(**given), rig_text_of=lambda asset: self.rig, clock=lambda: self.now,
            now=lambda: time.time() + self.now - 1000.0, free=lambda folder: self.free,
        )  # fmt: skip
        self.recordings.begin()

    def write(self, frames, pace=0.0):
        for each in frames:
            self.recordings.write(each)
            self.now += pace
            self.recordings.turn()

    @property
    def files(self):
        return sorted(path for path in self.folder.glob("*/*"))


def windows(frames):
    assembler = Windows()
    return content([w for f in frames for w in assembler.add(f)] + assembler.flush())


def of_files(paths):
    frames = []
    for path in paths:
        with Recording(path) as recording:
            assert recording.faults == []
            frames += recording.frames(lambda channel, error: pytest.fail(str(error)))
    return frames


def test_a_recording_holds_what_was_used_and_every_tool_reads_it(tmp_path):
    disk, frames = Disk(tmp_path), bursts(3)
    disk.write(frames)
    disk.recordings.close()
    (path,) = disk.files
    assert path.parent.name == ASSET and path.name == f"{ASSET}_20231114T221320.000Z.mcap"
    rig, metadata, found = read_windows(path)
    assert rig == tomllib.loads(RIG.decode()) and metadata["asset"] == ASSET
    assert content(found) == windows(frames)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary.statistics.message_count == len(frames) and summary.chunk_indexes
    assert disk.recordings.newest_ns == max(f.end_time_ns for f in frames)


def test_frames_that_are_left_out_are_not_recorded(tmp_path):
    used, frames = [], bursts(2)
    reception = Reception(lambda asset: Rig.from_mapping({}), lambda closed: None, used=used.append)
    for each in (*frames, *frames):  # sent again
        reception.feed(each)
    assert used == frames


def test_recordings_are_completed_by_size_age_and_silence_and_together_hold_every_frame(tmp_path):
    frames = unbroken(60.0)
    for limits, pace in (({"roll_bytes": 20_000}, 0.1), ({"roll_seconds": 10.0}, 0.1)):
        disk = Disk(tmp_path / next(iter(limits)), **limits)
        disk.write(frames, pace)
        disk.recordings.close()
        assert len(disk.files) > 5
        assert windows(of_files(disk.files)) == windows(frames)
    silent = Disk(tmp_path / "silent")
    silent.write(frames)
    assert [path.suffix for path in silent.files] == [".part"]
    silent.now += 700.0
    silent.recordings.turn()
    assert [path.suffix for path in silent.files] == [".mcap"]


def test_frames_after_a_change_of_the_rig_file_are_in_another_recording_that_holds_the_new_one(tmp_path):
    disk, frames = Disk(tmp_path), bursts(4)
    quarter = len(frames) // 4
    disk.write(frames[:quarter])
    disk.rig = None  # not known for a while: what was known holds
    disk.write(frames[quarter : 2 * quarter])
    disk.rig = RIG.replace(b"19", b"21")
    disk.write(frames[2 * quarter :])
    disk.recordings.close()
    found = {}
    for path in disk.files:
        with Recording(path) as recording:
            found[recording.rig_text] = [f.sequence for f in recording.frames(lambda channel, error: None)]
    assert found == {
        RIG: [f.sequence for f in frames[: 2 * quarter]],
        disk.rig: [f.sequence for f in frames[2 * quarter :]],
    }
    assert windows(of_files(disk.files)) == windows(frames)


def test_the_text_of_a_rig_file_is_written_once_for_as_long_as_it_holds():
    board = fakes.scratch_table()
    text_of = rig_texts(board)
    assert text_of(ASSET) is None
    board.update(ASSET, rig={"name": "before"})
    before = text_of(ASSET)
    board.update(ASSET, last_frame_ns=1)
    assert text_of(ASSET) is before and tomllib.loads(before.decode()) == {"name": "before"}
    board.update(ASSET, rig={"name": "after"})
    assert tomllib.loads(text_of(ASSET).decode()) == {"name": "after"}


def test_oldest_recordings_are_deleted_beyond_their_size_and_age_and_for_others_on_the_disk(tmp_path):
    frames = unbroken(120.0)
    sized = Disk(tmp_path / "sized", roll_bytes=20_000, keep_bytes=100_000)
    sized.write(frames, 0.1)
    sized.recordings.close()
    assert sized.recordings.deleted > 3 and sized.recordings.size <= 130_000
    left = of_files(sized.files)
    assert left[-1].start_time_ns == frames[-1].start_time_ns and left[0].start_time_ns > frames[0].start_time_ns
    aged = Disk(tmp_path / "aged", roll_bytes=20_000, keep_seconds=3600.0)
    aged.write(frames, 0.1)
    count = len(aged.files)
    aged.now += 4000.0
    aged.recordings.turn()
    assert count > 5 and [path.suffix for path in aged.files] in ([".part"], [".mcap"], [])
    spared = Disk(tmp_path / "spared", roll_bytes=20_000, spare_bytes=10**9)
    spared.write(frames[:400], 0.1)
    spared.free = 10**8
    spared.now += 3.0
    with pytest.raises(OSError, match=r"0.1 GB are free"):
        spared.recordings.turn()
    spared.recordings.abandon()
    assert [path.suffix for path in spared.files] == [".part"]
    with pytest.raises(OSError, match=r"0.1 GB are free") as raised:
        spared.recordings.write(frames[400])
    assert raised.value.errno == errno.ENOSPC


@pytest.mark.parametrize("torn", [0, 1, 700])
def test_recording_of_a_killed_process_is_completed_up_to_its_last_chunk(tmp_path, torn):
    disk, frames = Disk(tmp_path), unbroken(20.0)
    disk.write(frames[:240], 0.05)
    disk.recordings.abandon()
    (left,) = disk.files
    if torn:
        left.write_bytes(left.read_bytes()[:-torn])
    again = Disk(tmp_path)
    (path,) = again.files
    assert path == left.with_suffix("")
    found = of_files([path])
    assert 100 < len(found) <= 240
    assert [(f.channel, f.sequence) for f in found] == [(f.channel, f.sequence) for f in frames[: len(found)]]
    assert content(read_windows(path)[2]) == windows(frames[: len(found)])


def test_what_a_kill_leaves_while_it_is_completed_is_completed_again_and_nothing_readable_is_kept(tmp_path):
    disk = Disk(tmp_path)
    disk.write(unbroken(20.0)[:240], 0.05)
    disk.recordings.abandon()
    (left,) = disk.files
    left.with_suffix(".completed").write_bytes(b"half")
    left.with_name("empty.mcap.part").write_bytes(b"")
    again = Disk(tmp_path)
    assert again.files == [left.with_suffix("")]
    kept = kept_in(disk.folder)
    assert (kept.recordings, kept.unfinished) == (1, 0) and kept.bytes == again.recordings.size


def test_names_do_not_collide(tmp_path):
    disk, frames = Disk(tmp_path), bursts(1)
    for _ in range(3):
        disk.write(frames)
        disk.recordings.close()
    assert len(disk.files) == 3


def test_assets_whose_names_a_file_system_does_not_keep_apart_are_recorded_and_assessed_apart(share):
    disk, assets = Disk(share), ("unsw", "UNSW", "con", "x.", ".")
    for asset in (*assets, *assets):
        disk.write([replace(f, channel=f.channel._replace(asset=asset)) for f in bursts(1)])
        disk.recordings.close()
    stored = stored_recordings([str(disk.folder)])
    assert len(stored) == len(assets) and {len(each.parts) for each in stored} == {2}
    with ExitStack() as stack:
        found = [stack.enter_context(Recording(Path(each.parts[0].name))).assets for each in stored]
    assert sorted(found) == sorted([asset] for asset in assets)


# -- the thread --------------------------------------------------------------------------------------------


class Failing:
    """A disk that fails, or waits."""

    def __init__(self):
        self.folder, self.size, self.files, self.newest_ns, self.deleted = Path("raw"), 0, 0, 0, 0
        self.fails, self.written, self.abandoned = False, [], 0
        self.goes_on = threading.Event()
        self.goes_on.set()

    def begin(self):
        self._fail()

    def _fail(self):
        if self.fails:
            raise OSError(errno.ENOSPC, "No space left on device")

    def write(self, frame):
        self._fail()
        self.goes_on.wait(30)
        self.written.append(frame)

    def turn(self):
        pass

    def close(self):
        pass

    def abandon(self):
        self.abandoned += 1


@pytest.mark.slow
def test_a_full_disk_stops_the_recording_alone_is_said_and_it_goes_on_by_itself(caplog):
    caplog.set_level("INFO")
    disk = Failing()
    recorder, frames = RawRecorder(disk), bursts(4)
    try:
        for frame in frames[:10]:
            recorder.offer(frame)
        wait_until(lambda: len(disk.written) == 10, 10.0)
        disk.fails = True
        for frame in frames[10:20]:
            recorder.offer(frame)
        wait_until(lambda: recorder.figures()["raw_frames_left_out"] == 10, 10.0)
        assert recorder.figures()["raw_recording_stopped"] == 1.0 and disk.abandoned
        assert "cannot be written: No space left on device" in caplog.text
        disk.fails = False
        wait_until(lambda: recorder.figures()["raw_recording_stopped"] == 0.0, 20.0)
        for frame in frames[20:30]:
            recorder.offer(frame)
        wait_until(lambda: len(disk.written) == 20, 10.0)
        assert "go on" in caplog.text and recorder.thread.is_alive()
        assert recorder.figures()["raw_frames_recorded"] == 20
    finally:
        recorder.end()
    assert not recorder.thread.is_alive()


def test_a_slow_disk_holds_nobody_up_and_what_is_left_out_is_counted():
    disk = Failing()
    disk.goes_on.clear()
    recorder, frames = RawRecorder(disk, waiting_bytes=20_000), unbroken(60.0)
    try:
        began = time.monotonic()
        for frame in frames:
            recorder.offer(frame)
        assert time.monotonic() - began < 15.0
        left_out = recorder.figures()["raw_frames_left_out"]
        assert len(frames) - 60 < left_out < len(frames)
        disk.goes_on.set()
    finally:
        recorder.end()
    assert len(disk.written) == len(frames) - left_out


def test_a_rig_file_is_written_as_it_is():
    shared = Path(__file__).parents[2] / "recordings" / "rigs"
    documents = [tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(shared.glob("*.toml"))]
    odd = {
        "name": 'a "b"',
        "a b": {"c.d": {"x": 1e-9, "y": [1, 2.5, True]}, "list": [{"p": 1, "q": "r"}]},
        "n": 0.1 + 0.2,
    }
    for document in (*documents, odd):
        assert tomllib.loads(document_text(document)) == document
    assert documents and document_text({"a": None, "b": 1}) == "b = 1\n"


# -- the service -------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_killed_service_leaves_recordings_that_can_be_assessed_and_replayed(tmp_path, capsys):
    recording = write_recording(tmp_path / "a.mcap", 4)
    folder = tmp_path / "raw"
    given = {"RAW_FOLDER": str(folder), "RAW_SPARE_GB": "0"}
    expected = plain(assess(recording, twin=fake_twin.TWIN))
    running = Service(tmp_path / "data", **given).start()
    folder = folder / running.folder.relative_to(tmp_path / "data")
    try:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(4)
        wait_until(lambda: handed_on(folder) == handed_on(tmp_path, "a.mcap"))
        assert "gear_twin_raw_recording_stopped 0.0" in running.text("/metrics")
    finally:
        running.end(signal.SIGKILL)
    assert [path.suffix for path in folder.glob("unsw/*")] == [".part"]
    running = Service(tmp_path / "data", **given).start()
    try:
        wait_until(lambda: [path.suffix for path in folder.glob("unsw/*")] == [".mcap"], 20.0)
        (kept,) = folder.glob("unsw/*")
        found = plain(assess(kept, twin=fake_twin.TWIN))
        assert found["windows"] == expected["windows"]
        replay(kept, [running.endpoint], 0)  # all of it is known
        assert len(running.windows()) == 4
    finally:
        running.end(signal.SIGTERM)
    if Service.fleets is not None:  # it is for what `serve` keeps
        return
    assert run(["check", "--data", str(tmp_path / "data"), "--config", str(config(tmp_path, folder))]) == 0
    assert "1 raw recordings, " in capsys.readouterr().err


def handed_on(folder, pattern="unsw/*.part"):
    """How many frames a recording holds, which may be being written."""
    (path,) = folder.glob(pattern)
    try:
        with Recording(path) as recording:
            return sum(1 for _ in recording.messages())
    except InputError:
        return 0


def config(tmp_path, folder):
    path = tmp_path / "gear-twin.toml"
    path.write_text(f'[raw]\nfolder = "{folder}"\n')
    return path
