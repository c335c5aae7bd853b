"""Measurement files of every format become recordings with the samples, rate and units that they hold."""

import gc
import sys

import numpy as np
import pytest
from measurement_files import RATE, WRITERS, N, as_csv, as_wav16, signal

from service.errors import InputError
from service.files import readers
from service.files.import_recording import import_recording
from service.files.readers import read_table
from service.stream.sources.mcap import read_windows

G = 9.80665
MAPPING = """
schema = "gear-import/1"
asset = "bench"
[file]
path = "{file}"
{more}
[channels.top]
column = "{column}"
unit = "g"
[rig]
"""


SAID = "sample_rate_hz = 12800"
CASES = [
    ("run.csv", "CSV", "Acc1 (g)", "g", ""),
    ("recorder.csv", "CSV", "Beschleunigung", "g", ""),
    ("plain.csv.gz", "CSV", "column 2", "", 'time_column = "column 1"'),
    ("run.npz", "NPZ", "acc", "", SAID),
    ("run.npy", "NPY", "run[2]", "", 'time_column = "run[1]"'),
    ("run16.wav", "WAV", "channel 1", "", ""),
    ("run24.wav", "WAV", "channel 1", "", ""),
    ("float.wav", "WAV", "channel 1", "", ""),
    ("run.mat", "MAT", "run.acc", "", ""),
    ("run73.mat", "MAT 7.3", "run.acc", "", 'time_column = "run.time"'),
    ("run.tdms", "TDMS", "Acc1", "g", ""),
    ("run.uff", "UFF-58", "housing:3+Z", "g", ""),
    ("run.mf4", "MDF", "Acc1", "g", ""),
    ("run.h5", "HDF5", "run/acc", "g", ""),
    ("run.parquet", "Parquet", "Acc1 (g)", "g", ""),
]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the libraries that write
@pytest.mark.parametrize(("file", "kind", "column", "unit", "more"), CASES, ids=[c[0] for c in CASES])
def test_samples_rate_and_unit_of_a_file_come_out_as_they_went_in(tmp_path, file, kind, column, unit, more):
    x = signal()
    WRITERS[file](tmp_path / file, x)
    table = read_table(tmp_path / file)
    found = table.column(column)
    assert table.format == kind and found.unit == unit
    assert np.array_equal(found.values, x)
    (tmp_path / "mapping.toml").write_text(MAPPING.format(file=file, more=more, column=column))
    import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")
    _, metadata, (window,) = read_windows(tmp_path / "out.mcap")
    samples = window.accelerations["top"]
    assert samples.rate == pytest.approx(RATE, rel=1e-9)
    assert np.array_equal(samples.values, (x * G).astype(np.float32))
    if kind == "TDMS":
        assert metadata["started"] == "2024-05-01T12:00:00+00:00"


def test_every_format_has_a_file_that_proves_it():
    assert {f.name for f in readers.FORMATS} | {"CSV"} == {case[1] for case in CASES}


@pytest.mark.parametrize("form", [f for f in readers.FORMATS if f.library], ids=lambda f: f.name)
def test_a_format_whose_library_is_not_installed_says_what_to_install(form, tmp_path, monkeypatch):
    path = tmp_path / "run.data"
    path.write_bytes(form.begins[0].ljust(4096, b"\x00"))
    monkeypatch.setitem(sys.modules, form.library, None)
    with pytest.raises(InputError, match=rf"a {form.name} file, and {form.library} is not installed.*gear-twin\[form"):
        read_table(path)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("form", readers.FORMATS, ids=lambda f: f.name)
def test_a_broken_file_is_one_line_that_names_the_file_and_its_format(form, tmp_path):
    path = tmp_path / "run.data"
    path.write_bytes(form.begins[0] + b"\x07broken" * 100)
    with pytest.raises(InputError, match=rf"run\.data is no readable {form.name} file: ") as caught:
        read_table(path)
    assert "\n" not in str(caught.value)
    del caught  # some libraries leave a broken file to the garbage collector: here, where it is no error, not later
    gc.collect()


LAYOUTS = [
    ("1;2\n3;4\n5;6\n7;8\n", {"column 1": [1, 3, 5, 7], "column 2": [2, 4, 6, 8]}),
    ("x,5\n", None),
    ("a\n1,5\n2,5\n3,5\n4,5\n", {"a": [1.5, 2.5, 3.5, 4.5]}),
    ("a,b,\n1,2,\n3,,\n5,6,\n7,8,\n9,1,\n", {"a": [1, 3, 5, 7, 9], "b": [2, np.nan, 6, 8, 1]}),
    ("# made by x\n# t a\n0 1\n1 2\n2 3\n3 4\n", {"t": [0, 1, 2, 3], "a": [1, 2, 3, 4]}),
    ('"t","a"\n"s","m/s^2"\n"0","1"\n"1","2"\n"2","3"\n"3","4"\n', {"t": [0, 1, 2, 3], "a": [1, 2, 3, 4]}),
    (
        "when;a\n01.05.2024 23:59:59,5;1\n02.05.2024 00:00:00,5;2\n02.05.2024 00:00:01,5;3\n02.05.2024 00:00:02,5;4\n",
        {"when": [0, 1, 2, 3], "a": [1, 2, 3, 4]},
    ),
    ("state\ta\nOK\t1\nOK\t2\nbad\t3\nOK\t4\n", {"a": [1, 2, 3, 4]}),
    ("a,b\n1,2\n3,4\n5,6\n7,8\n9", {"a": [1, 3, 5, 7], "b": [2, 4, 6, 8]}),
]


