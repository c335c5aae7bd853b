"""The compiled kernels against numpy and scipy, which state the same without them."""

import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.dynamics_cases import TEN, contacts, model, worn
from twin import compiled
from twin.compiled import statistics
from twin.dynamics.harmonic_balance import Balance, Load, solve
from twin.dynamics.low_harmonics import LowHarmonics
from twin.effects import EFFECTS
from twin.effects.setup import contacts_of, setup_of
from twin.errors import ParameterError

RNG = np.random.default_rng(7)
LENGTHS = [2, 4, 6, 10, 14, 18, 22, 64, 100, 250, 256, 512, 1024, 1216, 2 * 101, 2310, 64 * 19 * 52]


@pytest.mark.parametrize("n", LENGTHS)
def test_lines_of_a_record_and_back(n):
    record = RNG.standard_normal(n)
    lines = compiled.to_lines(record)
    assert np.abs(lines - np.fft.rfft(record, norm="forward")).max() < 1e-14
    assert np.abs(compiled.to_samples(lines) - record).max() < 1e-13


def test_more_lengths_than_plans_are_kept():
    records = {n: RNG.standard_normal(n) for n in range(40, 80, 2)}
    for _ in range(2):
        for n, record in records.items():
            assert np.abs(compiled.to_lines(record) - np.fft.rfft(record, norm="forward")).max() < 1e-14, n


def test_splines_are_those_of_scipy_and_go_on_beyond_the_points():
    x, y = np.linspace(-1, 2, 300), RNG.standard_normal((3, 300))
    at = RNG.uniform(-1.02, 2.02, 1000)
    value, slope = compiled.spline(x[0], x[1] - x[0], y, at)
    expected = CubicSpline(x, y.T)
    assert np.abs(value - expected(at).T).max() < 1e-10 * np.abs(expected(at)).max()
    assert np.abs(slope - expected(at, 1).T).max() < 1e-10 * np.abs(expected(at, 1)).max()


def test_splines_reproduce_a_cubic():
    x, at = np.linspace(0, 1, 7), np.linspace(0, 1, 50)
    cubic = np.polynomial.Polynomial([0.3, -1.0, 2.0, 1.5])
    value, slope = compiled.spline(0.0, x[1], cubic(x)[None], at)
    assert value[0] == pytest.approx(cubic(at), abs=1e-14)
    assert slope[0] == pytest.approx(cubic.deriv()(at), abs=1e-12)


@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize("reach", [0, 3, 20])
def test_averages_are_a_convolution(stride, reach):
    values, weights = RNG.standard_normal((3, 64)), RNG.standard_normal(2 * reach + 1)
    found = compiled.averages(values, weights, stride)
    for row, average in zip(values, found, strict=True):
        expected = np.convolve(np.append(row, np.zeros(2 * reach + 1)), weights[::-1])[reach:][:65:stride]
        assert average == pytest.approx(expected, abs=1e-13)


def test_quasi_static_deflection_carries_the_mean_force_at_every_instant():
    table = contacts(worn(TEN, 50e-6), TEN, 512)
    d = compiled.quasi_static(table.stiffness, table.separation, table.side, 500.0)
    drive = table.side > 0
    carried = (table.stiffness[drive] * np.maximum(d + table.separation[drive], 0)).sum(axis=0)
    assert carried == pytest.approx(np.full(512, 500.0), rel=1e-12)


def with_friction_and_load():
    """Contacts with a further action, and an unbalance, over one turn of the pinion."""
    effects = (EFFECTS["tooth_friction"](coefficient=0.08), EFFECTS["mass_unbalance"](pinion=1e-3))
    setup = setup_of(model(), TEN, "pinion")
    for effect in effects:
        setup = effect.apply(setup)
    return contacts_of(setup, (worn(TEN, 50e-6),)), setup.loads


