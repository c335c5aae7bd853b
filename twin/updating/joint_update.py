"""A window of a machine whose structure is an estimate: its gauge, its depth, and what it teaches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi

import numpy as np

from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.quantiles import Z95
from twin.rig import Rig
from twin.structure_spread import Spread, structure_spread
from twin.updating import encoders
from twin.updating.depth import HARMONICS, Gauge, Response
from twin.updating.depth_search import SEARCH, first_range
from twin.updating.disc_remount import REMOUNT, SettledDepth
from twin.updating.encoders import DEPTH_HARMONICS, ENCODERS
from twin.updating.joint_gauge import JOINT, SCANNED, ZERO, JointDepth, LineFactors, Own, estimate_jointly
from twin.updating.memory import Memory
from twin.updating.prediction import Expectation

SHALLOWER = (
    0.5  # share of the depth at the start of a wear curve from which a depth is searched: that start is uncertain
)
Search = Callable[[Gauge, LineFactors], tuple[Expectation, JointDepth]]


def factors_before(rig: Rig, memory: Memory, features: WindowFeatures, speed_hz: float) -> LineFactors | None:
    """What is known of the factors and of the zero before a window; None where the structure is not estimated."""
    spread = structure_spread(rig, speed_hz)
    if spread is None:
        return None
    lines: Spread = spread.pinion_motion if features.transmission_error is None else spread.transmission_error
    known = memory.line_factors
    if known is None:
        return LineFactors.of_spread(lines, spread.compliance, speed_hz)
    if abs(known.speed_hz / speed_hz - 1) > ENCODERS.same_speed:
        known = known.at_speed(lines, speed_hz)
    return known.later(ENCODERS.offset_drift)


def joint_gauge(features: WindowFeatures, memory: Memory) -> Gauge | None:
    """What the window's encoders measure, the mean with its zero; None where there are no lines."""
    seen = encoders.encoder_lines(features)
    if seen is None or not encoders.has_depth_lines(seen):
        return None
    lines = np.array([seen.at(k) for k in DEPTH_HARMONICS])
    std = np.array([seen.std_at(k) for k in DEPTH_HARMONICS])
    unworn = encoders.unworn_like(features, memory)
    start = None if unworn is None else encoders.encoder_lines(unworn)
    if start is not None:
        lines = lines - np.array([start.at(k) for k in DEPTH_HARMONICS])
        std = np.hypot(std, [start.std_at(k) for k in DEPTH_HARMONICS])
    te = features.transmission_error
    return Gauge(
        lines=lines,
        from_unworn=start is not None,
        lines_std=std,
        mean=te.at(0).real if te is not None and te.get(0) is not None and features.torque_nm is not None else None,
        mean_std=ENCODERS.mean_noise,
        phase=None,
        phase_std=memory.phase_std,
        pinion_only=features.transmission_error is None,
    )


def settled_jointly(
    rig: Rig,
    memory: Memory,
    features: WindowFeatures,
    condition: Condition,
    search: Search,
) -> SettledDepth | None:
    """The depth that the window's encoders show, and the memory with what it taught; None where there are no lines."""
    factors = factors_before(rig, memory, features, condition.speed_hz)
    gauge = None if factors is None else joint_gauge(features, memory)
    if factors is None or gauge is None:
        return None
    notes: tuple[str, ...] = ()
    expectation, found = search(gauge, factors)
    if gauge.mean is not None and factors.has_zero and found.chi_square > REMOUNT.chi_square:
        again = search(gauge, factors.without_zero())
        if found.chi_square - again[1].chi_square > REMOUNT.chi_square:
            notes, contradicted = _contradiction(rig, factors, again[1].factors)
            if contradicted:
                again = search(gauge, replace(factors.without_zero(), contradicted=True))
            expectation, found = again
    memory = replace(memory, line_factors=found.factors, phase=found.estimate.phase, phase_std=ENCODERS.unworn_phase)
    return SettledDepth(
        memory=memory, gauge=gauge, expectation=expectation, estimate=found.estimate, notes=notes
    )  # fmt: skip


