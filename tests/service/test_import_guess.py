"""`gear-twin import FILE --guess`: what the columns are, with the reason, and a mapping that imports them at once."""

import json
import re
import runpy
import tomllib
from pathlib import Path

import numpy as np
import pytest

from service.cli import run
from service.errors import InputError
from service.files.guess import proposal_of
from service.files.import_mapping import load_import_mapping
from service.files.readers import Column, Table
from service.stream.sources.mcap import read_windows

RATE = 12800.0
SECONDS = 8.0
SPEED = 24.6
T = np.arange(int(SECONDS * RATE)) / RATE
ANGLE = 2 * np.pi * SPEED * T
RNG = np.random.default_rng(4)


def vibration(depth=0.15):
    mesh = sum(a * np.cos(k * 23 * ANGLE + k) for k, a in ((1, 0.5), (2, 0.3), (3, 0.1)))
    return (1 + depth * np.cos(ANGLE)) * mesh + 0.05 * RNG.normal(size=T.size)


def tacho(speed=SPEED, share=0.05):
    return np.where((speed * T) % 1 < share, 5.0, 0.1) + 0.03 * RNG.normal(size=T.size)


def write(path, **columns):
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, fmt="%.7g", delimiter=",", header=",".join(columns), comments="")


def becomes(columns, **how):
    """Label of every column's guess, and the whole proposal."""
    table = Table(format="CSV", columns=tuple(columns))
    found = proposal_of(table, "run.csv", **how)
    return {g.columns[0]: g.becomes for g in found.guesses}, found


def column(name, values, unit="", **more):
    return Column(name=name, values=np.asarray(values, dtype=float), unit=unit, **more)


TIME = column("Time (s)", T, "s")


