"""Impacts at one tooth of every turn are an alarm with the shaft in the action; other unknown content is watched."""

import pytest

from service.contract.effect_findings import _unknown
from twin.assessment import Assessment, Unavailable, Unexplained
from twin.attention import StatusLimits


def findings(struck):
    rest = Unexplained(verdict="unknown_effect", reason="impacts", struck=struck)
    none = Unavailable(reason="no model")
    answer = Assessment(
        window=None, wear=none, life=none, residual=none, effects=(), unexplained=rest, calibration=none
    )
    return list(_unknown(answer, StatusLimits()))


@pytest.mark.parametrize("shaft", ["pinion", "gear"])
def test_impacts_of_a_tooth_are_an_alarm_that_names_the_shaft(shaft):
    (finding,) = findings(shaft)
    assert finding.level == "alarm" and f"teeth of the {shaft}" in finding.action


def test_other_unknown_content_is_watched_and_looked_for_nearby():
    (finding,) = findings("")
    assert finding.level == "watch" and "nearby" in finding.action
