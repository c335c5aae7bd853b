"""Every number that decides a verdict is in the register, and its size follows from the machine."""

import ast
import json
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import pytest

from tests.dynamics_cases import RIG
from twin.rig import Rig
from twin.scales import UNITS, Scales
from twin.threshold_register import SETS, register

ROOT = Path(__file__).parents[2]
DECIDING = ("twin/tracing", "twin/baseline", "twin/encoder_pair")
NO_VERDICT = {
    "STEPS": "iterations of a numerical method",
    "NEIGHBOURS": "spacing of the grid of losses, between two of its points",
    "MOST_HISTORY": "memory: windows that are kept",
    "POOR": "choice of a start, not of a result",
    "UNDETERMINED": "rounding: eigenvalues that are zero",
    "CONVERGED": "end of an iteration",
    "BAND": "width of a reported or averaged band",
    "MESH_WIDTH": "which lines are the mesh and its sidebands",
    "SIDEBANDS": "width of a reported band",
    "TURNS_PER_PERIOD": "width of Hann's main lobe",
    "LEAST_MISS": "rounding: guards a division",
    "LEAST_GAIN": "rounding: guards a division",
    "CONSTANT": "number of parameters of a model",
    "RESONANT": "number of parameters of a model",
    "MOVED": "number of parameters of a model",
    "CAGE": "physics: orders of bearings, T. A. Harris, Rolling Bearing Analysis",
    "INNER": "physics: orders of bearings, T. A. Harris, Rolling Bearing Analysis",
    "BALL": "physics: orders of bearings, T. A. Harris, Rolling Bearing Analysis",
    "NEAR_FITTED": "width of the band that noise is averaged over",
}


@lru_cache(maxsize=512)
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def constants(file: Path) -> set[str]:
    """Names of a module that hold numbers."""
    found = set()
    for node in parsed(file).body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            numbers = [c for c in ast.walk(node.value) if isinstance(c, ast.Constant) and type(c.value) in (int, float)]
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if numbers:
                found |= {n.id for n in ast.walk(target) if isinstance(n, ast.Name)}
    return found


def test_every_number_that_something_is_compared_with_is_in_the_register():
    files = [f for folder in DECIDING for f in (ROOT / folder).rglob("*.py")]
    known = {name for file in files for name in constants(file)}
    missing = []
    for file in files:
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.Compare):
                used = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)} & known - set(NO_VERDICT)
                missing += [f"{file.relative_to(ROOT)}:{node.lineno} {name}" for name in sorted(used)]
    assert not missing, "\n".join(missing)


@pytest.mark.slow
def test_every_set_of_thresholds_is_in_the_register():
    listed = {(kind.__module__, kind.__name__) for kind in SETS}
    for file in (ROOT / "twin").rglob("*.py"):
        module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        for node in parsed(file).body:
            calls = (getattr(n.func, "id", "") for n in ast.walk(node) if isinstance(n, ast.Call))
            if isinstance(node, ast.ClassDef) and "deciding" in calls:
                assert (module, node.name) in listed, f"{module}.{node.name} is not in twin/threshold_register.py"


def test_every_number_has_a_meaning_and_a_source():
    for item in register():
        assert item.row.about.meaning and item.row.about.source, f"{item.module} {item.row.name}"


def test_sizes_on_the_reference_rig_are_those_that_were_tuned_on_it():
    sizes = {(item.row.group, item.row.name): item.scaled for item in register(Scales.of(RIG))}
    assert sizes["RattleThresholds", "sway"] == pytest.approx(15e-6, rel=2e-3)
    assert sizes["RattleThresholds", "largest_swing"] == pytest.approx(45.0)
    assert sizes["ShaftForceThresholds", "least_torque"] == pytest.approx(5e-3)
    assert sizes["ShaftForceThresholds", "least_acceleration"] == pytest.approx(2e-3)
    assert sizes["NonGearThresholds", "tone_amplitude"] == pytest.approx(0.05)
    assert sizes["WindowThresholds", "disc_moved"] == pytest.approx(15e-6, rel=2e-3)
    assert sizes["ToothErrorThresholds", "line_noise"] == pytest.approx(0.03e-6)
    assert sizes["TransferPathThresholds", "least_error"] == pytest.approx(0.3e-6)
    assert sizes["EccentricityThresholds", "least_without_run_out"] == pytest.approx(10e-6, rel=5e-3)
    assert sizes["MountThresholds", "resonance_band"] == pytest.approx((500.0, 6000.0))


def test_sizes_grow_with_the_machine():
    values = RIG.values | {"operating": {**RIG.values["operating"], "input_torque": 1000.0}}
    small, large = Scales.of(RIG), Scales.of(Rig(values))
    assert large.deflection == pytest.approx(100 * small.deflection)
    assert large.torque_noise == pytest.approx(100 * small.torque_noise)
    assert large.base_pitch == small.base_pitch


def test_static_deflection_is_the_mean_deflection_of_the_unworn_mesh_within_a_tenth():
    from tests.dynamics_cases import TEN, model

    assert Scales.of(RIG).deflection == pytest.approx(model().steady(model().unworn, TEN).deflection.mean(), rel=0.1)


def test_scales_of_a_rig_file_with_tooth_counts_alone_are_those_that_need_no_more():
    scales = Scales.of(Rig.from_mapping({"gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 52}}}))
    assert scales.get("base pitch") is None and scales.get("static mesh deflection") is None
    assert scales["acceleration noise floor"] == 0.002
    assert set(scales.values) <= set(UNITS)


@pytest.mark.slow
def test_command_prints_the_register_with_sizes_on_a_rig():
    command = [sys.executable, "-m", "service", "thresholds", "--rig", "recordings/rigs/unsw.toml"]
    done = subprocess.run([*command, "--json", "-"], cwd=ROOT, capture_output=True, text=True, check=True)
    rows = {(row["set"], row["name"]): row for row in json.loads(done.stdout)}
    swing = rows["RattleThresholds", "largest_swing"]
    assert (swing["share_of"], swing["on_this_rig_unit"]) == ("rated torque", "N·m")
    assert swing["on_this_rig"] == pytest.approx(45.0)
    assert len(rows) >= 200
    table = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert "largest_swing" in table and "45 N·m" in table
