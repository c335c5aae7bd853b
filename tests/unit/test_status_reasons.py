"""What the status says, and in which order: by what a machine is judged by, the strongest reason first."""

from dataclasses import fields, is_dataclass, replace
from itertools import combinations
from typing import get_type_hints

import numpy as np
import pytest

from service.contract.answer import report_of
from service.contract.parts import Wear as WearJson
from service.contract.status import status_of
from tests.unit.test_status import HEALTHY, effect, life, pair, wear
from twin import assessment
from twin.assessment import (
    Attribution,
    BaselineAssessment,
    BaselineWindow,
    HeldOutErrors,
    LevelExcess,
    Modulation,
    RateChange,
    RawLimit,
    RawMeasure,
    UnattributedLines,
    Unavailable,
    Unexplained,
)
from twin.baseline.sufficiency import digits_apart
from twin.learned_limits import OperatingPoint
from twin.level_record import with_level
from twin.updating.rate_change import rate_change
from twin.updating.wear_points import WearPoint

BASELINE = BaselineAssessment(recordings=("a", "b"), operating_points={}, shafts=(1.0,), channels=("y6",))
COMPARED = replace(
    HEALTHY, wear=Unavailable(reason="the rig file does not give gears.module"), life=Unavailable(reason="-"),
    baseline=BASELINE,
)  # fmt: skip


def modulation(depth=0.28, healthy=(0.028, 0.031), shaft="pinion", multiple=1, new=True, sensor="y6"):
    return Modulation(
        sensor=sensor, shaft=shaft, multiple=multiple, frequency=24.5, depth=depth, std=0.002, amplitude_share=1.0,
        pairs=(), healthy=healthy, new=new,
    )  # fmt: skip


def with_errors(name, before, after, channels=()):
    found = effect(name, channels)
    return replace(found, error_before=HeldOutErrors(waveform=before), error_after=HeldOutErrors(waveform=after))


@pytest.mark.parametrize(
    ("found", "said", "not_said"),
    [
        (COMPARED, "as in the healthy recordings", ("twin", "wear")),
        (replace(COMPARED, wear=Unavailable(reason="none")), "as in the healthy recordings", ("twin", "wear")),
        (replace(HEALTHY, life=Unavailable(reason="no limit")), "The twin explains the vibration.", ("limit",)),
        (HEALTHY, "The twin explains the vibration, and wear is far from its limit.", ()),
        (replace(HEALTHY, window=replace(HEALTHY.window, rms_measured=None)), "encoders measure", ("vibration",)),
    ],
)
def test_normal_machine_is_told_what_it_was_judged_by_and_nothing_else(found, said, not_said):
    status = status_of(found)
    assert status.level == "normal" and said in status.reasons[0]
    assert not any(word in status.reasons[0] for word in not_said)


def test_new_modulation_is_watched_with_its_size_and_its_causes():
    """As a plant saw it: `none found` and `normal` above a modulation nine times as deep as in healthy recordings."""
    status = status_of(replace(COMPARED, modulation=(modulation(), modulation(0.2, sensor="y7"))))
    assert status.level == "watch" and status.reasons == [
        "The mesh vibration is modulated once per turn of the pinion, which is new: 28 % in y6, healthy 2.8 to 3.1 %."
    ]
    assert status.action.startswith("Check for run-out or eccentricity of the pinion, a bent shaft")
    assert not any(word in " ".join([*status.reasons, status.action]) for word in ("twin", "wear", "mount"))


