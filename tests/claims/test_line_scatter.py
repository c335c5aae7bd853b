"""What the rig file's tolerances do to the mesh lines, against the whole response, and what follows for a band."""

from pathlib import Path

import numpy as np
import pytest

from service.files.rig import load_rig
from tests.dynamics_cases import RIG
from tests.updating_cases import TEN, curve, model, seen
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.model import Calibration, Condition, Model
from twin.structure_spread import times
from twin.updating.depth import HARMONICS, estimate_depth
from twin.updating.depth_band import BAND, DepthParts, structure_std
from twin.updating.encoders import gauge_of
from twin.updating.line_scatter import deviations, line_scatter
from twin.updating.memory import Memory
from twin.updating.outcome import stated_std
from twin.updating.prediction import Expectation

CURVE = curve()


def scatter_of_lines(rig, speed_hz):
    """Standard deviation of ln m_k of each line."""
    return np.linalg.norm(np.abs(line_scatter(rig, speed_hz, False)), axis=0)


@pytest.mark.parametrize("key", ["torsional_stiffness.k_3_5", "damping.modal_ratio"])
def test_the_change_of_a_line_is_that_of_the_whole_response(key):
    """Steady states of new and of worn flanks, solved with the value changed by its standard deviation."""
    keys = list(deviations(RIG))
    off = line_scatter(RIG, 10.0, False)[keys.index(key)]
    other = times(RIG, {key: np.log1p(deviations(RIG)[key])})
    condition, profiles = Condition(speed_hz=10.0, torque=10.0), [CURVE.profile(d) for d in (0.0, 20e-6)]

    def grown(twin: Model) -> np.ndarray:
        new, worn = (twin.transmission_error_lines(twin.steady(p, condition))[:HARMONICS] for p in profiles)
        return worn - new

    nominal = Model.of(RIG, Calibration.prior(RIG))
    solved = np.log(grown(Model.of(other, Calibration.prior(other))) / grown(nominal))
    assert solved == pytest.approx(off, abs=0.25 * np.abs(off).max() + 2e-4)


def test_a_line_near_a_natural_frequency_is_far_less_certain():
    """The first mesh harmonic far below the mode at 767 Hz, and on it (19 teeth at 40.4 Hz)."""
    assert scatter_of_lines(RIG, 10.0)[0] < 0.003
    assert scatter_of_lines(RIG, 40.4)[0] > 0.02


def test_a_rig_with_its_own_table_of_the_pair_stiffness_has_a_scatter():
    rig = load_rig(Path(__file__).parents[2] / "benchmarks" / "trace_campaigns" / "rigs" / "pump-drive.toml")
    assert np.all(scatter_of_lines(rig, 8.0) > 0)
    assert scatter_of_lines(rig, 8.0)[0] < 0.003


def test_the_scatter_is_proportional_to_the_tolerances():
    wide = times(RIG, {})
    wide.values["tolerances"] = {"stiffness": 0.06, "mass": 0.02, "damping": 0.4}
    wide = type(RIG)(wide.values)
    assert scatter_of_lines(wide, 10.0) == pytest.approx(2 * scatter_of_lines(RIG, 10.0), rel=0.2)


def test_the_band_holds_machines_within_their_tolerance():
    """Lines moved by values drawn within the tolerances: the structure's part of the band is the spread of depths."""
    gauge = gauge_of(seen(CURVE.profile(30e-6), revolutions=5000.0), Memory(), model(), TEN)
    response = Expectation.at(model(), CURVE, TEN, 30e-6).response(False, gauge.from_unworn)
    random, sources = np.random.default_rng(5), gauge.sources
    depths = []
    for _ in range(60):
        factor = np.exp(random.normal(size=len(sources)) @ sources)
        moved = type(gauge)(**{**{f: getattr(gauge, f) for f in gauge.__slots__}, "lines": gauge.lines * factor})
        depths.append(estimate_depth(moved, response, 1e-6, 60e-6).depth)
    (up, down, lines), _ = response(np.array([31e-6, 29e-6, 30e-6]))
    slope, variance = (up - down) / 2e-6, (gauge.scatter * np.abs(lines)) ** 2
    gain = np.conj(slope) / variance / np.sum(np.abs(slope) ** 2 / variance)
    assert np.std(depths) == pytest.approx(structure_std(gain, lines, sources), rel=0.25)


def test_parts_of_a_band_are_independent():
    parts = DepthParts(structure=3e-7, fit=4e-7, mean=0.0, noise=1e-7, shape=2e-7)
    expected = (BAND.tolerance * 3e-7) ** 2 + (BAND.fit * 4e-7) ** 2 + 1e-14 + 4e-14
    expected += (BAND.alike * 2e-5) ** 2 + BAND.floor**2
    assert parts.std(2e-5) == pytest.approx(np.sqrt(expected))


def test_an_effect_in_the_model_widens_the_band_only_where_it_acts_on_mesh_or_teeth():
    gauge = gauge_of(seen(CURVE.profile(30e-6), revolutions=5000.0), Memory(), model(), TEN)
    response = Expectation.at(model(), CURVE, TEN, 30e-6).response(False, gauge.from_unworn)
    found = estimate_depth(gauge, response, 1e-6, 60e-6)
    friction = Memory(effects=(Addition(effect=EFFECTS["tooth_friction"](coefficient=0.1)),))
    gain = Memory(effects=(Addition(effect=EFFECTS["sensor_gain"](gain=1.2)),))
    alone = stated_std(found, Memory())
    assert stated_std(found, gain) == alone
    assert stated_std(found, friction) == pytest.approx(np.hypot(alone, BAND.effects * found.depth))
