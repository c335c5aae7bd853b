"""What comes on the network, kept as rolling MCAP recordings: bounded, whole after a kill, by a process of its own."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
import tomllib
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import fake_twin
import pytest
from forked_processes import is_alive, role_of
from mcap.reader import make_reader
from memory_transport import MemoryNetwork
from service_streams import ROOT, Service, free_port, wait_until, write_recording
from sqlalchemy import update
from streams import ASSET, bursts, content, unbroken

from service.cli import run
from service.errors import InputError, NotReachable
from service.json_text import plain
from service.results.database import Database
from service.results.json_columns import dump
from service.results.names import Names
from service.results.raw_recordings import RawLimits, RawRecordings, kept_in
from service.results.roles import INGEST, OwnRole, Roles
from service.results.schema import ASSETS
from service.results.scratch import scratch
from service.results.sql_store import SqlStore
from service.results.stored_recordings import stored_recordings
from service.runtime import recorded_assets
from service.runtime.assess import assess
from service.runtime.by_settings import client_of, zenoh_of
from service.runtime.raw_recorder import RawRecorder
from service.runtime.recorded_assets import RecordedAssets
from service.runtime.replay import replay
from service.runtime.rig_sources import GivenRigs, OfferedRigs
from service.settings import Settings
from service.stream.inbox import Inbox
from service.stream.sources.mcap import RawFrame, Recording, read_windows
from service.stream.windows import Windows
from service.stream.wire.codec import encode
from service.stream.wire.topics import topic_of
from service.toml_text import document_text
from service.transport.zenoh import open_publisher, open_zenoh
from service.transport.zenoh_links import ZenohLinks
from service.transport.zenoh_session import open_session

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
            write(self.recordings, each)
            self.now += pace
            self.recordings.turn()

    @property
    def files(self):
        return sorted(path for path in self.folder.glob("*/*"))


def write(recordings, frame):
    recordings.write(frame.channel, frame.start_time_ns, frame.end_time_ns, encode(frame))


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


def test_a_rig_file_that_is_known_later_than_the_first_frame_is_in_the_same_recording(tmp_path):
    disk, frames = Disk(tmp_path), bursts(2)
    disk.rig = None
    disk.write(frames[:7])
    disk.rig = RIG
    disk.write(frames[7:], 0.5)
    disk.recordings.abandon()
    (left,) = disk.files
    with Recording(left) as recording:
        assert recording.rig_text == RIG
    (path,) = Disk(tmp_path).files
    rig, _, found = read_windows(path)
    assert rig == tomllib.loads(RIG.decode()) and content(found) == windows(of_files([path]))


def test_a_second_recorder_leaves_the_folder_of_the_first_alone(tmp_path):
    first = Disk(tmp_path)
    first.write(bursts(1))
    with pytest.raises(OSError, match="another process records there"):
        Disk(tmp_path)
    assert [path.suffix for path in first.files] == [".part"]
    first.recordings.close()
    Disk(tmp_path).recordings.close()


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
        write(spared.recordings, frames[400])
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


# -- from the inbox to the disk ----------------------------------------------------------------------------


class Failing:
    """A disk that fails."""

    def __init__(self):
        self.folder, self.size, self.files, self.newest_ns, self.deleted = Path("raw"), 0, 0, 0, 0
        self.fails, self.written, self.abandoned = False, [], 0

    def begin(self):
        self._fail()

    def _fail(self):
        if self.fails:
            raise OSError(errno.ENOSPC, "No space left on device")

    def write(self, channel, start_ns, end_ns, payload):
        self._fail()
        self.written.append((channel, payload))

    def turn(self):
        pass

    def close(self):
        pass

    def abandon(self):
        self.abandoned += 1


class Recorded:
    """A recorder on a clock of its own, and its inbox."""

    def __init__(self, disk, **given):
        self.now, self.inbox = 0.0, Inbox(**given)
        self.recorder = RawRecorder(self.inbox, disk, clock=lambda: self.now)

    def take(self, frames):
        for frame in frames:
            self.inbox.offer(topic_of(frame.channel), encode(frame))
        while not self.inbox.empty:
            self.recorder.turn(0.0)

    def figure(self, name):
        return self.recorder.figures()[name]


def test_a_full_disk_stops_the_recording_is_said_and_it_goes_on_by_itself(caplog):
    caplog.set_level("INFO")
    disk, frames = Failing(), bursts(4)
    recorded = Recorded(disk)
    recorded.take(frames[:10])
    assert len(disk.written) == 10 and recorded.figure("raw_recording_stopped") == 0.0
    disk.fails = True
    recorded.take(frames[10:20])
    assert recorded.figure("raw_frames_left_out") == 10
    assert recorded.figure("raw_recording_stopped") == 1.0 and disk.abandoned
    assert "cannot be written: No space left on device" in caplog.text
    recorded.now += 1.5
    recorded.recorder.turn(0.0)
    assert recorded.figure("raw_recording_stopped") == 1.0
    disk.fails = False
    recorded.now += 2.5
    recorded.take(frames[20:30])
    assert recorded.figure("raw_recording_stopped") == 0.0 and len(disk.written) == 20
    assert "go on" in caplog.text and recorded.figure("raw_frames_recorded") == 20


def test_a_slow_disk_holds_nobody_up_and_what_is_left_out_is_counted(caplog):
    disk, frames = Failing(), unbroken(60.0)
    recorded = Recorded(disk, max_bytes=40_000)
    for frame in frames:
        assert recorded.inbox.offer(topic_of(frame.channel), encode(frame))
    left_out = recorded.figure("raw_frames_left_out")
    assert len(frames) - 120 < left_out < len(frames)
    recorded.take([])
    assert len(disk.written) == len(frames) - left_out
    assert "slower than the stream" in caplog.text


def test_frames_are_recorded_as_they_came_and_what_breaks_the_contract_is_not():
    disk, frames = Failing(), bursts(1)
    recorded = Recorded(disk)
    recorded.inbox.offer(topic_of(frames[0].channel), b"no frame")
    recorded.take([*frames, *frames])  # sent again
    assert disk.written == [(f.channel, encode(f)) for f in (*frames, *frames)]
    assert recorded.recorder.recorder.refused == 1


# -- which frames ------------------------------------------------------------------------------------------


class Rows:
    """The database of a service, and who follows it."""

    def __init__(self, folder, **given):
        self.store = SqlStore(folder / "gear-twin.sqlite")
        self.followed = RecordedAssets(lambda: Database(self.store.path, shared=True), **given)

    def knows(self, asset, **parts):
        with self.store.database.transaction() as db:
            self.store.database.ensure(db, asset)
            for name, value in parts.items():
                db.execute(update(ASSETS).where(ASSETS.c.asset == asset).values({name: dump(value)}))


def test_frames_are_those_of_the_assets_that_the_database_knows_by_any_of_their_names(tmp_path):
    rows = Rows(tmp_path, asks=True)
    assert rows.followed.asset_of("press") == "press"  # nothing has been read yet: it is rather kept
    rows.knows("press", rig={"name": "a"})
    rows.knows("mill", retired={"since": "2026-01-01"})
    Names(rows.store.database).rename("press", "press-7")
    rows.followed.look()
    assert [rows.followed.asset_of(s) for s in ("press", "press-7", "mill", "new")] == ["press", "press", None, None]
    assert not rows.followed.admits("new") and rows.followed.admits("press-7")
    rows.knows("new")
    rows.knows("mill", retired=None)
    rows.followed.look()
    assert rows.followed.asset_of("new") == "new" and rows.followed.asset_of("mill") == "mill"


def test_assets_that_nobody_knows_are_recorded_where_new_ones_are_adopted_up_to_a_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(recorded_assets, "MOST_OTHERS", 2)
    rows = Rows(tmp_path, here=lambda stream: stream != "elsewhere")
    rows.knows("press")
    rows.followed.look()
    asked = [rows.followed.asset_of(s) for s in ("a", "elsewhere", "b", "c", "a", "press")]
    assert asked == ["a", None, "b", None, "a", "press"]


def test_the_rig_file_is_that_of_the_database_else_of_the_settings_else_one_that_the_network_offers(tmp_path):
    network = MemoryNetwork()
    given = GivenRigs(own={"a": ({"name": "given"}, "rig")})
    rows = Rows(tmp_path, given=given)
    network.rigs = {"a": b'name = "offered"', "b": b'name = "offered"'}
    with OfferedRigs(network).watching() as rows.followed.offered:

        def known(asset):
            rows.followed.rig_text(asset)
            rows.followed.look()
            text = rows.followed.rig_text(asset)
            return text and tomllib.loads(text.decode())["name"]

        assert [known(asset) for asset in ("a", "b", "c")] == ["given", "offered", None]
        rows.knows("a", rig={"name": "kept"})
        rows.knows("b", rig={"name": "offered"})
        before = rows.followed.rig_text("b")
        network.on_rig("c", b'name = "published"')
        assert [known(asset) for asset in ("a", "b", "c")] == ["kept", "offered", "published"]
        assert rows.followed.rig_text("b") == before  # no other file begins


def test_figures_of_a_process_are_in_its_row_and_those_of_all_are_merged(tmp_path):
    rows = Rows(tmp_path, figures=lambda: {"raw_frames_recorded": 7, "raw_recording_stopped": 0.0})
    rows.followed.look()
    roles = Roles(rows.store.database)
    other = OwnRole(rows.store.database, INGEST)
    other.say({"raw_frames_recorded": 5, "raw_recording_stopped": 1.0})
    assert roles.figures() == {"raw_frames_recorded": 12.0, "raw_recording_stopped": 1.0}
    other.gone()
    assert roles.figures(lambda: {"raw_recording_stopped": 0.0})["raw_recording_stopped"] == 0.0


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


# -- the network -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("config", [None, ROOT / "docs" / "examples" / "zenoh-access.json5"])
def test_the_recorder_is_let_in_and_hears_all_where_others_must_say_who_they_are(tmp_path, config):
    users = tmp_path / "users"
    users.write_text("viewer:secret\nlogger:word\n")  # a viewer may not hear frames
    settings = Settings(listen=[f"tcp/127.0.0.1:{free_port()}"], zenoh_users=users, zenoh_config=config)
    inbox, (sent, made) = Inbox(), bursts(1)[:2]
    logger = ZenohLinks(user="logger", password="word")
    with (
        scratch() as within, zenoh_of(settings, within)() as service, client_of(settings, within)() as recorder,
        recorder.subscribe(inbox), recorder.subscribe_made(inbox),
        open_publisher(settings.listen, links=logger) as publisher,
    ):  # fmt: skip
        assert oct(within.stat().st_mode & 0o777) == "0o700"
        publisher.declare([sent.channel])
        wait_until(lambda: service.publish_made(topic_of(made.channel), encode(made)) or not inbox.empty, 10.0)
        publisher.publish(RawFrame(sent.channel, sent.end_time_ns, encode(sent)))
        heard = set()
        wait_until(lambda: ((item := inbox.take(0.1)) and heard.add(item[:2])) or len(heard) == 2, 10.0)
        assert heard == {(frame.channel, encode(frame)) for frame in (sent, made)}
        with pytest.raises(NotReachable), open_zenoh((), settings.listen, wait=0.5):
            pass


# -- the process -------------------------------------------------------------------------------------------


GIVEN = {"RAW_SPARE_GB": "0"}


def records(running):
    return "gear_twin_raw_recording_stopped 0.0" in running.text("/metrics")


def recorder_of(running):
    """The recorder's process: the one that the service has started."""
    return role_of(running.process.pid, "record")


