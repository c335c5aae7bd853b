"""The joint fit of mesh lines: what it recovers, and what it says of a value that no line depends on."""

from dataclasses import replace

import numpy as np
import pytest

from tests.dynamics_cases import RIG, TEN, model, worn
from twin.effects.response import Effect
from twin.rig import Rig
from twin.tracing import joint_fit
from twin.tracing.joint_fit import fit, inverse
from twin.tracing.joint_problem import Problem, predict
from twin.tracing.mesh_trials import mesh_trials, started
from twin.tracing.mesh_windows import MeshWindows
from twin.tracing.observed import CHANNELS, HARMONICS, Observed
from twin.tracing.scatter import HealthyScatter, LineSizes

TRIALS = mesh_trials()
DEPTH = 25.6e-6  # rounds up to two digits: a curve from there on starts deeper


def window(index: int, depth: float, effects: tuple[Effect, ...] = ()) -> Observed:
    """A window that shows exactly what the twin predicts, with a thousandth of noise."""
    o = Observed(
        index=index, condition=TEN, revolutions=1000.0 * index + 1, worn=depth > 0, pinion_only=False, lines={}, std={},
        mean=None, torque_known=True,
    )  # fmt: skip
    found = predict(model(), effects, worn(TEN, depth), o)
    std = {channel: 1e-3 * np.abs(lines) + 1e-12 for channel, lines in found.lines.items()}
    return replace(o, lines=found.lines, std=std, mean=found.mean)


def unseen(o: Observed) -> Observed:
    return replace(o, lines={c: np.full_like(y, np.nan) for c, y in o.lines.items()}, mean=None)


def block_of(windows: list[Observed], depth: float = DEPTH) -> MeshWindows:
    return MeshWindows(
        model=model(), windows=tuple(windows), depth=np.array([w.worn * depth for w in windows]), phase=0.0,
        scatter=HealthyScatter.of_rig(RIG),
    )  # fmt: skip


REPEATED = [window(0, 0.0), *(window(i, DEPTH) for i in range(1, 5))]


def test_depth_and_number_of_an_effect_are_recovered_from_what_the_twin_itself_predicts():
    trial = started(TRIALS["tooth_friction"], np.array([0.5]), 0.0)
    effect = trial.make(np.array([0.6]))
    block = block_of([window(0, 0.0, (effect,)), window(1, DEPTH, (effect,)), window(2, DEPTH, (effect,))])
    found = fit(block.problem((trial,), block.wear()), None, 0.0, block.depth)
    assert found.numbers(found.trials[0])[0] == pytest.approx(0.6, abs=0.02)
    np.testing.assert_allclose(found.depth[1:], worn(TEN, DEPTH).max_depth, rtol=2e-3)
    assert abs(found.phase) < 1e-3 and found.misfit < 0.01


@pytest.mark.slow
def test_fit_ends_where_no_step_promises_more_from_whatever_start():
    """Of lines that are off by as much as those of healthy machines: what is found does not depend on the start."""
    rng, friction = np.random.default_rng(3), TRIALS["tooth_friction"]
    windows = [window(i, DEPTH * (i > 0), (friction.make(np.array([0.6])),)) for i in range(4)]
    off = {c: 1 + 0.02 * rng.standard_normal(n) for c, n in HARMONICS.items()}
    windows = [replace(w, lines={c: off[c] * y for c, y in w.lines.items()}) for w in windows]
    block, found = block_of(windows), []
    for start in (0.2, 1.2):
        problem = block.problem((started(friction, np.array([start]), 0.0),), block.wear())
        fitted = fit(problem, None, 0.0, block.depth)
        point = joint_fit._Point.of(problem, fitted.shared, fitted.phase, fitted.depth)
        assert joint_fit._slopes(problem, point).gain < joint_fit.CONVERGED
        found.append(fitted.numbers(problem.trials[0]))
    (low, std), (high, _) = found
    assert abs(high - low) < 2 * np.sqrt(joint_fit.CONVERGED) * std
    assert low == pytest.approx(0.6, abs=2 * float(std[0]))


