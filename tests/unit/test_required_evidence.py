"""Evidence that effects need at a rate of false alarms."""

from __future__ import annotations

from math import inf, log

import numpy as np
import pytest

from service.errors import InputError
from service.files.detectability import read_nulls
from twin.errors import ParameterError
from twin.options import Options
from twin.required_evidence import NullEvidence, RequiredEvidence
from twin.rig import Rig


def test_a_tenth_of_the_rate_asks_for_ln_10_more():
    at_one_percent, at_one_per_mille = RequiredEvidence(rate=0.01), RequiredEvidence(rate=0.001)
    assert at_one_percent.least("misalignment", 6.0) == pytest.approx(6.0)
    assert at_one_per_mille.least("misalignment", 6.0) - 6.0 == pytest.approx(log(10))


def test_what_healthy_machines_reach_counts_where_it_is_more():
    required = RequiredEvidence(by_effect={"sensor_gain": 9.0})
    assert required.least("sensor_gain", 6.0) == 9.0
    assert required.least("sensor_gain", 12.0) == pytest.approx(12.0)
    assert required.accepts("sensor_gain", 9.0) and not required.accepts("sensor_gain", 8.9)
    assert required.accepts("misalignment", -inf)


@pytest.mark.parametrize("rate", [0.0, 1.0, -0.1, 2.0])
def test_a_rate_lies_between_none_and_all(rate: float):
    with pytest.raises(ParameterError, match="between 0 and 1"):
        Options(false_alarm_rate=rate)


def test_threshold_of_an_exponential_tail_is_its_quantile():
    """A fifth of the healthy campaigns report an effect, with a mean excess of 2 nat: against the closed form."""
    rng = np.random.default_rng(3)
    slope, reported, campaigns, rate, effects = 2.0, 0.2, 100_000, 0.01, 15
    evidence = 3.0 + rng.exponential(slope, int(reported * campaigns))
    nulls = NullEvidence(campaigns=campaigns, found={"misalignment": tuple(np.sort(evidence)[::-1])})
    least = nulls.required(rate, effects).by_effect["misalignment"]
    assert least == pytest.approx(3.0 + slope * log(reported * effects / rate), rel=0.01)
    assert np.mean(evidence > least) * reported == pytest.approx(rate / effects, rel=0.5)


def test_few_reports_have_the_steepest_tail_that_turing_allows():
    nulls = NullEvidence(campaigns=100, found={"sensor_gain": (4.0,)})
    assert nulls.required(0.01, 15).by_effect["sensor_gain"] == pytest.approx(4.0 + log(0.01 * 15 / 0.01))


def test_nulls_count_for_the_rig_that_they_belong_to():
    rig, other = Rig({"name": "one"}), Rig({"name": "two"})
    nulls = NullEvidence(campaigns=100, found={"sensor_gain": (20.0,)})
    options = Options(nulls={rig.digest: nulls})
    assert options.required(rig).by_effect["sensor_gain"] > 20
    assert not options.required(other).by_effect


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a file of"),
        ("[]", "not a file of"),
        ('{"schema": "gear-rig/1"}', "must be 'gear-detectability/1'"),
        ('{"schema": "gear-detectability/1", "false_alarms": {"a": {"evidence": 3}}}', "not a file of"),
    ],
)
def test_other_files_are_one_clear_error(tmp_path, text: str, message: str):
    path = tmp_path / "nulls.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_nulls(path)
    with pytest.raises(InputError, match="cannot be read: no such file"):
        read_nulls(tmp_path / "none.json")
