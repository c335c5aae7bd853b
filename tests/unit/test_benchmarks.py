"""The benchmarks measure what they say, and run."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from benchmarks import bench_dynamics, bench_running
from benchmarks.figures import with_figures
from benchmarks.long_recording import TURNS, write_long_recording
from recordings.generator.spec import read as read_spec
from service.stream.sources.mcap import read_windows
from twin.dynamics.harmonic_balance import solve

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    path = tmp_path_factory.mktemp("long") / "long.mcap"
    write_long_recording(path, 10.0)
    _, metadata, windows = read_windows(path)
    assert metadata["asset"] == "unsw-short"
    return windows


def test_a_long_recording_is_whole_and_holds_as_much_signal_as_asked_for(windows):
    assert all(w.quality == "good" and not w.faults for w in windows)
    copies = windows[8:]  # the campaign has eight windows of its own
    assert sum(w.duration for w in copies) == pytest.approx(10.0, rel=0.05)
    rates = {w.accelerations["y6"].rate for w in windows}
    assert rates == {25600.0}


@pytest.mark.slow
def test_its_copies_are_the_same_window_whole_hunting_periods_later(windows):
    first, *copies = windows[7:]
    assert copies
    for number, copy in enumerate(copies, 1):
        assert np.array_equal(copy.accelerations["y6"].values, first.accelerations["y6"].values)
        for shaft, turns in TURNS.items():
            edges, before = copy.encoders[shaft], first.encoders[shaft]
            assert (edges.first_index - before.first_index) == number * turns * edges.per_rev
            assert edges.times - edges.times[0] == pytest.approx(before.times - before.times[0], abs=1e-9)


def test_twice_the_rate_keeps_the_level(windows):
    _, _, source = read_windows(ROOT / "recordings" / "short-campaign.mcap")
    for fine, coarse in zip(windows, source, strict=False):
        low, high = coarse.accelerations["y6"].values, fine.accelerations["y6"].values
        assert high.size == 2 * low.size
        assert np.std(high) == pytest.approx(np.std(low), rel=0.02)


def test_figures_replace_what_stood_in_their_table_and_nothing_else():
    command = "python -m benchmarks.figures none"  # runs no table: prints nothing
    text = f"before\n<!-- figures: {command} -->\n```\nold\n```\n<!-- end of figures -->\nafter\n"
    assert with_figures(text, ["other"]) == text
    emptied = f"before\n<!-- figures: {command} -->\n```\n\n```\n<!-- end of figures -->\nafter\n"
    assert with_figures(text, ["none"]) == emptied


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_all_benchmarks_run_and_stay_within_their_limits():
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "--quick"], cwd=ROOT, capture_output=True, text=True, timeout=1000
    )
    assert done.returncode == 0, done.stderr
    for what in ("LSODA", "update of one window", "wear curve to", "assess of the campaign", "peak memory"):
        assert what in done.stdout


def test_newtons_method_on_the_period_map_finds_the_steady_state():
    """Time integration's best method gives what the harmonic balance is compared with."""
    model = bench_dynamics.reference_model(512)
    table = bench_dynamics.contacts(model, model.unworn)
    steady = solve(model.structure, table, model.mean_force(bench_dynamics.CONDITION)).require_converged()
    period_map = bench_dynamics.PeriodMap(model, table, bench_dynamics.torques(model))
    lines = bench_dynamics.shot(period_map, always=False)
    assert bench_dynamics.error(lines, model.acceleration_lines(steady)[:10]) < 1e-3
    assert period_map.integrations < 200


@pytest.mark.parametrize("conditions", [bench_running.CONSTANT, bench_running.VARYING])
def test_the_campaigns_of_the_running_system_are_ones_of_the_generator(conditions):
    spec = read_spec(tomllib.loads(bench_running.spec_of(conditions)))
    assert len(spec["windows"]["at_revolutions"]) == len(spec["conditions"]) == bench_running.WINDOWS
    assert len({(c["speed_hz"], c["torque_nm"]) for c in spec["conditions"]}) == len(conditions)


def test_machines_of_a_kind_have_gears_of_their_own():
    rig = bench_dynamics.reference_model(256).rig
    first, second = bench_running.machine(rig, 0), bench_running.machine(rig, 1)
    assert first.values == rig.values
    assert second.get("gears.face_width") == pytest.approx(rig.get("gears.face_width") * (1 + bench_running.WIDER))