@pytest.mark.slow
def test_own_csv_is_understood_and_diagnosed_in_two_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write("own.csv", **{"Time (s)": T, "Acc1 (g)": vibration(), "Tacho (V)": tacho()})
    assert run(["import", "own.csv", "--guess", "--teeth", "23/57", "--out", "own.mcap"]) == 0
    said = capsys.readouterr().out
    assert "12800 Hz (from the times of 'Time (s)'), 8 s" in said
    assert "accel/Acc1" in said and "tachometer/pinion" in said and "196 regular pulses" in said
    mapping = load_import_mapping("own.toml")
    assert mapping.rig["gears"] == {"pinion": {"teeth": 23}, "gear": {"teeth": 57}}
    assert mapping.rig["operating"]["pinion_speed_hz"] == pytest.approx(SPEED, abs=0.01)
    _, _, windows = read_windows("own.mcap")
    assert set(windows[0].accelerations) == {"Acc1"} and set(windows[0].encoders) == {"pinion"}
    assert run(["diagnose", "own.mcap"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Sidebands of ±1 × pinion speed (24.6 Hz) at mesh harmonic 1, 2, 3: amplitude modulation of " in said
    depth = float(re.search(r"modulation of ([\d.]+) ±", said)[1])
    assert depth == pytest.approx(15, abs=0.3)
    assert "run-out or eccentricity of the pinion" in said


@pytest.mark.slow
def test_guess_alone_writes_the_mapping_and_no_recording(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write("own.csv", **{"Time (s)": T, "Acc1 (g)": vibration()})
    assert run(["import", "own.csv", "--guess", "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["sample_rate_hz"] == RATE and found["mapping"] == "own.toml"
    assert [c["becomes"] for c in found["proposal"]] == ["time", "accel/Acc1"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["own.csv", "own.toml"]
    assert run(["import", "own.csv", "--guess", "--yes"]) == 0
    assert (tmp_path / "own.mcap").is_file()
    (tmp_path / "own.toml").write_text("# mine")
    assert run(["import", "own.csv", "--guess"]) == 2
    assert "is there already, with other content; --force replaces it" in capsys.readouterr().err
    assert run(["import", "own.csv", "--guess", "--force"]) == 0


def test_mapping_that_is_written_says_what_is_missing_in_comments(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    levels = ((64 * SPEED * T) % 1 < 0.5).astype(float)
    write("own.csv", **{"Time (s)": T, "x": vibration(), "Enc A": levels, "Enc B": np.roll(levels, 2)})
    assert run(["import", "own.csv", "--guess"]) == 0
    text = (tmp_path / "own.toml").read_text()
    document = tomllib.loads(text)
    assert document["channels"]["encoder"]["pinion"]["columns"] == ["Enc A", "Enc B"]
    assert document["channels"]["x"]["unit"] == "unknown"
    assert "# edges_per_rev = 1024" in text and "--teeth 23/57" in text and "the file states no unit" in text


KINDS = [
    (column("Acc1 (g)", vibration(), "g"), "accel/Acc1"),
    (column("Beschleunigung Gehäuse", vibration(), "m/s^2"), "accel/Beschleunigung_Gehause"),
    (column("column 2", vibration()), "accel/column_2"),
    (column("Tacho (V)", tacho(), "V"), "tachometer/pinion"),
    (column("column 3", tacho(), ""), "tachometer/pinion"),
    (column("Keyphasor output shaft", tacho(9.9), "V"), "tachometer/gear"),
    (column("Laser", 5 - tacho(), "V"), "tachometer/pinion"),
    (column("Torque", 12 + vibration(), "N.m"), "torque/pinion"),
    (column("Drehmoment Abtrieb", 12 + vibration(), "kNm"), "torque/gear"),
    (column("Oil", 60 + 0.1 * vibration(), "°C"), "temperature/Oil"),
    (column("Mic", vibration(), "Pa"), "accel/Mic"),
    (column("v", vibration(), "mm/s"), "left out"),
    (column("I1", vibration(), "A"), "left out"),
    (column("spare", np.zeros(T.size)), "left out"),
    (column("counter", np.arange(T.size) ** 1.5), "left out"),
    (column("edges", np.arange(200) / 24.6 + 0.01, "s"), "encoder/pinion"),
    (column("empty", np.full(T.size, np.nan)), "left out"),
]


@pytest.mark.parametrize(("one", "label"), KINDS, ids=[k[0].name for k in KINDS])
def test_a_column_is_named_by_unit_name_or_values(one, label):
    found, proposal = becomes([TIME, one])
    assert found == {"Time (s)": "time", one.name: label}
    assert proposal.guesses[1].why


@pytest.mark.parametrize(
    ("unit", "expected"),
    [("mg", ("g", 1e-3)), ("mm/s^2", ("m/s2", 1e-3)), ("kNm", ("Nm", 1e3)), ("in-lb", ("Nm", 0.1129848))],
)
def test_units_of_a_thousandth_come_with_their_scale(unit, expected):
    _, found = becomes([TIME, column("a", vibration(), unit)])
    assert (found.guesses[1].unit, found.guesses[1].scale) == expected


def test_of_two_tachometers_the_faster_is_the_pinions():
    found, _ = becomes([TIME, column("t1x", tacho(9.93)), column("t2x", tacho())])
    assert found == {"Time (s)": "time", "t1x": "tachometer/gear", "t2x": "tachometer/pinion"}


@pytest.mark.slow
def test_the_first_accelerometer_becomes_the_reference_of_a_rig_file_of_init(tmp_path, monkeypatch, capsys):
    """The guess was refused: "rig.sensors.accelerometer = 'y6' must be one of the accelerometers"."""
    monkeypatch.chdir(tmp_path)
    write("own.csv", **{"Time (s)": T, "Acc1 (g)": vibration(), "Acc2 (g)": vibration(), "Tacho (V)": tacho()})
    Path("answers.toml").write_text(
        'schema = "gear-answers/1"\npinion_teeth = 23\ngear_teeth = 57\nspeed = "1476 rpm"\ntorque = "80 Nm"\n'
        'module = "2.5 mm"\nface_width = "30 mm"\nencoder_pinion = 1\n'
        '[[accelerometers]]\nplace = "pinion free side"\n[[accelerometers]]\nplace = "gear free side"\n'
    )
    assert run(["init", "--answers", "answers.toml", "--out", "mine"]) == 0
    assert "sample at 12573 Hz or more, or state your sample_rate" in capsys.readouterr().out
    assert run(["import", "own.csv", "--guess", "--rig", "mine/rig.toml", "--out", "own.mcap"]) == 0
    assert "assumed to be the rig file's reference accelerometer" in " ".join(capsys.readouterr().out.split())
    rig, _, (window, *_) = read_windows(Path("own.mcap"))
    assert set(window.accelerations) == {"y6", "Acc2"} and rig["sensors"]["accelerometer"] == "y6"


def test_shaft_of_the_tachometer_can_be_stated():
    found, _ = becomes([TIME, column("Tacho", tacho())], shaft="gear")
    assert found["Tacho"] == "tachometer/gear"


def test_vibration_with_pulses_in_it_is_no_tachometer():
    x = vibration() + 5 * (tacho() > 2)
    found, _ = becomes([TIME, column("a", x)])
    assert found["a"] == "accel/a"


def test_rate_that_is_stated_and_contradicted_is_refused_on_import(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write("own.csv", **{"Time (s)": T, "Acc1 (g)": vibration()})
    assert run(["import", "own.csv", "--guess", "--rate", "25600", "--out", "own.mcap"]) == 2
    said = capsys.readouterr().err
    assert "file.sample_rate_hz = 25600 Hz, but the times of 'Time (s)' give 12800 Hz" in said


@pytest.mark.slow
def test_file_without_time_or_rate_asks_for_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write("own.csv", **{"a": vibration()})
    assert run(["import", "own.csv", "--guess", "--out", "own.mcap"]) == 2
    assert "no sample rate is known" in capsys.readouterr().err
    assert run(["import", "own.csv", "--guess", "--rate", "12800", "--out", "own.mcap", "--force"]) == 0


WRONG = [
    (["import", "own.csv", "--guess", "--teeth", "23"], "--teeth 23 must be the tooth counts of pinion and gear"),
    (["import", "own.csv", "--guess", "--tachometer", "motor"], "--tachometer motor must be pinion or gear"),
    (["import", "gone.csv", "--guess"], "gone.csv does not exist"),
    (["import", "own.toml", "--guess"], "own.toml is a mapping file: --guess takes the data file itself"),
    (["import", "own.csv"], "--out must name the MCAP file to write; or --guess"),
    (["import", "own.csv", "--out", "x.mcap"], "own.csv is a data file (text), not a mapping file"),
]


@pytest.mark.parametrize(("arguments", "message"), WRONG)
def test_a_wrong_command_is_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.csv").write_text("a\n1\n2\n3\n4\n")
    assert run(arguments) == 2
    assert message in capsys.readouterr().err


def test_two_times_that_contradict_are_refused():
    with pytest.raises(InputError, match="falls from"):
        becomes([column("Time (s)", np.concatenate((T[:100], T[:100])), "s"), column("a", np.ones(200))])


@pytest.mark.slow
def test_likely_mistakes_are_named_when_a_file_is_imported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write("own.csv", **{"Time (s)": T, "Acc1 (g)": vibration() + 1, "Tacho (V)": tacho()})
    assert run(["import", "own.csv", "--guess", "--teeth", "29/57"]) == 0
    text = (tmp_path / "own.toml").read_text()
    (tmp_path / "own.toml").write_text(text.replace('unit = "g"', 'unit = "m/s2"'))
    capsys.readouterr()
    assert run(["import", "own.toml", "--out", "own.mcap"]) == 0
    said = capsys.readouterr().err
    assert "the file states g for 'Acc1 (g)', and the values come out 1/9.807 of that" in said
    assert "gravity in g that was read as m/s²?" in said
    assert "no mesh line at 29 teeth × 24.6 Hz" in said and "23 teeth" in said


@pytest.mark.slow
def test_mapping_of_the_tutorial_is_what_the_guess_writes(tmp_path, monkeypatch):
    made = runpy.run_path("docs/examples/machine.py")
    expected = Path("docs/examples/mapping.toml").read_text()
    monkeypatch.chdir(tmp_path)
    made["write"]("run.csv", made["recording"](load=0.5, seed=7, modulation=0.15, duration=20.0))
    arguments = ["--guess", "--teeth", "23/57", "--asset", "pump-drive", "--write", "mapping.toml"]
    assert run(["import", "run.csv", *arguments]) == 0
    assert (tmp_path / "mapping.toml").read_text() == expected


@pytest.mark.slow
def test_clipped_samples_of_an_imported_file_are_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write("own.csv", **{"Time (s)": T, "Acc1 (g)": vibration().clip(-0.7, 0.7), "Tacho (V)": tacho()})
    assert run(["import", "own.csv", "--guess", "--teeth", "23/57", "--yes"]) == 0
    assert "likely mistake: accel/Acc1: clipping" in capsys.readouterr().err
