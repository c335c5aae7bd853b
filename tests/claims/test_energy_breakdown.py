"""Energy by origin: shares and steadiness of a signal whose lines are known."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from twin.baseline.energy_breakdown import FAMILIES, energy_breakdown
from twin.baseline.reading import angle_of
from twin.baseline.spacing import Spacing
from twin.errors import WindowError
from twin.rig import Rig
from twin.windows import Edges, Samples, Window

TEETH, SPEED, RATE = (20, 30), 16.0, 4096.0
SHAFTS = (Fraction(1), Fraction(2, 3))
RIG = Rig.from_mapping({"gears": {"pinion": {"teeth": 20}, "gear": {"teeth": 30}}})
STRANGE = 1.2371  # order of a modulation of the mesh
AMPLITUDES = {"mesh": 2.0, "pinion": 0.6, "gear": 0.4, "both shafts": 0.3}  # of one line each
ORDERS = {"mesh": 20.0, "pinion": 7.0, "gear": 10 / 3, "both shafts": 1 / 3}
DEPTH, NOISE = 0.5, 0.3


def window(slip=0.0, seconds=16.0, seed=1):
    """One line of each family, a modulation of the mesh by something that slips (random walk of its phase), noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    θ = 2 * np.pi * SPEED * t
    phase = slip * np.cumsum(rng.normal(size=t.size)) / np.sqrt(RATE)
    signal = {name: a * np.cos(ORDERS[name] * θ + i) for i, (name, a) in enumerate(AMPLITUDES.items())}
    signal["no shaft"] = AMPLITUDES["mesh"] * np.cos(20 * θ) * DEPTH * np.cos(STRANGE * θ + phase)
    values = sum(signal.values()) + NOISE * rng.normal(size=t.size)
    edges = Edges(per_rev=1, first_index=0, times=np.arange(int(SPEED * seconds)) / SPEED)
    energy = {name: float(np.mean(x**2) / np.var(values)) for name, x in signal.items()}
    return Window(
        start_time_ns=1, accelerations={"a": Samples(start=0.0, rate=RATE, values=values)}, encoders={"pinion": edges}
    ), energy  # fmt: skip


SPACING = Spacing(
    order=STRANGE,
    std=1e-5,
    log_chance=-20.0,
    next_log_chance=0.0,
    channels=("a",),
    sidebands=(),
    excerpts=(),
    ratio=None,
)


def found(w):
    return {f.name: f for f in energy_breakdown(w.accelerations, angle_of(RIG, w), TEETH, SHAFTS, [SPACING])}


def test_every_family_has_its_share_and_what_turns_is_steady():
    w, energy = window()
    families = found(w)
    for name in FAMILIES:
        f = families[name]
        assert f.share == pytest.approx(energy[name], rel=0.03, abs=0.002)
        assert f.share_std < 0.02 * energy[name] + 0.001
        assert f.steady > 0.97


def test_what_slips_is_not_steady_and_what_turns_beside_it_is():
    families = found(window(slip=1.0)[0])  # about one radian in a second
    assert families["no shaft"].steady < 0.6
    assert families["mesh"].steady > 0.99


def test_tone_of_fixed_frequency_is_as_steady_as_it_is_said_to_be_and_less_than_what_turns():
    w, _ = window()
    t = np.arange(w.accelerations["a"].values.size) / RATE
    turns = SPEED * t + 0.2 * np.sin(2 * np.pi * 0.11 * t)  # the speed wanders slowly
    whole = np.arange(1, int(turns[-1]))
    edges = Edges(per_rev=1, first_index=1, times=np.interp(whole, turns, t))
    noise = 0.05 * np.random.default_rng(5).normal(size=t.size)
    speed = (whole[-1] - whole[0]) / (edges.times[-1] - edges.times[0])
    for name, values in {"fixed": np.cos(2 * np.pi * 7 * speed * t), "turns": np.cos(2 * np.pi * 7 * turns)}.items():
        one = replace(w, encoders={"pinion": edges}, accelerations={
            "a": Samples(start=0.0, rate=RATE, values=values + noise)
        })  # fmt: skip
        pinion = {f.name: f for f in energy_breakdown(one.accelerations, angle_of(RIG, one), TEETH, SHAFTS)}["pinion"]
        if name == "fixed":
            assert pinion.steady == pytest.approx(pinion.steady_if_fixed, abs=0.1) and pinion.steady < 0.7
        else:
            assert pinion.steady > 0.95 and pinion.steady_if_fixed < 0.7


def test_noise_alone_has_no_share_and_keeps_no_phase():
    w, _ = window()
    noise = np.random.default_rng(3).normal(size=w.accelerations["a"].values.size)
    quiet = replace(w, accelerations={"a": Samples(start=0.0, rate=RATE, values=noise)})
    for f in energy_breakdown(quiet.accelerations, angle_of(RIG, w), TEETH, SHAFTS):
        assert f.share < 0.01
        assert f.steady is None or f.steady < 0.7


def test_short_window_is_refused_in_words():
    w, _ = window(seconds=4.0)
    with pytest.raises(WindowError, match="pinion turns are too few to attribute lines to shafts: at least 80"):
        energy_breakdown(w.accelerations, angle_of(RIG, w), TEETH, SHAFTS)
