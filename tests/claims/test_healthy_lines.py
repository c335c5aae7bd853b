"""What a healthy machine's lines scatter by, against machines drawn within the tolerances of the rig file."""

import numpy as np
import pytest

from tests.mesh_pairs import UNSW_RIG
from twin.dynamics.structure import Structure, direction
from twin.model import mesh_of
from twin.rig import Rig
from twin.structure_spread import times
from twin.tracing.healthy_lines import HealthyLines, LearnedFactors, largest_healthy
from twin.updating.line_scatter import deviating_machines, deviations
from twin.updating.prediction import parts

RIG = Rig.from_mapping(UNSW_RIG)
HEALTHY = HealthyLines.of(RIG)
SPEED = 11.0
ORDERS = 19.0 * np.arange(1, 6)
NOTHING = LearnedFactors(path=(), mesh=())


def of_mesh(structure, frequency, seen):
    """Line per displacement of the teeth through a mean mesh stiffness: receptance coupling, by a dense inverse."""
    k, out = mesh_of(RIG, 256).stiffness.mesh_mean, []
    for f in frequency:
        ω = 2 * np.pi * f
        closed = structure.stiffness - ω**2 * structure.mass + 1j * ω * damping(structure)
        closed = closed + k * np.outer(structure.mesh, structure.mesh)
        out.append(seen @ np.linalg.solve(closed, k * structure.mesh))
    return np.array(out)


def damping(structure):
    ω, modes = structure.modes
    vibrating = np.where(ω > 2 * np.pi, 2 * structure.modal_damping * ω, 0.0)
    return structure.mass @ modes @ np.diag(vibrating) @ modes.T @ structure.mass


@pytest.mark.parametrize(("channel", "seen"), [("transmission_error", None), ("acceleration", "y6")])
def test_transfer_of_a_channel_is_that_of_the_coupled_structure(channel, seen):
    own = Structure.from_rig(RIG)
    looks = own.transmission_error if seen is None else direction({seen: 1.0})
    f = ORDERS * SPEED
    expected = of_mesh(own, f, looks) * (1.0 if seen is None else -((2 * np.pi * f) ** 2))
    assert deviating_machines(RIG).transfer(channel, f) == pytest.approx(expected, rel=1e-6)


def test_structure_scatters_as_machines_drawn_within_the_tolerances():
    rng, keys, f = np.random.default_rng(3), deviations(RIG), ORDERS * SPEED
    machines = deviating_machines(RIG)
    own, drawn = machines.transfer("acceleration", f), []
    for _ in range(200):
        logs = {key: np.log1p(σ * np.sqrt(3) * rng.uniform(-1, 1)) for key, σ in keys.items()}
        drawn.append(machines.transfer("acceleration", f, Structure.from_rig(times(RIG, logs))) / own - 1)
    scatter = np.sqrt(np.mean(np.abs(drawn) ** 2, axis=0))
    predicted = np.sqrt(np.sum(np.abs(machines.scatter("acceleration", f)) ** 2, axis=0))
    assert predicted == pytest.approx(scatter, rel=0.35)  # first order beside a mode at 767 Hz


def variance(channel, predicted, learned=NOTHING, depth=0.0, orders=ORDERS):
    return HEALTHY.variance(
        channel, orders, SPEED, np.asarray(predicted, dtype=complex), np.zeros(orders.size), depth, learned
    )


def test_line_whose_factor_was_learned_scatters_less_and_one_far_from_it_as_before():
    f = ORDERS[0] * SPEED
    learned = LearnedFactors(path=((4.0, f, 1.0 + 0j, 0.01),), mesh=((4.0, f, 1.0 + 0j, 0.01),), depths=(0.0,))
    before, after = variance("acceleration", np.ones(5)), variance("acceleration", np.ones(5), learned)
    assert after[0] < 0.5 * before[0] and after[3] == pytest.approx(before[3], rel=1e-6)


def test_scatter_grows_with_the_depth_worn_since_the_factors_were_learned_and_not_with_the_depth_itself():
    f = ORDERS * SPEED
    lines = tuple((4.0, float(x), 1.0 + 0j, 0.01) for x in f)
    deep = LearnedFactors(path=lines, mesh=lines, depths=(100e-6,))
    near, far = (variance("transmission_error", np.ones(5), deep, depth)[2] for depth in (101e-6, 150e-6))
    assert near == pytest.approx(variance("transmission_error", np.ones(5), deep, 99e-6)[2]) and far > 2 * near


def test_line_that_wear_has_cancelled_is_no_surer_than_the_parts_that_cancel():
    """Unworn teeth and wear make 1 and −0.98 m/s²; each is off by its own share, whatever is left of the sum."""
    unworn, left = np.ones(5, dtype=complex), np.full(5, 0.02 + 0j)
    rng, fixed = np.random.default_rng(2), variance("acceleration", np.zeros(5))
    off = rng.normal(size=(2, 20_000)) + 1j * rng.normal(size=(2, 20_000))
    seen = np.mean(np.abs(off[0] - 0.98 * off[1]) ** 2) / 2 * (variance("acceleration", np.ones(5)) - fixed)
    assert variance("acceleration", parts(left, unworn)) - fixed == pytest.approx(seen, rel=0.05)


def taught(factor):
    """Variance of an acceleration line away from where a path was learned with this factor."""
    learned = LearnedFactors(path=((4.0, float(ORDERS[0] * SPEED), factor + 0j, 0.001),), mesh=(), depths=(0.0,))
    return variance("acceleration", np.ones(5), learned)[3]


@pytest.mark.parametrize("factor", [3.0, 20.0, 100.0])
def test_path_beyond_the_tolerances_scatters_more_and_one_far_beyond_them_hides_no_more(factor):
    """A path that is not linear has factors of 20 and more: its errors are content, not scatter."""
    assert taught(1.001) < taught(factor) < 25 * taught(1.001)
    assert taught(factor) == pytest.approx(taught(2 * factor))


def test_encoder_lines_of_a_shafts_first_order_scatter_by_its_disc():
    orders = np.array([19 / 52, 1.0, 5.0, 19.0])
    std = np.sqrt(variance("transmission_error", np.zeros(4), orders=orders))
    assert std[0] > 1.5e-6 and std[1] > 1.5e-6 and std[2] < 0.2e-6 and std[3] < 0.2e-6


@pytest.mark.parametrize("shape", ["alike", "one line", "falling"])
def test_energy_left_by_a_healthy_machine_exceeds_the_limit_in_one_case_of_a_hundred(shape):
    v = {"alike": np.ones(40), "one line": np.array([1.0, 1e-3, 1e-3]), "falling": 0.7 ** np.arange(20)}[shape]
    rng = np.random.default_rng(5)
    lines = np.sqrt(v / 2) * (rng.normal(size=(20_000, v.size)) + 1j * rng.normal(size=(20_000, v.size)))
    beyond = np.mean(np.sum(np.abs(lines) ** 2, axis=1) > largest_healthy([v]))
    assert 0.005 < beyond < 0.02