@pytest.mark.parametrize("rounding", [0.0, 2e-6])
@pytest.mark.parametrize("case", ["mesh", "friction and unbalance"])
def test_solutions_satisfy_the_equations_as_numpy_states_them(case, rounding):
    table, loads = (contacts(worn(TEN, 50e-6), TEN, 512), ()) if case == "mesh" else with_friction_and_load()
    twin = model()
    force = twin.mean_force(TEN)
    found = solve(twin.structure, table, force, loads=loads, rounding=rounding)
    assert found.converged
    stated = Balance(twin.structure, table, force, loads, rounding).reached(compiled.to_lines(found.deflection))
    assert stated.progress.residual < 2e-9
    assert found.contact_forces == pytest.approx(stated.forces, rel=1e-9, abs=1e-6)
    assert found.force_lines == pytest.approx(stated.force_lines, rel=1e-9, abs=1e-9 * force)
    for lines, expected in zip(found.action_lines, stated.action_lines, strict=True):
        assert lines == pytest.approx(expected, rel=1e-9, abs=1e-9 * force)


def test_a_neighbours_low_harmonics_take_less_products_to_the_same_state():
    twin, force = model(), model().mean_force(TEN)
    near = solve(twin.structure, contacts(worn(TEN, 45e-6), TEN, 512), force)
    table = contacts(worn(TEN, 50e-6), TEN, 512)
    cold, warm = solve(twin.structure, table, force), solve(twin.structure, table, force, start=near)
    assert warm.products < 0.6 * cold.products
    assert warm.deflection == pytest.approx(cold.deflection, rel=1e-8, abs=1e-8 * np.abs(cold.deflection).max())


def test_solutions_along_a_branch_are_those_of_the_derivatives():
    table, loads = with_friction_and_load()
    twin, ε = model(), 2e-6

    def residual(d_hat, log_rounding):
        balance = Balance(twin.structure, table, twin.mean_force(TEN), loads, np.exp(log_rounding))
        return balance.at(d_hat).residual

    near = solve(twin.structure, table, twin.mean_force(TEN), loads=loads, rounding=1.5 * ε)
    d_hat = compiled.to_lines(near.deflection)
    balance = Balance(twin.structure, table, twin.mean_force(TEN), loads, ε)
    done, step, slope, _ = balance.along_branch(d_hat, None, 1e-10)
    here = residual(d_hat, np.log(ε))
    assert done.residual == pytest.approx(np.abs(here).max() / twin.mean_force(TEN), rel=1e-9)
    h = 1e-5
    along = (residual(d_hat + h * step, np.log(ε)) - residual(d_hat - h * step, np.log(ε))) / (2 * h)
    assert np.linalg.norm(along + here) < 1e-6 * np.linalg.norm(here)
    rounded = (residual(d_hat, np.log(ε) + h) - residual(d_hat, np.log(ε) - h)) / (2 * h)
    moved = (residual(d_hat + h * slope, np.log(ε)) - residual(d_hat - h * slope, np.log(ε))) / (2 * h)
    assert np.linalg.norm(moved + rounded) < 1e-6 * np.linalg.norm(rounded)


