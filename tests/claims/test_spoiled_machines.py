"""A machine whose recordings are at fault gets no name of a gear's fault, and is not called explained.

Truth  the windows of the short campaign, a sound machine, spoiled afterwards: benchmarks/foreign_content.py and below
"""

from dataclasses import replace

import pytest

from benchmarks.foreign_content import KINDS, is_right, spoiled
from benchmarks.scoring import ROOT, run, windows_of
from twin.plausibility import mistakes_of

UNKNOWN = "unknown_effect"


def campaign(name="short"):
    return windows_of(ROOT / "recordings" / f"{name}-campaign.mcap")


def scaled(window, gain):
    """A window recorded with another gain of the accelerometer."""
    changed = {n: replace(s, values=gain * s.values) for n, s in window.accelerations.items()}
    return replace(window, accelerations=changed)


def exchanged(window):
    """The encoders' channels the wrong way round."""
    pinion, gear = (window.encoders[shaft] for shaft in ("pinion", "gear"))
    return replace(window, encoders={"pinion": gear, "gear": pinion})


def columns_exchanged(window):
    """The encoders' edges the wrong way round, with the edges per turn that their own inputs have."""
    pinion, gear = (window.encoders[shaft] for shaft in ("pinion", "gear"))
    return replace(
        window,
        encoders={"pinion": replace(gear, per_rev=pinion.per_rev), "gear": replace(pinion, per_rev=gear.per_rev)},
    )


@pytest.mark.parametrize("name", ["short", "faulty", "paper"])
@pytest.mark.parametrize(("change", "words"), [
    (exchanged, "the encoders of pinion and gear are exchanged"),
    (columns_exchanged, "the columns of the two encoders"),
])  # fmt: skip
def test_exchanged_encoders_are_named_as_such_in_every_window(name, change, words):
    rig, windows = campaign(name)
    for window in windows[:8:3]:
        (mistake,) = mistakes_of(rig, change(window))
        assert mistake.kind == "swapped" and words in mistake.text


def judged(given, rig):
    """Names of effects, verdict with its reason, and level of the status after the last window."""
    report = run(rig, given)[1][-1].report
    rest, status = report["unexplained"], report["status"]
    return {e["name"] for e in report["effects"]} - {UNKNOWN}, rest, status, report


@pytest.mark.slow
def test_encoders_that_are_exchanged_throughout_explain_nothing_and_name_nothing():
    rig, windows = campaign()
    names, rest, status, _ = judged([exchanged(w) for w in windows], rig)
    assert not names and rest["verdict"] != "explained" and status["level"] != "normal"
    assert "transmission error" in rest["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["turned sensor", "brake chatter"])
def test_sensor_that_was_turned_and_a_brake_that_chatters_are_told_as_unknown_content_with_their_cause(name):
    rig, windows = campaign()
    given, s = spoiled(windows, KINDS[name], rig.teeth, 3)
    names, rest, status, report = judged(given, rig)
    assert not names and status["level"] != "normal"
    assert rest["verdict"] == UNKNOWN and is_right(KINDS[name], s, report)


@pytest.mark.slow
def test_last_window_of_another_gain_is_told_as_the_accelerometers():
    rig, windows = campaign()
    names, rest, status, _ = judged([*windows[:-1], scaled(windows[-1], 3.0)], rig)
    assert not names and status["level"] != "normal"
    assert rest["verdict"] == UNKNOWN and "the accelerometer" in rest["reason"]


@pytest.mark.slow
def test_one_window_of_another_gain_names_nothing_and_is_told_by_the_level():
    """Two held-out windows of eight cannot say more than that the level is not confirmed."""
    rig, windows = campaign()
    names, rest, status, _ = judged([scaled(w, 0.5) if i == 5 else w for i, w in enumerate(windows)], rig)
    assert not names and status["level"] != "normal"
    assert rest["verdict"] != "explained" and "level" in rest["reason"]