def test_windows_that_repeat_exactly_are_fitted_and_no_evidence_for_an_effect_between_them():
    """The depth at the onset, rounded, used to lie above that of the windows, and their depths dropped out of sight."""
    block = block_of(REPEATED)
    base = block.plain().fit
    trial = started(TRIALS["misalignment"], np.array([0.5]), 2500.0)
    found = block.fitted((trial,), base, 2).fit
    assert np.isfinite(found.covariance).all()
    assert found.log_evidence - base.log_evidence < 1
    value, std = found.numbers(found.trials[0])
    assert value < 2 * std


def test_window_without_any_line_leaves_its_depth_unknown_and_the_others_as_they_are():
    """Used to raise LinAlgError: H is singular."""
    with_it, without = block_of([*REPEATED[:3], unseen(REPEATED[3])]), block_of(REPEATED[:3])
    found, plain = with_it.plain().fit, without.plain().fit
    assert np.isinf(found.covariance[-1, -1]) and np.isfinite(found.covariance.diagonal()[:-1]).all()
    np.testing.assert_allclose(found.depth[:3], plain.depth, rtol=1e-6)
    assert found.log_evidence == pytest.approx(plain.log_evidence, abs=1e-3)


def test_covariance_is_the_inverse_where_everything_is_determined():
    rng = np.random.default_rng(1)
    J = rng.normal(size=(40, 7)) * 3
    H = J.T @ J + np.diag([1, 1, 1, 1, 0, 0, 0])
    covariance, log_det = inverse(H, 4)
    np.testing.assert_allclose(covariance @ H, np.eye(7), atol=1e-10)
    assert log_det == pytest.approx(np.linalg.slogdet(H)[1])


def test_undetermined_sum_of_two_depths_leaves_their_difference_and_the_rest_known():
    J = np.random.default_rng(2).normal(size=(40, 5)) * 3
    J[:, 4] = -J[:, 3]
    H = J.T @ J + np.diag([1, 1, 1, 0, 0])
    covariance, log_det = inverse(H, 3)
    assert np.isinf(covariance[3, 3]) and np.isinf(covariance[4, 4])
    without_sum = inverse(H[:4, :4], 3)[0]
    np.testing.assert_allclose(covariance[:3, :3], without_sum[:3, :3], atol=1e-9)
    assert np.isfinite(log_det)


def test_problem_knows_which_trial_a_number_belongs_to():
    trials = (TRIALS["misalignment"], TRIALS["profile_error"])
    problem = Problem(
        model=model(),
        windows=REPEATED[:2],
        profiles=lambda *_: model().unworn,
        trials=trials,
        scatter=HealthyScatter.of_rig(RIG),
    )
    owners = [problem.acting_on(j) for j in range(problem.shared)]
    assert owners == [None] * 3 + [trials[0]] + [trials[1]] * 4
    assert problem.numbers_of(trials[1]) == slice(4, 8)


