"""When a file was recorded: read from what it states, else asked for; never made up, and never UTC in silence."""

from __future__ import annotations

import os
import struct
from contextlib import nullcontext
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from service.cli import run
from service.errors import InputError
from service.files.dates import in_zone, moment_in, stated_in
from service.files.import_recording import import_recording
from service.files.readers import read_table
from service.runtime.replay import replay
from service.stream.sources.mcap import Recording

RATE = 2000.0
T = np.arange(4000) / RATE
VALUES = np.sin(300 * T)
LOCAL = datetime(2026, 3, 12, 8, 14)
BEGAN = datetime(2026, 3, 12, 7, 14, tzinfo=UTC)


def csv(path, preamble="", times=None):
    times = [f"{t:.4f}" for t in T] if times is None else times
    rows = "\n".join(f"{t};{v:.6f}" for t, v in zip(times, VALUES, strict=True))
    path.write_text(f"{preamble}Time;Acc (g)\n{rows}\n", encoding="utf-8")


@pytest.fixture
def imported(tmp_path, monkeypatch):
    """Imports a file by a mapping; what was written, and the metadata of the recording."""

    def run_import(path, column, extra="", **given):
        name = path.name
        text = f'schema = "gear-import/1"\nasset = "a"\n{extra}\n[file]\npath = "{name}"\n'
        if path.suffix != ".csv":
            text += f"sample_rate_hz = {RATE}\n"
        text += f'[channels.y6]\ncolumn = "{column}"\nunit = "g"\n[rig]\n'
        (tmp_path / "mapping.toml").write_text(text)
        out = tmp_path / "out.mcap"
        found = import_recording(tmp_path / "mapping.toml", out, **given)
        with Recording(out) as recording:
            first = min(message.log_time_ns for message in recording.messages())
            return found, recording.metadata["started"], datetime.fromtimestamp(first / 1e9, UTC)

    return run_import


@pytest.mark.parametrize(
    ("text", "moment"),
    [
        ("Datum: 12.03.2026 08:14:00", LOCAL),
        ("2026-03-12T08:14:00Z", LOCAL.replace(tzinfo=UTC)),
        ("2026-03-12 08:14:00+01:00", BEGAN),
        ("12.03.2026, 08:14:00 UTC+1", BEGAN),
        ("20260312T081400", LOCAL),
        ("12-Mar-2026 08:14:00", LOCAL),
        ("Thu Mar 12 08:14:00 2026", LOCAL),
        ("12. März 2026 08:14", LOCAL),
        ("March 12, 2026 8:14 AM", LOCAL),
        ("03/13/2026 08:14", LOCAL + timedelta(days=1)),
        ("13/03/2026 08:14", LOCAL + timedelta(days=1)),
        ("03/04/2026 08:14", None),  # two days
        ("2026-03-12", None),
        ("1904-01-01 00:00:00", None),  # a clock that was never set
        ("25:61:00 2026-03-12", None),
    ],
)
def test_dates_are_read_as_people_write_them(text, moment):
    assert moment_in(text) == moment


@pytest.mark.parametrize(
    "preamble",
    [
        "Datum: 12.03.2026 08:14:00\n",
        "Start time;2026-03-12 08:14:00\n",
        "Date;12.03.2026\nZeit;08:14:00\n",
        "Calibration date: 01.01.2020 00:00:00\n# Recorded = 12-Mar-2026 08:14:00\n",
        "2026-03-12 08:14:00\n",
    ],
)
def test_a_date_in_the_preamble_is_when_the_recording_begins(tmp_path, imported, preamble):
    """The clock once began at 2000-01-01, and the second recording was thrown away."""
    csv(tmp_path / "run.csv", preamble)
    _, started, first = imported(tmp_path / "run.csv", "Acc (g)", zone="Europe/Berlin")
    assert datetime.fromisoformat(started) == BEGAN and abs(first - BEGAN) < timedelta(seconds=1)


