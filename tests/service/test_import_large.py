"""Large measurement files are read in pieces: the memory that an import takes does not grow as the file does."""

from __future__ import annotations

import gzip
import re
import tracemalloc

import numpy as np
import pytest

from service.files.import_recording import import_recording
from service.files.readers import stored as stored_rows
from service.files.readers import uff
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


def universal_head(kind, n, binary=""):
    head = ["    -1", f"    58{binary}", "run", "NONE", "NONE", "NONE", "NONE"]
    head += ["    1         0    0         0       NONE         1   3       NONE         0   0"]
    head += [f"{kind:10d}{n:10d}{1:10d}{0:13.5e}{1 / RATE:13.5e}{0:13.5e}"]
    head += [f"{kind:10d}    0    0    0 NONE                 NONE" for kind in (17, 12, 0, 0)]
    return "\n".join([*head, ""]).encode()


def universal_binary(path):
    values = vibration(LONG).astype("<f4").tobytes()
    path.write_bytes(universal_head(2, LONG, f"b{1:6d}{2:6d}{11:12d}{len(values):12d}") + values + b"    -1\n")
    return "1+Z"


@pytest.mark.parametrize(
    ("write", "whole"),
    [
        (wav, 0),
        pytest.param(csv, 0, marks=pytest.mark.slow),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((npz, 1), (mat, 1), (h5, 0), (tdms, 0), (parquet, 0), (universal_binary, 0))
        ),
        pytest.param(csv_gz, 0, marks=pytest.mark.slow),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_an_import_takes_little_memory_beside_one_copy_of_its_longest_column(tmp_path, write, whole):
    """`whole`: copies of a column that the format's library makes at once."""
    path = tmp_path / f"run.{write.__name__.replace('_', '.')}"
    column = write(path)
    rate = "" if write in (wav, csv, csv_gz, universal_binary) else f"sample_rate_hz = {RATE}"
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


def universal(nodes, n=1001, **said):
    pyuff = pytest.importorskip("pyuff")
    return [
        pyuff.prepare_58(
            **{
                "binary": 0, "func_type": 1, "rsp_node": node, "rsp_dir": 3, "data": vibration(n) * node,
                "x": np.arange(n) / RATE + 1.0, "id1": "run", "id3": "12-Mar-26 08:14:00", "abscissa_spacing": 1,
                "abscissa_inc": 1 / RATE, "abscissa_min": 1.0, "abscissa_spec_data_type": 17,
                "ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "g", "orddenom_spec_data_type": 0,
                "z_axis_spec_data_type": 0, "ord_data_type": 4, "ver_num": 0, "load_case_id": 0, "ref_node": 1,
                "ref_dir": 0, "rsp_ent_name": "", "ref_ent_name": "", **said,
            }
        )
        for node in nodes
    ]  # fmt: skip


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves binary files open
@pytest.mark.parametrize("spacing", [0, 1])
@pytest.mark.parametrize(("kind", "binary"), [(2, 0), (4, 0), (4, 1)])
def test_universal_data_sets_are_read_as_another_program_reads_them(tmp_path, monkeypatch, kind, binary, spacing):
    pyuff = pytest.importorskip("pyuff")
    said = {"ord_data_type": kind, "binary": binary, "abscissa_spacing": spacing}
    pyuff.UFF(str(tmp_path / "a.uff")).write_sets(universal((1, 2), **said), "add", force_double=kind == 4)
    theirs = pyuff.UFF(str(tmp_path / "a.uff")).read_sets()
    for part in (2**22, 3000):
        monkeypatch.setattr(uff, "PART", part)
        monkeypatch.setattr(uff, "BLOCK", part)
        table = uff.read_uff(tmp_path / "a.uff")
        assert [c.name for c in table.columns] == ["1+Z", "2+Z"] and not table.notes and table.started is not None
        for column, their in zip(table.columns, theirs, strict=True):
            assert np.array_equal(column.values, their["data"]) and column.unit == "g"
            if spacing:
                assert (column.rate, column.start, column.times) == (RATE, 1.0, None)
            else:
                assert np.array_equal(column.times, their["x"])


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_values_of_either_order_and_size_are_read_where_they_lie(tmp_path, order):
    values = vibration(1001).astype(f"{order}f4")
    head = universal_head(2, values.size, f"b{1 if order == '<' else 2:6d}{2:6d}{11:12d}{values.nbytes:12d}")
    (tmp_path / "a.uff").write_bytes(head + values.tobytes() + b"    -1\n" + universal_head(2, 6) + b"    -1\n")
    table = uff.read_uff(tmp_path / "a.uff")
    assert np.array_equal(table.columns[0].values, values) and table.columns[0].name == "1+Z"
    assert table.left_out == {"1+Z #2": "holds 0 values"}


@pytest.mark.parametrize("mark", range(uff.MARK_LINE + 2))
def test_marks_are_found_wherever_a_block_ends(tmp_path, monkeypatch, mark):
    monkeypatch.setattr(uff, "BLOCK", 128)
    text = universal_head(2, 6) + b"x" * mark + b"\n    -1" + b" " * 74 + b"\r\n    -1\n   151\n    -1"
    text += b" 0\n   -1    -1  \n    -1\n    -1"
    (tmp_path / "a.uff").write_bytes(text)
    lines = [i for i in range(len(text)) if (i == 0 or text[i - 1] == 10) and text[i:].startswith(b"    -1")]
    found = list(uff._marks(tmp_path / "a.uff"))
    assert [at for at, is_line in found if is_line] == [i for i in lines if text[i:].split(b"\n")[0].strip() == b"-1"]
    assert [at for at, is_line in found if not is_line] == [text.index(b"   -1    -1  ") + 5]


def test_a_universal_file_that_was_cut_off_is_read_to_its_last_whole_line(tmp_path):
    line = "".join(f"{v:13.5e}" for v in vibration(6)).encode()
    (tmp_path / "a.uff").write_bytes(universal_head(2, 60) + (line + b"\n") * 4 + line[:30])
    table = uff.read_uff(tmp_path / "a.uff")
    assert table.columns[0].values.tolist() == [float(f"{v:.5e}") for v in vibration(6)] * 4
    assert table.notes == ("'1+Z' states 60 values and holds 24, which are read",)


SPOILED = [
    (universal_head(2, 6) + b"  1.00000E+00  x.00000E+00\n", "it holds '  x.00000E+00' for a number"),
    (universal_head(2, 6) + b"                1.00000E+00\n", "it holds '             ' for a number"),
    (universal_head(2, 6) + b"  1.00000E+00" * 7 + b"\n", "a line of its values is longer than 78 columns"),
    (universal_head(3, 6) + b"  1.00000E+00\n", "its numbers are of type 3, which is not known"),
    (universal_head(2, 6, f"b{1:6d}{3:6d}") + bytes(9), "its numbers are of type IBM 5/370, which is not known"),
    (
        universal_head(2, 6).replace(b"3.90625e-05", b"1.00000e400") + b"  1.00000E+00" * 2 + b"\n",
        "it states '1.00000e400' for a number",
    ),
]


@pytest.mark.parametrize(("data", "message"), SPOILED)
def test_a_spoiled_universal_file_is_refused_by_a_sentence_that_says_what_it_holds(tmp_path, data, message):
    (tmp_path / "a.uff").write_bytes(data + b"    -1\n")
    with pytest.raises(ValueError, match=re.escape(message)):
        uff.read_uff(tmp_path / "a.uff")


@pytest.mark.parametrize("binary", [0, 1])
def test_a_long_universal_data_set_takes_no_memory_that_grows_with_it(tmp_path, monkeypatch, binary):
    n = LONG // 10 // 6 * 6
    if binary:
        values = vibration(n).astype("<f4").tobytes()
        data = universal_head(2, n, f"b{1:6d}{2:6d}{11:12d}{len(values):12d}") + values
    else:
        data = universal_head(2, n) + ("".join(f"{v:13.5e}" for v in vibration(6)) + "\n").encode() * (n // 6)
    (tmp_path / "a.uff").write_bytes(data + b"    -1\n")
    monkeypatch.setattr(uff, "PART", 2**18)
    monkeypatch.setattr(uff, "BLOCK", 2**14)
    if not binary:  # binary values stay in the file, however few they are
        monkeypatch.setattr(stored_rows, "SHORT", 2**12)
    tracemalloc.start()
    (column,) = uff.read_uff(tmp_path / "a.uff").columns
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert column.values.size == n and most < (5e5 if binary else 3e6) < len(data)
