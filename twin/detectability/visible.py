"""The smallest size of each effect of the alarm class that a machine's own windows would have shown.

The detectors' own thresholds, met by the noise of these windows; nothing is simulated of the machine but the response
to one effect, which is kept:

    tooth crack    the change of one gear's lines that is sudden, large and evident enough (detectors/crack.py); the
                   loss q of the pair's stiffness that makes it, by the response to one loss: the further deflection of
                   a softer pair is in proportion to q/(1 − q)
    bearing        blows in the noise between the orders, put through envelope and search (features/non_gear.py,
                   detectors/non_gear.py) at ever smaller size, in all windows alike
    rattle         the swing of the torque from which teeth part (detectors/rattle.py)

Limits   the response is that of the calibrated model with unworn flanks; a crack that grows slowly is seen later; blows
         are sized at the accelerometer, because the path from the bearing is not in the rig file; a bearing of another
         order than the one that is tried may show earlier or later
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import inf, pi, radians, sqrt
from typing import NamedTuple

import numpy as np

from twin.assessment import SmallestSize
from twin.effects import EFFECTS
from twin.effects.bearing_defect import BearingGeometry
from twin.effects.kept import RESPONSES
from twin.effects.tooth_crack import ToothCrack
from twin.errors import TwinError
from twin.features.non_gear import NonGearFeatures, impacts_of
from twin.features.resample import AngleSignal
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.rig import Rig
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.detectors.crack import THRESHOLDS as CRACK
from twin.tracing.detectors.non_gear import THRESHOLDS as BLOWS
from twin.tracing.detectors.non_gear import defect_of
from twin.tracing.detectors.rattle import THRESHOLDS as RATTLE
from twin.tracing.detectors.rattle import strikes
from twin.tracing.tooth_patterns import NAMES, Pattern, near_energy, patterns, pinion_orders, rms_of

ALARM_CLASS = tuple(name for name, kind in EFFECTS.items() if kind.facts.alarm_class == "alarm")
ORDERS = (3.05, 5.4)  # of blows where the rig file names no bearing: outer and inner race of one with nine balls or so
SLIP = 0.01  # of their intervals
SAME = 0.03  # relative difference of a found order to that of the blows
CARRIER = 0.7  # order at which blows ring, of the highest one of the band
MOST_SAMPLES = 200_000  # of a simulated window
PER_TURN = 2.56  # samples a turn of a simulated window, over the highest order of the band
MOST_HEARD = 12  # windows over which the evidence of blows is summed
TRIALS = 4  # halvings of the range of blows, on a logarithmic scale
PROBE = 0.3  # loss of stiffness whose response is computed


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedBlows:
    """What is known of a blow at an accelerometer, where the path to it is not."""

    ring: float = deciding(
        1e-3,
        unit="s",
        meaning="time in which what a blow leaves at the accelerometer falls by a factor e",
        source="not derived: blows of less than a millisecond fill 1 kHz and more",
    )
    tried: tuple[float, float] = deciding(
        (0.1, 8.0),
        of="noise between the orders",
        meaning="RMS of blows that is tried",
        source="not derived: a tenth is lost in any noise, eight times it is plain to see",
    )


SIMULATED = SimulatedBlows()


def smallest_sizes(
    rig: Rig, model: Model, condition: Condition, windows: Sequence[WindowFeatures], phase: float | None
) -> tuple[SmallestSize, ...]:
    """The smallest size of each effect of the alarm class that measurement windows of a machine would have shown.

    model      calibrated, without effects
    condition  of the windows
    phase      of the mesh against the zero of the pinion's encoder [rad]; None where it is not known
    """
    scales = Scales.of(rig, condition)
    found = {
        size.name: size
        for size in (
            _crack(model, condition, windows, phase, scales),
            _bearing(rig, windows, phase),
            _rattle(windows, condition),
        )
    }
    return tuple(found.get(name) or _underived(name) for name in ALARM_CLASS)


def _underived(name: str) -> SmallestSize:
    first = next(p for p in EFFECTS[name].parameters if not p.shape)
    return _none(name, first.name, first.unit, "no smallest size is derived for this effect")


def _none(name: str, parameter: str, unit: str, why: str, hidden: bool = False) -> SmallestSize:
    return SmallestSize(name=name, parameter=parameter, unit=unit, value=None, basis=why, hidden=hidden)


# -- a cracked tooth ------------------------------------------------------------------------------------------


def _crack(
    model: Model, condition: Condition, windows: Sequence[WindowFeatures], phase: float | None, scales: Scales
) -> SmallestSize:
    """The loss of stiffness of one tooth, of whichever gear shows it later."""
    none = ("tooth_crack", "stiffness_loss", "")
    if phase is None:
        return _none(*none, "a cracked tooth is seen by encoders on both shafts, with the mesh phase known")
    losses = []
    for gear in (0, 1):
        seen = patterns(windows, model.mesh.pair.teeth, phase, gear)
        if len(seen) < 2:
            return _none(*none, "a cracked tooth is seen by encoders on both shafts, in two windows or more")
        try:
            response = _response(model, condition, gear, tuple(seen[0].orders.tolist()))
        except TwinError:
            return _none(*none, "the model has no steady state with a cracked tooth under this condition")
        losses.append(_loss(seen, model.mesh.pair.teeth[gear], np.array(response), scales))
    worst = max(losses)
    least = "a crack that sets in between two windows, against the changes from window to window so far"
    highest = ToothCrack.parameters[0].high
    if worst > highest:
        return _none(*none, f"not even a loss of {100 * highest:.0f} % would have been found: {least}", hidden=True)
    return SmallestSize(name="tooth_crack", parameter="stiffness_loss", unit="", value=worst, basis=least)


@lru_cache(maxsize=64)
def _response(model: Model, condition: Condition, gear: int, orders: tuple[int, ...]) -> tuple[complex, ...]:
    """Lines at a gear's orders by a tooth that has lost PROBE of its stiffness (n,) [m]; NotConverged."""
    effect = ToothCrack(stiffness_loss=PROBE, on=NAMES[gear])
    found = RESPONSES.get(model, (effect,), model.unworn, condition)
    at = pinion_orders(np.array(orders), gear, model.mesh.pair.teeth)
    return tuple(found.transmission_error(at).tolist())