@pytest.mark.parametrize("zone", ["", "+01:00", "Z"])
@pytest.mark.parametrize("day", ["%Y-%m-%d", "%d.%m.%Y"])  # of dots the day is first, as in a preamble
def test_the_first_row_of_a_column_of_dates_is_when_the_recording_begins(tmp_path, imported, zone, day):
    times = [f"{LOCAL + timedelta(seconds=float(t)):{day} %H:%M:%S.%f}{zone}" for t in T]
    csv(tmp_path / "run.csv", times=times)
    _, started, _ = imported(tmp_path / "run.csv", "Acc (g)", zone=None if zone else "+01:00")
    assert datetime.fromisoformat(started) == (LOCAL.replace(tzinfo=UTC) if zone == "Z" else BEGAN)


def test_a_column_that_counts_seconds_since_1970_states_the_date(tmp_path, imported):
    csv(tmp_path / "run.csv", times=[f"{BEGAN.timestamp() + t:.4f}" for t in T])
    _, started, _ = imported(tmp_path / "run.csv", "Acc (g)")
    assert abs(datetime.fromisoformat(started) - BEGAN) < timedelta(seconds=0.01)


def mat(path):
    from scipy.io import savemat

    savemat(path, {"acc": VALUES, "testtime": "12-Mar-2026 08:14:00"})


def mat_of_structures(path):
    from scipy.io import savemat

    savemat(path, {"acc": VALUES, "info": {"operator": "x", "Datum": "12.03.2026 08:14:00"}})


def hdf5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["acc"] = VALUES
        file.attrs["start_time"] = "2026-03-12T08:14:00"


def parquet(path):
    pyarrow = pytest.importorskip("pyarrow")
    table = pyarrow.table({"acc": VALUES}).replace_schema_metadata({"recorded": "2026-03-12 08:14:00"})
    pytest.importorskip("pyarrow.parquet").write_table(table, path)


