"""A disc that has turned, or a wrong phase of the first windows: what explains all windows together is believed."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from tests.mesh_pairs import UNSW_RIG
from tests.stored_states import stored_state
from twin.errors import NotAvailable
from twin.rig import Rig
from twin.tracing import remounts
from twin.tracing.remounts import trace_over_remounts

RIG = Rig.from_mapping(UNSW_RIG)
EARLY, LATE, SINCE = -1.0, -3.0, 4_000_000_000


@pytest.fixture
def turned(monkeypatch):
    """A machine whose memory says that the pinion's disc has turned, and the misfit that each attempt leaves."""
    tracing = replace(stored_state("unsw-rig").tracing, phase=EARLY, turns=())
    memory = replace(tracing.memory, phase=LATE, discs_since_ns=SINCE)

    def attempts(misfit):
        def trace(rig, history, depths, phase, *, since_ns, **_):
            left = misfit(phase, since_ns)
            if left is None:
                raise NotAvailable("effects are not traced before two measurement windows")
            return SimpleNamespace(misfit_before=100.0, misfit_after=left, phase=phase, since=since_ns)

        monkeypatch.setattr(remounts, "trace", trace)
        return trace_over_remounts(RIG, tracing, memory, (), 0.0)

    return attempts


def test_phase_of_the_later_windows_is_believed_for_all_where_it_explains_them_together(turned):
    after, whole = turned(lambda phase, since: 0.8 if phase == LATE else 500.0)
    assert (whole.phase, whole.since) == (LATE, 0)
    assert after.phase == LATE and after.turns == ((SINCE, 0.0),)


def test_earlier_windows_are_given_up_only_where_no_phase_explains_all(turned):
    after, part = turned(lambda phase, since: 0.8 if since else 500.0)
    assert (part.phase, part.since) == (LATE, SINCE)
    assert after.phase == EARLY and after.turns == ()


@pytest.mark.parametrize("few", [None, 400.0])
def test_windows_stay_as_they_were_where_neither_halves_the_misfit(turned, few):
    after, whole = turned(lambda phase, since: 500.0 if phase == EARLY else few)
    assert (whole.phase, whole.since) == (EARLY, 0) and after.phase == EARLY


def test_what_is_explained_is_traced_with_no_other_phase(turned):
    _, whole = turned(lambda phase, since: 1.0 if phase == EARLY else 0.0)
    assert whole.phase == EARLY