@pytest.mark.slow
def test_a_killed_service_leaves_recordings_that_can_be_assessed_and_replayed(tmp_path, capsys):
    recording = write_recording(tmp_path / "a.mcap", 4)
    folder = tmp_path / "raw"
    given = GIVEN | {"RAW_FOLDER": str(folder)}
    expected = plain(assess(recording, twin=fake_twin.TWIN))
    running = Service(tmp_path / "data", **given).start()
    folder = folder / running.folder.relative_to(tmp_path / "data")
    try:
        wait_until(lambda: records(running))
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(4)
        wait_until(lambda: handed_on(folder) == handed_on(tmp_path, "a.mcap"))
        frames = f"gear_twin_raw_frames_recorded_total {handed_on(folder)}"
        wait_until(lambda: frames in running.text("/metrics"))
        process = recorder_of(running)
    finally:
        running.end(signal.SIGKILL)
    wait_until(lambda: not is_alive(process), 5.0)
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
    assert run(["db", "check", "--data", str(tmp_path / "data"), "--config", str(config(tmp_path, folder))]) == 0
    assert " raw recordings, " in capsys.readouterr().err


@pytest.mark.slow
def test_a_killed_recorder_is_started_again_while_frames_flow_and_completes_what_it_has_left(tmp_path):
    recording = write_recording(tmp_path / "a.mcap", 40)
    folder = tmp_path / "raw"
    running = Service(tmp_path / "data", **GIVEN, RAW_FOLDER=str(folder)).start()
    folder = folder / running.folder.relative_to(tmp_path / "data")
    try:
        wait_until(lambda: records(running) and recorder_of(running) is not None)
        first = recorder_of(running)
        sending = threading.Thread(
            target=replay, args=(recording, [running.endpoint], 4.0), kwargs={"max_pause": 0.5}, daemon=True
        )
        sending.start()
        wait_until(lambda: handed_on(folder) > 0)
        os.kill(first, signal.SIGKILL)
        wait_until(lambda: recorder_of(running) not in (None, first))
        wait_until(lambda: handed_on(folder) > 0 and list(folder.glob("unsw/*.mcap")))
        running.wait_for_windows(40)
        sending.join(30)
    finally:
        running.end(signal.SIGTERM)
    assert running.process.poll() is not None and "it is started again in 0.1 s" in running.said()[1]
    wait_until(lambda: not list(folder.glob("unsw/*.part")), 20.0)
    assert len(of_files(folder.glob("unsw/*.mcap"))) > 0


