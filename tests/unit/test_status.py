"""The status of a machine: every rule of the table, the most severe first, and nothing that the contract forbids."""

from dataclasses import replace

import pytest

from service.contract.status import SEVERITY, lowered, none_yet, status_of, with_data_quality, with_status_since
from twin.assessment import (
    Assessment,
    EffectAssessment,
    Evidence,
    FlankProfile,
    Interval,
    Life,
    MethodEstimates,
    ModelValidity,
    ParameterValue,
    Unavailable,
    Unexplained,
    Wear,
    WearProfile,
    WindowAssessment,
)
from twin.attention import probability_within
from twin.effects import EFFECTS

FLANK = FlankProfile(radius=(), roll_angle=(), depth=())


def wear(depth=100e-6, valid=True):
    interval = Interval(median=depth, p05=0.9 * depth, p95=1.1 * depth)
    return Wear(
        wear_coefficient=1e-6, specific_wear_rate=1e-12, dwell_time=1e-4, dwell_time_speed=10.0,
        depth={"combined": interval, "pinion": interval, "gear": interval},
        profile=WearProfile(path_position=(), pinion=FLANK, gear=FLANK), method="transmission error",
        methods=MethodEstimates(),
        validity=ModelValidity(contact_loss_from=None, steady_state_to=500e-6, valid=valid),
    )  # fmt: skip


def life(median=1e6, spread=1.3, reached=False, limit=500e-6):
    revolutions = Interval(median=median, p05=median / spread, p95=median * spread)
    return Life(
        criterion="max_depth", limit=limit, reached=reached, revolutions=revolutions,
        time=revolutions.scaled(0.1), speed=10.0, torque=10.0,
    )  # fmt: skip


def effect(name, channels=()):
    return EffectAssessment(
        name=name, parameters={"lead_gap": ParameterValue(value=30e-6, unit="m", std=1e-6)},
        evidence=Evidence(log_evidence=50.0), channels=channels,
    )  # fmt: skip


HEALTHY = Assessment(
    window=WindowAssessment(
        index=5, kind="measurement", start_time_ns=1, revolutions=10_000.0, speed=10.0, torque=10.0, rms_measured=1.0
    ),
    wear=wear(), life=life(), residual=Unavailable(reason="none"), effects=(),
    unexplained=Unexplained(verdict="explained", share=0.01, limit=0.3), calibration=Unavailable(reason="none"),
)  # fmt: skip
ALARMING = [name for name, kind in EFFECTS.items() if kind.facts.alarm_class == "alarm"]


def test_machine_that_is_explained_and_far_from_its_end_of_life_is_normal():
    assert status_of(HEALTHY).level == "normal"


@pytest.mark.parametrize(
    ("changes", "level", "said"),
    [
        ({"life": life(reached=True)}, "end_of_life", "has reached 100.0 µm of 500.0 µm"),
        ({"wear": wear(510e-6), "life": life(0.0, reached=False)}, "end_of_life", "510.0 µm of 500.0 µm"),
        ({"life": life(500.0)}, "alarm", "within 1,000 revolutions (0.0278 h) with a probability of 100 %"),
        ({"life": life(1250.0)}, "watch", "with a probability of 8 %"),
        ({"effects": (effect("misalignment"),)}, "watch", "lead gap 30 µm"),
        ({"effects": (effect("mesh_change", ("a",)),)}, "watch", "Mesh change was found in a"),
        ({"unexplained": Unexplained(verdict="unknown_effect", reason="tones of 50 Hz")}, "watch", "tones of 50 Hz."),
        ({"wear": wear(valid=False)}, "watch", "beyond the validity of the model (500.0 µm)"),
        ({"wear": Unavailable(reason="no module given"), "life": Unavailable(reason="-")}, "no_verdict", "no module"),
        ({"unexplained": Unexplained(verdict="insufficient_data", reason="too few")}, "no_verdict", "too few."),
    ],
)
def test_every_rule_gives_its_level_and_a_sentence_with_figures(changes, level, said):
    status = status_of(replace(HEALTHY, **changes))
    assert status.level == level
    assert any(said in reason for reason in status.reasons), status.reasons
    assert all(reason.endswith(".") for reason in status.reasons)


@pytest.mark.parametrize("name", ALARMING)
def test_effect_of_the_alarm_class_is_an_alarm(name):
    assert ALARMING and status_of(replace(HEALTHY, effects=(effect(name),))).level == "alarm"


def test_most_severe_reason_comes_first():
    status = status_of(
        replace(
            HEALTHY,
            effects=(effect("misalignment"),),
            life=life(reached=True),
            unexplained=Unexplained(verdict="insufficient_data", reason="too few windows"),
        )
    )
    assert status.level == "end_of_life" and len(status.reasons) == 3
    assert "reached" in status.reasons[0] and "too few" in status.reasons[-1]


def test_probability_grows_with_the_horizon_and_is_that_of_the_interval_at_its_ends():
    revolutions = Interval(median=1000.0, p05=700.0, p95=1428.6)
    assert probability_within(revolutions, 700.0) == pytest.approx(0.05, abs=1e-3)
    assert probability_within(revolutions, 1000.0) == pytest.approx(0.5)
    assert probability_within(revolutions, 0.0) == 0.0
    bounded_below = Interval(median=None, p05=700.0, p95=None)
    assert probability_within(bounded_below, 600.0) == 0.0 and probability_within(bounded_below, 1e9) == 0.05


def test_window_that_could_not_be_used_and_stale_data_leave_nothing_normal():
    normal = status_of(HEALTHY).as_json()
    fault = {"kind": "gap", "channel": "accel/y6"}
    degraded = with_data_quality(normal, {"quality": "degraded", "faults": [fault]})
    assert degraded["level"] == "no_verdict" and "gap in accel/y6" in degraded["reasons"][0]
    assert with_data_quality(normal, {"quality": "repaired"}) == normal
    stale = lowered(status_of(replace(HEALTHY, life=life(reached=True))).as_json(), "No window for an hour.")
    assert stale["level"] == "end_of_life" and stale["reasons"][-1] == "No window for an hour."
    assert none_yet("no window yet")["level"] == "no_verdict"
    assert SEVERITY.index("normal") == 0


def test_since_is_when_the_level_was_reached():
    first = with_status_since(None, {"status": {"level": "watch", "reasons": ["a."]}}, 10**18, 100.0)
    same = with_status_since(first, {"status": {"level": "watch", "reasons": ["b."]}}, 2 * 10**18, 200.0)
    worse = with_status_since(same, {"status": {"level": "alarm", "reasons": ["c."]}}, 3 * 10**18, 300.0)
    assert same["status"]["since"] == first["status"]["since"] and same["status"]["reasons"] == ["b."]
    assert first["status"]["since"]["time"].startswith("2001-09-09T01:46:40")
    assert worse["status"]["since"]["revolutions"] == 300.0
