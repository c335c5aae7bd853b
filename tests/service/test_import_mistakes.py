"""Likely mistakes as a person meets them: in what `gear-twin import` says of a file that holds one."""

import numpy as np
import pytest

from service.cli import run
from tests.claims.test_plausibility import RATE, edges, vibration

MAPPING = """schema = "gear-import/1"
asset = "bench"
[file]
path = "data.npz"
sample_rate_hz = {rate}
[channels.a]
unit = "m/s2"
{more}
[rig.gears.pinion]
teeth = 23
[rig.gears.gear]
teeth = 57
[rig.operating]
pinion_speed_hz = 24.6
input_torque = 12.0
"""
PULSES = '[channels.encoder.pinion]\ncolumn = "e"\nunit = "s"\nedges_per_rev = {}\n'
GEAR = '[channels.encoder.gear]\ncolumn = "g"\nunit = "s"\nedges_per_rev = 1024\n'
TORQUE = '[channels.torque.pinion]\ncolumn = "t"\nunit = "Nm"\n'
T = np.arange(int(12 * RATE)) / RATE

CASES = {
    "clean": (RATE, {"a": vibration(), "e": edges(1).times}, PULSES.format(1), None),
    "unit": (RATE, {"a": vibration() + 1.0, "e": edges(1).times}, PULSES.format(1), "gravity in g that was read as"),
    "thousand": (RATE, {"a": 1000 * vibration(), "e": edges(1).times}, PULSES.format(1), "mV or mg that were read as"),
    "polarity": (
        RATE, {"a": vibration(), "e": edges(1).times, "t": -12.0 + np.sin(T)}, PULSES.format(1) + TORQUE,
        "the torque meter's polarity? scale = -1 turns it",
    ),
    "shifted": (
        RATE, {"a": vibration(wander=0.01, shift=0.25), "e": edges(1, wander=0.01).times}, PULSES.format(1),
        "their clocks or trigger times differ",
    ),
    "exchanged": (
        RATE, {"a": vibration(), "e": edges(1024, 23 / 57).times, "g": edges(1024).times}, PULSES.format(1024) + GEAR,
        "the encoders of pinion and gear are exchanged?",
    ),
    "aliasing": (
        2700.0, {"a": vibration(rate=2700.0, highest=8000.0), "e": edges(1).times}, PULSES.format(1),
        "mesh harmonics above half the sampling rate (1350 Hz) appear below it",
    ),
    "mesh": (
        RATE, {"a": vibration(teeth=25), "e": edges(1).times}, PULSES.format(1),
        "25 teeth, or a speed of 26.7",
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_import_names_the_mistake_of_a_file_and_nothing_else(name, tmp_path, monkeypatch, capsys):
    rate, columns, more, sentence = CASES[name]
    monkeypatch.chdir(tmp_path)
    np.savez("data.npz", **columns)
    (tmp_path / "mapping.toml").write_text(MAPPING.format(rate=rate, more=more))
    assert run(["import", "mapping.toml", "--out", "out.mcap"]) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if "likely mistake" in line]
    if sentence is None:
        assert said == []
    else:
        assert len(said) == 1 and sentence in said[0], said