def test_low_harmonics_are_inverted_exactly_where_the_operator_has_no_others():
    n, m = 256, 20
    k = np.arange(n // 2 + 1)
    stiffness, weight = RNG.standard_normal(n), 1 + 0.3 * RNG.standard_normal(n)
    ratio = 1 + 0.2j * k / n
    w = np.where(k < m, 0.1 * np.fft.rfft(RNG.standard_normal(n)) / n**0.5 + 0.05, 0)
    w[0] = 0.1

    def low(u):
        change = np.fft.irfft(w * u, n, norm="forward")
        out = np.fft.rfft(stiffness * change, norm="forward") + ratio * np.fft.rfft(weight * change, norm="forward")
        return u + np.where(k < m, out, 0)

    inverse = LowHarmonics(ratios=(np.ones(k.size), ratio), tangents=(stiffness, weight), to_closing=w, count=m).inverse
    u = np.where(k < m, np.fft.rfft(RNG.standard_normal(n)) / n, 0)
    u[0] = u[0].real
    found = inverse @ compiled.split(low(u)[:m])
    assert compiled.joined(found) == pytest.approx(u[:m], rel=1e-4, abs=1e-6)


def test_lines_are_split_and_joined():
    lines = RNG.standard_normal((3, 5)) + 1j * RNG.standard_normal((3, 5))
    assert np.array_equal(compiled.joined(compiled.split(lines)), lines)


@pytest.mark.parametrize(
    "call",
    [
        lambda: compiled.to_lines(np.zeros(7)),
        lambda: compiled.to_lines(np.zeros(0)),
        lambda: compiled.spline(0.0, 1.0, np.zeros((1, 4)), np.zeros(3)),
        lambda: compiled.averages(np.zeros((1, 8)), np.ones(4), 1),
        lambda: compiled.quasi_static(np.ones((3, 8)), np.zeros((3, 6)), np.ones(3), 1.0),
        lambda: compiled.monodromy(np.zeros((2, 2, 2)), np.zeros((1, 3)), np.zeros((1, 8)), 0.0),
        lambda: solve(model().structure, contacts(worn(TEN, 50e-6), TEN, 512), 500.0, start=np.zeros(510)),
        lambda: carried_on(np.zeros(200, complex), np.zeros(257, complex)),
        lambda: carried_on(np.zeros(257, complex), np.zeros(200, complex)),
        lambda: carried_on(np.zeros(257, complex), np.zeros(257, complex), 256),
        lambda: balance_of_512().compiled.branch_solutions(np.zeros(257, complex), np.eye(8), 1e-6),
    ],
)
def test_arrays_that_do_not_fit_are_refused_before_a_kernel_reads_them(call):
    with pytest.raises(ParameterError):
        call()


def balance_of_512(samples: int = 512) -> Balance:
    return Balance(model().structure, contacts(worn(TEN, 50e-6), TEN, samples), model().mean_force(TEN))


def carried_on(d_hat, left, samples: int = 512):
    return balance_of_512().compiled.carry_on(balance_of_512(samples).compiled, d_hat, left, None, 1e-6)


def test_no_number_gives_no_number():
    value, slope = compiled.spline(0.0, 1.0, np.arange(6.0)[None], np.array([2.0, np.nan]))
    assert value[0, 0] == pytest.approx(2.0)
    assert np.isnan(value[0, 1]) and np.isnan(slope[0, 1])


@pytest.mark.parametrize("case", ["mesh", "friction and unbalance"])
def test_motion_is_carried_on_by_the_derivative(case):
    """To the same equations with another residual that it is to leave: the change is that which the derivative asks."""
    twin, force = model(), model().mean_force(TEN)
    table, loads = (contacts(worn(TEN, 50e-6), TEN, 512), ()) if case == "mesh" else with_friction_and_load()
    balance = Balance(twin.structure, table, force, loads)
    d_hat = compiled.to_lines(solve(twin.structure, table, force, loads=loads).deflection)
    wanted = 1e-9 * force * compiled.to_lines(RNG.standard_normal(table.samples))  # no contact opens or closes
    here = balance.at(d_hat).residual
    found = balance.compiled.carry_on(balance.compiled, d_hat, here + wanted, None, 1e-10)
    there = balance.at(compiled.to_lines(found.deflection)).residual
    assert np.linalg.norm(there - here - wanted) < 1e-4 * np.linalg.norm(wanted)
    stated = balance.reached(compiled.to_lines(found.deflection))
    assert found.forces == pytest.approx(stated.forces, rel=1e-9, abs=1e-6)
    assert found.force_lines == pytest.approx(stated.force_lines - (there - here - wanted), abs=1e-9 * force)


@pytest.mark.slow
def test_threads_that_end_leave_nothing_behind():
    """A service without worker processes computes every window in a thread of its own."""
    record = np.zeros(2**16)

    def used() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

    def many(count: int) -> int:
        for _ in range(count):
            thread = threading.Thread(target=compiled.to_lines, args=(record,))
            thread.start()
            thread.join()
        return used()

    before = many(20)
    assert many(200) - before < 50e6  # a plan of this length takes 2.6 MB: 520 MB if they stayed


def test_missing_kernels_say_what_to_do():
    program = "import twin.compiled as c; c.LIBRARY = '/nowhere.so'; c._load()"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert "make install" in done.stderr.splitlines()[-1]


def test_a_load_that_nothing_answers_changes_nothing():
    twin = model()
    table = contacts(worn(TEN, 50e-6), TEN, 512)
    silent = Load(direction=np.zeros(21), lines=np.ones(257, dtype=complex))
    plain = solve(twin.structure, table, twin.mean_force(TEN))
    loaded = solve(twin.structure, table, twin.mean_force(TEN), loads=(silent,))
    assert np.array_equal(plain.deflection, loaded.deflection)


@pytest.mark.parametrize("count", [1, 2, 5, 16, 1000, 65537, 100_000])
@pytest.mark.parametrize("digits", [1, 3, 15])
def test_the_middle_of_a_record_is_that_of_numpy(count, digits):
    values = np.round(RNG.standard_normal(count) * 10.0 ** RNG.integers(-3, 4), digits)
    values[RNG.random(count) < 0.1] = RNG.choice([np.nan, np.inf, -np.inf, 0.0, -0.0])
    found, finite = statistics.middle(values), values[np.isfinite(values)]
    assert found.finite == finite.size
    if finite.size:
        distance = np.abs(finite - np.median(finite))
        assert tuple(found)[1:] == (finite.min(), finite.max(), np.median(finite), np.median(distance))
    else:
        assert np.isnan(found[1:]).all()


def test_a_record_of_nothing_has_no_middle():
    assert statistics.middle(np.empty(0)).finite == 0


@pytest.mark.parametrize("count", [1, 2, 5, 16, 255, 256, 1000, 65537])
@pytest.mark.parametrize("case", ["noise", "two levels", "mostly equal", "tone", "heavy tails", "one far", "lost"])
def test_what_is_said_to_be_near_is_near(count, case):
    values = RNG.standard_normal(count) + 3
    if case == "two levels":
        values = RNG.choice([-1.0, 1.0], count)
    elif case == "mostly equal":
        values = np.where(RNG.random(count) < 0.7, 10.0, values)
    elif case == "tone":
        values = np.sin(2 * np.pi * np.arange(count) / max(count // 255 + 1, 2))  # as even as the values looked at
    elif case == "heavy tails":
        values = RNG.standard_cauchy(count)
    elif case == "one far":
        values[count // 2] = 1e3
    elif case == "lost":
        values[RNG.random(count) < 0.2] = RNG.choice([np.nan, np.inf, -np.inf])
    finite = values[np.isfinite(values)]
    if not finite.size:
        assert not statistics.all_near(values, 1e9)
        return
    distance = np.abs(finite - np.median(finite))
    for times in (1.5, 3.0, 5.0, 44.0, 1e3):
        if statistics.all_near(values, times):
            assert distance.max() <= times * np.median(distance) * (1 + 1e-12)
    if case in ("noise", "lost") and count >= 1000:
        assert statistics.all_near(values, 44.0)
    ends = (finite.size, finite.min(), finite.max(), (finite == finite.min()).sum(), (finite == finite.max()).sum())
    assert tuple(statistics.extremes(values)) == ends


def test_a_record_of_nothing_has_no_extremes():
    for values in (np.empty(0), np.array([np.nan, np.inf])):
        assert statistics.extremes(values) == (0, np.inf, -np.inf, 0, 0)
        assert not statistics.all_near(values, 44.0)


@pytest.mark.parametrize("spread", [np.inf, 0.2])
def test_best_phases_are_the_lowest_of_a_fine_scan(spread):
    """Lines of three orders; products as large as those of clear lines, so that one phase is lowest by far."""
    rng, prior, k = np.random.default_rng(5), 3.0, np.arange(1, 4)
    products = 40 * (rng.standard_normal((50, 3)) + 1j * rng.standard_normal((50, 3)))
    found = compiled.best_phases(products, np.linspace(-np.pi, np.pi, 120, endpoint=False), prior, spread)
    fine = np.linspace(-np.pi, np.pi, 40_001)[1:]
    off = (fine - prior + np.pi) % (2 * np.pi) - np.pi
    cost = 0.5 * (off / spread) ** 2 - (np.exp(-1j * np.outer(fine, k)) @ products.T).real.T
    distance = (found - fine[cost.argmin(axis=1)] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(distance).max() < 2e-4
    assert np.all((found > -np.pi) & (found <= np.pi))