SPACING = UnattributedLines(
    window="w", order=0.4, order_std=0.01, frequency=4.1, frequency_std=0.1, part=1, geared=None, clearness=40.0,
    next_clearness=10.0,
)  # fmt: skip
RAW = RawLimit(
    measures=(RawMeasure(channel="y6", name="kurtosis", value=9.0, low=2.8, high=3.4, beyond=True),),
    false_alarms=0.005,
)
COMPARED_WINDOW = BaselineWindow(
    index=5, name="w", start_time_ns=1, speed=10.0, speed_std=None, speed_source="", torque=None, between=("a", "b"),
    interpolated=True, pattern_correlation=0.1, same_teeth=False,
)  # fmt: skip
PANELS = {
    "modulation": {"modulation": (modulation(),)},
    "modulation without a healthy depth": {"modulation": (modulation(healthy=None),)},
    "tooth pattern": {"baseline": replace(BASELINE, window=COMPARED_WINDOW)},
    "content in words": {"attribution": Attribution(unknown="a tone at order 4.3 that nothing explains")},
    "unknown effect": {"effects": (effect("unknown_effect", ("y6",)),)},
    "an accelerometer's fault": {"effects": (effect("sensor_clipping", ("y6",)),)},
    "wear rate": {"wear": replace(wear(), rate_change=RateChange(factor=5.0, revolutions=9e3, windows=3))},
    "encoders' ratio": {"encoder_pair": pair(contradicted=True)},
    "lines of no shaft": {"unattributed_lines": (SPACING,)},
    "raw limit": {"baseline": replace(BASELINE, raw_limit=RAW)},
    "level": {
        "level_excess": LevelExcess(
            sensor="y6", value=9.0, median=1.0, limit=3.0, relative=False, windows=1, lasting=False
        )
    },
    "effect": {"effects": (replace(effect("misalignment"), status="suspected"),)},
    "unknown content": {"unexplained": Unexplained(verdict="unknown_effect", reason="lines at order 3")},
}


@pytest.mark.parametrize("verdict", ["explained", "unknown_effect"])
@pytest.mark.parametrize("count", [1, 2, 3, len(PANELS)])
def test_no_machine_is_normal_while_any_panel_calls_something_new(count, verdict):
    for names in combinations(PANELS, count):
        changes = {"unexplained": Unexplained(verdict=verdict, reason="a tone"), "baseline": BASELINE}
        for name in names:
            changes |= PANELS[name]
        status = status_of(replace(COMPARED, **changes))
        assert status.level in ("watch", "alarm"), names
        assert status.findings[0].reason in status.reasons[0] and status.action == status.findings[0].action


JUDGED = {  # flags of an assessment that call something new or changed
    "BaselineWindow.same_teeth", "RawMeasure.beyond", "UnattributedLines.new", "Modulation.new",
    "StatedRatio.contradicted", "LevelExcess.lasting", "InspectedDepth.contradicts", "Life.reached",
    "ModelValidity.valid",
}  # fmt: skip
OTHERS = {  # that tell how something was found, and nothing of the machine
    "Attribution.other_structure",
    "BaseRadii.assumed",
    "BaselineWindow.interpolated",
    "BaselineWindow.pattern_compared",
    "LevelExcess.relative",
    "PossibleCause.possible",
    "RawLimit.decides_alone",
    "RmsEstimate.converged",
    "RmsEstimate.updated",
    "SensorIndicators.calibrated",
    "SmallestSize.hidden",
    "WindowAssessment.modelled",
    "WindowAssessment.updated",
}


def test_every_flag_of_an_assessment_calls_something_new_in_the_status_too_or_says_nothing_of_the_machine():
    kinds = [kind for kind in vars(assessment).values() if is_dataclass(kind)]
    types = {f"{kind.__name__}.{f.name}": get_type_hints(kind)[f.name] for kind in kinds for f in fields(kind)}
    flags = {name for name, type_ in types.items() if type_ in (bool, bool | None)}
    assert flags == JUDGED | OTHERS


@pytest.mark.parametrize("known", [modulation(new=False), modulation(healthy=None, new=None)])
def test_modulation_that_is_not_new_leaves_a_machine_normal(known):
    assert status_of(replace(COMPARED, modulation=(known,))).level == "normal"


