"""What a person reads first: the state in a few words, and a life that does not calm beside a found damage."""

from dataclasses import replace

import numpy as np
import pytest

from gear_twin import Result
from service.contract.answer import assemble, report_of
from service.contract.finding import MOST_WORDS, shortened
from service.contract.overview import overview
from service.contract.status import of_wear_alone, status_of
from service.report.content import report_of as paper_of
from service.report.text import answer_text
from tests.unit.test_status import HEALTHY, effect, life, wear
from tests.unit.test_verdict_window import NOT_ASSESSED, START, Rhythm, followed, judged
from twin.assessment import LevelExcess, Preliminary, Unavailable, Unexplained
from twin.baseline.comparison import loads_of
from twin.baseline.reading import WindowReading

LONG = Preliminary(
    reasons=(
        "the wear coefficient is only that of the rig file, and the latest windows were recorded under loads at which "
        "the calibration of the model was never made, so that neither the depth nor its growth can be relied on",
    ),
    remedies=("record a run at low speed",),
)
EXCESS = LevelExcess(sensor="y6", value=4.0, median=1.0, limit=2.0, relative=True, windows=3, lasting=True)
STATES = {
    "normal": HEALTHY,
    "worn": replace(HEALTHY, wear=wear(511e-6), life=life(0.0, reached=True)),
    "preliminary": replace(HEALTHY, wear=replace(wear(511e-6), preliminary=LONG), life=life(1.0)),
    "unknown": replace(
        HEALTHY,
        unexplained=Unexplained(
            verdict="unknown_effect", share=0.2,
            reason="lines at " + ", ".join(f"{10 * k}.3 Hz" for k in range(1, 30)) + " belong to no shaft",
        ),
    ),
    "without model": replace(
        HEALTHY, life=Unavailable(reason="-"),
        wear=Unavailable(reason="the rig file does not give " + ", ".join(f"gears.key_{k}" for k in range(30))),
    ),
    "crack": replace(HEALTHY, effects=(effect("tooth_crack"),)),
    "level": replace(HEALTHY, level_excess=EXCESS),
}  # fmt: skip


@pytest.mark.parametrize("found", STATES.values(), ids=STATES)
def test_state_is_said_in_at_most_25_words(found):
    status = status_of(found)
    assert 0 < len(status.summary.split()) <= MOST_WORDS
    assert status.reasons[0].startswith(status.summary.rstrip(". …")[:40])


def test_summary_of_a_normal_machine_says_that_its_latest_windows_were_not_assessed():
    rhythm, at = followed(Rhythm(), START, [10.0] * 8)
    rhythm, _ = followed(rhythm, at, [10.0] * 2, NOT_ASSESSED[0], index=8)
    status = judged(rhythm)
    assert status.level == "normal" and len(status.summary.split()) <= MOST_WORDS
    assert status.summary.endswith("window 7; the latest 2 windows were not assessed.")


@pytest.mark.parametrize(
    ("text", "short"),
    [
        ("A short sentence.", "A short sentence."),
        (" ".join(["word"] * 12) + ": " + " ".join(["word"] * 20) + ".", " ".join(["word"] * 12) + "."),
        (" ".join(["word"] * 40), " ".join(["word"] * 24) + " …"),
    ],
)
def test_long_sentences_end_at_a_clause(text, short):
    assert shortened(text) == short


def answer_of(found, asset="fan"):
    status = status_of(found)
    quality = {"windows": {"good": 1}, "faults": [], "channels": {}, "missing_channels": []}
    return assemble(
        asset, [{"index": 0, "kind": "measurement", "quality": "good", "notes": []}], report_of(found, status), quality
    )


DAMAGED = {
    "crack": STATES["crack"],
    "bearing": replace(HEALTHY, effects=(effect("bearing_defect"),)),
    "unknown": STATES["unknown"],
    "level": STATES["level"],
}


@pytest.mark.parametrize("found", DAMAGED.values(), ids=DAMAGED)
def test_life_beside_a_found_damage_is_of_wear_alone_wherever_it_stands(found):
    answer = answer_of(found)
    assert answer["rul"]["of_wear_alone"] is True and overview(answer, None)["life_of_wear_alone"]
    assert "Remaining life, of wear alone: " in answer_text(answer)
    names = [name for name, _, _ in paper_of(answer).figures]
    assert "Remaining life, of wear alone" in names and "Remaining life" not in names
    assert "remaining life, of wear alone" in Result(answer)._repr_html_()


@pytest.mark.parametrize("found", [HEALTHY, replace(HEALTHY, effects=(effect("misalignment"),)), STATES["worn"]])
def test_life_of_a_machine_without_other_damage_is_its_life(found):
    answer = answer_of(found)
    assert "of_wear_alone" not in answer["rul"] and not overview(answer, None)["life_of_wear_alone"]
    assert "of wear alone" not in answer_text(answer) and not of_wear_alone(answer["status"])


@pytest.mark.parametrize(
    ("torques", "speeds", "loads"),
    [
        ((50.0,) * 12, (10.0,) * 12, 1),
        ((50.0, 51.0, 20.0), (10.0, 10.0, 10.0), 2),
        ((None, None, None), (10.0, 20.0, 10.2), 2),
        ((), (), 0),
    ],
)
def test_windows_of_a_baseline_are_counted_by_their_operating_conditions(torques, speeds, loads):
    readings = [
        WindowReading(
            name=f"healthy#{i}", start_time_ns=i, duration=1.0, turns=10.0, period=1, speed_hz=speed, speed_std_hz=None,
            angle_from="encoder", absolute=True, torque_nm=torque, channels={},
        )
        for i, (torque, speed) in enumerate(zip(torques, speeds, strict=True))
    ]  # fmt: skip
    assert loads_of(readings) == loads and np.size(readings) == len(torques)