def _loss(seen: Sequence[Pattern], z: int, response: np.ndarray, scales: Scales) -> float:
    """The least loss of one of z teeth whose change all of the detector's thresholds let pass; 1 where none does."""
    steps = np.array([b.lines - a.lines for a, b in pairwise(seen)])
    quiet, floor = float(np.median([rms_of(s) for s in steps])), CRACK.least_quiet * scales.graduation[0]
    restless = float(np.sqrt(np.median(near_energy(steps, seen[0].orders, z), axis=0).max()))  # the tooth that is most
    least = max(CRACK.suddenness * max(restless, floor), CRACK.least_change * scales.deflection)
    noise = max(quiet * sqrt(2 / response.size), floor)
    power = np.abs(response) ** 2

    def found(factor: float) -> bool:
        change = factor**2 * power
        evidence = 0.5 * float((change / (noise**2 + CRACK.response_scatter**2 * change)).sum())
        return factor * rms_of(response) > least and evidence > CRACK.least_evidence

    factor = _least(found, 1e-3, 1e3, halvings=12)
    softer = factor * PROBE / (1 - PROBE)
    return 1.0 if factor == inf else softer / (1 + softer)


def _least(found: Callable[[float], bool], low: float, high: float, halvings: int = TRIALS) -> float:
    """The least factor that is found, from above; infinite where even the highest is not."""
    if not found(high):
        return inf
    for _ in range(halvings):
        middle = sqrt(low * high)
        low, high = (low, middle) if found(middle) else (middle, high)
    return high


# -- blows on a bearing ---------------------------------------------------------------------------------------


def _bearing(rig: Rig, windows: Sequence[WindowFeatures], phase: float | None) -> SmallestSize:
    """RMS of blows at the reference accelerometer [m/s²]."""
    none = ("bearing_defect", "acceleration_rms", "m/s²")
    heard = [w for w in windows if w.noise_rms and w.speed_hz and w.duration]
    if not heard:
        return _none(*none, "a bearing shows in an accelerometer, in a window with a known speed")
    latest = heard[-1]
    assert latest.noise_rms is not None and latest.speed_hz is not None
    orders = _bearing_orders(rig)
    evidence = BLOWS.least_evidence if phase is not None else BLOWS.least_evidence_without_phase
    window = _Window.of(rig, latest.speed_hz, latest.duration)
    count = min(len(heard), MOST_HEARD)
    ratio = max(_least_blows(window, order, count, evidence) for order in orders)
    basis = (
        f"blows at order {' or '.join(f'{order:.3g}' for order in orders)} in all of {count} windows, in the noise of "
        f"{latest.noise_rms:.3g} m/s² between the orders; sized at the accelerometer, as the path from the bearing is "
        "not known"
    )
    if ratio == inf:
        return _none(*none, f"no size would have been found: {basis}")
    return SmallestSize(
        name="bearing_defect", parameter="acceleration_rms", unit="m/s²", value=ratio * latest.noise_rms, basis=basis
    )


