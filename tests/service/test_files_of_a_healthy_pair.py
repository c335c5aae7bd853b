"""Files of a healthy pair, from the file to the answer: what its tachometer and its sensor do is not the machine's.

Truth  mesh lines, a line of each shaft and noise, without a modulation; RMS 8.00 m/s². The files of the folder of
       reference cases are written by their own scripts, the others here
"""

import json
import subprocess
import sys

import numpy as np
import pytest

from service.cli import run

SECONDS, TRUE_RMS = 18.0, 8.0


def pair(rate, speed, ramp=0.0, seed=1):
    """Times, acceleration [g] and turns of the pinion of a healthy pair of 23 and 57 teeth."""
    t = np.arange(int(SECONDS * rate)) / rate
    turns = speed * t + 0.5 * ramp * t**2
    mesh = 2 * np.pi * 23 * turns
    x = sum(size * np.cos(k * mesh + k) for k, size in ((1, 1.0), (2, 0.5), (3, 0.25)))
    x += 0.05 * np.cos(2 * np.pi * turns) + 0.1 * np.random.default_rng(seed).normal(size=t.size)
    return t, x * TRUE_RMS / 9.80665 / x.std(), turns


def written(folder, t, x, turns, flank=0.0):
    """The file of a logger whose tachometer gives a square pulse a turn, or one with flanks of a share of a turn."""
    from_middle = np.abs((turns + 0.5) % 1 - 0.5)
    pulse = 5.0 * (from_middle < 0.025) if not flank else 5 / (1 + np.exp((from_middle - 0.025) / flank))
    columns = np.stack([t, x, pulse], axis=1)
    np.savetxt(folder / "data.csv", columns, "%.6f", ",", header="Time (s),Acc (g),Tacho (V)", comments="")


def answered(folder, monkeypatch):
    """What the two commands of a newcomer answer of `data.csv`."""
    monkeypatch.chdir(folder)
    assert run(["import", "data.csv", "--guess", "--teeth", "23/57", "--age", "unknown", "--out", "out.mcap"]) == 0
    assert run(["assess", "out.mcap", "--json", "answer.json"]) == 0
    return json.loads((folder / "answer.json").read_text())


def check_healthy(said):
    assert said["status"]["level"] == "no_verdict" and said["effects"] == [] and not said.get("unattributed_lines")
    assert said["unexplained"]["verdict"] != "unknown_effect"
    levels = [w["rms_measured"] for w in said["windows"]]
    assert levels == pytest.approx([TRUE_RMS] * len(levels), rel=0.01)


def by_its_script(shared, folder, case):
    script = shared / "cases" / case / "make.py"
    if not script.is_file():
        pytest.skip(f"the reference cases are not here: no file {script}")
    subprocess.run([sys.executable, "-B", str(script)], cwd=folder, check=True, timeout=60)


TACHOMETERS = ("k05-control-triangle", "k05-ttl-tacho-constant", "k05-ttl-tacho-ramp", "k05-steep-but-not-square")


@pytest.mark.slow
@pytest.mark.parametrize("case", TACHOMETERS)
def test_a_tachometer_read_from_samples_makes_no_finding_in_the_reference_cases(shared, tmp_path, monkeypatch, case):
    by_its_script(shared, tmp_path, case)
    check_healthy(answered(tmp_path, monkeypatch))


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "flank"), [
    ({"rate": 5120.0, "speed": 24.47}, 0.0),
    ({"rate": 8192.0, "speed": 19.37, "ramp": 0.02}, 0.0),
    ({"rate": 10000.0, "speed": 27.9, "ramp": -0.01}, 0.003),
])  # fmt: skip
def test_a_tachometer_read_from_samples_makes_no_finding(tmp_path, monkeypatch, machine, flank):
    written(tmp_path, *pair(**machine), flank)
    check_healthy(answered(tmp_path, monkeypatch))


def check_drift_is_said(said):
    check_healthy(said)
    assert said["windows"][0]["quality"] == "repaired"
    assert [f["kind"] for f in said["windows"][0]["faults"]] == ["drift"]


@pytest.mark.slow
def test_a_sensor_that_settles_is_said_and_its_level_is_that_of_the_vibration_in_the_reference_case(
    shared, tmp_path, monkeypatch
):
    by_its_script(shared, tmp_path, "k14-iepe-settling")
    check_drift_is_said(answered(tmp_path, monkeypatch))


@pytest.mark.slow
@pytest.mark.parametrize("drift", [
    lambda t: -8.0 * np.exp(-t / 0.8), lambda t: 0.3 * t, lambda t: 3.0 * np.exp(-t / 6.0),
], ids=["from below", "warming up", "slowly"])  # fmt: skip
def test_a_sensor_that_settles_is_said_and_its_level_is_that_of_the_vibration(tmp_path, monkeypatch, drift):
    t, x, turns = pair(5120.0, 24.5)
    written(tmp_path, t, x + drift(t), turns)
    check_drift_is_said(answered(tmp_path, monkeypatch))
