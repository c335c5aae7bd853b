"""An effect is added by one file, one line of the table and one instance, and tracing finds it.

The three effects of tests/added_effects act over a mesh period, with a turn of a shaft, and on how the flanks wear.
What the table has in their place is taken out, so that nothing else can name them. The campaigns are the generator's.
"""

import tomllib
from importlib import import_module

import numpy as np
import pytest

from benchmarks.scoring import ROOT, windows_of
from recordings.generator import simulate, write
from tests.dynamics_cases import relative
from tests.effects_cases import solved
from twin.effects import EFFECTS, neutral
from twin.errors import ParameterError
from twin.step import Options, State, step
from twin.tracing.mesh_trials import mesh_trials

RIG = ROOT / "recordings" / "rigs" / "unsw.toml"


def loaded(name):
    """The class of a file of tests/added_effects; its name is the file's, in capitals."""
    return getattr(import_module(f"tests.added_effects.{name}"), "".join(word.capitalize() for word in name.split("_")))


ADDED = {  # name: the instance, what it replaces, what the generator puts in, parameter and its value
    "sliding_friction": (
        {"friction": 0.08}, "tooth_friction", {"name": "tooth_friction", "mu": 0.08}, ("friction", 0.08, 0.25),
    ),
    "heavy_spot": (
        {"unbalance": 5e-3}, "mass_unbalance",
        {"name": "mass_unbalance", "pinion_g_mm": 20_000.0, "phase": 0.6}, ("unbalance", 0.02, 0.15),
    ),
    "crossed_axes": (
        {"opening": 20e-6}, "misalignment", {"name": "misalignment", "lead_um": 40.0}, ("opening", 40e-6, 0.3),
    ),
}  # fmt: skip


@pytest.fixture(params=ADDED)
def added(request, monkeypatch):
    """Name and class of an effect that has been added to the table, and what it replaces taken out."""
    name = request.param
    kind = loaded(name)
    monkeypatch.delitem(EFFECTS, ADDED[name][1])
    monkeypatch.setitem(EFFECTS, name, kind)
    return name, kind


def test_added_effect_holds_to_the_rules_of_the_table(added):
    name, kind = added
    effect = kind(**ADDED[name][0])
    healthy, found = solved(period=effect.period), solved(effect)
    assert np.array_equal(solved(neutral(effect)).acceleration_lines, healthy.acceleration_lines)
    assert relative(found.acceleration_lines, healthy.acceleration_lines) > 1e-5
    assert effect.period in kind.facts.periods and found.setup.slices == kind.facts.slices
    assert (name in mesh_trials()) == (kind.facts.detector == "mesh")
    size = kind.parameters[0]
    with pytest.raises(ParameterError, match=rf"\.{size.name} = .* is outside"):
        kind(**{size.name: 1.1 * size.high})


def campaign(tmp_path, effect, seed=4242):
    """Windows of a generated campaign of six windows to some 45 µm, with one effect from the start."""
    spec = {
        "schema": "gear-campaign/1",
        "asset": "unsw-rig",
        "description": "one effect from the start",
        "seed": seed,
        "wear": {"k_m2_per_n": 1.3e-12, "from_revolutions": 60.0, "dynamic_forces": True},
        "machine": {"slices": 7},
        "conditions": [{"speed_hz": 12.0, "torque_nm": 11.0}],
        "windows": {"seconds": 2.5, "at_revolutions": [0.0, 1500.0, 3000.0, 4500.0, 6000.0, 7500.0]},
        "effects": [{"onset_revolutions": 0.0, **effect}],
        "truth": {"to_end_of_life": False},
    }
    text = RIG.read_text(encoding="utf-8")
    path = tmp_path / "campaign.mcap"
    write(simulate(spec, tomllib.loads(text)), path, tmp_path / "truth.json", text)
    return windows_of(path)


@pytest.mark.slow
def test_added_effect_is_found_by_tracing_on_a_generated_campaign(added, tmp_path):
    name, _ = added
    _, _, put, (parameter, value, tolerance) = ADDED[name]
    rig, windows = campaign(tmp_path, put)
    state = State()
    for window in windows:
        state, _ = step(rig, state, window, Options(trace=True))
    assert [found.name for found in state.tracing.found] == [name]
    size, unit, _ = state.tracing.found[0].parameters[parameter]
    assert size == pytest.approx(value, rel=tolerance)
    assert unit == next(p.unit for p in EFFECTS[name].parameters if p.name == parameter)
