"""Simulated machines of a rig: their instruments record what the model says, and effects are found from a size."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.detectability.limits import FACTOR, HALVINGS, limit_of, made, simulated_effects, smallest_found
from twin.detectability.machines import drawn
from twin.detectability.nulls import null_evidence, one_campaign
from twin.detectability.windows import Campaign, instruments_of, simulated
from twin.effects.pitch_error import PitchError
from twin.features.extract import extract
from twin.model import Condition
from twin.required_evidence import DEFAULT
from twin.rig import Rig

ROOT = Path(__file__).parents[2]
CONDITION = Condition(speed_hz=12.0, torque=11.0)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.from_mapping(tomllib.loads((ROOT / "recordings" / "rigs" / "unsw.toml").read_text(encoding="utf-8")))


def campaign_of(rig: Rig, windows: int = 6, depth: float = 45e-6) -> Campaign:
    return Campaign(conditions=(CONDITION,) * windows, depth=depth, instruments=instruments_of(rig))


def test_recorded_lines_are_those_of_the_model(rig: Rig):
    """Mesh lines read from the samples against the steady state that they were made from."""
    rng = np.random.default_rng(5)
    machine = replace(drawn(rig, rng), teeth=PitchError())  # spacing errors move mesh lines by some per cent
    (window,) = simulated(machine, campaign_of(rig, windows=1), rng)
    features = extract(rig, window)
    steady = machine.model.steady(machine.model.unworn, CONDITION)
    per_mesh = np.exp(1j * machine.phase * np.arange(1, 9))
    heard = machine.model.acceleration_lines(steady)[:8] * per_mesh
    k, y, _ = features.acceleration.mesh()
    floor = rig.tolerances.acceleration_floor
    np.testing.assert_allclose(y[np.isin(k, np.arange(1, 9))], heard, atol=2 * floor + 0.02 * np.abs(heard).max())
    error = machine.model.transmission_error_lines(steady)[:3] * per_mesh[:3]
    k, e, _ = features.transmission_error.mesh()
    np.testing.assert_allclose(e[:3], error, atol=0.05e-6 + 0.02 * np.abs(error).max())
    assert features.speed_hz == pytest.approx(CONDITION.speed_hz, rel=5e-3)
    assert features.torque_nm == pytest.approx(CONDITION.torque, rel=2e-3)


def test_machines_differ_within_the_tolerances(rig: Rig):
    machines = [drawn(rig, np.random.default_rng(seed)) for seed in range(200)]
    damping = np.array([m.model.calibration.modal_damping for m in machines]) / rig.value("damping.modal_ratio")
    assert np.abs(damping - 1).max() <= rig.tolerances.damping
    assert np.std(damping) == pytest.approx(rig.tolerances.damping / np.sqrt(3), rel=0.15)  # evenly spread
    first = np.array([m.discs[0].lines[0] for m in machines]) * rig.gear_pair().base_radius[0]
    assert np.sqrt(np.mean(np.abs(first) ** 2)) == pytest.approx(rig.tolerances.pinion_once_per_turn, rel=0.15)


@pytest.mark.slow
def test_a_healthy_machine_gives_nothing_and_a_misaligned_one_its_misalignment(rig: Rig):
    campaign = campaign_of(rig)
    assert one_campaign(rig, campaign, 1, required=DEFAULT) == ()
    effect, value = made("misalignment", 1.0, rig.teeth, 1)
    (found,) = one_campaign(rig, campaign, 1, (effect,), required=DEFAULT)
    assert found.name == "misalignment"
    size, _, std = found.parameters["lead_gap"]
    assert abs(size) == pytest.approx(value, abs=3 * std)


@pytest.mark.slow
def test_the_same_seed_is_the_same_machine(rig: Rig):
    campaign = campaign_of(rig, windows=4)
    first, again = (one_campaign(rig, campaign, 7) for _ in range(2))
    assert null_evidence([first]) == null_evidence([again])


@pytest.mark.parametrize("true", [0.05, 0.3, 1.0, 2.7, 60.0])
def test_the_smallest_size_is_found_within_the_stated_factor(true: float):
    smallest, tried = smallest_found(lambda size: size >= true, 1.0, largest=FACTOR**4, least=FACTOR**-3)
    assert smallest is not None and true <= smallest <= true * FACTOR ** (1 / 2**HALVINGS) * (1 + 1e-9)
    assert tried >= smallest


def test_sizes_that_are_never_found_or_cannot_be_simulated_end():
    assert smallest_found(lambda size: False, 1.0, 256.0, 1 / 64) == (None, 256.0)
    assert smallest_found(lambda size: True, 1.0, 256.0, 1 / 64)[0] == pytest.approx(1 / 64)
    assert smallest_found(lambda size: None, 1.0, 256.0, 1 / 64) == (None, 0.0)
    assert smallest_found(lambda size: None if size > 3 else False, 1.0, 256.0, 1 / 64) == (None, 1.0)
    smallest, _ = smallest_found(lambda size: None if size > 0.5 else size > 0.1, 1.0, 256.0, 1 / 64)
    assert smallest is not None and 0.1 < smallest < 0.15


def test_made_effects_stay_within_their_bounds(rig: Rig):
    for name in simulated_effects():
        for size in (FACTOR**-3, 1.0, FACTOR**4):
            made(name, size, rig.teeth, 0)  # ImpossibleSize otherwise


@pytest.mark.slow
def test_limit_of_an_eccentricity_is_its_discs_own_run_out(rig: Rig):
    """An eccentricity is told from the disc's own run-out from 4 times that on; the limit cannot be much lower."""
    limit = limit_of(rig, campaign_of(rig), "pinion_eccentricity", range(2), DEFAULT)
    assert limit.value is not None
    disc = rig.tolerances.pinion_once_per_turn
    assert 3 * disc < limit.value < 10 * disc


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.03, 0.12, 0.5])
def test_torque_that_swings_once_a_turn_is_neither_an_unbalance_nor_an_eccentricity(share: float):
    """A ripple of so much of the mean torque, on a light spindle drive whose housing it shakes at the shaft's order."""
    path = ROOT / "benchmarks" / "trace_campaigns" / "rigs" / "spindle-drive.toml"
    spindle = Rig.from_mapping(tomllib.loads(path.read_text(encoding="utf-8")))
    condition = Condition(speed_hz=18.0, torque=8.0)
    campaign = Campaign(conditions=(condition,) * 6, depth=6e-6, instruments=instruments_of(spindle))
    (effect, _) = made("torque_ripple", share * condition.torque, spindle.teeth, 0)
    found = one_campaign(spindle, campaign, 5000, (effect,), DEFAULT)
    assert found is not None and [e.name for e in found] == ["torque_ripple"]
    assert found[0].parameters["amplitude"][0] == pytest.approx(effect.amplitude, rel=0.2)  # of a modelled line: 8 %
