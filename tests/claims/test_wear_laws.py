"""Every registered wear law."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.dynamics_cases import RIG
from tests.updating_cases import TEN, model
from twin.errors import NotAvailable, ParameterError
from twin.model import Calibration, Model
from twin.rig import Rig
from twin.wear.curve import MasterCurve
from twin.wear.law_of_rig import law_of
from twin.wear.laws import LAWS
from twin.wear.laws.law import WearLaw
from twin.wear.laws.running_in import RunningIn

PARAMETERS: dict[str, dict[str, float]] = {  # one instance a law
    "archard": {},
    "running_in": {"initial_ratio": 5.0, "depth": 2e-6},
}
EVERY = [LAWS[name].of(values) for name, values in PARAMETERS.items()]
WORK = np.array([0.0, 0.3, 2.0, 7.0])  # [N·m]


def rig_with(name: str, values: dict[str, float]) -> Rig:
    wear = {**RIG.values["wear"], "law": name, **({name: values} if values else {})}
    return Rig.from_mapping({**RIG.values, "wear": wear})


def curve_with(name: str, values: dict[str, float], until: float = 6e-6) -> MasterCurve:
    rig = rig_with(name, values)
    twin = Model.of(rig, Calibration.prior(rig))
    return MasterCurve.build(twin, TEN, twin.unworn, until)


def test_every_law_of_the_table_is_tested():
    assert PARAMETERS.keys() == LAWS.keys()


@pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
def test_a_rig_file_names_the_law_and_gives_its_parameters(law: WearLaw):
    assert law_of(rig_with(law.name, PARAMETERS[law.name])) == law


@pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
def test_no_law_wears_without_sliding_work_or_puts_material_on(law: WearLaw):
    for worn in (0.0, 1e-7, 3e-6, 1e-3):
        rate = law.rate(WORK, np.full(WORK.size, worn))
        assert rate[0] == 0.0 and np.all(np.diff(rate) > 0)


@pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
def test_every_law_wears_each_slice_of_the_face_as_if_it_were_alone(law: WearLaw):
    worn = np.array([[0.0, 1e-6, 2e-6, 3e-6], [4e-6, 0.0, 1e-5, 1e-7]])
    both = law.rate(np.array([WORK, 2 * WORK]), worn)
    assert np.array_equal(both, [law.rate(WORK, worn[0]), law.rate(2 * WORK, worn[1])])


def test_a_rig_file_without_a_law_wears_by_archards():
    assert law_of(RIG).name == "archard"
    plain = MasterCurve.build(model(), TEN, model().unworn, 2e-6)
    assert np.array_equal(curve_with("archard", {}, 2e-6).work, plain.work)


def test_a_law_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(ParameterError, match=r"wear\.law = 'magic' must be one of archard"):
        rig_with("magic", {})


RUNNING_IN = RunningIn(initial_ratio=5.0, depth=2e-6)


def by_sliding_work(law: RunningIn, u: np.ndarray) -> np.ndarray:
    """The closed form of the source: a transient that dies away, and steady wear u [m]."""
    return u + law.depth * (1 - np.exp(-(law.initial_ratio - 1) * u / law.depth))


@pytest.mark.parametrize("ratio", [1.0, 1.3, 5.0, 40.0, 100.0])
def test_running_in_follows_the_published_sum_of_transient_and_steady_wear(ratio):
    """The rate by the depth lost, integrated independently, is the closed form by the sliding work."""
    law = RunningIn(initial_ratio=ratio, depth=2e-6)
    u = np.linspace(0, 8e-6, 60)
    scaled = solve_ivp(
        lambda _, h: law.rate(np.ones(1), 1e-6 * h), (0, 8), [0.0], t_eval=u * 1e6, rtol=1e-10, atol=1e-12
    )
    assert 1e-6 * scaled.y[0] == pytest.approx(by_sliding_work(law, u), rel=1e-7, abs=1e-14)


def test_fresh_flanks_wear_by_the_ratio_faster_and_run_in_ones_by_the_wear_coefficient():
    assert RUNNING_IN.factor(np.zeros(1)) == pytest.approx(5.0, rel=1e-12)
    assert RUNNING_IN.factor(np.array([40e-6])) == pytest.approx(1.0, abs=1e-12)


def test_running_in_without_a_ratio_is_archards_law():
    plain, same = curve_with("archard", {}), curve_with("running_in", {"initial_ratio": 1.0 + 1e-12, "depth": 1e-3})
    assert same.depth == pytest.approx(plain.depth, rel=1e-9)
    assert same.work == pytest.approx(plain.work, rel=1e-9)


def test_a_pair_that_runs_in_is_ahead_by_the_depth_of_running_in_and_then_wears_alike():
    """The deepest point has lost d more; the profile is smoothed, so that the point may move a little."""
    depth = 1e-6
    plain, fresh = (
        curve_with("archard", {}, 20e-6),
        curve_with("running_in", {"initial_ratio": 4.0, "depth": depth}, 20e-6),
    )
    x = plain.work_at(12e-6)
    assert fresh.depth_at(x) - plain.depth_at(x) == pytest.approx(depth, rel=0.15)
    assert fresh.work_at(1e-7) == pytest.approx(plain.work_at(1e-7) / 4.0, rel=0.08)
    assert np.all(np.diff(fresh.profiles, axis=0) >= 0), "no material grows back"


def test_the_wear_coefficient_rescales_revolutions_for_every_law():
    """Twice K with half the revolutions is the same x, so one curve serves: the rate is proportional to the work w."""
    worn = np.full(WORK.size, 0.7e-6)
    assert RUNNING_IN.rate(2 * WORK, worn) == pytest.approx(2 * RUNNING_IN.rate(WORK, worn), rel=1e-14)


def test_steps_of_running_in_converge_with_order_two():
    """The step that resolves the law is a quarter of d; shorter ones change the result by the square."""
    from twin.wear.evolution import evolve

    half_width, law, ends = model().calibration.contact_half_width, RUNNING_IN, []
    for size in (0.5e-6, 0.25e-6, 0.125e-6):
        points = evolve(
            model().mesh, lambda p, s: model().steady(p, TEN, s), model().unworn, half_width, 3e-6,
            step=lambda depth, largest, size=size: size, law=law,
        )  # fmt: skip
        found = list(points)
        ends.append(np.interp(2.5e-6, [p.profile.max_depth for p in found], [p.work for p in found]))
    coarse, fine = abs(ends[0] - ends[1]), abs(ends[1] - ends[2])
    assert coarse / fine > 2.5


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"initial_ratio": 0.5, "depth": 1e-6}, "wear.running_in.initial_ratio"),
        ({"initial_ratio": 3.0, "depth": 2.0}, "wear.running_in.depth = 2 m .*micrometres"),
        ({"initial_ratio": 3.0, "dept": 1e-6}, "did you mean wear.running_in.depth"),
    ],
)
def test_parameters_that_cannot_be_are_refused(values, said):
    with pytest.raises(ParameterError, match=said):
        rig_with("running_in", values)


def test_parameters_of_a_law_that_is_not_chosen_are_refused():
    wear = {**RIG.values["wear"], "running_in": {"initial_ratio": 3.0, "depth": 1e-6}}
    with pytest.raises(ParameterError, match="does not use it"):
        law_of(Rig.from_mapping({**RIG.values, "wear": wear}))


def test_a_law_without_its_parameters_is_not_available():
    with pytest.raises(NotAvailable, match=r"wear\.running_in\.depth"):
        law_of(rig_with("running_in", {"initial_ratio": 3.0}))