@pytest.mark.parametrize(("text", "columns"), LAYOUTS)
def test_the_layout_of_a_text_file_is_found_in_it(tmp_path, text, columns):
    path = tmp_path / "a.csv"
    path.write_text(text)
    if columns is None:
        with pytest.raises(InputError, match=r"a\.csv"):
            read_table(path)
        return
    table = read_table(path)
    assert [c.name for c in table.columns] == list(columns)
    for column in table.columns:
        assert column.values == pytest.approx(columns[column.name], nan_ok=True)


@pytest.mark.parametrize(
    "line",
    [
        "Sample rate: 25600 Hz",
        "Sampling Frequency [kHz];25,6",
        "fs = 25.6 kHz",
        "Abtastrate (Hz);25600",
        "Sample Rate,25600.00",
    ],
)
def test_a_rate_stated_above_the_numbers_is_read(tmp_path, line):
    path = tmp_path / "a.csv"
    path.write_text(f"{line}\na\n1\n2\n3\n4\n")
    assert read_table(path).rate == pytest.approx(25600)


@pytest.mark.parametrize("cell", ["oops", "0.05_95"])  # the latter is one to Python
def test_a_cell_that_is_no_number_is_named_with_its_row_and_column(tmp_path, cell):
    path = tmp_path / "a.csv"
    path.write_text("t,a\n" + "".join(f"{i},{cell if i == 7 else i}\n" for i in range(40)))
    with pytest.raises(InputError, match=f"row 8 of column 'a' is '{cell}', not a number"):
        read_table(path)


TIMES = [
    ("sample_rate_hz = 6400", "file.sample_rate_hz = 6400 Hz, but the times of 'Time.*' give 12800 Hz"),
    ("sample_rate_hz = 25600", "file.sample_rate_hz = 25600 Hz, but the times of 'Time.*' give 12800 Hz"),
    ("sample_rate_hz = 12.8", "12.8 Hz, but .* give 12800 Hz; is the time in ms"),
    ('time_column = "clock"', "file.time_column = 'clock' is not in run.csv, which has Time"),
]


@pytest.mark.parametrize(("more", "message"), TIMES)
def test_a_rate_that_contradicts_the_time_column_is_refused_with_both_numbers(tmp_path, more, message):
    as_csv(tmp_path / "run.csv", signal())
    (tmp_path / "mapping.toml").write_text(MAPPING.format(file="run.csv", more=more, column="Acc1 (g)"))
    with pytest.raises(InputError, match=message):
        import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")


def test_samples_that_the_time_column_shows_to_be_missing_are_missing_in_the_recording(tmp_path):
    x = signal()
    kept = np.concatenate((np.arange(5000), np.arange(5100, N)))
    rows = "\n".join(f"{i / RATE:.8f},{float(x[i])!r}" for i in kept.tolist())
    (tmp_path / "run.csv").write_text(f"Time (s),Acc1 (g)\n{rows}\n")
    (tmp_path / "mapping.toml").write_text(MAPPING.format(file="run.csv", more="", column="Acc1 (g)"))
    found = import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")
    _, _, (window,) = read_windows(tmp_path / "out.mcap")
    values = window.accelerations["top"].values
    assert np.flatnonzero(np.isnan(values)).tolist() == list(range(5000, 5100))
    assert np.array_equal(values[5100:], (x[5100:] * G).astype(np.float32))
    assert "100 samples are missing" in found["notes"]["accel/top"]


