"""Counters, sensitivities, speeds and names as people and their recorders write them."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import savemat

from service.cli import run
from service.errors import InputError
from service.files.documents import Part
from service.files.guess import proposal_of
from service.files.import_mapping import mapped_channels, unwrapped
from service.files.readers import read_table
from service.signals.trends import trends_of
from service.stream.sources.mcap import read_windows
from service.toml_text import document_text, value_text
from twin.errors import WindowError
from twin.features.pulses import PulseSettings, pulses_of

RATE, SPEED, COUNTS = 20480.0, 16.5, 1024


def bench(path, first=0, roll=None, sense=1, seconds=4.0):
    """Accelerometer, two sampled counters and a torque meter of a pair 19/31, as NI programs export them."""
    t = np.arange(round(seconds * RATE)) / RATE
    turns = SPEED * t + 0.1
    x = np.cos(2 * np.pi * 19 * turns) + 0.05 * np.random.default_rng(3).standard_normal(t.size)
    pinion, gear = (first + sense * np.floor(turns * ratio * COUNTS).astype(np.int64) for ratio in (1, 19 / 31))
    if roll:
        pinion, gear = pinion % roll, gear % roll
    columns = {"acc_brg_DE_V": 0.1 * x, "enc_in_counts": pinion, "enc_out_counts": gear, "torque_in_Nm": 45 + x}
    savemat(path, columns | {"Fs": RATE})
    return path


@pytest.mark.parametrize(
    ("first", "roll", "sense"), [(0, None, 1), (123456, None, -1), (65000, 2**16, 1), (2**32 - 5000, 2**32, 1)]
)
def test_a_counter_that_is_sampled_becomes_the_encoder_of_its_shaft(tmp_path, monkeypatch, capsys, first, roll, sense):
    monkeypatch.chdir(tmp_path)
    bench(tmp_path / "b.mat", first, roll, sense)
    arguments = ["import", "b.mat", "--guess", "--teeth", "19/31", "--pulses-per-rev", str(COUNTS), "--out", "b.mcap"]
    assert run(arguments) == 0, capsys.readouterr()
    _, _, windows = read_windows(tmp_path / "b.mcap")
    window = next(iter(windows))
    for shaft, ratio in (("pinion", 1), ("gear", 19 / 31)):
        edges = window.encoders[shaft]
        speed = (edges.times.size - 1) / edges.per_rev / (edges.times[-1] - edges.times[0])
        assert speed == pytest.approx(SPEED * ratio, rel=1e-3)
    assert set(window.torques) == {"pinion"}


def test_a_counter_without_its_counts_a_turn_is_proposed_and_says_what_to_add(tmp_path):
    found = proposal_of(read_table(bench(tmp_path / "b.mat")), "b.mat")
    assert found.rate == RATE
    guesses = {g.columns[0]: g for g in found.guesses}
    assert [guesses[n].becomes for n in ("enc_in_counts", "enc_out_counts")] == ["encoder/pinion", "encoder/gear"]
    assert "--pulses-per-rev" in guesses["enc_in_counts"].remark
    assert (guesses["acc_brg_DE_V"].kind, guesses["torque_in_Nm"].unit) == ("accel", "Nm")


def test_a_counter_passes_from_its_largest_number_to_0_and_back():
    true = np.array([65530, 65533, 65537, 65540, 65534, 65530])
    assert unwrapped((true % 2**16).astype(float)).tolist() == true.tolist()
    assert unwrapped(np.array([5.0, 9.0, 7.0])).tolist() == [5, 9, 7]


@pytest.mark.parametrize(
    ("kind", "given", "factor"),
    [
        ("accel", "100 mV/g", 9.80665 / 0.1), ("accel", "10.2mV/(m/s²)", 1 / 0.0102), ("accel", "0,1 V/g", 98.0665),
        ("torque", "5 mV/Nm", 200.0), ("torque", "0.01 V/kNm", 1e5),
    ],
)  # fmt: skip
def test_a_sensitivity_is_read_as_it_stands_on_a_certificate(kind, given, factor):
    table = {"column": "a", "unit": "V", "sensitivity": given}
    assert mapped_channels(Part("m.toml", {f"{kind}/pinion": table}))[0].factor == pytest.approx(factor)


@pytest.mark.parametrize("given", ["100 mV", "mV/g", "100 mV/Nm", "fast"])
def test_a_sensitivity_that_cannot_be_read_says_how_to_write_it(given):
    with pytest.raises(InputError, match=r"must be a number of V per m/s², or a text such as '100 mV/m/s2' or"):
        mapped_channels(Part("m.toml", {"a": {"unit": "V", "sensitivity": given}}))


def csv(path, header: str, columns) -> str:
    np.savetxt(path, np.stack(columns, 1), "%.6f", ",", header=header, comments="")
    return path.name


def vibration(rate=5120.0, seconds=4.0):
    t = np.arange(round(rate * seconds)) / rate
    return t, np.cos(2 * np.pi * 563.5 * t) + 0.1 * np.random.default_rng(1).standard_normal(t.size)


@pytest.mark.parametrize("given", ["1470rpm", "1470 1/min", "24.5", "24.5Hz", "24,5 hz", "1470 U/min"])
def test_a_speed_is_taken_with_its_unit(tmp_path, monkeypatch, given):
    monkeypatch.chdir(tmp_path)
    name = csv(tmp_path / "a.csv", "time,Acc (g)", vibration())
    assert run(["import", name, "--guess", "--teeth", "23/57", "--speed", given]) == 0
    assert "pinion_speed_hz = 24.5" in (tmp_path / "a.toml").read_text()


@pytest.mark.parametrize("given", ["fast", "0", "-5", "1752000rpm", "5 m/s"])
def test_a_speed_that_is_none_is_refused_with_an_example(tmp_path, monkeypatch, capsys, given):
    monkeypatch.chdir(tmp_path)
    name = csv(tmp_path / "a.csv", "time,Acc (g)", vibration())
    assert run(["import", name, "--guess", f"--speed={given}"]) == 2
    assert "such as 29.2 (Hz) or 1752rpm" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--rate", "12800"], "file.sample_rate_hz = 12800 Hz, but the times of 'time' give 5120 Hz"),
        (["--asset", "Pumpe 3"], "--asset: asset = 'Pumpe 3' must be 1 to 64 letters"),
    ],
)
def test_a_mapping_that_its_own_reader_would_refuse_is_not_written(tmp_path, monkeypatch, capsys, more, said):
    monkeypatch.chdir(tmp_path)
    name = csv(tmp_path / "a.csv", "time,Acc (g)", vibration())
    assert run(["import", name, "--guess", *more]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "a.toml").exists()


@pytest.mark.parametrize("text", ["a\tb", "a\rb", 'q"\\', "x\x7fy", "Schwingung µ", "\x01", "a\nb"])
def test_every_name_of_a_file_can_be_written_as_toml(text):
    import tomllib

    assert tomllib.loads(f"k = {value_text(text)}")["k"] == text
    rig = {"name": text, text: {"teeth": 19, text: {"points": [[2.0, 10.0], [1e22, {text: True}]]}}}
    assert tomllib.loads(document_text(rig)) == rig


@pytest.mark.parametrize("name", ["Dreh [/min]", "[bold]a", "x [/]", "[link=http://a]b", "a [/red] (g)"])
def test_names_of_a_file_are_shown_as_they_are(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    t, x = vibration()
    file = csv(tmp_path / "a.csv", f"Zeit [s],Beschl [g],{name}", [t, x, np.sin(t) + 2])
    assert run(["import", file, "--guess", "--out", "a.mcap"]) == 0
    out = capsys.readouterr().out
    assert all(label in out for label in ("Zeit [s]", "Beschl [g]", name))


def test_a_file_without_a_channel_says_why_each_column_is_none(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    t, _ = vibration()
    file = csv(tmp_path / "a.csv", "time,speed,class", [t, 1500 + np.sin(t), t // 1])
    assert run(["import", file, "--guess", "--out", "a.mcap"]) == 2
    said = capsys.readouterr().err
    assert "no column of the file can be a channel: speed: a measured speed has no channel" in said


@pytest.mark.parametrize(("teeth", "rate"), [(60, 5120.0), (60, 2560.0 * 2), (120, 10240.0)])
def test_pulses_of_few_samples_have_no_noise_of_their_own_edges(teeth, rate):
    t = np.arange(round(10 * rate)) / rate
    found = pulses_of(5.0 * ((teeth * 24.5 * t) % 1 < 0.5), rate, PulseSettings(per_rev=teeth))
    assert found.speed == pytest.approx(24.5, rel=1e-4)
    assert found.missed == found.doubled == 0


@pytest.mark.parametrize("frequency", [50.0, 700.0, 1400.0, 2200.0])
def test_a_vibration_in_noise_has_no_pulses(frequency):
    t = np.arange(51200) / 5120
    noisy = np.cos(2 * np.pi * frequency * t) + 0.4 * np.random.default_rng(1).standard_normal(t.size)
    with pytest.raises(WindowError):
        pulses_of(noisy, 5120.0, PulseSettings())


def test_a_level_without_a_unit_is_not_shown_in_one(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    t, x = vibration()
    file = csv(tmp_path / "a.csv", "time,vib1,acc2 (g),torque", [t, x, x, 0.0002 * np.sin(300 * t)])
    assert run(["import", file, "--guess", "--teeth", "23/57", "--speed", "24.5", "--out", "a.mcap"]) == 0
    capsys.readouterr()
    assert run(["assess", "a.mcap", "--json", "a.json"]) == 0
    shown = capsys.readouterr().out
    assert "The unit of vib1 is not known: RMS of raw values." in shown and "RMS m/s²" not in shown
    assert "torque N·m" not in shown
    record = json.loads((tmp_path / "a.json").read_text())["windows"][-1]
    assert record["indicators"]["vib1"]["unit"] == "unknown" and "unit" not in record["indicators"]["acc2"]
    assert record["not_available"]["torque_nm"] == "the unit of the torque channel is not known"


@pytest.mark.parametrize("name", ["vib1", "accel_bearing", "Beschleunigung A"])
def test_a_raw_reference_accelerometer_has_no_level_in_the_record_nor_in_what_is_made_of_it(
    tmp_path, monkeypatch, capsys, name
):
    monkeypatch.chdir(tmp_path)
    file = csv(tmp_path / "a.csv", f"time,{name}", list(vibration()))
    assert run(["import", file, "--guess", "--teeth", "23/57", "--speed", "24.5", "--out", "a.mcap"]) == 0
    assert run(["assess", "a.mcap", "--json", "a.json"]) == 0
    assert run(["report", "a.json", "--out", "a.html"]) == 0
    record = json.loads((tmp_path / "a.json").read_text())["windows"][-1]
    (sensor,) = record["indicators"]
    assert record["rms_measured"] is None and record["mesh_bands"] is None
    assert record["not_available"]["rms"] == f"the unit of accel/{sensor} is not known"
    assert record["indicators"][sensor]["rms"] > 0
    trends = trends_of([SimpleNamespace(record=record)])
    assert [q.unit for q in trends.quantities if q.name == f"{sensor}/rms"] == [""]
    shown = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "m/s²" not in shown


def test_a_mapping_without_a_data_file_takes_that_of_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file = csv(tmp_path / "a.csv", "time,Acc (g)", vibration())
    mapping = 'schema = "gear-import/1"\nasset = "a"\nage = "new"\n[channels.Acc]\ncolumn = "Acc (g)"\nunit = "g"\n'
    (tmp_path / "m.toml").write_text(mapping)
    assert run(["import", "m.toml", "--source", file, "--out", "a.mcap"]) == 0
    capsys.readouterr()
    assert run(["import", "m.toml", "--out", "a.mcap"]) == 2
    assert "file.path = (missing) must name a data file, or --source must" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("started = 2026-03-12", "started = 2026-03-12 must be a date with time"),
        ('[channels.b]\ncolumn = "c"', "channels.b.unit = (missing) must be one of"),
    ],
)
def test_a_message_shows_what_the_file_has_and_no_word_of_python(tmp_path, capsys, line, said):
    head = f'schema = "gear-import/1"\nasset = "a"\n{line}\n'
    (tmp_path / "m.toml").write_text(f'{head}[channels.a]\nunit = "g"\n[file]\npath = "a.csv"\n')
    assert run(["import", str(tmp_path / "m.toml"), "--out", str(tmp_path / "a.mcap")]) == 2
    error = capsys.readouterr().err
    assert said in error and "None" not in error and "datetime" not in error


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "band"), [(1000.0, [0, 450]), (2000.0, [0, 900]), (5120.0, None)])
def test_a_file_of_a_low_rate_has_the_levels_that_import_promises(tmp_path, monkeypatch, capsys, rate, band):
    monkeypatch.chdir(tmp_path)
    t = np.arange(round(20 * rate)) / rate
    x = np.cos(2 * np.pi * 263 * t) + 0.1 * np.random.default_rng(1).standard_normal(t.size)
    file = csv(tmp_path / "a.csv", "time,vib1 (g)", [t, x])
    assert run(["import", file, "--guess", "--out", "a.mcap"]) == 0
    assert (read_windows(tmp_path / "a.mcap")[0].get("sensors") or {}).get("band_hz") == band
    assert run(["assess", "a.mcap", "--json", "a.json"]) == 0, capsys.readouterr().err
    assert json.loads((tmp_path / "a.json").read_text())["windows"][-1]["rms_measured"] == pytest.approx(7, rel=0.02)