def test_weights_whiten_the_covariance_that_the_scatter_states():
    """C = ρ²·m·mᴴ + β²·P·Pᵀ + diag(2σ² + (κ|m|)² + φ²P² + floor² + (τ|m − m′|)²), of windows of one speed."""
    rng, sizes = np.random.default_rng(3), HealthyScatter.of_rig(RIG)
    channel, harmonic, group = ("encoder", "acceleration", "acceleration"), np.array([2, 1, 7]), np.array([0, 0, 1, 0])
    m, added = (rng.normal(size=(3, 4)) + 1j * rng.normal(size=(3, 4)) for _ in range(2))
    m, added, depth = 1e-6 * m, 1e-7 * added, np.array([0.0, 1e-5, 2e-5, 3e-5])
    std, P = 1e-7 * rng.uniform(1, 2, (3, 4)), rng.uniform(1, 2, (3, 4))
    std[1, 2] = np.nan  # a window that lacks the line
    found = LineSizes.of(sizes, channel, harmonic, std, P, group).weights(m, depth, added)
    log_det = 0.0
    for i, k in enumerate(harmonic):
        there = np.isfinite(std[i])
        scatter = sizes.channels[channel[i]]
        ρ, κ = (size[k - 1] for size in scatter.sizes(k))
        κ = κ + scatter.per_depth * k * depth
        each = 2 * std[i] ** 2 + (κ * abs(m[i])) ** 2 + (sizes.each * P[i]) ** 2 + scatter.floor**2
        C = np.diag(each + (sizes.teeth * abs(added[i])) ** 2).astype(complex)
        C += sizes.common**2 * np.outer(P[i], P[i])
        C += ρ**2 * np.outer(m[i], m[i].conj()) * (group[:, None] == group)
        C, root = C[np.ix_(there, there)], found.root[i][np.ix_(there, there)]
        np.testing.assert_allclose(root @ C @ root.conj().T, np.eye(there.sum()), atol=1e-9)
        log_det += np.linalg.slogdet(C)[1]
    assert found.log_det == pytest.approx(log_det)


def test_jacobian_is_the_difference_of_residuals():
    trial = started(TRIALS["tooth_friction"], np.array([0.5]), 0.0)
    block = block_of(REPEATED[:3])
    problem = block.problem((trial,), block.wear())
    shared, depth = np.array([0.1, -0.2, 0.3, 0.5]), np.array([0.0, DEPTH, 0.9 * DEPTH])
    point = joint_fit._Point.of(problem, shared, 0.05, depth)
    J = joint_fit._jacobian(problem, point)

    def residual(shared: np.ndarray, phase: float, depth: np.ndarray) -> np.ndarray:
        twin = problem.at(shared)
        found = [problem.predict(i, twin, depth[i]) for i in range(3)]
        lines = problem.compared.turned(phase) - np.stack([p.every for p in found], axis=1)[problem.compared.kept]
        means = problem.means.measured - np.array([p.mean for p in found])
        return problem.whitened(lines[..., None], means[:, None], point.weights)[:, 0]

    def slope(ds: np.ndarray, dp: float, dd: np.ndarray) -> np.ndarray:
        above, below = (residual(shared + s * ds, 0.05 + s * dp, depth + s * dd) for s in (1, -1))
        return (above - below) / 2

    h, still, none = 1e-3, np.zeros(3), np.zeros(4)
    columns = [slope(h * e, 0.0, still) / h for e in np.eye(4)]
    columns.append(slope(none, 1e-5, still) / 1e-5)
    step = 1e-3 * joint_fit.DEPTH_SCALE
    columns += [slope(none, 0.0, step * np.eye(3)[i]) / 1e-3 for i in (1, 2)]
    for column, expected in zip(J.T, columns, strict=True):
        assert np.linalg.norm(column - expected) < 0.02 * np.linalg.norm(expected)


def test_scatter_of_the_structure_grows_with_the_tolerance_that_the_rig_file_states():
    loose = Rig.from_mapping({**RIG.values, "tolerances": {"stiffness": 0.06}})
    usual, wide = HealthyScatter.of_rig(RIG), HealthyScatter.of_rig(loose)
    for channel in CHANNELS:
        np.testing.assert_allclose(wide.channels[channel].structure, 2 * np.array(usual.channels[channel].structure))
        assert wide.channels[channel].windows == usual.channels[channel].windows


def test_scatter_of_the_reference_rig_is_that_which_the_thresholds_were_tuned_with():
    usual = HealthyScatter.of_rig(RIG)
    assert (usual.common, usual.each) == pytest.approx((0.05e-6, 0.03e-6), rel=1e-4)
    assert (usual.mean_std, usual.mean_drift) == pytest.approx((0.5e-6, 10e-6), rel=1e-4)
    assert [usual.channels[c].per_depth for c in CHANNELS] == pytest.approx([200, 200, 400], rel=1e-4)
    assert [usual.channels[c].floor for c in CHANNELS] == pytest.approx([0, 2e-3, 0.01])
