"""The status of a machine: every rule of the table, the most severe first, and nothing that the contract forbids."""

from dataclasses import replace

import pytest

from service.contract.finding import SEVERITY, Finding
from service.contract.status import Added, data_of, none_yet, shown, status_of, with_status_since
from twin.assessment import (
    Assessment,
    EffectAssessment,
    EncoderPair,
    EstablishedBefore,
    Evidence,
    FlankProfile,
    HealthyErrors,
    Interval,
    Life,
    LifeDate,
    MethodEstimates,
    ModelValidity,
    PairCurve,
    PairRemainder,
    PairSpeed,
    PairSpeeds,
    ParameterValue,
    Preliminary,
    StatedRatio,
    Turns,
    Unavailable,
    Unexplained,
    Wear,
    WearProfile,
    WindowAssessment,
)
from twin.attention import StatusLimits, probability_within, revolutions_ahead
from twin.effects import EFFECTS
from twin.rig import Rig

HEALTHY = HealthyErrors(waveform=0.3)

FLANK = FlankProfile(radius=(), roll_angle=(), depth=())


def wear(depth=100e-6, valid=True, spread=1.1):
    interval = Interval(median=depth, p05=depth / spread, p95=spread * depth)
    return Wear(
        wear_coefficient=1e-6, specific_wear_rate=1e-12, dwell_time=1e-4, dwell_time_speed=10.0,
        depth={"combined": interval, "pinion": interval, "gear": interval},
        profile=WearProfile(path_position=(), pinion=FLANK, gear=FLANK), method="transmission error",
        methods=MethodEstimates(),
        validity=ModelValidity(contact_loss_from=None, steady_state_to=500e-6, valid=valid),
    )  # fmt: skip


def life(median=1e9, spread=1.3, reached=False, limit=500e-6):
    revolutions = Interval(median=median, p05=median / spread, p95=median * spread)
    return Life(
        criterion="max_depth", limit=limit, reached=reached, revolutions=revolutions,
        time=revolutions.scaled(0.1), speed=10.0, torque=10.0,
    )  # fmt: skip


def pair(contradicted):
    stated = StatedRatio(ratio=2.7, source="the rig file", deviations=9.0, contradicted=contradicted)
    ratio = ParameterValue(value=2.5, unit="", std=1e-4)
    return EncoderPair(
        window=0, ratio=ratio, tooth_counts=(), stated=stated, turns=Turns(pinion=5.0, gear=2.0),
        pinion_speed=PairSpeed(mean=1.0, highest=1.0), run_out=(), base_radii=None,
        rest=PairRemainder(before=0.0, after=0.0), missed_counts=(), sharp_steps=(),
        transmission_error=PairCurve(pinion_turns=(), before=(), after=()),
        speed=PairSpeeds(time=(), pinion=(), gear=()),
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
    unexplained=Unexplained(verdict="explained", share=0.01, limits=HEALTHY), calibration=Unavailable(reason="none"),
)  # fmt: skip
ALARMING = [name for name, kind in EFFECTS.items() if kind.facts.alarm_class == "alarm"]


def test_machine_that_is_explained_and_far_from_its_end_of_life_is_normal():
    assert status_of(HEALTHY).level == "normal"


