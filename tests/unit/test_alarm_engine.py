"""The alarm engine: hysteresis, duration, learned limits, late windows, and rules that cannot be."""

import json

import pytest
from pydantic import ValidationError

from service.alarms.engine import Moment, evaluate, learn_anew
from service.alarms.memory import Memory
from service.alarms.readings import Reading, Readings, of_report, of_window
from service.alarms.rules import DEFAULT_RULES, Rule, load_rules
from service.errors import InputError
from twin.learned_limits import OperatingPoint
from twin.serial import from_plain, to_plain

NS = 1_000_000_000
LEVEL = Rule(name="level", quantity="rms", watch=10.0, alarm=20.0, hysteresis=0.1)
GOOD = {"level": "ok", "reason": ""}


def at_level(value, place="a1", point=None):
    return Readings(readings=(Reading(quantity="rms", place=place, value=value, point=point),), judged=frozenset())


def run(rule, values, memory=None, start=0, step=60.0, learn=True):
    """(window, verb, level) of the changes that a series of levels makes; `updated` left out."""
    memory, said = memory or Memory(), []
    for index, value in enumerate(values, start=start):
        moment = Moment(time_ns=round(index * step * NS), window=index, learn=learn)
        memory, changes = evaluate([rule], memory, at_level(value), moment)
        said += [(index, c.verb, c.level) for c in changes if c.verb != "updated"]
        memory = from_plain(Memory, json.loads(json.dumps(to_plain(memory))))  # as a restart does
    return memory, said


def test_alarm_is_raised_escalated_lowered_and_ended():
    _, said = run(LEVEL, [5, 12, 25, 12, 5])
    assert said == [(1, "raised", "watch"), (2, "escalated", "alarm"), (3, "lowered", "watch"), (4, "ended", "watch")]


def test_quantity_that_oscillates_about_its_limit_raises_once():
    _, said = run(LEVEL, [9, 10.5, 9.5, 10.5, 9.2, 11, 9.9, 10.1])
    assert said == [(1, "raised", "watch")]
    _, plain = run(LEVEL.model_copy(update={"hysteresis": 0.0}), [9, 10.5, 9.5, 10.5, 9.2])
    assert len(plain) == 4, "the hysteresis is what holds it"


def test_duration_in_windows_ignores_a_spike_and_needs_the_same_to_end():
    rule = LEVEL.model_copy(update={"windows": 3})
    _, said = run(rule, [5, 50, 5, 50, 50, 5, 12, 25, 12, 12, 5, 12, 5, 5, 5])
    assert said == [(8, "raised", "watch"), (14, "ended", "watch")]


def test_duration_in_seconds_is_that_of_the_stream():
    rule = LEVEL.model_copy(update={"seconds": 150.0})
    assert run(rule, [12] * 4)[1] == [(3, "raised", "watch")]
    assert run(rule, [12] * 4, step=10.0)[1] == []


def test_quantity_that_is_bad_below_its_limit():
    rule = Rule(name="life", quantity="life", watch=100.0, alarm=24.0)
    memory, said = Memory(), []
    for index, hours in enumerate([300.0, 90.0, 20.0, 24.5, 300.0]):
        reading = Readings(readings=(Reading(quantity="life", value=hours),), judged=frozenset())
        memory, changes = evaluate([rule], memory, reading, Moment(time_ns=index, window=index))
        said += [(index, c.verb) for c in changes if c.verb != "updated"]
    assert said == [(1, "raised"), (2, "escalated"), (4, "ended")]


def test_preliminary_figure_is_at_most_watch():
    rule = Rule(name="depth", quantity="depth", alarm=500.0)
    reading = Readings(readings=(Reading(quantity="depth", value=600.0, preliminary=True),), judged=frozenset())
    _, (change,) = evaluate([rule], Memory(), reading, Moment(time_ns=0, window=0))
    assert change.level == "watch" and "preliminary" in change.reason


