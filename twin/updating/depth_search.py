"""The depth that the encoders of one window show, and the twin's response solved near it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.model import Model
from twin.thresholds import deciding
from twin.updating.depth import DepthEstimate, Gauge, estimate_depth
from twin.updating.prediction import Expectation


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthSearch:
    """Where a depth is sought, and when the response is solved again at the depth found."""

    times_expected: float = deciding(
        4.0,
        of="the depth expected",
        meaning="depth to which the first search goes",
        source="not derived: a wear coefficient four times too small is found at once",
    )
    least: float = deciding(
        40e-6,
        unit="m",
        meaning="depth to which the first search goes at least",
        source="not derived: a scan of some tens of micrometres costs little",
    )
    shift: float = deciding(
        0.1,
        of="the depth expected",
        meaning="difference of found and expected depth from which the response is solved again at the depth found",
        source="not derived: saves a solution where the depth hardly differs",
    )
    least_for_shift: float = deciding(
        5e-6,
        unit="m",
        meaning="expected depth below which `shift` is of this depth",
        source="not derived: the depth from which a tenth of it is more than its noise",
    )


SEARCH = DepthSearch()


def depth_from(
    gauge: Gauge,
    expectation: Expectation,
    model: Model,
    projected: float,
    new: Model | None,
    search: DepthSearch = SEARCH,
) -> tuple[Expectation, DepthEstimate]:
    """The depth that a gauge shows, and the expectation solved near it.

    projected  the depth expected before [m]
    new        the model of the time when the flanks were new, None where it had no effects
    Searched to some times what was expected; to the curve's end where that does not hold it.
    """
    curve = expectation.curve
    shallow, deep = first_range(expectation, projected, search)

    def found(near: Expectation) -> DepthEstimate:
        return estimate_depth(gauge, near.response(gauge.pinion_only, gauge.from_unworn), shallow, deep)

    estimate = found(expectation)
    if estimate.at_limit and deep < curve.valid_to:
        deep = curve.valid_to
        estimate = found(expectation)
    moved = abs(estimate.depth - projected) > search.shift * max(projected, search.least_for_shift)
    if not expectation.solved or moved:
        again = Expectation.at(model, curve, expectation.condition, estimate.depth, new)
        if again.solved:
            return again, found(again)
    return expectation, estimate


def first_range(expectation: Expectation, projected: float, search: DepthSearch = SEARCH) -> tuple[float, float]:
    """Depths [m] between which a depth is searched first."""
    curve, shallow = expectation.curve, expectation.curve.start_depth
    sought = max(search.times_expected * projected, search.least)
    return shallow, max(min(curve.valid_within(min(sought, curve.limit)), sought), shallow + 1e-6)


def phase_of_known_depth(gauge: Gauge, expectation: Expectation, depth: float) -> DepthEstimate:
    """The mesh phase of a window whose depth [m] is known from others: the estimate within a narrow range of depths."""
    width = max(1e-6, 0.02 * depth)
    low = max(depth - width, expectation.curve.start_depth)
    lines = replace(gauge, mean=None)
    return estimate_depth(lines, expectation.response(gauge.pinion_only, gauge.from_unworn), low, low + width)