@pytest.mark.parametrize("shaft", ["pinion", "gear"])
@pytest.mark.parametrize(("multiple", "times"), [(1, "once"), (2, "twice"), (3, "three times")])
def test_modulation_is_named_by_shaft_and_times(shaft, multiple, times):
    status = status_of(replace(COMPARED, modulation=(modulation(shaft=shaft, multiple=multiple),)))
    assert f"modulated {times} per turn of the {shaft}" in status.reasons[0]


@pytest.mark.parametrize(("times", "depth"), [(1.10, 0.337), (1.05, 0.12), (1.3, 0.52)])
def test_strongest_reason_is_first(times, depth):
    """Peaks 1.10 times the healthy ones stood above a new modulation of 34 % of the mesh lines."""
    peaks = with_errors("mesh_change", 1.0, 1 / times)
    status = status_of(replace(COMPARED, effects=(peaks,), modulation=(modulation(depth),)))
    assert f"{100 * depth:.3g} %" in status.reasons[0] and "Mesh change" in status.reasons[1]
    deep = status_of(replace(COMPARED, effects=(with_errors("mesh_change", 1.0, 0.05),), modulation=(modulation(0.1),)))
    assert "Mesh change" in deep.reasons[0]


def test_effect_that_explains_nothing_is_last_however_large_its_evidence():
    """Pitch errors with 6,007 nat and an error of 100.6 → 100.6 % stood above the eccentricity that was there."""
    found = (with_errors("pitch_error", 1.006, 1.006), with_errors("pinion_eccentricity", 0.8, 0.3))
    status = status_of(replace(HEALTHY, effects=found))
    assert "eccentricity" in status.reasons[0] and "Pitch errors" in status.reasons[1]
    assert report_of(replace(HEALTHY, effects=found), status)["effects"][0]["name"] == "pitch_error"


def test_alarm_is_first_whatever_it_explains():
    found = (with_errors("misalignment", 1.0, 0.1), with_errors("tooth_crack", 1.0, 0.9))
    status = status_of(replace(HEALTHY, effects=found))
    assert status.level == "alarm" and "crack" in status.reasons[0]


# -- the wear rate -------------------------------------------------------------------------------------------


def points(rates, scatter=0.02, each=4, seed=1, step=2000.0):
    """Windows of a machine that wears at these rates, so many windows each."""
    rng, work, n, out = np.random.default_rng(seed), 0.0, 0.0, []
    for rate in rates:
        for _ in range(each):
            n, work = n + step, work + rate * step
            std = scatter * (work + 1.0)
            out.append(
                WearPoint(
                    revolutions=n, depth=1e-6 * work, work=float(work + std * rng.normal()), shared_std=0.0, own_std=std
                )
            )
    return tuple(out)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("factor", [5.0, 8.0, 20.0])
def test_wear_rate_that_rises_by_a_large_factor_is_said(factor, seed):
    change = rate_change(points((1e-3, factor * 1e-3), seed=seed))
    assert change is not None and change.factor == pytest.approx(factor, rel=0.35) and change.windows >= 2
    assert 6000 <= change.revolutions <= 10_000
    status = status_of(replace(HEALTHY, wear=replace(wear(), rate_change=change)))
    assert status.level == "watch" and status.reasons[0].startswith("The wear rate has risen ")
    assert "lubrication" in status.action


def test_wear_rate_that_falls_by_a_large_factor_is_said_and_the_machine_stays_normal():
    change = rate_change(points((8e-3, 1e-3), scatter=0.001))
    assert change is not None and change.factor == pytest.approx(1 / 8, rel=0.5)
    status = status_of(replace(HEALTHY, wear=replace(wear(), rate_change=change)))
    assert status.level == "normal" and "The wear rate has fallen to " in status.reasons[1]
    assert "far from its limit" in status.reasons[0] and status.action == "No action needed."


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("rates", [(1e-3, 1e-3), (1e-3, 2e-3), (2e-3, 1e-3), (1e-3, 1.5e-3, 2.5e-3)])
def test_wear_rate_that_changes_by_less_is_not_said(rates, seed):
    assert rate_change(points(rates, seed=seed)) is None


