"""Malformed frames, recordings, rig and measurement files, drawn from a seed: a part of what `make chaos` draws."""

from __future__ import annotations

import pytest

from tests.chaos import guided
from tests.chaos.files import attack
from tests.chaos.frames import Attack

SEED = 20_261_122


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "count"), [("recordings", 200), ("rigs", 600), ("measurements", 60)])
def test_damaged_files_are_read_as_far_as_they_go_or_refused_by_one_line(kind, count, tmp_path):
    tally = attack(kind, count, SEED, tmp_path, lambda line: None)
    assert tally.faults == []
    assert tally.files == count and tally.used > 0 and tally.refused > 0


@pytest.mark.slow
@pytest.mark.parametrize("ask", [True, False])
def test_malformed_frames_neither_stop_the_service_nor_reach_a_sound_machine(tmp_path, ask):
    outcome = Attack(SEED, tmp_path).run(6_000, ask=ask)
    assert outcome.failure is None
    assert outcome.sound


@pytest.mark.slow
def test_input_found_by_coverage_is_used_or_refused_as_is_meant(tmp_path):
    tally = guided.attack(15, SEED, tmp_path, lambda line: None)
    if tally.skipped:
        pytest.skip(tally.skipped)
    assert tally.faults == [] and all(tally.inputs.values())
