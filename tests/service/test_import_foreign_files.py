"""Measurement files that other programs wrote, read as those programs meant them.

Sources    MATLAB 7.1 and 7.4, and WAV files, from the tests of SciPy; LabVIEW, from those of npTDMS; pandas with Arrow
           0.7.1, from those of PyArrow; HBM catman, from those of pyuff (tests/data/catman.uff)
Known      what the files hold by their own documentation, not by the libraries that read them here
"""

from importlib import util
from pathlib import Path

import numpy as np
import pytest

from service.errors import InputError
from service.files.import_recording import import_recording
from service.files.readers import read_table
from service.stream.sources.mcap import read_windows

CATMAN = Path(__file__).parents[1] / "data" / "catman.uff"
EIGHTHS = np.arange(9) * np.pi / 4  # `testdouble` of SciPy's MAT files
SAWTOOTH = np.array([-1.0, -0.5, 0.0, 0.5, 1.0 - 2**-23])  # first channel, 24 bit
SINE = np.sin(2 * np.pi * np.arange(128) / 128)
FILES = [
    ("scipy/io/matlab/tests/data/testdouble_7.1_GLNX86.mat", "MAT", "testdouble", "", None, EIGHTHS),
    ("scipy/io/matlab/tests/data/testdouble_6.1_SOL2.mat", "MAT", "testdouble", "", None, EIGHTHS),  # big-endian
    ("scipy/io/matlab/tests/data/testhdf5_7.4_GLNX86.mat", "MAT 7.3", "testdouble", "", None, EIGHTHS),
    ("scipy/io/tests/data/test-8000Hz-le-3ch-5S-24bit.wav", "WAV", "channel 1", "", 8000.0, SAWTOOTH),
    ("scipy/io/tests/data/test-8000Hz-be-3ch-5S-24bit.wav", "WAV", "channel 1", "", 8000.0, SAWTOOTH),
    ("nptdms/test/data/raw_timestamps.tdms", "TDMS", "Untitled", "", 1000.0, SINE),
    ("pyarrow/tests/data/parquet/v0.7.1.parquet", "Parquet", "x", "", None, np.array([3.95, 3.89, 4.05, 4.2])),
]


def found(file):
    """A file of a library's own tests; skipped where the library was installed without them."""
    spec = util.find_spec(file.partition("/")[0])
    path = Path(spec.origin).parents[1] / file if spec and spec.origin else Path(file)
    if not path.is_file():
        pytest.skip(f"{file} is not installed")
    return path


@pytest.mark.parametrize(("file", "form", "column", "unit", "rate", "values"), FILES, ids=[f[0] for f in FILES])
def test_samples_rate_and_unit_are_what_the_other_program_wrote(file, form, column, unit, rate, values):
    table = read_table(found(file))
    read = table.column(column)
    assert (table.format, read.unit) == (form, unit)
    assert (read.rate or table.rate) == (None if rate is None else pytest.approx(rate, rel=1e-9))
    assert read.values[: values.size] == pytest.approx(values, abs=1e-9)


def test_a_recorder_of_labview_states_unit_and_rate_of_each_channel():
    table = read_table(found("nptdms/test/data/raw1.tdms"))
    channels = [c for c in table.columns if c.name.endswith("Channel") or c.name.endswith("Chan")]
    assert [c.name for c in channels[:2]] == ["First  Channel", "Second Chan"]
    assert {c.unit for c in channels} == {"Volts"} and all(c.rate == pytest.approx(50e3) for c in channels)
    assert channels[1].values.mean() - channels[0].values.mean() == pytest.approx(1.0, abs=0.3)


def test_a_universal_file_of_catman_becomes_a_recording(tmp_path):
    read = read_table(CATMAN).column("1x : m/s²")
    assert read.rate == pytest.approx(20000.0) and read.unit == "m/s²"
    assert read.values[[0, 1, -1]].tolist() == [-3.81956, -3.56616, -5.84096] and read.values.size == 13
    many = np.tile(CATMAN.read_text(encoding="utf-8").splitlines()[13:15], 200).tolist()  # of a useful length
    lines = CATMAN.read_text(encoding="utf-8").splitlines()
    lines[8] = lines[8].replace("        13", "      2400")
    (tmp_path / "long.uff").write_text("\n".join([*lines[:13], *many, lines[-1], ""]), encoding="utf-8")
    (tmp_path / "mapping.toml").write_text(
        'schema = "gear-import/1"\nasset = "bench"\n[file]\npath = "long.uff"\n'
        '[channels.top]\ncolumn = "1x : m/s²"\nunit = "m/s2"\n[rig]\n',
        encoding="utf-8",
    )
    import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")
    _, _, (window,) = read_windows(tmp_path / "out.mcap")
    samples = window.accelerations["top"]
    assert samples.rate == pytest.approx(20000.0) and samples.values.size == 2400
    assert samples.values[:2] == pytest.approx([-3.81956, -3.56616], rel=1e-6)


EMPTY = [
    ("", "empty.csv is no readable CSV file: it is empty"),
    ("\n \n", "empty.csv is no readable CSV file: it is empty"),
    ("    -1\n   151\nmodel\n    -1\n", "no time history .data set 58 of function type 1., only data sets 151"),
]


@pytest.mark.parametrize(("text", "message"), EMPTY)
def test_a_file_without_a_signal_says_what_it_holds(tmp_path, text, message):
    (tmp_path / "empty.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_table(tmp_path / "empty.csv")
