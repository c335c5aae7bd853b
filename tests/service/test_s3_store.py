"""Raw recordings and results in a store that speaks S3: SeaweedFS, where it is installed."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import fake_twin
import pytest
import s3_server
from s3_server import KEY, READER, SECRET, S3Server
from service_streams import Service, wait_until, write_recording
from streams import ASSET, bursts

from service.cli import run
from service.errors import StoreError
from service.fleet.assess_task import Work, assess_one
from service.fleet.segments import Segments
from service.json_text import json_text
from service.results.object_store import ObjectStore
from service.results.raw_recordings import RawLimits, RawRecordings
from service.results.raw_segments import SegmentSender
from service.results.stored_recordings import stored_recordings
from service.runtime.assess import assess
from service.runtime.replay import replay
from service.stream.assembly import DEFAULT
from service.stream.wire.codec import encode

pytestmark = [pytest.mark.s3, pytest.mark.skipif(s3_server.program() is None, reason=s3_server.MISSING)]

ROOM = RawLimits(roll_bytes=10**9, roll_seconds=3600.0, keep_bytes=10**9, keep_seconds=10**9, spare_bytes=0)


@pytest.fixture(scope="module")
def server():
    with S3Server() as server:
        yield server


@pytest.fixture
def use(server, monkeypatch):
    """Sets the environment for the server, with what is given instead; None: not set."""

    def use(**other):
        for name in [name for name in os.environ if name.startswith("AWS_")]:
            monkeypatch.delenv(name)
        for name, value in server.environment(**other).items():
            if value is not None:
                monkeypatch.setenv(name, value)

    use()
    return use


@pytest.fixture
def url(server, use):
    """The URL of a place for recordings, in which there is nothing."""
    return f"{server.new_place()}/raw"


class Machine:
    """Recordings of one machine that wait for the store of a URL."""

    def __init__(self, folder, url):
        self.spool, self.url, self.now = RawRecordings(folder, ROOM), url, time.time
        self.spool.begin()

    def record(self, frames):
        for frame in frames:
            self.spool.write(frame.channel, frame.start_time_ns, frame.end_time_ns, encode(frame))
        self.spool.close()

    def sender(self, keep_bytes=10**9, keep_seconds=10**9):
        return SegmentSender(
            self.spool.folder, lambda: ObjectStore(self.url, make=True), keep_bytes=keep_bytes,
            keep_seconds=keep_seconds, prefix="gearbox", pauses=(0.1, 0.5), now=self.now,
        )  # fmt: skip

    @property
    def waiting(self):
        return sorted(self.spool.folder.glob("*/*"))

    @property
    def objects(self):
        return sorted(entry.name for entry in ObjectStore(self.url).entries())


@pytest.fixture
def machine(tmp_path, url):
    return Machine(tmp_path / "spool", url)


def stored_frames(url):
    """All frames of a store's one machine, as `fleet assess` reads them."""
    (found,) = stored_recordings([url])
    with Segments(found.where, found.parts, "gearbox", any_rig=True) as segments:
        frames = list(segments.frames(lambda channel, error: pytest.fail(str(error))))
    assert not segments.faults
    return frames


def by_channel(frames):
    out = {}
    for frame in frames:
        out.setdefault(frame.channel, []).append((frame.start_time_ns, frame.sequence, frame.nbytes))
    return out


def test_objects_are_written_once_listed_by_pages_read_and_deleted(url, tmp_path):
    store = ObjectStore(url + "/")
    assert list(store.entries()) == [] and store.entry("a") is None and store.read("a") is None
    assert store.put_once("results/a.json", b"first") and not store.put_once("results/a.json", b"second")
    assert store.read("results/a.json") == b"first"
    before = store.entry("results/a.json")
    assert (before.size, before.written) == (5, pytest.approx(time.time(), abs=60))
    store.put("results/a.json", b"other")
    with pytest.raises(StoreError, match=r"a\.json has changed since it was listed"):
        store.read_to(tmp_path / "copy", "results/a.json", before.tag)
    names = {f"many/{number}" for number in range(1001)}  # a page has 1000
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda name: store.put(name, b"x"), names))
    assert {entry.name for entry in store.entries("many")} == names
    store.delete(["results/a.json", "results/never.json"])
    assert [entry.name for entry in store.entries("results")] == []
    with pytest.raises(StoreError, match=r"a\.json has been deleted since it was listed"):
        store.read_to(tmp_path / "copy", "results/a.json", before.tag)


