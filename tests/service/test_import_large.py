"""Large measurement files are read in pieces: the memory that an import takes does not grow as the file does."""

from __future__ import annotations

import gzip
import tracemalloc

import numpy as np
import pytest

from service.files.import_recording import import_recording
from service.files.readers.stored import SHORT, GrowingRow, StoredRow, beginning, changed, pieces, row_of, stored

RATE = 25600.0
LONG = 2_500_000
TEXT = 600_000  # rows
PACKED = 40e6  # of memory that no file needs more of [bytes]


def vibration(n):
    return np.sin(np.arange(n) * 0.13) + 0.1 * np.random.default_rng(1).normal(size=n)


def wav(path):
    from scipy.io import wavfile

    wavfile.write(path, int(RATE), (vibration(LONG) * 2**13).astype("<i2"))
    return "channel 1"


def npz(path):
    np.savez(path, acc=vibration(LONG))
    return "acc"


def mat(path):
    from scipy.io import savemat

    savemat(path, {"acc": vibration(LONG)})
    return "acc"


def h5(path):
    with pytest.importorskip("h5py").File(path, "w") as file:
        file["acc"] = vibration(LONG)
    return "acc"


def tdms(path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        for part in np.array_split(vibration(LONG), 10):
            writer.write_segment([nptdms.ChannelObject("g", "acc", part)])
    return "acc"


def parquet(path):
    pyarrow = pytest.importorskip("pyarrow")
    table = pyarrow.table({"acc": vibration(LONG)})
    pytest.importorskip("pyarrow.parquet").write_table(table, path, row_group_size=200_000)
    return "acc"


def rows():
    return "".join(f"{i / RATE:.7f},{v:.6f}\n" for i, v in enumerate(vibration(TEXT).tolist()))


def csv(path):
    path.write_text(f"Time (s),acc\n{rows()}")
    return "acc"


def csv_gz(path):
    path.write_bytes(gzip.compress(f"Time (s),acc\n{rows()}".encode(), 1))
    return "acc"


@pytest.mark.parametrize(
    ("write", "whole"),
    [
        (wav, 0),
        (csv, 0),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((npz, 1), (mat, 1), (h5, 0), (tdms, 0), (parquet, 0))
        ),
        pytest.param(csv_gz, 0, marks=pytest.mark.slow),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_an_import_takes_little_memory_beside_one_copy_of_its_longest_column(tmp_path, write, whole):
    """`whole`: copies of a column that the format's library makes at once."""
    path = tmp_path / f"run.{write.__name__.replace('_', '.')}"
    column = write(path)
    rate = "" if write in (wav, csv, csv_gz) else f"sample_rate_hz = {RATE}"
    (tmp_path / "mapping.toml").write_text(
        f'schema = "gear-import/1"\nasset = "a"\nstarted = 2026-03-12T08:14:00Z\n[file]\npath = "{path.name}"\n{rate}\n'
        f'[channels.y6]\ncolumn = "{column}"\nunit = "g"\n[rig]\n'
    )
    tracemalloc.start()
    try:
        found = import_recording(tmp_path / "mapping.toml", tmp_path / "out.mcap")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < PACKED + 1.1 * whole * 8 * LONG
    samples = TEXT if write in (csv, csv_gz) else LONG
    assert found["duration"] == pytest.approx(samples / RATE, rel=1e-6)


def test_a_stored_row_has_the_values_of_the_array():
    values = np.random.default_rng(2).normal(size=SHORT + 7)
    row = stored(values)
    assert isinstance(row, StoredRow) and stored(values[:9]) is not row
    assert np.array_equal(np.asarray(row), values) and row[-1] == values[-1] and row[3] == values[3]
    assert np.array_equal(row[5:2000:3], values[5:2000:3]) and row[4:4].size == 0
    assert np.array_equal(np.concatenate(list(pieces(row))), values)
    assert np.array_equal(np.asarray(changed(row, lambda part: 2 * part)), 2 * values)
    assert np.array_equal(beginning(row), values[: beginning(row).size])
    assert GrowingRow().row().size == 0
    assert row_of([np.arange(3), np.arange(2)]).tolist() == [0, 1, 2, 0, 1]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves binary files open
@pytest.mark.parametrize("spacing", [0, 1])
@pytest.mark.parametrize(("kind", "binary"), [(2, 0), (4, 0), (4, 1)])
def test_a_universal_data_set_is_the_same_in_parts_and_in_one(tmp_path, monkeypatch, kind, binary, spacing):
    pyuff = pytest.importorskip("pyuff")
    from service.files.readers import uff

    n, read = 1001, []
    for node in (1, 2):
        pyuff.UFF(str(tmp_path / "a.uff")).write_sets(
            pyuff.prepare_58(
                binary=binary, func_type=1, rsp_node=node, rsp_dir=3,
                data=vibration(n) * node, x=np.arange(n) / RATE + 1.0,
                id1="run", id3="12-Mar-26 08:14:00", abscissa_spacing=spacing, abscissa_inc=1 / RATE, abscissa_min=1.0,
                abscissa_spec_data_type=17, ordinate_spec_data_type=12, ordinate_axis_units_lab="g",
                orddenom_spec_data_type=0, z_axis_spec_data_type=0, ord_data_type=kind, ver_num=0, load_case_id=0,
                ref_node=1, ref_dir=0, rsp_ent_name="", ref_ent_name="",
            ),
            "add",
        )  # fmt: skip
    for long in (2**24, 3000):
        monkeypatch.setattr(uff, "LONG", long)
        read.append(uff.read_uff(tmp_path / "a.uff"))
    for one, parts in zip(read[0].columns, read[1].columns, strict=True):
        assert one.values.size == n and np.array_equal(one.values, parts.values)
        assert (one.name, one.unit, one.rate, one.start) == (parts.name, parts.unit, parts.rate, parts.start)
        assert one.times is None or np.array_equal(one.times, parts.times)
    assert read[0].started == read[1].started and read[0].started is not None


def test_a_long_universal_data_set_takes_the_memory_of_its_file_and_little_more(tmp_path, monkeypatch):
    pytest.importorskip("pyuff")
    from service.files.readers import uff

    head = ["    -1", "    58", "run", "NONE", "NONE", "NONE", "NONE"]
    head += ["    1         0    0         0       NONE         1   3       NONE         0   0"]
    head += [f"{2:10d}{LONG // 10:10d}{1:10d}{0:13.5e}{1 / RATE:13.5e}{0:13.5e}"]
    head += [f"{kind:10d}    0    0    0 NONE                 NONE" for kind in (17, 12, 0, 0)]
    line = "".join(f"{v:13.5e}" for v in vibration(6))
    text = "\n".join([*head, *[line] * (LONG // 60), "    -1", ""])
    (tmp_path / "a.uff").write_text(text)
    monkeypatch.setattr(uff, "LONG", 2**18)
    tracemalloc.start()
    (column,) = uff.read_uff(tmp_path / "a.uff").columns
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert column.values.size == LONG // 60 * 6 and most < len(text) + 11e6