BROKEN_TIMES = [
    (lambda t: np.where(np.arange(N) > 6000, t - 0.3, t), "falls from .* at row 6002; two records in one"),
    (lambda t: np.cumsum(np.tile([1e-5, 2e-4], N // 2)), "is not evenly spaced: steps from 1e-05 to 0.0002 s"),
    (lambda t: np.where(np.arange(N) > 6000, t + 30, t), "has gaps of 30 s, longer than its 12800 values"),
    (lambda t: np.where(np.arange(N) == 6000, np.nan, t), "of which 1 are empty"),
]


@pytest.mark.parametrize(("broken", "message"), BROKEN_TIMES)
def test_a_broken_time_column_is_refused_with_its_place(tmp_path, broken, message):
    times = broken(np.arange(N) / RATE)
    rows = "\n".join(f"{t:.8f},{v!r}" for t, v in zip(times.tolist(), signal().tolist(), strict=True))
    (tmp_path / "run.csv").write_text(f"Time (s),Acc1 (g)\n{rows}\n")
    mapping = MAPPING.format(file="run.csv", more='time_column = "Time (s)"', column="Acc1 (g)")
    (tmp_path / "mapping.toml").write_text(mapping)
    with pytest.raises(InputError, match=message):
        import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")


BOTH = """
schema = "gear-import/1"
asset = "bench"
[file]
path = "data.npz"
sample_rate_hz = 12800
{channels}
[rig]
"""
FORMS = [
    '[channels.encoder.pinion]\ncolumn = "e"\nunit = "s"\nedges_per_rev = 256\n'
    '[channels.torque.pinion]\ncolumn = "t"\nunit = "Nm"\n',
    '[channels."encoder/pinion"]\ncolumn = "e"\nunit = "s"\nedges_per_rev = 256\n'
    '[channels."torque/pinion"]\ncolumn = "t"\nunit = "Nm"\n',
    '[channels.pinion]\nkind = "encoder"\ncolumn = "e"\nunit = "s"\nedges_per_rev = 256\n'
    '[channels."torque/pinion"]\ncolumn = "t"\nunit = "Nm"\nscale = 1.0\n',
]


@pytest.mark.parametrize("channels", FORMS)
def test_torque_and_encoder_of_one_shaft_come_from_one_mapping(tmp_path, channels):
    edges, torque = np.arange(2500) / 2560.0 + 0.001, 10 + np.sin(np.arange(N))
    np.savez(tmp_path / "data.npz", e=edges, t=torque)
    (tmp_path / "mapping.toml").write_text(BOTH.format(channels=channels))
    found = import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")
    assert set(found["channels"]) == {"encoder/pinion", "torque/pinion"}
    _, _, (window,) = read_windows(tmp_path / "out.mcap")
    assert np.diff(window.encoders["pinion"].times) == pytest.approx(np.diff(edges), abs=1e-9)
    assert window.torques["pinion"].values == pytest.approx(torque, rel=1e-6)


TWICE = [
    (
        FORMS[0] + FORMS[1].replace('"e"', '"x"'),
        "channels.encoder/pinion and channels.encoder.pinion are both encoder/pi",
    ),
    ('[channels."torque/pinion"]\nkind = "accel"\nunit = "g"\n', "kind = 'accel' contradicts the name of its table"),
    ('[channels."torque/motor"]\nunit = "Nm"\n', r"must be named pinion or gear, such as \[channels.torque.pinion\]"),
    ("[channels.encoder.pinion]\nunit = 'V'\n", "unit = 'V' must be one of .*kind = 'tachometer'"),
    ("[channels.tachometer.pinion]\nedges_per_rev = 2\n", "edges_per_rev = 2 does not go with kind .*pulses_per_rev"),
    ("[channels.a]\nunit = 'g'\nthreshold = 2\n", "threshold = 2 goes with kind 'tachometer' only"),
    ("[channels.a]\nunit = 'g'\nscale = 0\n", "scale = 0 makes every value 0"),
    ("[channels.tachometer.pinion]\nedge = 'up'\n", "edge = 'up' must be rising or falling"),
]


@pytest.mark.parametrize(("channels", "message"), TWICE)
def test_a_wrong_channel_is_one_line_that_names_its_table(tmp_path, channels, message):
    np.savez(tmp_path / "data.npz", e=np.arange(10.0), t=np.arange(10.0))
    (tmp_path / "mapping.toml").write_text(BOTH.format(channels=channels))
    with pytest.raises(InputError, match=message):
        import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")


@pytest.mark.parametrize("write", [as_wav16, as_csv])
def test_a_data_file_given_as_a_mapping_is_recognised(tmp_path, write):
    path = tmp_path / ("run.wav" if write is as_wav16 else "run.csv")
    write(path, signal())
    with pytest.raises(InputError, match=r"is a data file \((WAV|text)\), not a mapping file; .*--guess"):
        import_recording(path, tmp_path / "out.mcap")


TACHO = """
schema = "gear-import/1"
asset = "bench"
[file]
path = "run.csv"
[channels.top]
column = "Acc1 (g)"
unit = "g"
[channels.tachometer.pinion]
column = "Tacho (V)"
first_edge_index = 1000
[rig]
"""


def test_tachometer_pulses_become_the_encoder_of_their_shaft(tmp_path):
    t, x = np.arange(N) / RATE, signal()
    volts = np.where((24.6 * t + 0.3) % 1 < 0.05, 5.0, 0.1) + 0.05 * np.random.default_rng(2).normal(size=N)
    rows = "\n".join(f"{a:.8f},{b:.5f},{c:.3f}" for a, b, c in zip(t, x, volts, strict=True))
    (tmp_path / "run.csv").write_text(f"Time (s),Acc1 (g),Tacho (V)\n{rows}\n")
    (tmp_path / "mapping.toml").write_text(TACHO)
    found = import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")
    assert "24 pulses of 'Tacho (V)', 1 a turn, 24.6" in found["notes"]["encoder/pinion"]
    _, _, (window,) = read_windows(tmp_path / "out.mcap")
    edges = window.encoders["pinion"]
    assert (edges.per_rev, edges.first_index, edges.times.size) == (1, 1000, 24)
    expected = (np.arange(1, 25) - 0.3) / 24.6
    assert np.max(np.abs(edges.times - expected)) < 1 / RATE
