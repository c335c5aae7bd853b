"""Encoders whose channels are exchanged are named as such, and explain nothing and name no fault of a gear."""

from dataclasses import replace

import pytest

from benchmarks.scoring import ROOT, run, windows_of
from twin.plausibility import mistakes_of


def campaign(name="short"):
    return windows_of(ROOT / "recordings" / f"{name}-campaign.mcap")


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
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (exchanged, "the encoders of pinion and gear are exchanged"),
        (columns_exchanged, "the columns of the two encoders are exchanged"),
    ],
)
def test_exchanged_encoders_are_named_as_such_in_every_window(name, change, words):
    rig, windows = campaign(name)
    for window in windows[:8:3]:
        (mistake,) = mistakes_of(rig, change(window))
        assert mistake.kind == "swapped" and words in mistake.text


@pytest.mark.slow
def test_encoders_that_are_exchanged_throughout_explain_nothing_and_name_nothing():
    rig, windows = campaign()
    said = run(rig, [exchanged(w) for w in windows])[1][-1].report
    assert not {e["name"] for e in said["effects"]} - {"unknown_effect"} and said["status"]["level"] != "normal"
    assert said["unexplained"]["verdict"] != "explained"
    assert "transmission error" in said["unexplained"]["reason"]