def test_preliminary_figure_that_earlier_windows_support_reaches_its_level():
    rule = Rule(name="depth", quantity="depth", alarm=500.0)
    part = {"max_depth_um": {"combined": {"median": 600.0}}}
    for before, level in ((None, "watch"), ({"windows": 6}, "alarm")):
        report = {"wear": {**part, "preliminary": {"reasons": ["r"], "established_before": before}}}
        _, (change,) = evaluate([rule], Memory(), of_report(report), Moment(time_ns=0, window=0))
        assert change.level == level and "preliminary" in change.reason


def test_window_that_arrives_late_or_twice_changes_nothing():
    memory, _ = run(LEVEL, [5, 5, 12])
    for late in (0, 1, 2):
        after, changes = evaluate([LEVEL], memory, at_level(50.0), Moment(time_ns=late * 60 * NS, window=late))
        assert changes == [] and after == memory


def test_windows_after_a_clock_that_was_set_back_are_judged():
    memory, said = Memory(), []
    for index, value in enumerate([5, 12, 25, 12, 5, 12]):
        moment = Moment(time_ns=(100 - 50 * index) * 3600 * NS, window=index)
        memory, changes = evaluate([LEVEL], memory, at_level(value), moment)
        said += [(index, c.verb) for c in changes]
    assert said == [(1, "raised"), (2, "escalated"), (3, "lowered"), (4, "ended"), (5, "raised")]


def test_duration_in_seconds_begins_again_where_the_clock_was_set_back():
    rule, memory, said = LEVEL.model_copy(update={"seconds": 150.0}), Memory(), []
    values, times = [12] * 5 + [5] * 6, [900, 1000, 60, 120, 240, 900, 1000, 60, 120, 180, 240]
    for index, (value, seconds) in enumerate(zip(values, times, strict=True)):
        memory, changes = evaluate([rule], memory, at_level(value), Moment(time_ns=seconds * NS, window=index))
        said += [(index, c.verb) for c in changes]
    assert said == [(4, "raised"), (10, "ended")]


def test_limits_are_learned_first_and_only_from_healthy_windows():
    rule = Rule(name="rms", quantity="rms", windows=1)
    memory, said = run(rule, [10.0, 10.1, 9.9] * 3)
    assert said == [] and len(memory.keys["rms/a1"].learned[0].values) == 9
    memory, said = run(rule, [100.0], memory, start=9, learn=False)
    assert said == [] and len(memory.keys["rms/a1"].learned[0].values) == 9, "not learned from an unhealthy window"
    memory, said = run(rule, [10.0, 14.0, 30.0, 10.0], memory, start=10)
    assert said == [(11, "raised", "watch"), (12, "escalated", "alarm"), (13, "ended", "alarm")]


def test_alarms_by_learned_limits_end_and_the_limits_are_learned_anew():
    rules = [
        Rule(name="rms", quantity="rms", windows=1),
        Rule(name="set", quantity="rms", watch=20.0),
        Rule(name="slow", quantity="rms", windows=3),
    ]
    memory = Memory()

    def judged(values, start):
        nonlocal memory
        said = []
        for index, value in enumerate(values, start=start):
            both = (*at_level(value).readings, *at_level(value, "a2").readings)
            at = Moment(time_ns=index, window=index)
            memory, changes = evaluate(rules, memory, Readings(readings=both, judged=frozenset()), at)
            said += [(c.verb, c.key) for c in changes if c.verb != "updated"]
        return said

    raised = judged([10.0] * 10 + [90.0] * 2, 0)
    assert raised == [("raised", f"{rule}/{place}") for rule in ("rms", "set") for place in ("a1", "a2")]
    memory, ended = learn_anew(rules, memory, "a1", "The sensor was moved.")
    assert [(c.verb, c.key, c.level, c.reason) for c in ended] == [
        ("ended", "rms/a1", "alarm", "The sensor was moved.")
    ]
    assert {key for key, own in memory.keys.items() if own.level} == {"set/a1", "rms/a2", "set/a2"}
    assert {key for key, own in memory.keys.items() if own.learned} == {"rms/a2", "slow/a2"}
    assert memory.keys["slow/a1"].levels["alarm"].up == 0 and memory.keys["slow/a2"].levels["alarm"].up == 2
    memory, ended = learn_anew(rules, memory, "", "The gears were replaced.")
    assert [c.key for c in ended] == ["rms/a2"]
    assert judged([5.0] * 10, 12) == [("ended", "set/a1"), ("ended", "set/a2")]
    assert judged([15.0], 22) == [("raised", "rms/a1"), ("raised", "rms/a2")], "beyond the new limits"