def _contradiction(rig: Rig, before: LineFactors, after: LineFactors) -> tuple[tuple[str, ...], bool]:
    """What is said of a mean that contradicts its lines, and whether it may be an effect that is not in the model.

    A lost count shifts the zero by whole edges of one disc, at its base radius; an effect or a moved disc by any
    amount. An edge that is not large against what the zero is uncertain by shows nothing.
    """
    said = "the mean of the transmission error contradicts its mesh lines"
    jump = after.mean[ZERO] - before.mean[ZERO]
    near = Z95 * float(np.hypot(ENCODERS.offset_drift, after.depth_std))
    for shaft, radius in zip(("pinion", "gear"), rig.gear_pair().base_radius, strict=True):
        edges = rig.get(f"encoders.{shaft}_edges_per_rev")
        edge = 2 * pi * radius / edges if edges else 0.0
        count = round(jump / edge) if edge > JOINT.least_edge * near else 0
        if count and abs(jump - count * edge) < near:
            note = f"{said} by {abs(count)} edge(s) of the {shaft}'s encoder: lost counts; its zero is learned again"
            return (note,), False
    return (
        f"{said}: a moved disc, or an effect that is not in the model; its zero is learned again, and the band of the "
        "depth is wider by what such an effect may shift it",
    ), True


def of_known_depth(expectation: Expectation, model: Model, depth: float) -> Search:
    """A search that knows the depth [m] already: the window teaches factors and zero alone."""

    def search(gauge: Gauge, factors: LineFactors) -> tuple[Expectation, JointDepth]:
        at = np.array([depth])
        return expectation, estimate_jointly(gauge, _own(expectation, model, gauge, depth), factors, at)

    return search


def of_unknown_depth(expectation: Expectation, model: Model, projected: float, new: Model | None) -> Search:
    """A search from new flanks on, twice as deep each time while the band reaches its end.

    projected  the depth expected before [m]
    new        the model of the time when the flanks were new, None where it had no effects
    """
    curve = expectation.curve

    def search(gauge: Gauge, factors: LineFactors) -> tuple[Expectation, JointDepth]:
        shallow, deep = first_range(expectation, projected)
        shallow *= SHALLOWER
        own = _own(expectation, model, gauge, projected)

        def found(by: Own, to: float) -> JointDepth:
            grid = shallow + (to - shallow) * np.linspace(0, 1, SCANNED) ** 1.5
            return estimate_jointly(gauge, by, factors, grid)

        result = found(own, deep)
        while result.estimate.at_limit and deep < (deeper := curve.valid_within(min(2 * deep, curve.limit))):
            deep = deeper
            result = found(own, deep)
        depth = result.estimate.depth
        if not expectation.solved or abs(depth - projected) > SEARCH.shift * max(projected, SEARCH.least_for_shift):
            again = Expectation.at(model, curve, expectation.condition, depth, new)
            if again.solved:
                return again, found(_own(again, model, gauge, projected), deep)
        return expectation, result

    return search


def _own(expectation: Expectation, model: Model, gauge: Gauge, projected: float) -> Own:
    """What the model says of a window."""
    condition = expectation.condition
    steady = model.steady(model.unworn, condition)
    lines = model.pinion_motion_lines(steady) if gauge.pinion_only else model.transmission_error_lines(steady)
    new = lines[:HARMONICS]
    return Own(
        response=_response(expectation, gauge, new, model.mean_transmission_error(steady, condition)),
        unworn=np.abs(new),
        load=model.compliance_outside_mesh * condition.torque,
        projected=projected,
    )


def _response(expectation: Expectation, gauge: Gauge, new: np.ndarray, mean: float) -> Response:
    """Lines and mean by depth; below the start of a wear curve between those of new flanks and of its start.

    new, mean  lines and mean transmission error of new flanks [m]
    """
    start = expectation.curve.start_depth
    at = expectation.response(gauge.pinion_only, gauge.from_unworn)

    def response(depths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lines, means = at(np.maximum(depths, start))
        early = depths < start
        share = depths[early] / start
        before = 0.0 if gauge.from_unworn else new
        lines[early] = before + share[:, None] * (lines[early] - before)
        means[early] = mean + share * (means[early] - mean)
        return lines, means

    return response
