"""What MATLAB files hold is imported whole, or it is said what is not: cells, units, objects, counters."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from service.cli import run
from service.errors import InputError
from service.files.guess import proposal_of
from service.files.import_mapping import load_import_mapping, unwrapped
from service.files.readers import read_table

RATE, N = 12800.0, 12800
T = np.arange(N) / RATE
RNG = np.random.default_rng(3)
X = np.sin(2 * np.pi * 560 * T) + 0.1 * RNG.normal(size=N)
PULSES = np.where((24.3 * T) % 1 < 0.1, 24.0, 0.0)
TURNS = 24.3 * T


def becomes(path):
    """What each column of a file is guessed to be."""
    return {g.columns[0]: g.becomes for g in proposal_of(read_table(path), path.name).guesses}


def element(kind, data):
    return struct.pack("<2I", kind, len(data)) + data + bytes(-len(data) % 8)


def an_object(name, kind):
    """An object as MATLAB 5 files hold it: flags, name, system and class, and a reference to what is elsewhere."""
    numbers = element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    held = element(6, struct.pack("<2I", 13, 0)) + element(5, struct.pack("<2i", 6, 1)) + element(1, b"") + numbers
    texts = b"".join(element(1, t.encode()) for t in (name, "MCOS", kind))
    return element(14, element(6, struct.pack("<2I", 17, 0)) + texts + element(14, held))


def as_mat5(path, objects):
    savemat(path, {"acc": X, "fs": RATE})
    with path.open("ab") as file:
        file.writelines(an_object(name, kind) for name, kind in objects.items())


def as_mat73(path, objects):
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("acc", X[None, :]), ("fs", np.array([[RATE]]))):
            file.create_dataset(name, data=values).attrs["MATLAB_class"] = np.bytes_("double")
        for name, kind in objects.items():
            held = file.create_dataset(name, data=np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype=np.uint32))
            held.attrs["MATLAB_class"], held.attrs["MATLAB_object_decode"] = np.bytes_(kind), 3
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize("write", [as_mat5, as_mat73])
def test_each_object_is_told_by_its_name_with_what_to_save_in_its_place(tmp_path, monkeypatch, capsys, write):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "run.mat", {"recorded": "datetime", "step": "duration", "T": "timetable", "odd": "my.Class"})
    assert run(["import", "run.mat", "--guess", "--yes"]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if "object of MATLAB's class" in line]
    for said in (
        "'recorded' is an object of MATLAB's class datetime, which cannot be read: save posixtime(recorded)",
        "'step' is an object of MATLAB's class duration, which cannot be read: save seconds(step)",
        "'T' is an object of MATLAB's class timetable", "'odd' is an object of MATLAB's class my.Class",
    ):  # fmt: skip
        assert any(said in line for line in told), said
    assert len(told) == 4 and read_table(tmp_path / "run.mat").column("acc").rate == RATE


def test_rows_in_a_cell_array_are_columns_also_of_different_lengths(tmp_path):
    cell, mixed = np.empty(3, dtype=object), np.empty(2, dtype=object)
    cell[:], mixed[:] = [X, PULSES, X[:6000] * 2], [X[:50], "a text"]
    savemat(tmp_path / "run.mat", {"data": cell, "mixed": mixed, "fs": RATE})
    table = read_table(tmp_path / "run.mat")
    assert [(c.name, c.values.size, c.rate) for c in table.columns] == [
        ("data[1]", N, RATE), ("data[2]", N, RATE), ("data[3]", 6000, RATE)
    ]  # fmt: skip
    assert table.left_out == {"mixed": "of mixed kinds, not real numbers"}


def test_a_structure_states_the_unit_of_its_one_signal(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    warm = 20.0 + 0.01 * np.arange(20)
    content = {
        "vib": {"time": T, "data": X, "unit": "g", "fs": RATE},
        "oil": {"data": warm, "Units": "degC", "fs": 20.0},
        "both": {"a": X, "b": X[::-1], "unit": "mm/s", "fs": RATE},  # of which it is the unit is not said
    }
    savemat("run.mat", content)
    table = read_table(tmp_path / "run.mat")
    assert {c.name: c.unit for c in table.columns} == {
        "vib.time": "", "vib.data": "g", "oil.data": "degC", "both.a": "", "both.b": ""
    }  # fmt: skip
    assert set(table.left_out) == {"both.unit"}
    assert becomes(tmp_path / "run.mat")["oil.data"] == "temperature/oil.data"
    assert run(["import", "run.mat", "--guess", "--yes"]) == 0
    assert {c.label for c in load_import_mapping("run.toml").channels} >= {"accel/vib.data", "temperature/oil.data"}


def test_a_shaft_that_is_said_goes_before_one_that_is_assumed(tmp_path):
    counts = np.floor(TURNS * 1024)
    savemat(tmp_path / "run.mat", {"tacho": PULSES, "acc": X, "n_pinion": counts, "n_gear": counts // 3, "fs": RATE})
    found = becomes(tmp_path / "run.mat")
    assert (found["n_pinion"], found["n_gear"], found["tacho"]) == ("encoder/pinion", "encoder/gear", "left out")


COUNTS = np.floor(TURNS * 1024 + 0.2)
COUNTERS = {
    "one that goes back now and then": COUNTS - np.isin(np.arange(N), (5000, 9000, 9001)),
    "one that trembles": np.floor(TURNS * 1024 + 0.6 * RNG.normal(size=N)),
    "one that begins anew at each turn": COUNTS % 1024,
    "one that falls to 0 at each turn": 1023 - COUNTS % 1024,
    "one of 16 bits": COUNTS % 2**16,
}


@pytest.mark.parametrize("counter", COUNTERS)
def test_a_counter_is_no_vibration(tmp_path, counter, monkeypatch):
    monkeypatch.chdir(tmp_path)
    savemat("run.mat", {"acc": X, "ctr0": COUNTERS[counter], "fs": RATE})
    assert becomes(tmp_path / "run.mat") == {"acc": "accel/acc", "ctr0": "encoder/pinion"}
    assert run(["import", "run.mat", "--guess", "--yes", "--pulses-per-rev", "1024", "--json", "out.json"]) == 0
    assert '"edges": 248' in (tmp_path / "out.json").read_text()


def test_whole_numbers_that_alternate_are_no_counter(tmp_path):
    savemat(tmp_path / "run.mat", {"acc": np.rint(X * 2000), "ai1": np.rint(X[::-1] * 2000) + 9000, "fs": RATE})
    assert becomes(tmp_path / "run.mat") == {"acc": "accel/acc", "ai1": "accel/ai1"}


def test_a_counter_of_each_turn_is_one_that_goes_on():
    assert np.array_equal(unwrapped(COUNTS % 1024, 1024), COUNTS)
    assert np.array_equal(unwrapped(1023 - COUNTS % 1024, 1024), 1023 - COUNTS)
    assert np.array_equal(unwrapped(COUNTS % 2**16, 1024), COUNTS)


def cells(*values):
    out = np.empty(len(values), object)
    out[:] = values
    return out


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    ("value", "length"),
    [({"a": X}, 1), (cells(X, X[:9], X), 3), ("abc", 3), ({"a": cells(X, X[:9], X)}, 3), ({"a": {"b": "abc"}}, 3)],
)
def test_a_number_of_parts_that_was_spoiled_takes_no_memory(tmp_path, packed, value, length):
    savemat(tmp_path / "a.mat", {"run": value})
    data = (tmp_path / "a.mat").read_bytes()
    last = data.rfind(struct.pack("<4I", 5, 8, 1, length))  # the dimensions
    many = data[: last + 8] + struct.pack("<I", 20_000_000) + data[last + 12 :]
    variable = many[128:]
    if packed:
        packing = zlib.compress(variable)
        variable = struct.pack("<2I", 15, len(packing)) + packing
    (tmp_path / "a.mat").write_bytes(many[:128] + variable)
    tracemalloc.start()
    with pytest.raises(InputError, match=r"it states an array of \d+ parts, of which at most 10000000 are read"):
        read_table(tmp_path / "a.mat")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 20e6