@pytest.mark.parametrize(
    ("changes", "level", "said", "action"),
    [
        ({"life": life(reached=True)}, "end_of_life", "end of life: 100 µm of 500 µm", "replace the gear pair: 100 µm"),
        ({"wear": wear(511e-6), "life": life(0.0)}, "end_of_life", "511 µm of 500 µm", "Stop the machine and replace"),
        (
            {"life": life(500.0)},
            "alarm",
            "within 30 days of operation with a probability of 100 %",
            "Replace the gear pair within 38 s of operation",
        ),
        ({"life": life(32.4e6)}, "watch", "with a probability of 8 %", "Prepare the replacement"),
        ({"wear": wear(410e-6)}, "watch", "410 µm of 500 µm (82 %)", "Plan the replacement of the gear pair"),
        ({"wear": wear(399e-6, spread=1.3)}, "watch", "95th percentile is 518.7 µm", "measure the wear depth"),
        ({"effects": (effect("misalignment"),)}, "watch", "lead gap 30 µm", "Check the alignment of the shafts"),
        ({"effects": (effect("mesh_change", ("a",)),)}, "watch", "Mesh change was found in a", "Inspect the flanks"),
        (
            {"effects": (effect("sensor_gain", ("a1",)),)},
            "watch",
            "found in a1",
            "Check the gain and the calibration of the accelerometer (a1).",
        ),
        (
            {"effects": (effect("sensor_polarity", ("a1",)),)},
            "watch",
            "A reversed sensor was found in a1",
            "Check the wiring and the direction of mounting of the sensor (a1).",
        ),
        (
            {"unexplained": Unexplained(verdict="unknown_effect", share=0.2, reason="tones of 50 Hz")},
            "watch",
            "explains (20 % of the measured energy): tones of 50 Hz.",
            "Find the cause",
        ),
        ({"wear": wear(valid=False)}, "watch", "beyond the validity of the model (500.0 µm)", "Measure the wear depth"),
        ({"encoder_pair": pair(contradicted=True)}, "watch", "ratio 2.5000 contradicts the rig file", "tooth counts"),
        (
            {"wear": Unavailable(reason="the rig file does not give gears.module"), "life": Unavailable(reason="-")},
            "no_verdict",
            "gears.module",
            "Complete the rig file",
        ),
        (
            {"wear": Unavailable(reason="RMS is not available: sample faster"), "life": Unavailable(reason="-")},
            "no_verdict",
            "sample faster",
            "Remove the reason (`gear-twin doctor`",
        ),
        (
            {"unexplained": Unexplained(verdict="insufficient_data", reason="too few")},
            "no_verdict",
            "too few.",
            "Record further windows",
        ),
    ],
)
def test_every_rule_gives_its_level_a_sentence_with_figures_and_an_action(changes, level, said, action):
    status = status_of(replace(HEALTHY, **changes))
    assert status.level == level
    assert any(said in reason for reason in status.reasons), status.reasons
    assert all(reason.endswith(".") for reason in status.reasons)
    assert action in status.action and status.action.endswith("."), status.action
    assert status.findings[0].level == level and [f.reason for f in status.findings] == status.reasons


@pytest.mark.parametrize("name", ALARMING)
def test_effect_of_the_alarm_class_is_an_alarm(name):
    assert ALARMING and status_of(replace(HEALTHY, effects=(effect(name),))).level == "alarm"


def test_reason_states_sizes_and_the_tooth_but_no_angles():
    found = EffectAssessment(
        name="tooth_crack", evidence=Evidence(log_evidence=50.0),
        parameters={"stiffness_loss": ParameterValue(value=0.6, unit="", std=0.1),
                    "tooth": ParameterValue(value=5, unit="", std=0.0)},
    )  # fmt: skip
    assert status_of(replace(HEALTHY, effects=(found,))).reasons[0].endswith("found: stiffness loss 60 %, tooth 5.")
    turning = replace(
        found, name="pinion_eccentricity",
        parameters={"eccentricity": ParameterValue(value=8e-5, unit="m", std=1e-6),
                    "high_point": ParameterValue(value=1.0, unit="rad", std=0.1),
                    "shift_share": ParameterValue(value=0.6, unit="", std=0.1)},
    )  # fmt: skip
    assert status_of(replace(HEALTHY, effects=(turning,))).reasons[0].endswith("found: eccentricity 80 µm.")
    mount = replace(
        found, name="sensor_resonance", parameters={"frequency": ParameterValue(value=1181.3, unit="Hz", std=120.0)}
    )
    assert "frequency 1,181 Hz" in status_of(replace(HEALTHY, effects=(mount,))).reasons[0]
    pitch = replace(found, name="pitch_error", parameters={})
    assert status_of(replace(HEALTHY, effects=(pitch,))).reasons[0] == "Pitch errors were found."


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


FAULT = {"kind": "gap", "channel": "accel/y6"}
GOOD, BAD = {"quality": "good", "start_time": "t0"}, {"quality": "degraded", "faults": [FAULT], "start_time": "t1"}