def test_every_operating_condition_has_limits_of_its_own():
    rule, memory = Rule(name="rms", quantity="rms", windows=1), Memory()
    slow, fast = OperatingPoint(speed=5.0, torque=10.0), OperatingPoint(speed=10.0, torque=10.0)
    said = []
    for index in range(24):
        point, value = (slow, 1.0) if index % 2 else (fast, 10.0)
        moment = Moment(time_ns=index, window=index)
        memory, changes = evaluate([rule], memory, at_level(value, point=point), moment)
        said += changes
    assert said == [] and [len(p.values) for p in memory.keys["rms/a1"].learned] == [10, 10]
    _, changes = evaluate([rule], memory, at_level(10.0, point=slow), Moment(time_ns=24, window=24))
    assert [c.level for c in changes] == ["alarm"] and "learned from the first 10 windows" in changes[0].reason


def status(*findings):
    level = findings[0]["level"] if findings else "normal"
    return {"status": {"level": level, "reasons": [f["reason"] for f in findings], "findings": list(findings)},
            "wear": {"max_depth_um": {"combined": {"median": 1.0}}}}  # fmt: skip


CRACK = {"subject": "effect/tooth_crack", "level": "alarm", "reason": "A crack.", "action": "Stop."}
WORN = {"subject": "depth", "level": "end_of_life", "reason": "511 µm of 500 µm.", "action": "Stop."}


def test_findings_of_the_status_raise_alarms_by_the_default_rules_and_end_them():
    memory, said = Memory(), []
    reports = [status(), status(CRACK), status(CRACK, WORN), status(WORN), status()]
    for index, report in enumerate(reports):
        readings = of_window({"index": index, "quality": "good"}, report, GOOD)
        memory, changes = evaluate(DEFAULT_RULES, memory, readings, Moment(time_ns=index, window=index))
        said += [(index, c.verb, c.key, c.level) for c in changes if c.verb != "updated"]
    assert said == [
        (1, "raised", "effect/tooth_crack", "alarm"),
        (2, "raised", "depth", "alarm"),
        (3, "ended", "effect/tooth_crack", "alarm"),
        (4, "ended", "depth", "alarm"),
    ]


def test_refused_window_says_nothing_of_the_machine_but_of_the_data():
    memory, said = Memory(), []
    bad = {"level": "degraded", "reason": "the latest window is refused: no torque"}
    for index, quality in enumerate(["good", "refused", "refused", "good", "good"]):
        readings = of_window({"index": index, "quality": quality}, status(WORN), bad if quality == "refused" else GOOD)
        memory, changes = evaluate(DEFAULT_RULES, memory, readings, Moment(time_ns=index, window=index))
        said += [(index, c.verb, c.key) for c in changes if c.verb != "updated"]
    assert said == [(0, "raised", "depth"), (2, "raised", "data"), (4, "ended", "data")]


def test_levels_are_not_judged_where_a_wear_depth_is_known():
    record = {"index": 0, "quality": "good", "indicators": {"a1": {"rms": 3.0, "kurtosis": 3.0, "crest_factor": 4.0,
              "gears": {"pinion": {"fm4": 3.0, "fm0": None}}}}}  # fmt: skip
    known, _ = evaluate(DEFAULT_RULES, Memory(), of_window(record, status(), GOOD), Moment(time_ns=0, window=0))
    assert known.keys == {}
    without = {**status(), "wear": {"status": "not available", "reason": "-"}}
    learning, _ = evaluate(DEFAULT_RULES, Memory(), of_window(record, without, GOOD), Moment(time_ns=0, window=0))
    assert set(learning.keys) == {"rms/a1", "kurtosis/a1", "fm4/a1/pinion"}


