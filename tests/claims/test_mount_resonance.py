"""A resonance of the accelerometer's mount is told from its curve: by how lines change, or by the rig file's path.

Truth  the response of a mass on a moving base, written out here; structures and model errors drawn by lot
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.scoring import windows_of
from tests.instrument_faults import mount
from twin.rig import Rig
from twin.tracing.detectors.sensor import THRESHOLDS
from twin.tracing.gain_change import mount_change
from twin.tracing.transfer_path import Quotient, fit_sensor

RIGS = Path(__file__).parents[2] / "recordings" / "rigs"
TOP, GAIN = 2000.0, 0.05  # end of the band [Hz], spread of a sensor's gain
TURNS = (900.0, 1800.0, 3600.0, 4500.0, 5400.0)
ONSET = 3000.0
MEASURED = 4  # harmonics whose transmission error is measured


def response(f, f0, ζ):
    r = f / f0
    return (1 + 2j * ζ * r) / (1 - r**2 + 2j * ζ * r)


def quotients(meshes, change=lambda f: 1.0, before=lambda f: 1.0, seed=0, apart=0.0):
    """Ten harmonics in five windows that take the mesh frequencies [Hz] in turn; every line has a factor of its own.

    change  what happens to every line at the onset
    before  what the path makes of it from the start
    apart   standard deviation of the logarithm of what lines change by on their own
    """
    rng = np.random.default_rng(seed)
    drawn = {}
    out = []
    for i, n in enumerate(TURNS):
        mesh = meshes[i % len(meshes)]
        for k in range(1, 11):
            f, modelled = k * mesh * (1 + 0.002 * rng.normal()), k > MEASURED
            if f > 1.1 * TOP:
                continue
            own = drawn.setdefault((mesh, k), 0.3 * (rng.normal(size=2) @ (1, 1j)) * modelled)
            moved = drawn.setdefault((mesh, k, "moved"), apart * (rng.normal(size=2) @ (1, 1j)))
            noise = (0.1 if modelled else 0.02) * (rng.normal(size=2) @ (1, 1j))
            late = n > ONSET
            ratio = before(f) * np.exp(own + noise + moved * late) * (change(f) if late else 1.0)
            out.append(
                Quotient(
                    frequency=f,
                    log=complex(np.log(ratio)),
                    std=0.4 if modelled else 0.02,
                    order=k,
                    modelled=modelled,
                    revolutions=n,
                )
            )
    return out


@pytest.mark.parametrize(
    ("f0", "ζ", "meshes"),
    [
        (1900.0, 0.05, (213.0,)),
        (1100.0, 0.03, (134.0,)),
        (1500.0, 0.02, (350.0, 444.0)),
        (1720.0, 0.04, (213.0, 270.0)),
        (760.0, 0.06, (190.0,)),
        (2300.0, 0.03, (195.0,)),
    ],
)
def test_mount_that_begins_to_resonate_is_told_whatever_the_structure_makes_of_each_line(f0, ζ, meshes):
    for seed in range(2):
        found = mount_change(quotients(meshes, lambda f: response(f, f0, ζ), seed=seed), TOP, GAIN)
        assert found is not None and found.mount.log_evidence > THRESHOLDS.least_evidence
        assert found.mount.effect.frequency == pytest.approx(f0, rel=max(0.03, 3 * found.mount.std))
        assert found.onset - 2 * found.onset_std < ONSET < found.onset + 2 * found.onset_std


@pytest.mark.parametrize("meshes", [(213.0,), (350.0, 444.0)])
@pytest.mark.parametrize(
    ("change", "apart"),
    [(1.0, 0.0), (0.7, 0.0), (1.5, 0.0), (1.0, 0.2), (1.0, 0.5), (0.8, 0.2)],
)
def test_lines_that_stay_change_alike_or_each_by_its_own_are_no_resonance(change, apart, meshes):
    found = [mount_change(quotients(meshes, lambda f: change, seed=seed, apart=apart), TOP, GAIN) for seed in range(4)]
    assert max(f.mount.log_evidence for f in found if f is not None) < THRESHOLDS.least_evidence


@pytest.mark.parametrize("order", [1, 6, 10])
def test_one_line_that_wear_has_nearly_cancelled_is_no_resonance(order):
    """It jumps by itself; a resonance would move its neighbours."""
    for jump in (-1.5, 1.5):
        seen = [
            replace(q, log=q.log + jump * (q.order == order and q.revolutions > ONSET)) for q in quotients((200.0,))
        ]
        found = mount_change(seen, TOP, GAIN)
        assert found is not None and found.mount.log_evidence < THRESHOLDS.least_evidence


@pytest.mark.parametrize(
    ("f0", "ζ", "meshes"), [(1720.0, 0.033, (213.0, 267.0)), (1250.0, 0.02, (204.0,)), (1480.0, 0.05, (185.0, 230.0))]
)
def test_lines_on_both_sides_of_a_resonance_tell_it_from_the_start(f0, ζ, meshes):
    """Beyond it lines are turned by half a turn, where a phase of +π and one of −π are the same."""
    rig = Rig.from_mapping(tomllib.loads((RIGS / "unsw.toml").read_text(encoding="utf-8")))
    for seed in range(2):
        seen = quotients(meshes, before=lambda f: response(f, f0, ζ), seed=seed)
        gain, resonance = fit_sensor(rig, 0.02, seen)
        assert resonance.log_evidence > max(gain.log_evidence, THRESHOLDS.least_evidence)
        assert resonance.over_other > THRESHOLDS.over_other_structure
        assert resonance.effect.frequency == pytest.approx(f0, rel=max(0.03, 3 * resonance.std))


def test_sound_mount_of_the_rig_files_own_structure_has_no_resonance():
    rig = Rig.from_mapping(tomllib.loads((RIGS / "unsw.toml").read_text(encoding="utf-8")))
    for seed in range(2):
        assert fit_sensor(rig, 0.02, quotients((213.0,), seed=seed))[1].log_evidence < THRESHOLDS.least_evidence


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_mount_that_begins_to_resonate_in_a_recorded_campaign_is_named_from_then_on():
    from benchmarks.spoiled_instruments import laid
    from service.contract.estimate import step
    from twin.options import Options
    from twin.state import State

    rig, windows = windows_of(RIGS.parent / "short-campaign.mcap")
    half, spoil, state = len(windows) // 2, mount(1900.0, 0.03), State()
    for i, window in enumerate(windows):
        spoiled = window if i < half else laid(rig, spoil(window, np.random.default_rng(0)))
        state, found = step(rig, state, spoiled, Options(trace=True))
    (effect,) = found.report["effects"]
    assert effect["name"] == "sensor_resonance"
    assert effect["parameters"]["frequency"]["value"] == pytest.approx(1900.0, rel=0.05)
    assert 400.0 < effect["onset_revolutions"] < 1250.0