def test_window_that_could_not_be_used_and_stale_data_leave_nothing_normal():
    normal = status_of(HEALTHY).as_json()
    data = data_of([GOOD, BAD, {**BAD, "start_time": "t2"}])
    assert (data.level, data.since) == ("degraded", "t1") and "gap in accel/y6" in data.reason
    degraded = shown(normal, data)
    assert degraded["level"] == "no_verdict" and "gap in accel/y6" in degraded["reasons"][0]
    assert degraded["action"].startswith("Check the data") and degraded["since"]["time"] == "t1"
    assert shown(normal, data_of([BAD, {**GOOD, "quality": "repaired"}])) == {**normal, "since": None}
    worn = status_of(replace(HEALTHY, life=life(reached=True))).as_json()
    stale = shown(worn, data_of([GOOD], ("no window for an hour", "t3")))
    assert stale["level"] == "end_of_life" and stale["reasons"][-1] == "No window for an hour."
    assert stale["action"].startswith("Stop the machine")
    assert none_yet("no window yet")["level"] == "no_verdict" and data_of([]).level == "waiting"
    assert SEVERITY.index("normal") == 0


def test_active_alarm_of_the_service_is_part_of_the_status():
    finding = Finding(subject="rms/a1", level="alarm", reason="RMS of a1 is 9 m/s².", action="Inspect the machine.")
    status = shown(status_of(HEALTHY).as_json(), data_of([GOOD]), [Added(finding=finding, since="t4")])
    assert status["level"] == "alarm" and status["reasons"] == ["RMS of a1 is 9 m/s²."]
    assert status["action"] == "Inspect the machine." and status["since"]["time"] == "t4"


PRELIMINARY = Preliminary(
    reasons=("the wear coefficient is only that of the rig file",), remedies=("record a run at low speed",)
)


@pytest.mark.parametrize("depth", [100e-6, 511e-6])
def test_preliminary_depth_or_life_is_never_more_than_watch_and_says_what_would_settle_it(depth):
    ended = life(1.0, reached=depth > 500e-6)
    for changes in (
        {"wear": replace(wear(depth), preliminary=PRELIMINARY), "life": ended},
        {"wear": wear(depth), "life": replace(ended, preliminary=PRELIMINARY)},
    ):
        status = status_of(replace(HEALTHY, **changes))
        assert status.level == "watch", status
        assert "preliminary: the wear coefficient is only that of the rig file." in status.reasons[0]
        assert status.action == "Record a run at low speed."


SUPPORTED = replace(PRELIMINARY, before=EstablishedBefore(windows=6, revolutions=12_001.0, depth=328e-6))


@pytest.mark.parametrize(
    ("depth", "spread", "level", "action"),
    [
        (511e-6, 2.0, "alarm", "Stop the machine, measure the wear depth, and replace the gear pair if it is as"),
        (511e-6, 1.01, "end_of_life", "Stop the machine and replace the gear pair: 511 µm of 500 µm."),
        (460e-6, 1.1, "watch", "Plan the replacement of the gear pair and measure the wear depth"),
    ],
)
def test_preliminary_depth_that_earlier_windows_had_established_keeps_its_alarm(depth, spread, level, action):
    """The lower end of the band beyond the limit is the end of life; the median alone stops the machine to measure."""
    reached = life(1e9, reached=depth > 500e-6)
    changes = {"wear": replace(wear(depth, spread=spread), preliminary=SUPPORTED)}
    status = status_of(replace(HEALTHY, **changes, life=replace(reached, preliminary=SUPPORTED)))
    assert status.level == level and status.action.startswith(action), status
    assert "is preliminary: the wear coefficient is only that of the rig file; it counts all the" in status.reasons[0]
    assert "6 earlier windows had established the depth (328 µm at 12,001 revolutions)" in status.reasons[0]
    unsure = replace(HEALTHY, **changes, life=replace(reached, preliminary=PRELIMINARY))
    assert status_of(unsure).level == "watch" and status_of(unsure).action == "Record a run at low speed."


def test_life_that_earlier_windows_support_keeps_its_alarm():
    soon = replace(life(500.0), preliminary=SUPPORTED)
    status = status_of(replace(HEALTHY, wear=replace(wear(), preliminary=SUPPORTED), life=soon))
    assert status.level == "alarm" and status.action.startswith("Replace the gear pair within")


