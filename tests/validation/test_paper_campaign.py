"""The published wear campaign, beside the paper's figures.

Source     K. Feng et al., Wear 426–427 (2019) 1410–1415, sections 4.2 and 5: one update at 6000 revolutions, none
           needed at 12,000; 12,000 revolutions after that update 7 % off the wear depth and 13 % off the RMS
Recording  recordings/paper-campaign.mcap, a simulated machine of another formulation than the twin's, with its
           truth beside it
Tolerance  the paper's 7 % on depth. Its RMS at 18,000 revolutions is not asserted: the recorded machine wears by
           static forces and stays smooth, the twin's flanks carry the waves of its dynamic forces, and from some
           250 µm on the level tells these two apart, not the depth. Up to 12,000 revolutions the paper's own
           threshold, 5 %, must do.
The table  python -m benchmarks.paper_campaign
"""

from functools import lru_cache

import pytest

from benchmarks.paper_campaign import ONE_UPDATE, RECORDING, lines_of, papers_windows
from benchmarks.scoring import Score, read_truth, run, score_run, truth_beside, windows_of
from twin.options import Options

DEPTH_AT_18000 = 7.0  # percent, paper section 5
THRESHOLD = 5.0  # percent, paper section 4.2


@lru_cache(maxsize=1)
def given():
    rig, windows = windows_of(RECORDING)
    return rig, windows, read_truth(truth_beside(RECORDING))


@lru_cache(maxsize=1)
def one_update():
    """By way and revolutions, from the paper's windows with one update at 6000."""
    rig, windows, truth = given()
    _, estimates = run(rig, papers_windows(windows, rig), Options(update_until=ONE_UPDATE))
    lines = lines_of([e.record for e in estimates], truth, "paper's", "one")
    return {(x.method, x.revolutions): x for x in lines}


@lru_cache(maxsize=1)
def every_window_run():
    rig, windows, _ = given()
    return run(rig, windows)[1]


def every_window() -> Score:
    return score_run("paper-campaign", every_window_run(), given()[2])


def test_papers_windows_are_two_calibrations_and_four_measurements():
    rig, windows, _ = given()
    assert len(papers_windows(windows, rig)) == 6


@pytest.mark.slow
def test_one_update_at_6000_revolutions_brings_level_and_depth_together():
    line = one_update()["fused", 6000]
    assert line.updated
    assert abs(line.rms_error) > THRESHOLD, "no update would have been needed"
    assert abs(line.rms_error_after) < THRESHOLD
    assert abs(line.depth_error) < 3


@pytest.mark.slow
def test_no_second_update_is_needed_at_12000_revolutions():
    line = one_update()["fused", 12000]
    assert abs(line.rms_error) < THRESHOLD
    assert abs(line.depth_error) < DEPTH_AT_18000


def test_depth_12000_revolutions_after_the_only_update_is_within_the_papers_error():
    assert abs(one_update()["fused", 18000].depth_error) < DEPTH_AT_18000


def test_papers_own_way_stays_shallow_where_damping_and_width_are_not_the_rig_files():
    """Side by side: the RMS alone is biased low, transmission error is not."""
    for revolutions in (6000, 12000, 18000):
        paper, fused = one_update()["rms", revolutions], one_update()["fused", revolutions]
        assert paper.depth_error < -10
        assert abs(fused.depth_error) < 0.5 * abs(paper.depth_error)


@pytest.mark.slow
def test_depth_in_every_window_up_to_300_micrometres():
    for row in every_window().worn:
        if row.true <= 300:
            assert abs(row.depth_error) < (3.0 if row.true <= 150 else 7.0), f"{row.depth:.1f} for {row.true:.1f} µm"


@pytest.mark.slow
def test_bands_hold_the_true_depth_to_the_end():
    assert every_window().coverage >= 0.9


@pytest.mark.slow
def test_level_after_an_update_is_within_the_threshold_or_says_why():
    score = every_window()
    assert score.within(THRESHOLD) >= 0.9
    assert all(abs(row.error_after) <= THRESHOLD or row.notes for row in score.rows)


@pytest.mark.slow
def test_machine_past_its_end_of_life_is_stopped_though_its_figure_is_preliminary_by_then():
    """511 of 500 µm, where the model does not meet the lines any more; earlier windows had established the depth."""
    report = every_window_run()[-1].report
    status, depth = report["status"], report["wear"]["max_depth_um"]["combined"]
    assert depth["median"] > 500 > depth["p05"] and report["wear"]["preliminary"] is not None
    assert status["level"] == "alarm", status
    assert status["action"].startswith("Stop the machine, measure the wear depth, and replace the gear pair")
    assert "µm of 500 µm" in status["action"] and "but the figure is preliminary" in status["reasons"][0]
    assert report["wear"]["preliminary"]["established_before"]["windows"] >= 3