@pytest.mark.slow
@pytest.mark.serve_only("workers of a fleet are in the process that is its router here")
def test_a_service_that_is_suspended_takes_no_frame_from_the_recordings(tmp_path):
    endpoint, folder = f"tcp/127.0.0.1:{free_port()}", tmp_path / "raw"
    with Recording(write_recording(tmp_path / "a.mcap", 6)) as recording, open_session([endpoint]):
        frames = list(recording.messages())
        given = GIVEN | {"LISTEN": "[]", "CONNECT": f'["{endpoint}"]', "RAW_FOLDER": str(folder), "NEW_ASSETS": "adopt"}
        running = Service(tmp_path / "data", **given).start()
        try:
            wait_until(lambda: records(running))
            with open_publisher([endpoint]) as publisher:
                publisher.declare({frame.channel for frame in frames})
                others = [running.process.pid, role_of(running.process.pid, "ingest")]
                for process in others:
                    os.kill(process, signal.SIGSTOP)
                for frame in frames:
                    publisher.publish(frame)
                wait_until(lambda: handed_on(folder) == len(frames), 20.0)
        finally:
            for process in others:
                os.kill(process, signal.SIGCONT)
            running.end(signal.SIGTERM)


@pytest.mark.slow
def test_record_keeps_all_streams_in_rolling_files_without_a_service_and_without_a_database(tmp_path, capsys):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    recording = write_recording(tmp_path / "a.mcap", 2)
    environment = os.environ | {
        "GEAR_TWIN_RAW_FOLDER": str(tmp_path / "raw"), "GEAR_TWIN_RAW_SPARE_GB": "0", "PYTHONPATH": str(ROOT),
        "GEAR_TWIN_DATA": str(tmp_path / "none"),
    }  # fmt: skip
    command = [sys.executable, "-m", "service", "record", "--listen", endpoint]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        with Recording(recording) as given, open_publisher([endpoint]) as publisher:
            frames = list(given.messages())
            publisher.offer_rig("unsw", given.rig_text)
            publisher.declare({frame.channel for frame in frames})
            for frame in frames:
                publisher.publish(frame)
            wait_until(lambda: handed_on(tmp_path / "raw") == len(frames))
        process.send_signal(signal.SIGTERM)
        said, _ = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 0 and f"{len(frames)} frames recorded" in said
    (path,) = (tmp_path / "raw").glob("unsw/*")
    with Recording(path) as kept, Recording(recording) as given:
        assert kept.rig() == given.rig()
        assert sorted((f.channel, f.payload) for f in kept.messages()) == sorted((f.channel, f.payload) for f in frames)
    assert not (tmp_path / "none").exists()


def test_record_without_a_file_and_without_settings_says_what_to_give(capsys):
    assert run(["record", "--connect", "tcp/127.0.0.1:9"]) == 2
    assert "give --out FILE, or set folder or url in the table [raw]" in capsys.readouterr().err


def handed_on(folder, pattern="unsw/*.part"):
    """How many frames a recording holds, which may be being written."""
    try:
        (path,) = folder.glob(pattern)
        with Recording(path) as recording:
            return sum(1 for _ in recording.messages())
    except (InputError, ValueError):
        return 0


def config(tmp_path, folder):
    path = tmp_path / "gear-twin.toml"
    path.write_text(f'[raw]\nfolder = "{folder}"\n')
    return path
