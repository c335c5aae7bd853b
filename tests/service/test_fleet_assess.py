"""Stored recordings assessed side by side: the answers of `assess`, each made once, whatever ends between."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import fake_twin
import pytest
from marked_twin import marked
from service_streams import write_recording

from service.errors import InputError
from service.fleet import cli
from service.fleet.assess_task import Work, assess_one
from service.fleet.batch import SUMMARY, assess_all
from service.fleet.ray_session import START_ATTEMPTS, _start_here
from service.json_text import json_text
from service.results.object_store import ObjectStore
from service.results.raw_recordings import RawLimits, RawRecordings
from service.results.scratch import PREFIX, scratch
from service.results.stored_recordings import stored_recordings
from service.runtime.assess import assess
from service.stream.assembly import DEFAULT
from service.stream.sources.mcap import Recording
from service.stream.wire.codec import encode

PROGRAM = Path(__file__).parent / "marked_twin.py"
RECORDINGS, WINDOWS = 20, 4
LONG = 600.0  # that Ray may take to begin and to end on a machine whose cores are busy [s]
LIMITS = RawLimits(roll_bytes=10**9, roll_seconds=3600.0, keep_bytes=10**9, keep_seconds=10**9, spare_bytes=0)


def work(results, **given):
    return Work(
        results=str(results), options=None, assembly=DEFAULT, prefix="gearbox", twin=fake_twin.TWIN, given={},
    ) if not given else replace(work(results), **given)  # fmt: skip


def plain(path, **given) -> bytes:
    """What `gear-twin assess --json` writes."""
    return (json_text(assess(path, twin=fake_twin.TWIN, **given)) + "\n").encode()


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Machines of one folder, each with a rig file of its own name."""
    folder = tmp_path_factory.mktemp("recordings")
    for number in range(RECORDINGS):
        name = f"machine{number:02d}"

        write_recording(folder / f"{name}.mcap", WINDOWS, name, seed=number, changed=renamed(name))
    return folder


def renamed(name):
    return (b'name = "unsw"', f'name = "{name}"'.encode())


def of_one(path):
    (recording,) = stored_recordings([str(path)])
    return recording


@pytest.mark.slow
def test_a_result_is_the_answer_of_assess_and_is_made_once(recordings, tmp_path):
    path, marks = recordings / "machine03.mcap", tmp_path / "marks"
    done = work(tmp_path / "results", twin=marked(marks))
    first, second = assess_one(done, of_one(path)), assess_one(done, of_one(path))
    assert (first.state, second.state) == ("assessed", "found") and first.result == second.result
    assert (tmp_path / "results" / first.result).read_bytes() == plain(path)
    assert len(marks.read_text().splitlines()) == WINDOWS


