"""What a data file states about its values is used, or it is said that it was not."""

from __future__ import annotations

import datetime as dt
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

from service.cli import run
from service.errors import InputError
from service.files.guess import proposal_of
from service.files.readers import read_table
from service.files.readers.table import split_unit

RATE = 5120.0
BEGIN = dt.datetime(2026, 11, 26, 14, 15, 30)


def gear(rate: float = RATE, seconds: float = 8.0, speed: float = 24.5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, acceleration [g] and tachometer [V] of a healthy pair, seconds long."""
    t = np.arange(round(seconds * rate)) / rate
    turns = speed * t
    x = sum(a * np.cos(2 * np.pi * 23 * k * turns + k) for k, a in ((1, 1.0), (2, 0.5), (3, 0.25)))
    return t, x + 0.1 * np.random.default_rng(1).standard_normal(t.size), 5.0 * (turns % 1 < 0.05)


def csv(path: Path, stamps, name: str, x: np.ndarray, tacho: np.ndarray) -> Path:
    rows = "\n".join(f"{s},{u:.4f},{v:.0f}" for s, u, v in zip(stamps, x, tacho, strict=True))
    path.write_text(f"{name},Acc (g),Tacho (V)\n{rows}\n", encoding="utf-8")
    return path


def guessed(path: Path):
    return proposal_of(read_table(path), path.name)


@pytest.mark.parametrize(
    ("rate", "digits"), [(5120, 0), (2560, 0), (4096, 0), (5120, 1), (833, 1), (833, 3), (1652, 2), (995, 3)]
)
def test_the_rate_of_printed_times_is_that_of_whole_ticks(tmp_path, rate, digits):
    t, x, tacho = gear(rate)
    stamps = [f"{BEGIN + dt.timedelta(seconds=s + 0.04):%Y-%m-%d %H:%M:%S.%f}" for s in t]
    cut = {0: -7, 1: -5, 2: -4, 3: -3}[digits]
    found = guessed(csv(tmp_path / "a.csv", [s[:cut] for s in stamps], "Timestamp", x, tacho))
    assert found.rate == pytest.approx(rate, rel=2e-4)
    assert found.duration == pytest.approx(8, rel=2e-4)
    assert not any(axis.missing for axis in found.axes)


@pytest.mark.slow
def test_times_of_six_digits_lose_no_rate_where_they_grow_long(tmp_path):
    t, x, tacho = gear(1652.0, 130.0)
    found = guessed(csv(tmp_path / "a.csv", [f"{s:.6g}" for s in t], "time", x, tacho))
    assert found.rate == pytest.approx(1652, rel=2e-4)


def test_times_too_coarse_for_a_rate_ask_for_it_in_one_sentence(tmp_path):
    t, x, tacho = gear(seconds=1.5)
    stamps = [f"{BEGIN + dt.timedelta(seconds=s):%Y-%m-%d %H:%M:%S}" for s in t]
    with pytest.raises(InputError, match=r"in steps of 1 s, of which none is whole; .*--rate"):
        guessed(csv(tmp_path / "a.csv", stamps, "Timestamp", x, tacho))


@pytest.mark.parametrize(("unit", "name"), [(1e-3, "timestamp"), (1e-6, "ts"), (1e-9, "epoch"), (1.0, "Time (s)")])
def test_a_date_as_a_number_has_the_unit_that_its_size_says(tmp_path, unit, name):
    t, x, tacho = gear(1000.0)
    begin = 1795702530
    stamps = [f"{begin + s:.3f}" if unit == 1 else round(begin / unit) + round(s / unit) for s in t]
    found = guessed(csv(tmp_path / "a.csv", stamps, name, x, tacho))
    assert found.rate == pytest.approx(1000, rel=1e-4)
    assert abs((found.axes[0].began - dt.datetime(2026, 11, 26, 14, 15, 30, tzinfo=dt.UTC)).total_seconds()) < 1e-3


def test_a_date_in_days_of_a_spreadsheet_is_a_time(tmp_path):
    t, x, tacho = gear(1000.0)
    found = guessed(csv(tmp_path / "a.csv", [f"{46352.5 + s / 86400:.10f}" for s in t], "time", x, tacho))
    assert found.rate == pytest.approx(1000, rel=1e-4)
    assert found.axes[0].began.year == 2026


@pytest.mark.parametrize(
    "form",
    [
        "%m/%d/%Y %I:%M:%S.%f %p", "%Y/%m/%d %H:%M:%S.%f", "%d-%b-%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f",
        "%Y-%m-%dT%H:%M:%S.%fZ", "%Y-%m-%d %H:%M:%S.%f+0530", "%b %d %Y %H:%M:%S.%f", "%I:%M:%S.%f %p",
    ],
)  # fmt: skip
def test_dates_and_times_of_day_are_read_in_every_usual_notation(tmp_path, form):
    t, x, tacho = gear(1000.0)
    stamps = [(BEGIN + dt.timedelta(seconds=s)).strftime(form) for s in t]
    found = guessed(csv(tmp_path / "a.csv", stamps, "Timestamp", x, tacho))
    assert found.rate == pytest.approx(1000, rel=1e-4)
    assert found.duration == pytest.approx(8, rel=1e-3)


def test_a_change_of_the_offset_from_utc_is_no_fall(tmp_path):
    t, x, tacho = gear(1000.0)
    begin, change = (dt.datetime(2026, 10, 25, 0, 59, 50, tzinfo=dt.UTC), dt.datetime(2026, 10, 25, 1, tzinfo=dt.UTC))
    stamps = []
    for s in t:
        utc = begin + dt.timedelta(seconds=float(s))
        stamps.append(utc.astimezone(dt.timezone(dt.timedelta(hours=2 if utc < change else 1))).isoformat())
    path = csv(tmp_path / "a.csv", stamps, "Timestamp", x, tacho)
    assert guessed(path).rate == pytest.approx(1000, rel=1e-4)
    assert read_table(path).started == begin


def test_a_column_that_is_no_number_is_left_out_with_its_first_cell(tmp_path):
    path = tmp_path / "a.csv"
    rows = [f"{i / 1000};{np.sin(i):.4f};1.470,{i % 90 + 10}" for i in range(2000)]
    path.write_text("Zeit (s);Beschl (g);Drehmoment (Nm)\n" + "\n".join(rows).replace(".", ",", 0), encoding="utf-8")
    left_out = {g.columns[0]: g.why for g in guessed(path).guesses if g.kind == "left out"}
    assert left_out["Drehmoment (Nm)"] == "row 1 is '1.470,10', which is no number and no known time"


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("name", ["Unnamed: 0", "No", "t", "index"])
def test_numbers_of_the_rows_are_no_time(tmp_path, first, name):
    _, x, tacho = gear()
    found = guessed(csv(tmp_path / "a.csv", range(first, first + x.size), name, x, tacho))
    assert found.axes == () and found.rate is None
    assert "counts the rows" in found.guesses[0].why


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("torque [Nm] - T 10Nm", ("torque - T 10Nm", "Nm")),
        ("speed [RPM] - w1", ("speed - w1", "RPM")),
        ("acc_brg_DE_V", ("acc_brg_DE", "V")),
        ("torque_in_Nm", ("torque_in", "Nm")),
        ("Beschl. / m/s²", ("Beschl.", "m/s²")),
        ("time_ms", ("time", "ms")),
        ("acc_v", ("acc_v", "")),
        ("Acc [2]", ("Acc [2]", "")),
    ],
)
def test_a_unit_is_read_wherever_it_stands_in_a_name(label, expected):
    assert split_unit(label) == expected


@pytest.mark.parametrize("name", ["speed", "load", "class", "clock", "rpm", "fault_state", "Drehzahl"])
def test_a_column_that_calls_itself_something_else_is_no_accelerometer(tmp_path, name):
    t, x, _ = gear()
    path = tmp_path / "a.csv"
    other = 1500 + np.cumsum(np.random.default_rng(2).standard_normal(t.size))
    np.savetxt(path, np.stack([t, x, other], 1), "%.6f", ",", header=f"time,Acc (g),{name}", comments="")
    assert {g.columns[0]: g.kind for g in guessed(path).guesses}[name] == "left out"


def test_a_column_of_classes_is_no_accelerometer_whatever_its_name(tmp_path):
    t, x, _ = gear()
    path = tmp_path / "a.csv"
    np.savetxt(path, np.stack([t, x, (3 * (t // 2)) % 4], 1), "%.6f", ",", header="time,Acc (g),q", comments="")
    assert "4 whole numbers" in next(g.why for g in guessed(path).guesses if g.columns == ("q",))


@pytest.mark.parametrize("name", ["channel 2", "simout", "readout", "layout", "Tacho2"])
def test_a_shaft_is_taken_from_a_name_only_where_it_is_a_word_of_it(tmp_path, name):
    t, x, tacho = gear()
    path = tmp_path / "a.csv"
    np.savetxt(path, np.stack([t, x, tacho], 1), "%.6f", ",", header=f"time,Acc (g),{name}", comments="")
    found = next(g for g in guessed(path).guesses if g.columns == (name,))
    assert (found.becomes, found.remark) == ("tachometer/pinion", "assumed to be on the pinion")


def packed(file, name: str, values: np.ndarray, **attributes) -> None:
    file.create_dataset(name, data=values).attrs.update({"units": "m/s2", "fs": [RATE], **attributes})


def test_packed_values_of_netcdf_and_hdf5_are_unpacked(tmp_path):
    h5py = pytest.importorskip("h5py")
    _, x, _ = gear(seconds=10)
    stored = np.round(x / 0.61).astype("i2")
    holed = stored.copy()
    holed[100:500] = -32768
    with h5py.File(tmp_path / "a.nc", "w") as file:
        packed(file, "plain", stored, scale_factor=0.61)
        packed(file, "shifted", stored, scale_factor=[0.61], add_offset=[2.5])
        packed(file, "holed", holed, scale_factor=0.61, _FillValue=np.int16(-32768))
        packed(file, "limited", holed, scale_factor=0.61, valid_range=[-1000, 1000])
        packed(file, "odd", stored, gain=0.61)
    table = read_table(tmp_path / "a.nc")
    values = {c.name: c.values for c in table.columns}
    assert values["plain"] == pytest.approx(stored * 0.61)
    assert values["shifted"] == pytest.approx(stored * 0.61 + 2.5)
    for name in ("holed", "limited"):
        assert np.flatnonzero(np.isnan(values[name])).tolist() == list(range(100, 500))
        assert any(name in note and "400 of 51200 values are missing" in note for note in table.notes)
    assert "'odd' states gain = 0.61, which is not applied" in table.notes
    assert {c.rate for c in table.columns} == {RATE}


def test_scale_and_missing_value_in_the_metadata_of_parquet_are_used(tmp_path):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    _, x, _ = gear(seconds=10)
    stored = np.round(x / 0.001).astype("i4")
    stored[:5] = 99999
    field = pa.field("acc", pa.int32(), metadata={"unit": "g", "scale_factor": "0.001", "missing_value": "99999"})
    parquet.write_table(pa.table([pa.array(stored)], schema=pa.schema([field])), tmp_path / "a.parquet")
    found = read_table(tmp_path / "a.parquet").columns[0]
    assert np.isnan(found.values[:5]).all()
    assert found.values[5:] == pytest.approx(stored[5:] * 0.001)
    assert found.unit == "g"


def test_samples_that_mdf_marks_as_invalid_are_missing(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    t, x, _ = gear(seconds=10)
    invalid = np.zeros(x.size, dtype=bool)
    invalid[5000:15000] = True
    signal = asammdf.Signal(
        samples=np.where(invalid, 0, x), timestamps=t, name="Acc", unit="g", invalidation_bits=invalid
    )
    with asammdf.MDF(version="4.10") as file:
        file.append([signal])
        file.save(tmp_path / "a.mf4")
    assert np.array_equal(np.isnan(read_table(tmp_path / "a.mf4").columns[0].values), invalid)


@pytest.mark.parametrize("later", [2.0, 1.25])
def test_each_channel_of_tdms_begins_at_its_own_time(tmp_path, later):
    nptdms = pytest.importorskip("nptdms")
    _t, x, tacho = gear()
    base, cut = np.datetime64("2026-11-26T14:15:30.000000"), round(later * RATE)

    def channel(group, name, values, start, offset):
        moment = base + np.timedelta64(round(start * 1e6), "us")
        stated = {"wf_start_time": moment, "wf_start_offset": offset, "wf_increment": 1 / RATE}
        return nptdms.ChannelObject(group, name, values, stated)

    parts = [
        channel("a", "Tacho", tacho, 0, 0.0), channel("b", "Acc", x[cut:], later, 0.0),
        channel("b", "Late", x[cut:], 0, later),
    ]  # fmt: skip
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as file:
        file.write_segment(parts)
    table = read_table(tmp_path / "a.tdms")
    assert {c.name: c.start for c in table.columns} == {"Tacho": 0.0, "Acc": later, "Late": later}
    assert table.started == dt.datetime(2026, 11, 26, 14, 15, 30, tzinfo=dt.UTC)


def test_one_odd_part_of_a_matlab_file_is_left_out_and_the_rest_is_read(tmp_path):
    from scipy.io import savemat

    t, x, tacho = gear(seconds=10)
    odd = np.empty((1, 3), object)
    odd[0, 0], odd[0, 1], odd[0, 2] = {"name": "bearing"}, x[:50], "note"
    savemat(tmp_path / "a.mat", {"time": t, "acc": x, "tacho": tacho, "meta": odd})
    found = guessed(tmp_path / "a.mat")
    assert found.rate == RATE
    assert {g.columns[0]: g.why for g in found.guesses}["meta"] == "unequal parts"


def test_an_odd_part_of_numpy_and_hdf5_files_is_left_out_with_its_reason(tmp_path):
    h5py = pytest.importorskip("h5py")
    t, x, _ = gear(seconds=10)
    np.savez(tmp_path / "a.npz", time=t, acc=x, odd=np.array([{"a": 1}, None], dtype=object))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["acc"], file["odd"] = t, x, np.zeros((300, 300))
    for name, why in (("a.npz", "cannot be read"), ("a.h5", "300 × 300")):
        table = read_table(tmp_path / name)
        assert why in table.left_out["odd"]
        assert guessed(tmp_path / name).rate == RATE


def test_matlab_files_of_level_4_are_read(tmp_path):
    from scipy.io import savemat

    t, x, tacho = gear(seconds=10)
    savemat(tmp_path / "a.mat", {"t": t[:, None], "acc": x[:, None], "tacho": tacho[:, None]}, format="4")
    found = guessed(tmp_path / "a.mat")
    assert (found.rate, found.guesses[2].becomes) == (RATE, "tachometer/pinion")


def test_a_rate_that_stands_beside_the_data_as_a_number_is_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    from scipy.io import savemat

    _, x, tacho = gear(seconds=10)
    savemat(tmp_path / "a.mat", {"acc": x, "tacho": tacho, "Fs": RATE})
    savemat(tmp_path / "b.mat", {"rec": {"acc": x, "tacho": tacho, "dt": 1 / RATE}})
    np.savez(tmp_path / "c.npz", acc=x, tacho=tacho, sample_rate=RATE)
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file["run1/acc"], file["run1/tacho"], file["run1/fs"] = x, tacho, RATE
        file["run2/acc"], file["run2/fs"] = x, 2 * RATE
    for name in ("a.mat", "b.mat", "c.npz"):
        assert guessed(tmp_path / name).rate == pytest.approx(RATE)
    rates = {c.name: c.rate for c in read_table(tmp_path / "d.h5").columns}
    assert rates == {"run1/acc": RATE, "run1/tacho": RATE, "run2/acc": 2 * RATE}


def test_the_time_of_a_group_is_that_of_its_columns(tmp_path):
    h5py = pytest.importorskip("h5py")
    t, x, _tacho = gear(seconds=10)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run1/time"], file["run1/acc"] = t, x
        file["run2/time"], file["run2/acc"] = 2 * t, x
    found = guessed(tmp_path / "a.h5")
    assert {axis.name: axis.rate for axis in found.axes} == {"run1/time": RATE, "run2/time": RATE / 2}


@pytest.mark.parametrize("kind", ["moment", "duration", "nullable"])
def test_a_column_of_times_by_its_type_is_the_time_whatever_its_name(tmp_path, kind):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    t, x, tacho = gear(seconds=10)
    ns = np.round(t * 1e9).astype("timedelta64[ns]")
    times = {"moment": np.datetime64("2026-11-26T14:15:30", "ns") + ns, "duration": ns}.get(kind, ns)
    table = pa.table({"Acc (g)": x, "Tacho (V)": tacho, "__index_level_0__": pa.array(times)})
    parquet.write_table(table, tmp_path / "a.parquet")
    found = guessed(tmp_path / "a.parquet")
    assert (found.rate, found.axes[0].name) == (RATE, "__index_level_0__")


def test_columns_of_lists_and_texts_are_left_out_with_their_reason(tmp_path):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    _, x, _tacho = gear(seconds=10)
    lists = pa.array([list(x[i : i + 512]) for i in range(10)])
    parquet.write_table(pa.table({"n": np.arange(10.0) ** 2, "acc": lists, "who": ["me"] * 10}), tmp_path / "a.parquet")
    assert read_table(tmp_path / "a.parquet").left_out["acc"] == "lists of 512 values, one list a row"
    assert "who" in read_table(tmp_path / "a.parquet").left_out


def wav(path: Path, cut: int | None = None, size: int | None = None) -> Path:
    from scipy.io import wavfile

    _, x, tacho = gear(seconds=10)
    wavfile.write(path, int(RATE), np.stack([(x * 8000).astype("i2"), (tacho * 4000).astype("i2")], 1))
    data = bytearray(path.read_bytes())
    at = data.find(b"data")
    if size is not None:
        data[at + 4 : at + 8] = data[4:8] = struct.pack("<I", size)
    path.write_bytes(data[: at + 8 + cut] if cut else data)
    return path


@pytest.mark.parametrize(("cut", "size"), [(4 * 30000 + 2, None), (None, 0), (None, 2**32 - 1), (4 * 30000 + 1, 0)])
def test_a_recording_of_an_interrupted_recorder_gives_its_whole_frames(tmp_path, cut, size):
    table = read_table(wav(tmp_path / "a.wav", cut, size))
    frames = 30000 if cut else 51200
    assert [c.values.size for c in table.columns] == [frames, frames]
    assert f"the {frames} whole samples of each channel are read" in table.notes[0]


def test_a_workbook_is_called_by_its_name(tmp_path):
    import zipfile

    with zipfile.ZipFile(tmp_path / "a.xlsx", "w") as file:
        file.writestr("[Content_Types].xml", "<Types/>")
        file.writestr("xl/workbook.xml", "<workbook/>")
    with pytest.raises(InputError, match="workbook of a spreadsheet program: save the sheet as CSV"):
        read_table(tmp_path / "a.xlsx")


def test_no_time_column_gives_a_warning_of_the_program(tmp_path):
    t, x, tacho = gear(seconds=6)
    stamps = [f"{BEGIN + dt.timedelta(seconds=s):%Y-%m-%d %H:%M:%S}" for s in t]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        guessed(csv(tmp_path / "a.csv", stamps, "Timestamp", x, tacho))


@pytest.mark.parametrize("scale", [1e3, 1e6])
def test_times_without_a_unit_that_would_make_a_vibration_slow_ask_for_it(tmp_path, monkeypatch, capsys, scale):
    monkeypatch.chdir(tmp_path)
    t, x, tacho = gear()
    csv(tmp_path / "a.csv", [f"{scale * s:.4f}" for s in t], "time", x, tacho)
    assert run(["import", "a.csv", "--guess", "--out", "a.mcap"]) == 2
    assert "is the time in ms or µs? Its unit goes into the header" in capsys.readouterr().err


def test_a_date_that_does_not_change_is_no_time_and_stops_nothing(tmp_path):
    _, x, tacho = gear()
    found = guessed(csv(tmp_path / "a.csv", ["2026-11-26 14:15"] * x.size, "Date", x, tacho))
    assert found.axes == () and found.guesses[0].why == "constant, 0"


@pytest.mark.parametrize("unit", ["/min", "U/min", "bar", "1/s", "kHz", "°"])
def test_a_column_in_a_unit_of_another_quantity_is_no_accelerometer(tmp_path, unit):
    t, x, _ = gear(seconds=2)
    path = tmp_path / "a.csv"
    head = f"time,Acc (g),Dreh [{unit}]"
    np.savetxt(path, np.stack([t, x, 1500 + x], 1), "%.6f", ",", header=head, comments="", encoding="utf-8")
    assert guessed(path).guesses[2].kind == "left out"


def test_a_number_that_reads_like_a_scale_is_named(tmp_path):
    from scipy.io import savemat

    t, x, _ = gear(seconds=2)
    savemat(tmp_path / "a.mat", {"rec": {"t": t, "X": {"Data": x, "scale": 0.5}}})
    assert read_table(tmp_path / "a.mat").notes == ("the number 'rec.X.scale' = 0.5 is not applied",)