def test_a_file_of_several_parts_is_stored_whole(url, tmp_path):
    big, copy = tmp_path / "big", tmp_path / "copy"
    big.write_bytes(os.urandom(12_000_000))
    store = ObjectStore(url)
    store.put("big", big)
    store.read_to(copy, "big", store.entry("big").tag)
    assert copy.read_bytes() == big.read_bytes()


def test_segments_are_sent_and_assessed_as_one_recording(machine, url):
    frames = bursts(4)
    for begin in range(0, len(frames), len(frames) // 4):
        machine.record(frames[begin : begin + len(frames) // 4])
        machine.sender().end()
    assert not machine.waiting
    assert len(machine.objects) == 4 and all(name.startswith(f"rig/{ASSET}/17") for name in machine.objects)
    assert by_channel(stored_frames(url)) == by_channel(frames)
    (one,) = stored_recordings([f"{url}/{machine.objects[0]}"])
    assert one.where == f"{url}/{machine.objects[0]}"


def test_a_service_s_segments_are_assessed_with_results_in_the_store(url, tmp_path):
    recording = write_recording(tmp_path / "a.mcap", 4)
    running = Service(tmp_path / "data", RAW_URL=url, RAW_SPARE_GB="0").start()
    try:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(4)
        assert "gear_twin_raw_store_unavailable 0.0" in running.text("/metrics")
    finally:
        running.end(signal.SIGTERM)
    (found,) = stored_recordings([url])
    results = f"{url.rpartition('/')[0]}/results"
    work = Work(results=results, options=None, assembly=DEFAULT, prefix="gearbox", given={}, twin=fake_twin.TWIN)
    first, second = assess_one(work, found), assess_one(work, found)
    assert (first.state, second.state) == ("assessed", "found") and first.result == second.result
    expected = json.loads(json_text(assess(recording, twin=fake_twin.TWIN)))
    assert json.loads(ObjectStore(results).read(first.result))["windows"] == expected["windows"]


def test_retention_deletes_the_oldest_segments_in_the_store_and_nothing_else(machine):
    frames = bursts(4)
    for begin in range(0, len(frames), len(frames) // 4):
        machine.record(frames[begin : begin + len(frames) // 4])
        machine.sender().end()
        time.sleep(1.1)  # the store's times are whole seconds
    store = ObjectStore(machine.url)
    store.put("notes.json", b"x" * 10**6)
    names = machine.objects[1:]
    sizes = [store.entry(name).size for name in names]
    sender = machine.sender(keep_bytes=sum(sizes[2:]))
    sender.end()
    assert machine.objects == ["notes.json", *names[2:]] and sender.figures()["raw_segments_deleted"] == 2
    machine.now = lambda: time.time() + 3600.0
    machine.sender(keep_seconds=3000.0).end()
    assert machine.objects == ["notes.json"]


def test_a_store_that_is_away_and_comes_back_has_all_that_was_recorded(server, machine, url, caplog):
    caplog.set_level("INFO")
    frames = bursts(4)
    quarters = [frames[begin : begin + len(frames) // 4] for begin in range(0, len(frames), len(frames) // 4)]
    machine.record(quarters[0])
    sender = machine.sender()
    try:
        wait_until(lambda: not machine.waiting, 20.0)
        server.kill()
        try:
            for quarter in quarters[1:3]:
                machine.record(quarter)
            wait_until(lambda: sender.figures()["raw_store_unavailable"] == 1.0, 30.0)
            assert sender.figures()["raw_segments_failed"] >= 1 and len(machine.waiting) == 2
            wait_until(lambda: f"no answer from {server.endpoint}: it must run and be" in caplog.text, 30.0)
            with pytest.raises(StoreError, match="its address is AWS_ENDPOINT_URL"):
                stored_recordings([url])
        finally:
            server.start()
        machine.record(quarters[3])
        wait_until(lambda: not machine.waiting and sender.figures()["raw_store_unavailable"] == 0.0, 30.0)
        assert sender.figures()["raw_segments_stored"] == 4 and sender.figures()["raw_segments_waiting"] == 0
        assert f"raw recordings are moved to {url} again" in caplog.text
    finally:
        sender.end()
    assert by_channel(stored_frames(url)) == by_channel(frames)


def test_an_upload_that_is_cut_off_leaves_nothing_or_the_whole(server, url, tmp_path):
    big, copy = tmp_path / "big", tmp_path / "copy"
    big.write_bytes(os.urandom(40_000_000))
    store = ObjectStore(url)
    with ThreadPoolExecutor(1) as pool:
        upload = pool.submit(store.put, "big", big)
        time.sleep(0.2)
        server.kill()
        fault = upload.exception(60.0)
    server.start()
    assert fault is None or isinstance(fault, StoreError)
    left = store.entry("big")
    assert left is None or left.size == 40_000_000
    assert left or fault  # both where the server was killed between the end of the upload and its answer
    store.put("big", big)
    store.read_to(copy, "big")
    assert copy.read_bytes() == big.read_bytes()


REFUSED = r"refuses the credentials \(403( \w+)?\): AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY must be of one who may"
WRONG = "not-the-secret-of-the-tests"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"AWS_SECRET_ACCESS_KEY": WRONG}, REFUSED),
        ({"AWS_ACCESS_KEY_ID": "nobody", "AWS_SECRET_ACCESS_KEY": WRONG}, REFUSED),
        ({"AWS_ACCESS_KEY_ID": READER}, REFUSED),
        ({"AWS_SECRET_ACCESS_KEY": None}, "there are no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"),
        ({"AWS_ACCESS_KEY_ID": f"{KEY}\n"}, "AWS_ENDPOINT_URL hold what no request can"),
        ({"AWS_ENDPOINT_URL": "127.0.0.1:8333"}, "AWS_ENDPOINT_URL = '127.0.0.1:8333' must begin with http://"),
    ],
)
def test_credentials_that_do_not_serve_are_said_once_without_the_secret_and_segments_wait(
    machine, use, caplog, given, expected
):
    machine.record(bursts(1))
    use(**given)
    sender = machine.sender()
    try:
        wait_until(lambda: "cannot be moved" in caplog.text, 20.0)
        assert sender.figures()["raw_store_unavailable"] == 1.0
        said = [record.getMessage() for record in caplog.records if "cannot be moved" in record.getMessage()]
        assert re.search(expected, said[0]) and machine.url in said[0] and "\n" not in said[0]
        assert SECRET not in caplog.text and WRONG not in caplog.text
        assert len(machine.waiting) == 1
        use()
        wait_until(lambda: not machine.waiting, 20.0)
    finally:
        sender.end()
    assert len(machine.objects) == 1


def test_a_bucket_that_is_not_there_is_one_clear_error(server, use, tmp_path, capsys):
    bucket = "no-such-bucket"
    expected = f"s3://{bucket}/raw: {server.endpoint} has no bucket {bucket!r} (404 NoSuchBucket): make it there"
    assert run(["fleet", "assess", f"s3://{bucket}/raw", "--results", str(tmp_path / "results")]) == 2
    said = capsys.readouterr().err
    assert expected in said and len(said.splitlines()) <= 2
    store = ObjectStore(f"s3://{bucket}/raw")
    for act in (lambda: store.put("a", b"x"), lambda: store.put_once("a", b"x"), lambda: store.read("a")):
        with pytest.raises(StoreError) as raised:
            act()
        assert str(raised.value).startswith(expected)


@pytest.mark.parametrize("part", ["recordings", "results"])
def test_wrong_credentials_end_an_assessment_before_it_begins(url, use, tmp_path, capsys, part):
    recording = write_recording(tmp_path / "a.mcap", 1)
    use(AWS_SECRET_ACCESS_KEY=WRONG)
    here, there = str(recording), str(tmp_path / "results")
    of, to = (url, there) if part == "recordings" else (here, url)
    assert run(["fleet", "assess", of, "--results", to]) == 2
    said = capsys.readouterr().err
    assert re.search(REFUSED, said.replace("\n", " ")) and url in said and WRONG not in said and SECRET not in said
