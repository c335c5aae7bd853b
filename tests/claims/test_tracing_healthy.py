"""A healthy machine keeps its twin: tracing adds nothing to it and changes no figure of it."""

from functools import lru_cache

import pytest

from benchmarks.scoring import ROOT, windows_of
from service.contract.estimate import decide, step
from twin.errors import NotAvailable
from twin.options import Options
from twin.state import State
from twin.tracing.decisions import Decision

SHORT = ROOT / "recordings" / "short-campaign.mcap"


@lru_cache(maxsize=2)
def followed(trace):
    rig, windows = windows_of(SHORT)
    state, out = State(), []
    for window in windows:
        state, estimate = step(rig, state, window, Options(trace=trace))
        out.append(estimate)
    return rig, state, out


@pytest.mark.slow
def test_traced_and_untraced_twin_say_the_same_to_the_bit():
    _, with_it, traced = followed(True)
    _, without, plain = followed(False)
    assert [e.record for e in traced] == [e.record for e in plain]
    assert with_it.memory == without.memory
    for part in ("wear", "rul", "residual", "effects", "calibration"):
        assert traced[-1].report[part] == plain[-1].report[part]
    left, unjudged = (out[-1].report["unexplained"] for out in (traced, plain))
    assert left["share_percent"] == unjudged["share_percent"] and left["orders"] == unjudged["orders"]
    assert left["verdict"] == "explained"
    assert unjudged["verdict"] == "insufficient_data" and "held-out" in unjudged["reason"]


@pytest.mark.slow
def test_nothing_is_added_named_or_told_at_any_window():
    _, state, out = followed(True)
    for estimate in out:
        assert estimate.report["effects"] == []
        assert estimate.report["unexplained"]["verdict"] != "unknown_effect"
        assert all(kind != "effect" for kind, _ in estimate.events)
    assert state.tracing.log == ()
    assert out[-1].report["tracing"]["held_out"]


@pytest.mark.slow
def test_untraced_twin_has_no_tracing_to_decide_on():
    rig, state, out = followed(False)
    assert "tracing" not in out[-1].report
    with pytest.raises(NotAvailable):
        decide(rig, state, Decision(name="misalignment", verb="pin"))


@pytest.mark.slow
def test_effect_that_is_not_there_cannot_be_accepted_and_can_be_ruled_out():
    rig, state, _ = followed(True)
    with pytest.raises(NotAvailable, match="only an effect that was found can stay"):
        decide(rig, state, Decision(name="misalignment", verb="accept"))
    after, estimate = decide(rig, state, Decision(name="misalignment", verb="reject"))
    assert estimate.report["tracing"]["rejected"] == ["misalignment"]
    assert after.latest.wear == state.latest.wear
    again, _ = decide(rig, State.from_dict(after.to_dict()), Decision(name="misalignment", verb="release"))
    assert again.tracing.rejected == ()