@pytest.mark.parametrize("seed", range(20))
def test_rise_that_the_scatter_hides_is_not_said(seed):
    assert rate_change(points((1e-3, 4e-3), scatter=0.5, seed=seed)) is None


def test_too_few_windows_show_no_change_of_the_rate():
    assert rate_change(points((1e-3, 8e-3))[:4]) is None and rate_change(()) is None


def test_change_of_the_rate_is_part_of_the_answer():
    worn = replace(wear(), rate_change=RateChange(factor=8.0, revolutions=9000.0, windows=3))
    assert WearJson.of(worn).as_json()["rate_change"] == {"factor": 8.0, "revolutions": 9000.0, "windows": 3}
    assert "rate_change" not in WearJson.of(wear()).as_json()


# -- a level without a name ------------------------------------------------------------------------------------

POINT = OperatingPoint(speed=10.0, torque=50.0)


def levels(values, relative=False, point=POINT):
    known, out = (), []
    for value in values:
        known, excess = with_level(known, point, value, relative=relative, sensor="y6")
        out.append(excess)
    return out


@pytest.mark.parametrize("relative", [True, False])
@pytest.mark.parametrize("times", [4.0, 10.0])
def test_level_far_beyond_the_first_windows_is_watched_at_once_and_an_alarm_after_three(relative, times):
    rng = np.random.default_rng(3)
    healthy = np.exp(0.03 * rng.normal(size=14))
    found = levels([*healthy, times, times, times], relative)
    assert found[:14] == [None] * 14
    told = [status_of(replace(HEALTHY, level_excess=one)) for one in found[14:]]
    assert [status.level for status in told] == ["watch", "watch", "alarm"]
    assert "in 3 windows in a row" in told[-1].reasons[0] and "y6" in told[-1].reasons[0]
    assert ("the model's" in told[-1].reasons[0]) == relative


@pytest.mark.parametrize("seed", range(10))
def test_healthy_levels_and_a_single_spike_raise_no_alarm(seed):
    values = np.exp(0.1 * np.random.default_rng(seed).normal(size=60))
    values[30] = 40.0
    found = levels(values)
    assert [i for i, one in enumerate(found) if one is not None] == [30] and not found[30].lasting


def test_levels_of_another_operating_condition_are_not_compared():
    known = ()
    for _ in range(12):
        known, _ = with_level(known, POINT, 1.0, relative=False, sensor="y6")
    elsewhere = OperatingPoint(speed=20.0, torque=50.0)
    assert with_level(known, elsewhere, 9.0, relative=False, sensor="y6")[1] is None
    assert with_level(known, POINT, 9.0, relative=True, sensor="y6")[1] is None
    assert with_level(known, POINT, 9.0, relative=False, sensor="y6")[1] is not None


def test_level_is_said_beside_a_named_effect_and_after_it_where_it_explains_less():
    excess = LevelExcess(sensor="y6", value=3.0, median=1.0, limit=2.0, relative=True, windows=1, lasting=False)
    status = status_of(replace(HEALTHY, effects=(effect("tooth_crack"),), level_excess=excess, life=life()))
    assert status.level == "alarm" and "crack" in status.reasons[0] and "3 times" in status.reasons[1]


def test_what_a_baseline_cannot_judge_names_no_model():
    unsure = Unexplained(verdict="insufficient_data", reason="the operating point lies beyond the baseline's")
    status = status_of(replace(COMPARED, unexplained=unsure))
    assert status.level == "no_verdict" and "healthy recordings" in status.reasons[0]
    assert "rig file" not in status.action and "twin" not in status.action


@pytest.mark.parametrize(
    ("values", "digits"),
    [((24.5, 24.5), 5), ((24.50012, 24.50034, 24.50051), 6), ((24.5, 24.6), 5), ((1e3, 1e3 + 1e-9), 12)],
)
def test_numbers_that_differ_are_written_differently(values, digits):
    """A reason once was "24.5 Hz lies beyond 24.5 to 24.5 Hz"."""
    assert digits_apart(*values) == digits