def _bearing_orders(rig: Rig) -> tuple[float, ...]:
    """The orders of blows on either race of the rig file's first bearing, in turns of the pinion."""
    for one in rig.get("rolling_bearings", ()):
        geometry = BearingGeometry(
            balls=int(one["rolling_elements"]),
            ball_diameter=one["element_diameter"],
            pitch_diameter=one["pitch_diameter"],
            contact_angle=radians(one.get("contact_angle_deg", 0.0)),
        )
        turns = 1.0 if one["shaft"] == "pinion" else rig.teeth[0] / rig.teeth[1]
        return tuple(turns * geometry.orders()[part] for part in ("outer", "inner"))
    return ORDERS


class _Window(NamedTuple):
    """What decides how blows are heard in one window."""

    teeth: tuple[int, int]
    turns: float  # of the pinion
    top: float  # highest order of the analysis band
    speed_hz: float

    @classmethod
    def of(cls, rig: Rig, speed_hz: float, duration: float) -> _Window:
        """A window in two digits, so that windows alike share what was simulated; not longer than is simulated."""
        top = _two_digits(rig.band[1] / speed_hz)
        turns = min(duration * speed_hz, MOST_SAMPLES / (PER_TURN * top))
        return cls(teeth=rig.teeth, turns=_two_digits(turns), top=top, speed_hz=_two_digits(speed_hz))


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def _least_blows(window: _Window, order: float, count: int, evidence: float) -> float:
    """RMS of the least blows over that of the noise that they are found in; infinite where none are.

    count     windows that hold them
    evidence  that the search asks for [nat]
    """

    def found(ratio: float) -> bool:
        heard = _heard(window, order, ratio)
        defect = defect_of([(1000.0 * number, heard[number % len(heard)]) for number in range(count)])
        return defect is not None and defect.log_evidence >= evidence and abs(defect.effect.order / order - 1) < SAME

    return _least(found, *SIMULATED.tried)


@lru_cache(maxsize=256)
def _heard(
    window: _Window, order: float, ratio: float, blows: SimulatedBlows = SIMULATED
) -> tuple[NonGearFeatures, ...]:
    """What two simulated windows show of blows with so many times the RMS of the noise."""
    wheels = {name: {"teeth": z} for name, z in zip(NAMES, window.teeth, strict=True)}
    rig = Rig.from_mapping({"gears": wheels, "sensors": {"band_hz": [0.0, window.top * window.speed_hz]}})
    rng, per_turn = np.random.default_rng(2019), PER_TURN * window.top
    size, ring = round(window.turns * per_turn), window.speed_hz * blows.ring
    out = []
    for _ in range(2):
        noise = sqrt(PER_TURN / 2) * rng.standard_normal(size)  # of RMS 1 within the band
        values = noise + ratio * _ringing(size, per_turn, order, CARRIER * window.top, ring, rng)
        signal = AngleSignal(start=0.0, step=2 * pi / per_turn, values=values, usable=np.ones(size, dtype=bool))
        seen = impacts_of(rig, signal, window.speed_hz)
        out.append(
            NonGearFeatures(
                duration=window.turns / window.speed_hz, speed_hz=window.speed_hz, tones=(), lines=(),
                kurtosis=seen.kurtosis, rates=seen.rates,
            )
        )  # fmt: skip
    return tuple(out)


def _ringing(size: int, per_turn: float, order: float, carrier: float, ring: float, rng: np.random.Generator):
    """What blows at an order leave (size,), of RMS 1: they ring at an order, for a part of a turn, with slip."""
    at = np.cumsum((1 + SLIP * rng.standard_normal(int(size / per_turn * order) + 2)) / order)
    turns = np.arange(size) / per_turn
    out = np.zeros(size)
    for blow in at:
        first = int(np.ceil(blow * per_turn))
        t = turns[first : first + int(10 * ring * per_turn) + 1] - blow
        out[first : first + t.size] += np.exp(-t / ring) * np.sin(2 * pi * carrier * t)
    return out / np.sqrt(np.mean(out**2))


# -- rattle ---------------------------------------------------------------------------------------------------


def _rattle(windows: Sequence[WindowFeatures], condition: Condition) -> SmallestSize:
    """Swing of the torque at its meter [N·m]."""
    metered = [w for w in windows if w.torque is not None]
    none = ("backlash_rattle", "torque_swing", "N·m")
    if not metered:
        return _none(
            *none, "without a torque meter rattle is found only once the teeth strike and the transmission error sways"
        )
    share = RATTLE.parting_share_of_blows if strikes(metered) else RATTLE.parting_share
    return SmallestSize(
        name="backlash_rattle", parameter="torque_swing", unit="N·m", value=share * condition.torque,
        basis=f"a swing of {share:g} of the mean torque at the meter, once a turn of the pinion or a multiple of it",
    )  # fmt: skip
