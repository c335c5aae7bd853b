"""Lines of responses that are kept: the same as solved anew, within a budget, in threads."""

import threading

import numpy as np
import pytest

from tests.dynamics_cases import FOURTEEN, TEN, model, worn
from tests.effects_cases import INSTANCES
from twin.effects.extended import extend, window_lines
from twin.effects.kept import KeptResponses
from twin.effects.response import solve_with

FRICTION, ECCENTRIC = INSTANCES["tooth_friction"][0], INSTANCES["pinion_eccentricity"][0]
CRACK = INSTANCES["tooth_crack"][0]
CASES = [((), 0.0, TEN), ((), 25e-6, TEN), ((FRICTION,), 25e-6, TEN), ((FRICTION,), 25e-6, FOURTEEN)]


def asked(kept: KeptResponses, case):
    effects, depth, condition = case
    return kept.get(model(), effects, worn(TEN, depth), condition)


@pytest.mark.parametrize("case", [*CASES, ((ECCENTRIC,), 25e-6, TEN)])
def test_lines_that_are_kept_are_those_of_the_response(case):
    effects, depth, condition = case
    kept = KeptResponses()
    first, again = asked(kept, case), asked(kept, case)
    assert again is first and kept.solved == 1
    solved = solve_with(model(), effects, worn(TEN, depth), condition)
    for channel in ("acceleration_lines", "transmission_error_lines", "torque_lines", "pinion_motion_lines", "orders"):
        assert np.array_equal(getattr(first, channel), getattr(solved, channel)), channel
    assert first.mean_transmission_error == solved.mean_transmission_error
    orders = [19, 38]
    assert np.array_equal(first.transmission_error(orders), solved.transmission_error(orders))
    assert np.array_equal(first.at_mesh(first.structure.torque_meter, 2), solved.torque(orders))
    assert np.array_equal(first.acceleration(orders), solved.acceleration(orders))


def test_whatever_was_asked_before_the_lines_are_the_same():
    full = KeptResponses()
    for case in CASES:
        asked(full, case)
    for case in CASES:
        alone = asked(KeptResponses(), case)
        assert np.array_equal(asked(full, case).acceleration_lines, alone.acceleration_lines)
    assert full.solved == len(CASES)


def test_responses_stay_within_the_budget_and_the_latest_is_kept():
    whole = KeptResponses()
    asked(whole, CASES[0])
    kept = KeptResponses(2 * whole.nbytes)
    for case in CASES:
        asked(kept, case)
        assert kept.nbytes <= kept.budget
    assert len(kept) < len(CASES)
    solved = kept.solved
    asked(kept, CASES[-1])
    assert kept.solved == solved
    kept.clear()
    assert len(kept) == 0 and kept.nbytes == 0


def test_threads_share_what_is_kept():
    kept, found = KeptResponses(), []

    def ask() -> None:
        for case in CASES:
            found.append((case, asked(kept, case).transmission_error_lines))

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(kept) == len(CASES)
    fresh = KeptResponses()
    for case, lines in found:
        assert np.array_equal(lines, asked(fresh, case).transmission_error_lines)
    for case in CASES:
        asked(fresh, case)
    assert kept.nbytes == fresh.nbytes


def test_lines_of_a_window_with_effects_of_a_turn_are_solved_once():
    """Asked for again with equal effects put in anew; at another depth or torque they are others."""
    gearbox = model()
    asks = [(25e-6, TEN), (25e-6, TEN), (35e-6, TEN), (25e-6, FOURTEEN)]
    found = [window_lines(extend(gearbox, (CRACK, FRICTION)), worn(TEN, d), c) for d, c in asks]
    assert found[1] is found[0] and len({id(each) for each in found}) == 3
    extended = extend(gearbox, (CRACK, FRICTION))
    alone = extended.response(worn(TEN, 25e-6).across(extended.slices), TEN, whole=True)
    assert np.array_equal(found[0].lines.transmission_error[:2], alone.transmission_error([19, 38]))
    with pytest.raises(ValueError, match="read-only"):
        found[0].lines.acceleration[0] = 0.0