def test_preliminary_figures_far_from_their_limits_leave_nothing_normal():
    status = status_of(replace(HEALTHY, wear=replace(wear(), preliminary=PRELIMINARY)))
    assert status.level == "no_verdict" and status.action == "Record a run at low speed."
    assert "preliminary: the wear coefficient is only that of the rig file." in status.reasons[0]


def test_date_of_the_end_of_life_is_in_what_to_do():
    date = LifeDate(
        since_ns=0, running_share=0.5, source="observed", median_ns=None, p05_ns=1_700_000_000 * 10**9, p95_ns=None
    )
    status = status_of(replace(HEALTHY, life=replace(life(500.0), date=date)))
    assert status.action.startswith(
        "Replace the gear pair before 2023-11-14 22:13 UTC, that is within 38 s of operation"
    )


def of_days(days):
    """A machine that turns ten times a second, with a life of so many days of running without a break."""
    return life(days * 86_400 * 10.0, spread=1.05)


@pytest.mark.parametrize(("days", "level"), [(0.02, "alarm"), (29.0, "alarm"), (31.0, "watch"), (40.0, "normal")])
def test_life_is_looked_at_against_thirty_days_whatever_the_machine_has_run_so_far(days, level):
    """A machine with 26 minutes left was `normal`, because it had run for an hour only."""
    for run in (None, 0.0, 2500.0, 1e9):
        found = replace(HEALTHY, life=of_days(days), window=replace(HEALTHY.window, revolutions=run))
        assert status_of(found).level == level


def test_horizon_is_calendar_time_where_the_running_time_a_day_is_known():
    def used(share):
        date = LifeDate(
            since_ns=0, running_share=share, source="rig file", median_ns=None, p05_ns=None, p95_ns=None
        )  # fmt: skip
        return replace(HEALTHY, life=replace(of_days(12.0), date=date))

    assert status_of(used(0.25)).level == "normal"  # 12 days of running are 48 by the calendar
    status = status_of(used(0.5))
    assert status.level == "alarm" and "within 30 days with" in status.reasons[0]
    assert revolutions_ahead(used(0.25).life) == 30 * 86_400 * 0.25 * 10.0


def test_horizon_can_be_set_for_all_machines_and_for_one():
    found = replace(HEALTHY, life=of_days(40.0))
    assert status_of(found, StatusLimits(horizon=60 * 86_400.0)).level == "alarm"
    rig = Rig.from_mapping({"end_of_life": {"max_depth": 5e-4, "horizon_days": 90}})
    limits = StatusLimits(horizon=3600.0).of_rig(rig)
    assert limits.horizon == 90 * 86_400 and "within 90 days" in status_of(found, limits).reasons[0]
    assert StatusLimits(horizon=3600.0).of_rig(Rig.from_mapping({})).horizon == 3600.0
    assert status_of(replace(HEALTHY, life=of_days(0.1)), StatusLimits(horizon=0.0)).level == "normal"


def test_since_is_when_the_level_was_reached():
    first = with_status_since(None, {"status": {"level": "watch", "reasons": ["a."]}}, 10**18, 100.0)
    same = with_status_since(first, {"status": {"level": "watch", "reasons": ["b."]}}, 2 * 10**18, 200.0)
    worse = with_status_since(same, {"status": {"level": "alarm", "reasons": ["c."]}}, 3 * 10**18, 300.0)
    assert same["status"]["since"] == first["status"]["since"] and same["status"]["reasons"] == ["b."]
    assert first["status"]["since"]["time"].startswith("2001-09-09T01:46:40")
    assert worse["status"]["since"]["revolutions"] == 300.0


def test_the_same_reason_is_said_once():
    reason = "wear is not available: the rig file does not give gears.module"
    status = status_of(
        replace(
            HEALTHY, wear=Unavailable(reason=reason), life=Unavailable(reason="-"),
            unexplained=Unexplained(verdict="insufficient_data", reason=reason),
        )
    )  # fmt: skip
    assert status.reasons == ["The machine cannot be judged: the rig file does not give gears.module."]
    assert "gear-twin init" in status.action