def test_alarm_whose_rule_is_gone_ends():
    memory, _ = run(LEVEL, [12])
    after, (change,) = evaluate([], memory, at_level(12.0), Moment(time_ns=9 * NS * 60, window=9))
    assert (change.verb, change.key) == ("ended", "level/a1") and after.keys == {}


def test_rule_that_watches_another_quantity_under_its_name_begins_afresh():
    both = (*at_level(25.0).readings, Reading(quantity="kurtosis", place="a1", value=3.0))
    readings = Readings(readings=both, judged=frozenset())
    memory, _ = evaluate([LEVEL], Memory(), readings, Moment(time_ns=0, window=0))
    other = Rule(name="level", quantity="kurtosis", watch=6.0)
    memory, changes = evaluate([other], memory, readings, Moment(time_ns=1, window=1))
    assert [(c.verb, c.quantity) for c in changes] == [("ended", "rms")]
    assert memory.keys["level/a1"].quantity == "kurtosis" and memory.keys["level/a1"].level is None
    memory, _ = run(Rule(name="level", quantity="rms", windows=1), [0.5] * 10)
    learned = Rule(name="level", quantity="kurtosis", windows=1)
    memory, changes = evaluate([learned], memory, readings, Moment(time_ns=10, window=10))
    assert changes == [] and memory.keys["level/a1"].learned[0].values == [3.0], "not by the limits of the other"


def test_temperature_and_depth_have_limits_by_number():
    rules = [Rule(name="oil", quantity="temperature", watch=70.0), Rule(name="deep", quantity="depth", watch=40.0)]
    record = {"index": 0, "quality": "good", "temperatures": {"oil": {"value": 75.0, "values": 3}}}
    report = {**status(), "wear": {"max_depth_um": {"combined": {"median": 44.0}}}}
    _, changes = evaluate(rules, Memory(), of_window(record, report, GOOD), Moment(time_ns=0, window=0))
    assert [c.reason for c in changes] == [
        "Temperature of oil is 75 °C, above the limit of 70 °C for watch (set by its rule).",
        "Wear depth is 44 µm, above the limit of 40 µm for watch (set by its rule).",
    ]
    assert changes[0].action == "Check the oil level and the cooling at oil."


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"quantity": "noise"}, "is not known; known are depth, life"),
        ({"quantity": "rms", "watch": 5.0, "alarm": 4.0}, "must lie beyond watch"),
        ({"quantity": "life", "watch": 5.0, "alarm": 9.0}, r"must lie beyond watch = 5 \(below\)"),
        ({"quantity": "temperature"}, "needs a limit"),
        ({"quantity": "effect", "basis": "learned"}, "must be criterion"),
        ({"quantity": "rms", "basis": "learned", "watch": 3.0}, "limits of basis"),
        ({"quantity": "rms", "windows": 0}, "greater than or equal to 1"),
        ({"quantity": "rms", "learn_windows": 3}, "greater than or equal to 10"),
        ({"quantity": "rms", "volume": 3}, "Extra inputs"),
    ],
)
def test_rules_that_cannot_be_are_refused_with_what_would_be_right(given, said, tmp_path):
    with pytest.raises(ValidationError, match=said):
        Rule(name="r", **given)
    file = tmp_path / "rules.toml"
    lines = [f"{key} = {json.dumps(value)}" for key, value in given.items()]
    file.write_text("\n".join(["[[rule]]", 'name = "r"', *lines]))
    with pytest.raises(InputError, match=rf"rules.toml: rule.0.*{said}"):
        load_rules(file)


def test_rule_file_is_read_and_names_are_unique(tmp_path):
    file = tmp_path / "rules.toml"
    file.write_text('[[rule]]\nname = "oil"\nquantity = "temperature"\nwatch = 70\n')
    assert load_rules(file) == (Rule(name="oil", quantity="temperature", watch=70.0),)
    file.write_text(file.read_text() * 2)
    with pytest.raises(InputError, match="more than one rule is called oil"):
        load_rules(file)
    with pytest.raises(InputError, match="cannot be read"):
        load_rules(tmp_path / "none.toml")