def tdms(path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        root = nptdms.RootObject(properties={"DateTime": np.datetime64("2026-03-12T07:14:00")})
        writer.write_segment([root, nptdms.ChannelObject("g", "acc", VALUES)])


def wav(path):
    from scipy.io import wavfile

    wavfile.write(path, int(RATE), VALUES.astype(np.float32))
    raw = path.read_bytes()
    chunk = bytes(320) + b"2026-03-12" + b"08:14:00" + bytes(264)
    added = b"bext" + struct.pack("<I", len(chunk)) + chunk
    path.write_bytes(raw[:4] + struct.pack("<I", len(raw) - 8 + len(added)) + raw[8:12] + added + raw[12:])


def npz(path):
    np.savez(path, acc=VALUES, begin=np.datetime64("2026-03-12T08:14:00"))


def npz_of_seconds(path):
    np.savez(path, acc=VALUES, start_time=BEGAN.timestamp())


def mat_of_days(path):
    from scipy.io import savemat

    days = (LOCAL - datetime(1, 1, 1)).total_seconds() / 86400 + 367  # as MATLAB counts them
    savemat(path, {"acc": VALUES, "info": {"datenum": days}})


def hdf5_of_milliseconds(path):
    with pytest.importorskip("h5py").File(path, "w") as file:
        file["acc"] = VALUES
        file["acc"].attrs["timestamp"] = int(BEGAN.timestamp() * 1000)


def universal(path):
    pyuff = pytest.importorskip("pyuff")
    data = pyuff.prepare_58(
        binary=0, func_type=1, rsp_node=3, rsp_dir=3, rsp_ent_name="acc", ref_ent_name="", ref_node=1, ref_dir=0,
        data=VALUES, x=T, id1="run", id3="12-Mar-26 08:14:00", abscissa_spacing=1, abscissa_inc=1 / RATE,
        abscissa_min=0.0, abscissa_spec_data_type=17, ordinate_spec_data_type=12, ordinate_axis_units_lab="g",
        orddenom_spec_data_type=0, z_axis_spec_data_type=0, ord_data_type=4, ver_num=0, load_case_id=0,
    )  # fmt: skip
    pyuff.UFF(str(path)).write_sets(data, "overwrite")


WITH_DATES = (
    mat, mat_of_structures, mat_of_days, hdf5, hdf5_of_milliseconds, parquet, tdms, wav, npz, npz_of_seconds, universal,
)  # fmt: skip


@pytest.mark.parametrize("write", WITH_DATES)
def test_the_date_in_a_files_metadata_is_when_the_recording_begins(tmp_path, imported, write):
    path = tmp_path / f"run.{write.__name__.partition('_')[0]}"
    write(path)
    _, started, _ = imported(path, read_table(path).columns[0].name, zone="Europe/Berlin")
    assert datetime.fromisoformat(started) == BEGAN


def test_a_local_time_is_never_taken_for_utc_in_silence(tmp_path, imported):
    csv(tmp_path / "run.csv", "Datum: 12.03.2026 08:14:00\n")
    found, started, _ = imported(tmp_path / "run.csv", "Acc (g)")
    assert "2026-03-12 08:14:00 by a clock whose zone is not stated, taken for UTC" in found["notes"]["started"]
    assert datetime.fromisoformat(started) == datetime(2026, 3, 12, 8, 14, tzinfo=UTC)
    _, started, _ = imported(tmp_path / "run.csv", "Acc (g)", 'zone = "Europe/Berlin"')
    assert datetime.fromisoformat(started) == BEGAN


def test_a_person_who_can_be_asked_states_the_zone_of_a_local_time_once(tmp_path, imported):
    asked = []

    def ask(question):
        asked.append(question)
        return "Europe/Berlin"

    csv(tmp_path / "run.csv", "Datum: 12.03.2026 08:14:00\n")
    found, started, _ = imported(tmp_path / "run.csv", "Acc (g)", ask=ask)
    assert datetime.fromisoformat(started) == BEGAN and "started" not in found["notes"]
    assert (
        len(asked) == 1 and "run.csv: it began at 2026-03-12 08:14:00 by a clock whose zone is not stated" in asked[0]
    )
    imported(tmp_path / "run.csv", "Acc (g)", 'zone = "+01:00"', ask=ask)
    csv(tmp_path / "run.csv", "Datum: 2026-03-12T08:14:00+01:00\n")
    imported(tmp_path / "run.csv", "Acc (g)", ask=ask)
    assert len(asked) == 1


@pytest.mark.parametrize(("name", "number"), [("start", 45000.0), ("test_id", 740000), ("date", 12.5), ("gain", 1.7e9)])
def test_a_number_that_may_be_something_else_is_no_date(name, number):
    assert stated_in({name: number}) is None


def test_an_hour_that_came_twice_is_asked_for_its_offset():
    night = datetime(2025, 10, 26, 2, 30)
    with pytest.raises(InputError, match=r"clocks of Europe/Berlin were set; give --zone \+0200 or \+0100"):
        in_zone("run.csv", night, "Europe/Berlin")
    assert in_zone("run.csv", night, "+0200") == (datetime(2025, 10, 26, 0, 30, tzinfo=UTC), "")


def test_a_file_without_a_date_is_offered_its_own_time_and_replayed_by_no_service(tmp_path, imported):
    csv(tmp_path / "run.csv")
    os.utime(tmp_path / "run.csv", (BEGAN.timestamp(), BEGAN.timestamp()))
    found, started, first = imported(tmp_path / "run.csv", "Acc (g)")
    assert started == "" and first.year == 1970
    assert "states no date" in found["notes"]["started"]
    assert "--started 2026-03-12T07:14:00+00:00" in found["notes"]["started"]
    with pytest.raises(InputError, match="when it was recorded is not known; import it again with --started"):
        replay(tmp_path / "out.mcap", ["tcp/x"], 0, publish_to=lambda *_: nullcontext())
    _, started, _ = imported(tmp_path / "run.csv", "Acc (g)", started="2026-03-12T08:14:00+01:00")
    assert datetime.fromisoformat(started) == BEGAN


def test_a_date_of_the_future_is_refused(tmp_path, imported):
    csv(tmp_path / "run.csv", "Date: 2126-03-12T08:14:00Z\n")
    with pytest.raises(InputError, match=r"begins at 2126-03-12T08:14:00\+00:00, which is in the future"):
        imported(tmp_path / "run.csv", "Acc (g)")


def test_a_date_that_the_file_contradicts_is_told(tmp_path, imported):
    csv(tmp_path / "run.csv", "Date: 2026-03-12T08:14:00Z\n")
    found, _, _ = imported(tmp_path / "run.csv", "Acc (g)", started="2026-02-12T08:14:00Z")
    assert any("but the file states 2026-03-12T08:14:00+00:00: the given one is used" in m for m in found["mistakes"])


def test_the_command_takes_date_and_zone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    csv(tmp_path / "run.csv")
    options = ["import", "run.csv", "--guess", "--teeth", "23/57", "--yes"]
    assert run([*options, "--started", "12.03.2026 08:14", "--zone", "Europe/Berlin"]) == 0
    with Recording(tmp_path / "run.mcap") as recording:
        assert datetime.fromisoformat(recording.metadata["started"]) == BEGAN
    assert run([*options, "--started", "yesterday", "--zone", "Europe/Berlin"]) == 2
    assert "--started = 'yesterday' must be a date with a time of day" in capsys.readouterr().err


@pytest.mark.parametrize("stated", ["option", "terminal"])
def test_the_zone_that_a_guessed_mapping_was_given_holds_for_the_next_file(tmp_path, monkeypatch, stated):
    monkeypatch.chdir(tmp_path)
    if stated == "terminal":
        answers = iter(["Europe/Berlin"])  # one question alone
        monkeypatch.setattr("sys.stdin.isatty", lambda: True)
        monkeypatch.setattr("typer.prompt", lambda *_, **__: next(answers))
    csv(tmp_path / "run.csv", "Datum: 12.03.2026 08:14:00\n")
    options = ["--zone", "Europe/Berlin"] if stated == "option" else []
    command = ["import", "run.csv", "--guess", "--teeth", "23/57", "--age", "unknown", "--out", "run.mcap"]
    assert run([*command, *options]) == 0
    assert 'zone = "Europe/Berlin"' in (tmp_path / "run.toml").read_text()
    csv(tmp_path / "next.csv", "Datum: 13.03.2026 08:14:00\n")
    assert run(["import", "run.toml", "--source", "next.csv", "--out", "next.mcap"]) == 0
    with Recording(tmp_path / "next.mcap") as recording:
        assert datetime.fromisoformat(recording.metadata["started"]) == BEGAN + timedelta(days=1)


def _tachometer(speed):
    t = np.arange(20000) / 5000.0
    return t, np.sin(2 * np.pi * 23 * speed * t), np.where((speed * t) % 1 < 0.05, 5.0, 0.1)


def _own_csv(path):
    rows = "\n".join(f"{t:.5f},{a:.5f},{p}" for t, a, p in zip(*_tachometer(29.3), strict=True))
    path.write_text(f"Time (s),Acc (g),Tacho (V)\n{rows}\n")


@pytest.mark.parametrize(("speed", "said"), [("1752", "is it in revolutions a minute?"), ("12", "leave it out")])
def test_a_speed_that_the_files_tachometer_contradicts_is_refused(tmp_path, monkeypatch, capsys, speed, said):
    monkeypatch.chdir(tmp_path)
    _own_csv(tmp_path / "run.csv")
    assert run(["import", "run.csv", "--guess", "--teeth", "23/57", "--speed", speed]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "contradicted by the file's tachometer, which gives 29.3 Hz" in told and said in told


def test_a_rate_that_the_file_contradicts_is_not_printed_as_given(tmp_path, monkeypatch, capsys):
    """`--rate 12800` was once printed as "8000 Hz (as given)"."""
    monkeypatch.chdir(tmp_path)
    _own_csv(tmp_path / "run.csv")
    wav(tmp_path / "run.wav")
    for name, rate in (("run.csv", 5000), ("run.wav", 2000)):
        run(["import", name, "--guess", "--rate", "12800", "--force"])
        told = " ".join(capsys.readouterr().out.split())
        assert f"the file gives {rate} Hz, which contradicts --rate 12800" in told
