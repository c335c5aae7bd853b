"""Names that others wrote are shown as text: they steer no terminal, close no element, end no line and no label."""

import io
import logging

import numpy as np
import pytest
from prometheus_client import generate_latest
from prometheus_client.parser import text_string_to_metric_families

from service.api.collector import family_of
from service.cli import run
from service.cli.show import say
from service.files.import_mapping import load_import_mapping
from service.files.readers import read_table
from service.logs import LimitedLines, formatter
from service.operation.metric_catalogue import METRICS
from service.printable import all_printable, printable

RATE, N = 12800.0, 12800
X = np.sin(2 * np.pi * 560 * np.arange(N) / RATE) + 0.1 * np.random.default_rng(1).normal(size=N)
NAMES = (
    "acc\x1b[2J\x1b[31mred", "acc\x9b2J", "acc\x1b]0;title\x07", "acc<script>alert(1)</script>", "acc[bold]",
    "acc\u202egnp", "acc\nnew = 1", "acc\r\ngear-twin: all is well", "acc{0.__class__}%s%n", "acc$x^2$ \\in{a} & #1~_",
    "acc`a` | *b* [c](d)", 'acc"}\\ 1\n', "acc+#", "=cmd|' /C calc'!A0", "acc 100 %", "Schwingung µ °C 加速度",
)  # fmt: skip
STEERING = [
    chr(n) for n in (*range(9), *range(11, 32), *range(127, 160), *range(0x202A, 0x202F), *range(0x2066, 0x206A))
]


def steers(text):
    return [c for c in STEERING if c in text]


def as_hdf5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file.attrs["fs"] = RATE
        for name in NAMES:
            data = file.create_dataset(name.replace("/", "÷"), data=X)
            data.attrs["unit"], data.attrs["gain\x1b[2J"] = "g\x1b[2J", 3
            file.create_dataset("odd " + name.replace("/", "÷"), data="text\x1b[2J")


def as_csv(path):
    names = [" ".join(name.split("\n")).replace(",", ";").replace("\r", "") for name in NAMES]
    head = ",".join(["time (s)", *(f"{name} (g)" for name in names), "odd\x1b[2J"])
    rows = "\n".join(f"{i / RATE:.9f}," + f"{x:.6f}," * len(names) + "\x1b[2J" for i, x in enumerate(X.tolist()))
    path.write_bytes(f"{head}\n{rows}\n".encode())


@pytest.mark.parametrize("write", [as_hdf5, as_csv])
def test_a_file_of_any_names_is_proposed_imported_and_shown_without_steering_the_terminal(
    tmp_path, monkeypatch, capsys, write
):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "run.dat")
    assert run(["import", "run.dat", "--guess", "--yes", "--teeth", "23/57"]) == 0
    said = capsys.readouterr()
    assert not steers(said.out + said.err) and "acc[bold]" in said.out
    assert all(line.startswith("gear-twin: ") for line in said.err.splitlines())
    assert not steers((tmp_path / "run.toml").read_text(encoding="utf-8"))
    table, mapping = read_table(tmp_path / "run.dat"), load_import_mapping("run.toml")
    assert {c.columns[0] for c in mapping.channels} <= set(table.names)
    assert len(mapping.channels) == len(NAMES)


def test_a_mapping_finds_a_column_by_the_name_that_the_file_has(tmp_path):
    pytest.importorskip("h5py")
    as_hdf5(tmp_path / "run.h5")
    assert read_table(tmp_path / "run.h5").column("acc\x1b[2J\x1b[31mred").name == "acc?[2J?[31mred"


def test_columns_whose_names_are_then_alike_are_both_there(tmp_path):
    np.savez(tmp_path / "run.npz", **{"acc\x01": X, "acc\x02": 2 * X})
    assert read_table(tmp_path / "run.npz").names == ("acc?", "acc? #2")


@pytest.mark.parametrize("name", NAMES)
def test_what_is_said_and_logged_is_one_line_that_steers_nothing(capsys, name):
    say(f"the name {name}")
    stream = io.StringIO()
    lines = LimitedLines(formatter("text"), 0, stream=stream)
    lines.emit(logging.LogRecord("service.a", logging.WARNING, "", 0, "the name %s", (name,), None))
    for said in (capsys.readouterr().err, stream.getvalue()):
        assert said.count("\n") == 1 and not steers(said.rstrip("\n")) and "the name" in said


def test_words_of_any_script_stay_as_they_are():
    for text in ("Prüfstand 3, µm/s²", "加速度", "می\u200cخواهم", "½ 😀", 'a "b" \\ c'):
        assert printable(text) == text
    assert all_printable({"a\x1b": ["b\x1b", 1.5, None, True]}) == {"a?": ["b?", 1.5, None, True]}


@pytest.mark.parametrize("name", NAMES)
def test_a_label_of_any_text_is_read_back_by_the_parser_of_prometheus(name):
    entry = METRICS["frames"]

    class One:
        def collect(self):
            yield family_of(entry, {(name, name): 3.0})

    (family,) = text_string_to_metric_families(generate_latest(One()).decode())
    ((sample),) = family.samples
    assert set(sample.labels.values()) == {name} and sample.value == 3.0
