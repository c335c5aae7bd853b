"""Schedules of faults, drawn from a seed: a part of what `make chaos` draws."""

from __future__ import annotations

import os

import pytest

from tests.chaos import kills
from tests.chaos.schedules import KINDS, Run, draw

SEED = 20_261_122


@pytest.mark.serve_only("faults in the files of `serve`; schedules of fleets are in tests/chaos/fleet.py")
@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 3])
def test_after_faults_the_windows_are_those_of_the_undisturbed_run(number, tmp_path):
    schedule = draw(SEED, number)
    if os.geteuid() != 0 and any(fault.kind.startswith("disk") for fault in schedule.faults):
        pytest.skip("a disk of its own can be mounted by root alone")
    outcome = Run(schedule, tmp_path)()
    assert outcome.wrong == []


def test_a_schedule_is_the_same_in_any_run_and_half_of_them_leave_the_publisher_alone():
    assert draw(SEED, 17) == draw(SEED, 17) != draw(SEED, 18)
    schedules = [draw(SEED, number) for number in range(200)]
    assert sum(schedule.survives for schedule in schedules) == 100
    assert {fault.kind for schedule in schedules for fault in schedule.faults} == {*KINDS, "replay_kill"}


@pytest.mark.slow
def test_frames_that_are_sent_again_to_a_service_that_came_back_are_not_too_late(tmp_path):
    """The cache of the publisher once gave it newer frames first, and a window lost a whole channel."""
    tally = kills.attack(1, 2, tmp_path, lambda line: None)
    assert tally.faults == []
