"""What a rig file states twice must agree: values that repeat others of the file, and names that the model must know.

A contradiction is refused with both values and a likely cause. What is only estimated from other values is compared in
`twin/rig_notes.py`, which says what differs and refuses nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from math import cos, pi, radians
from typing import Any

from twin.errors import NotAvailable, ParameterError
from twin.geometry.gear_pair import GearPair
from twin.mesh.given_stiffness import knots, not_a_knot, refuse_unless_positive
from twin.rig_derived import Get
from twin.rig_estimated import PARTS
from twin.rig_schema import DEGREES_OF_FREEDOM, TORSION_CHAINS, TORSION_LINKS

ROUNDING = 1e-3  # relative difference that the rounding of a repeated value may make
SPAN = 0.01  # of the base pitch by which a stiffness table may miss an end of the path of contact
LEAST_POINTS = 4  # of a stiffness table: a cubic spline needs them
MEASURED = "measured"  # a torque meter whose place in the chain the file does not say
USUAL_METER = (2, 3)
WHEELS = ("pinion", "gear")


def refuse_contradictions(get: Get, gear_pair: Callable[[], GearPair]) -> None:
    """Raises ParameterError at the first contradiction; `gear_pair` makes the geometry where the file gives it."""
    _wheels(get)
    _layout(get)
    _sensors(get)
    _operating(get)
    _estimated(get)
    _rolling_bearings(get)
    try:
        pair = gear_pair()
    except NotAvailable:  # the geometry's own error names what is missing
        pair = None
    if pair is not None:
        _path_of_contact(get, pair)
    _pair_stiffness(get, pair)


def torque_meter_nodes(expression: str) -> tuple[int, int]:
    """The two nodes of a torque meter's expression such as `k_2_3*(th2-th3)`; those between motor and pinion where the
    file says only that torque is `measured`.
    """
    if expression.strip() == MEASURED:
        return USUAL_METER
    found = re.fullmatch(r"k_(\d+)_(\d+)\s*\*\s*\(\s*th(\d+)\s*-\s*th(\d+)\s*\)", expression.strip())
    if found:
        a, b, c, d = (int(number) for number in found.groups())
        if (a, b) == (c, d) and (a, b) in TORSION_LINKS:
            return a, b
    known = ", ".join(f"k_{a}_{b}*(th{a}-th{b})" for a, b in TORSION_LINKS)
    raise ParameterError(
        f"sensors.torque = {expression!r} must be '{MEASURED}' or the twist of a torsional spring: one of {known}"
    )


def _rolling_bearings(get: Get) -> None:
    for i, bearing in enumerate(get("rolling_bearings") or ()):
        d, D, n = (bearing[key] for key in ("element_diameter", "pitch_diameter", "rolling_elements"))
        if n * d > pi * D:
            raise ParameterError(
                f"rolling_bearings[{i}]: {n:g} rolling elements of {d:g} m do not fit on a pitch circle of {D:g} m; "
                "a radius in place of a diameter?"
            )


def _differ(a: float, b: float) -> bool:
    return abs(a - b) > ROUNDING * max(abs(a), abs(b))


def _wheels(get: Get) -> None:
    m, α, root = get("gears.module"), get("gears.pressure_angle_deg"), get("gears.dedendum")
    for wheel in WHEELS:
        z, r = get(f"gears.{wheel}.teeth"), get(f"gears.{wheel}.pitch_radius")
        if None not in (m, z, r) and _differ(r, m * z / 2):
            raise ParameterError(
                f"gears.{wheel}.pitch_radius = {r:g} m contradicts module·teeth/2 = {m * z / 2:g} m; "
                "a diameter, or another tooth count?"
            )
        rb = get(f"gears.{wheel}.base_radius")
        if None not in (m, α, z, rb) and _differ(rb, m * z / 2 * cos(radians(α))):
            raise ParameterError(
                f"gears.{wheel}.base_radius = {rb:g} m contradicts module·teeth/2·cos α = "
                f"{m * z / 2 * cos(radians(α)):g} m; another pressure angle?"
            )
        bore = get(f"gears.{wheel}.bore_radius")
        if None not in (m, z, bore, root) and bore >= m * z / 2 - root:
            raise ParameterError(
                f"gears.{wheel}.bore_radius = {bore:g} m must be below the root radius "
                f"{m * z / 2 - root:g} m; a diameter?"
            )
    z1, z2, share = (get(p) for p in ("gears.pinion.teeth", "gears.gear.teeth", "wear.pinion_share"))
    if None not in (z1, z2, share) and _differ(share, z2 / (z1 + z2)):
        raise ParameterError(
            f"wear.pinion_share = {share:g} contradicts z2/(z1 + z2) = {z2 / (z1 + z2):g}: in one passage both flanks "
            "lose the same depth, so the tooth counts alone set the share"
        )


def _layout(get: Get) -> None:
    dofs = get("layout.degrees_of_freedom")
    if dofs is not None and tuple(dofs) != DEGREES_OF_FREEDOM:
        raise ParameterError(
            "layout.degrees_of_freedom must be the 21 coordinates of the paper's eq. 2 in its order: "
            + ", ".join(DEGREES_OF_FREEDOM)
        )
    for shaft, chain in TORSION_CHAINS.items():
        given = get(f"layout.torsion_chain_{shaft}")
        if given is not None and tuple(given) != chain:
            raise ParameterError(
                f"layout.torsion_chain_{shaft} = {[int(node) for node in given]} must be {list(chain)}: "
                "the model has no other chain"
            )
    low, high = get("shafts.diameter_min"), get("shafts.diameter_max")
    if None not in (low, high) and low > high:
        raise ParameterError(f"shafts.diameter_min = {low:g} m must not exceed shafts.diameter_max = {high:g} m")
    segments = get("shafts.torsion_segments")
    pairs = segments is None or all(isinstance(part, tuple) and len(part) == 2 and min(part) > 0 for part in segments)
    if not pairs:
        raise ParameterError("shafts.torsion_segments must be pairs of length and diameter above 0, [[m, m], …]")


def _sensors(get: Get) -> None:
    band = get("sensors.band_hz") or (0.0, 1.0)
    if len(band) != 2 or not all(isinstance(edge, float) for edge in band):
        raise ParameterError("sensors.band_hz must be the lowest and the highest frequency, [Hz, Hz]")
    low, high = band
    if not low < high:
        raise ParameterError(f"sensors.band_hz = [{low:g}, {high:g}] Hz must rise")
    for shaft, chain in TORSION_CHAINS.items():
        place, known = get(f"sensors.encoder_{shaft}"), [f"th{node}" for node in chain]
        if place is not None and place not in known:
            raise ParameterError(f"sensors.encoder_{shaft} = {place!r} must be one of {', '.join(known)}")
    if get("sensors.torque") is not None:
        torque_meter_nodes(get("sensors.torque"))


def _operating(get: Get) -> None:
    interval, end = get("operating.measurement_interval_revs"), get("operating.end_revs")
    if None not in (interval, end) and interval > end:
        raise ParameterError(
            f"operating.measurement_interval_revs = {interval:g} must not exceed operating.end_revs = {end:g}"
        )


def _estimated(get: Get) -> None:
    """Every estimated part has its spread, and every key that is listed has a value in the file."""
    parts, spread = get("estimated.parts") or (), get("estimated.spread") or {}
    for part in parts:
        if part not in PARTS:
            raise ParameterError(f"estimated.parts names {part!r}; known: {', '.join(PARTS)}")
        if part not in spread:
            raise ParameterError(
                f"estimated.spread.{part} is missing: how far may the machine differ, as a deviation of ln?"
            )
    for part in spread:
        if part not in parts:
            raise ParameterError(f"estimated.spread.{part} is stated, but estimated.parts does not name {part}")
    for kind in ("derived", "assumed"):
        for key in get(f"estimated.{kind}") or ():
            if get(key) is None:
                raise ParameterError(f"estimated.{kind} names {key!r}, which has no value in the file")


def _path_of_contact(get: Get, pair: GearPair) -> None:
    derived = {
        "start": (pair.path_start, " m"),
        "end": (pair.path_end, " m"),
        "base_pitch": (pair.base_pitch, " m"),
        "contact_ratio": (pair.contact_ratio, ""),
    }
    for name, (value, unit) in derived.items():
        given = get(f"gears.path_of_contact.{name}")
        if given is not None and _differ(given, value):
            raise ParameterError(
                f"gears.path_of_contact.{name} = {given:g}{unit} contradicts {value:g}{unit}, which follows from "
                "teeth, module, pressure angle and addendum; leave it out, or correct those"
            )


def _pair_stiffness(get: Get, pair: GearPair | None) -> None:
    s, k = get("mesh.pair_s"), get("mesh.pair_stiffness")
    if s is None or k is None:
        if s is not None or k is not None or get("mesh.stiffness_source") == "given":
            raise ParameterError("mesh.pair_s and mesh.pair_stiffness go together: one of them is missing")
        return
    fault = next(_table_faults(s, k, pair), None)
    if fault is not None:
        raise ParameterError(fault)
    if pair is not None:
        refuse_unless_positive(pair, not_a_knot(s, k, knots(pair)))


def _table_faults(s: Any, k: Any, pair: GearPair | None) -> Iterator[str]:
    """What is wrong with a table of pair stiffness k [N/m] at path positions s [m]."""
    if len(s) != len(k):
        yield f"mesh.pair_s has {len(s)} values and mesh.pair_stiffness {len(k)}: one each"
    if len(s) < LEAST_POINTS:
        yield f"mesh.pair_s has {len(s)} values: at least {LEAST_POINTS} are needed"
    for i, (a, b) in enumerate(pairwise(s)):
        if not a < b:
            yield f"mesh.pair_s[{i + 1}] = {b:g} m must be above mesh.pair_s[{i}] = {a:g} m: positions rise"
    for i, value in enumerate(k):
        if not value > 0:
            yield f"mesh.pair_stiffness[{i}] = {value:g} N/m must be positive"
    if pair is not None:
        margin = SPAN * pair.base_pitch
        if s[0] > pair.path_start + margin or s[-1] < pair.path_end - margin:
            yield (
                f"mesh.pair_s spans {s[0]:g} to {s[-1]:g} m and must reach over the path of contact, "
                f"{pair.path_start:g} to {pair.path_end:g} m; millimetres, or measured from the pitch point?"
            )