@pytest.mark.slow
def test_another_content_option_or_version_is_assessed_again(recordings, tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    shutil.copy(recordings / "machine00.mcap", path)
    done = work(tmp_path / "results")
    states = [assess_one(done, of_one(path)).state]
    states.append(assess_one(replace(done, given={"trace": False}), of_one(path)).state)
    os.utime(path, ns=(0, 10**18))
    states.append(assess_one(done, of_one(path)).state)
    monkeypatch.setattr("service.fleet.assess_task.__version__", "0.0.1")
    states.append(assess_one(done, of_one(path)).state)
    states.append(assess_one(done, of_one(path)).state)
    assert states == ["assessed"] * 4 + ["found"]
    assert len(list((tmp_path / "results").glob("a-*.json"))) == 4


def test_what_cannot_be_assessed_is_kept_with_its_reason_and_what_cannot_be_read_is_tried_again(recordings, tmp_path):
    bad, results = tmp_path / "bad.mcap", tmp_path / "results"
    bad.write_bytes((recordings / "machine00.mcap").read_bytes()[:3000])
    for state in ("refused", "refused"):
        outcome = assess_one(work(results), of_one(bad))
        assert outcome.state == state and str(bad) in outcome.reason
    kept = json.loads((results / outcome.result).read_text())
    assert kept["recording"] == str(bad) and kept["reason"] == outcome.reason
    gone = of_one(bad)
    bad.write_bytes(b"other")
    outcome = assess_one(work(results, given={"x": 1}), gone)
    assert outcome.reason == f"{bad} has changed since it was listed" and outcome.result is None
    bad.unlink()
    outcome = assess_one(work(results, given={"x": 1}), gone)
    assert "cannot be read: no such file" in outcome.reason and outcome.result is None
    assert len(list(results.iterdir())) == 1


def test_a_fault_of_one_recording_costs_that_one_alone(recordings, tmp_path):
    twin = replace(fake_twin.TWIN, new_state=lambda: 1 / 0, step=lambda *given: 1 / 0)
    outcome = assess_one(work(tmp_path / "results", twin=twin), of_one(recordings / "machine00.mcap"))
    assert outcome.state == "refused" and "internal error" in outcome.reason


def test_a_given_rig_file_is_used_for_all(recordings, tmp_path):
    rig = recordings.parent / "own.toml"
    with Recording(recordings / "machine01.mcap") as recording:
        rig.write_bytes(recording.rig_text)
    given = work(tmp_path / "results", rig=(rig.name, rig.read_bytes()))
    path = recordings / "machine02.mcap"
    outcome = assess_one(given, of_one(path))
    assert (tmp_path / "results" / outcome.result).read_bytes() == plain(path, rig_path=rig)


@pytest.mark.parametrize("url", [False, True])
def test_segments_of_an_asset_are_one_recording(recordings, tmp_path, url):
    path = recordings / "machine05.mcap"
    raw = RawRecordings(tmp_path / "raw", LIMITS, rig_text_of=lambda asset: rig_text(path))
    raw.begin()
    with Recording(path) as recording:
        for number, frame in enumerate(recording.frames(lambda channel, error: pytest.fail(str(error))), 1):
            raw.write(frame.channel, frame.start_time_ns, frame.end_time_ns, encode(frame))
            if number % 30 == 0:
                raw.close()
    raw.close()
    assert len(list((tmp_path / "raw").glob("machine05/*.mcap"))) > 2
    where = f"file://{tmp_path}/raw" if url else str(tmp_path / "raw")
    (found,) = stored_recordings([where])
    outcome = assess_one(work(f"file://{tmp_path}/results"), found)
    assert outcome.result.startswith("machine05-")
    assert (tmp_path / "results" / outcome.result).read_bytes() == plain(path)


def rig_text(path):
    with Recording(path) as recording:
        return recording.rig_text


def test_segments_of_two_rig_files_are_one_recording_by_a_third(recordings, tmp_path):
    folder = tmp_path / "machine05"
    folder.mkdir()
    first = write_recording(folder / "1700000000000000000.mcap", 2, "machine05", changed=renamed("x"))
    write_recording(folder / "1700000600000000000.mcap", 2, "machine05", later=600.0)
    (found,) = stored_recordings([str(tmp_path)])
    assert [Path(part.name).name for part in found.parts] == ["1700000000000000000.mcap", "1700000600000000000.mcap"]
    outcome = assess_one(work(tmp_path / "results"), found)
    assert outcome.state == "refused" and "--rig" in outcome.reason
    outcome = assess_one(work(tmp_path / "results", rig=("own.toml", rig_text(first)), given={"rig": 1}), found)
    assert outcome.state == "assessed"
    (folder / "1700000300000000000.mcap").write_bytes(b"no recording")
    (found,) = stored_recordings([str(tmp_path)])
    outcome = assess_one(work(tmp_path / "results", rig=("own.toml", rig_text(first)), given={"rig": 1}), found)
    answer = json.loads((tmp_path / "results" / outcome.result).read_text())
    assert len(answer["windows"]) == 4
    assert "1700000300000000000.mcap" in answer["data_quality"]["recording"][0]


def test_recordings_are_found_in_files_folders_and_urls_and_each_is_listed_once(recordings, tmp_path):
    one = recordings / "machine00.mcap"
    listed = stored_recordings([str(one), str(recordings), str(recordings)])
    assert len(listed) == RECORDINGS and listed[0].where == str(one)
    urls = stored_recordings([f"file://{recordings}", f"file://{recordings}/machine00.mcap"])
    assert len(urls) == RECORDINGS and {r.label for r in urls} == {r.label for r in listed}
    for wrong, said in (
        (str(tmp_path), "holds no recording"),
        (str(tmp_path / "none"), "no such file"),
        (f"file://{tmp_path}/none", "no such folder"),
        (f"file://{recordings}/none.mcap", "no such object"),
        ("ftp://host/raw", "s3://"),
    ):
        with pytest.raises(InputError, match=said):
            stored_recordings([wrong])


def test_an_object_is_written_once_and_whole(tmp_path):
    store = ObjectStore(f"file://{tmp_path}/a b", make=True)
    assert store.put_once("x/y.json", b"1") and not store.put_once("x/y.json", b"2")
    assert store.read("x/y.json") == b"1" and store.read("none") is None and store.entry("none") is None
    (tmp_path / "a b" / "x" / "empty.json").write_bytes(b"")
    assert store.put_once("x/empty.json", b"3") and store.read("x/empty.json") == b"3"
    assert sorted(entry.name for entry in store.entries("x")) == ["x/empty.json", "x/y.json"]
    store.delete(["x/y.json", "x/y.json"])
    assert [entry.name for entry in store.entries()] == ["x/empty.json"]


def test_a_cluster_that_is_not_there_is_said_at_once(recordings, tmp_path):
    found = stored_recordings([str(recordings / "machine00.mcap")])
    for address in ("127.0.0.1:1", "127.0.0.1:99999", "ray://127.0.0.1:1"):
        with pytest.raises(InputError, match=f"--address {address}: no Ray cluster answers there"):
            assess_all(found, work(tmp_path / "results"), address=address)


class LateRay:
    """A Ray whose first attempts to start time out, as on a machine whose cores are busy."""

    def __init__(self, fails):
        self.fails, self.ended = fails, 0

    def init(self, **given):
        if self.ended < self.fails:
            raise Exception("The current node timed out during startup.\nMore")  # as Ray raises it

    def shutdown(self):
        self.ended += 1


def test_a_ray_that_is_late_to_start_is_started_again_and_in_the_end_it_is_said():
    ray = LateRay(fails=START_ATTEMPTS - 1)
    _start_here(ray, 2)
    assert ray.ended == START_ATTEMPTS - 1
    with pytest.raises(
        InputError, match=r"could not be started here: The current node timed out during startup\.: are"
    ):
        _start_here(LateRay(fails=START_ATTEMPTS), 2)


def test_the_options_of_the_command_are_part_of_a_result_s_name(recordings, tmp_path):
    rig = tmp_path / "own.toml"
    rig.write_bytes(rig_text(recordings / "machine01.mcap"))
    one = of_one(recordings / "machine00.mcap")
    works = [
        cli.work_of(str(tmp_path), None, "fused", True),
        cli.work_of(str(tmp_path), None, "fused", False),
        cli.work_of(str(tmp_path), None, "rms", True),
        cli.work_of(str(tmp_path), rig, "fused", True),
        cli.work_of(str(tmp_path), None, "fused", True, false_alarm_rate=0.02),
        cli.work_of(str(tmp_path), None, "fused", True, asset="machine00"),
    ]
    assert len({each.name_of(one) for each in works}) == len(works)
    assert cli.work_of("results", None, "fused", True).results == str(Path("results").absolute())
    with pytest.raises(InputError, match=r"none.toml"):
        cli.work_of(str(tmp_path), tmp_path / "none.toml", "fused", True)


def test_folders_of_killed_processes_are_deleted_and_those_in_use_stay(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    left, young = tmp_path / f"{PREFIX}left", tmp_path / f"{PREFIX}young"
    for each in (left, young):
        (each / "x").mkdir(parents=True)
    with scratch() as used:
        for each in (left, used):
            os.utime(each, (0, 0))
        with scratch() as other:
            assert sorted(tmp_path.iterdir()) == sorted([young, used, other])
    assert list(tmp_path.iterdir()) == [young]


# -- with Ray ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ray_here():
    from service.fleet.ray_session import ray_session

    loaded = "ray" in sys.modules and "RAY_AUTH_MODE" not in os.environ
    assert not loaded, "Ray reads its settings when it is loaded, and another test of this process has loaded it"
    with pytest.MonkeyPatch.context() as changed:
        changed.setenv("PYTHONPATH", os.pathsep.join(map(str, (PROGRAM.parent, PROGRAM.parents[2]))))
        with ray_session(None, 2) as ray:
            yield ray


@pytest.mark.slow
@pytest.mark.timeout(2 * LONG)
def test_a_worker_that_is_killed_costs_no_result_and_every_result_is_that_of_assess(ray_here, recordings, tmp_path):
    marks, killed = tmp_path / "marks", []
    given = work(tmp_path / "results", twin=marked(marks, 0.1))

    def kill_one(summary, total):
        if len(summary.outcomes) == 5 and not killed:
            killed.append(int(marks.read_text().split()[-1]))
            os.kill(killed[0], signal.SIGKILL)

    found = stored_recordings([str(recordings)])
    summary = assess_all(found, given, kill_one)
    counts = dict(summary.counts)
    found_done = counts.pop("found")  # one, where the worker was killed between its result and its answer
    assert killed and found_done <= 1 and counts == {"assessed": RECORDINGS - found_done, "refused": 0}
    for recording in found:
        result = tmp_path / "results" / summary.outcomes[recording.where].result
        assert result.read_bytes() == plain(recording.where)
    counted = Counter(line.rpartition(" ")[0] for line in marks.read_text().splitlines())
    again = {window.split()[0] for window, times in counted.items() if times > 1}
    assert len(counted) == RECORDINGS * WINDOWS and len(again) <= 1 - found_done
    assert assess_all(found, given).counts == {"assessed": 0, "found": RECORDINGS, "refused": 0}
    assert json.loads((tmp_path / "results" / SUMMARY).read_text())["found"] == RECORDINGS


@pytest.mark.slow
def test_results_that_cannot_be_written_end_the_run_with_the_reason(ray_here, recordings, tmp_path):
    results = tmp_path / "results"
    results.mkdir()
    given = work(results, twin=marked(tmp_path / "marks"))
    for recording in (found := stored_recordings([str(recordings)])):
        name = given.name_of(recording)
        (results / f"{name}.json").mkdir()
    with pytest.raises(InputError, match="cannot be used"):
        assess_all(found, given)


@pytest.mark.slow
@pytest.mark.timeout(3 * LONG)
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_ended_goes_on_where_it_was(recordings, tmp_path, how):
    marks, results = tmp_path / "marks", tmp_path / "results"
    command = [sys.executable, str(PROGRAM), str(marks), "0.2", "fleet", "assess", str(recordings)]
    command += ["--results", str(results), "--workers", "2"]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, (PROGRAM.parent, PROGRAM.parents[2]))),
        "TMPDIR": str(short(tmp_path)),
    }
    given = {"env": environment, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, start_new_session=True, **given) as process:
        while len(list(results.glob("*.json"))) < 5 and process.poll() is None:
            time.sleep(0.05)
        if how == signal.SIGINT:  # as of a terminal: to all
            os.killpg(process.pid, how)
        else:
            process.send_signal(how)
        said = process.communicate(timeout=LONG)
    settle(results, marks)
    status = {signal.SIGINT: 130, signal.SIGKILL: -9}[how]
    assert process.returncode == status, said
    assert said[0] == "" and all(line.startswith("gear-twin: ") for line in said[1].splitlines()), said
    done = {path.name: path.stat().st_mtime_ns for path in results.glob("*.json")}
    marked_before = Counter(line.split()[0] for line in marks.read_text().splitlines())
    assert 5 <= len(done) < RECORDINGS
    again = subprocess.run(command, timeout=LONG, **given)
    assert again.returncode == 0, again.stderr
    assert f"{RECORDINGS - len(done)} recordings assessed, {len(done)} found done, 0 refused" in again.stdout
    assert again.stderr == ""
    assert all((results / name).stat().st_mtime_ns == at for name, at in done.items())
    machines = Counter(line.split()[0] for line in marks.read_text().splitlines())
    for name in done:
        machine = name.partition("-")[0]
        assert machines[machine] == marked_before[machine] == WINDOWS
    assert len(machines) == RECORDINGS


def settle(results, marks):
    """Waits until what computes has written the results that it was making when the run was ended."""
    found, since = None, time.monotonic()
    while time.monotonic() - since < 3.0:
        now = sorted(results.iterdir()), marks.stat().st_size
        if now != found:
            found, since = now, time.monotonic()
        time.sleep(0.1)


def short(folder):
    """A folder whose sockets have names that are short enough."""
    return Path("/tmp") if len(str(folder)) > 40 else folder
