"""A copied rig file with changed teeth and a few seconds of unworn gears: never an alarm or an established life."""

import numpy as np
import pytest

from service.contract.answer import report_of
from service.contract.status import status_of
from tests.stand_ins import StandIn, copied_rig, windows_of
from twin.step import Options, State, step

TRIED = StandIn(seconds=20.0)  # what a first user tried: 23/57, m 2.5, 24.6 Hz, 20 s, 15 % once-per-turn modulation
SHORT = {"seconds": 4.0, "rate": 12800.0}


def answers(machine, trace=True):
    rig, state = copied_rig(machine), State()
    for window in windows_of(machine):
        state, found = step(rig, state, window, Options(trace=trace))
        yield report_of(found, status_of(found))


def faults(machine, trace=True):
    """What is claimed too early of a machine without wear."""
    for report in answers(machine, trace):
        level, wear, life = report["status"]["level"], report["wear"], report["rul"]
        if level in ("alarm", "end_of_life"):
            yield f"{machine}: {level}: {report['status']['reasons'][0]}"
        if "hours" in life and not life["preliminary"]:
            yield f"{machine}: life {life['hours']}"
        if "max_depth_um" in wear and not wear["preliminary"] and wear["max_depth_um"]["combined"]["p05"] > 0:
            yield f"{machine}: depth {wear['max_depth_um']['combined']}"


def stand_ins(count):
    """Machines of all kinds, the same at every run."""
    random = np.random.default_rng(13)
    pairs = ((17, 43), (19, 52), (20, 30), (23, 57), (23, 46), (25, 36), (29, 29), (31, 67), (35, 53), (41, 60))
    for i in range(count):
        module = float(random.choice([1.5e-3, 2e-3, 2.5e-3, 3e-3, 4e-3]))
        yield StandIn(
            teeth=pairs[i % len(pairs)],
            module=module,
            speed=float(random.uniform(6.0, 45.0)),
            encoders=("tachometer", "tachometer", "pinion", "both")[i % 4],
            level=float(10 ** random.uniform(-0.5, 2.0)),
            unit=float(random.choice([1.0, 1.0, 1.0, 9.81, 1 / 9.81, 1000.0, 1e-3])),
            noise=float(random.uniform(0.02, 0.8)),
            modulation=float(random.uniform(0.0, 0.5)),
            unworn_error=float(random.uniform(0.3e-6, 6e-6)),
            first_turn=int(random.choice([0, 0, 400, 20_000, 5_000_000])),
            torque=None if i % 3 else float(random.uniform(3.0, 60.0)),
            windows=2,
            seconds=4.0,
            rate=12800.0,
            seed=i,
        )


@pytest.mark.slow
def test_what_a_first_user_tried_gives_no_depth_and_no_life_and_says_why():
    *_, report = answers(TRIED)
    assert report["status"]["level"] == "no_verdict"
    for part in ("wear", "rul"):
        assert report[part]["status"] == "not available"
        assert "the rig file does not describe this machine" in report[part]["reason"]
        assert "encoders on both shafts" in report[part]["reason"]
    (found,) = [m for m in report["modulation"] if m["shaft"] == "pinion" and m["per_turn"] == 1]
    assert found["depth_percent"] == pytest.approx(15, abs=4)  # it was left out because there is a rig file


@pytest.mark.slow
@pytest.mark.parametrize("first_turn", [400, 5_000_000])
def test_level_of_a_machine_that_was_not_recorded_when_new_is_preliminary_at_most(first_turn):
    assert not list(faults(StandIn(first_turn=first_turn, level=40.0, **SHORT), trace=False))


@pytest.mark.slow
@pytest.mark.parametrize("part", range(6))
def test_none_of_60_stand_ins_gives_an_alarm_or_an_established_life(part):
    chosen = list(stand_ins(60))[part::6]
    assert len(chosen) == 10
    claimed = [fault for i, machine in enumerate(chosen) for fault in faults(machine, trace=i == 3)]
    assert not claimed, "\n".join(claimed)
