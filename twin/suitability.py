"""What a recording supports with what is known of the machine, and what speaks against it: speed, mesh lines, encoders,
band, load, length and number of windows.

Every finding is a sentence with its figures; one that is no `ok` says what would be right. The windows are those of a
recording, their features those that the twin reads of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import gcd

import numpy as np

from twin.errors import NotAvailable
from twin.features.extract import USABLE_RATE
from twin.features.plausible import torque_contradiction
from twin.features.window_features import WindowFeatures
from twin.gear_age import NEWNESS, unworn
from twin.rig import Rig
from twin.thresholds import deciding
from twin.updating.calibration import FIT
from twin.updating.depth import HARMONICS
from twin.windows import Edges, Window

OK, NOTE, PROBLEM = "ok", "note", "problem"
MESH_BANDS = 5  # mesh harmonics whose bands are reported


@dataclass(frozen=True, slots=True, kw_only=True)
class SuitabilityLimits:
    """From when a recording and a rig file contradict each other, or a recording is too short."""

    speed: float = deciding(
        0.05,
        of="nominal speed of the rig file",
        meaning="difference of the measured speed from which it is said",
        source="not derived: the change of speed that starts a new wear segment",
    )
    ratio: float = deciding(
        0.02,
        of="tooth ratio",
        meaning="difference of the ratio of the encoders' speeds from which edges or tooth counts are wrong",
        source="not derived: a lost edge in fifty; tooth counts that differ by one differ by more on most pairs",
    )
    mesh_line: float = deciding(
        5.0,
        of="standard deviation of the line",
        meaning="amplitude from which a mesh line is there",
        source="convention: five standard deviations",
    )
    varied_load: float = deciding(
        FIT.least_load_range,
        of="mean torque",
        meaning="range of torques from which two loads were recorded",
        source="CalibrationFit.least_load_range",
    )
    least_worn: int = deciding(
        3,
        unit="windows",
        meaning="worn windows from which a wear rate follows",
        source="derivation: two give a rate, the third tests it",
    )


LIMITS = SuitabilityLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that was looked at."""

    level: str  # OK, NOTE or PROBLEM
    text: str
    remedy: str = ""  # what would be right; empty where nothing is to be done
    mistake: str = ""  # kind of likely mistake (twin/plausibility) that says the same, where it is found


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """A window with its features."""

    window: Window
    features: WindowFeatures


def findings(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits = LIMITS) -> tuple[Finding, ...]:
    """What windows and rig file say of each other."""
    rules = (_speed, _encoder_ratio, _encoder_edges, _mesh_lines, _band, _load, _length, _history, _left_out)
    return tuple(finding for rule in rules for finding in rule(rig, seen, limits))


def _speeds(seen: Sequence[Seen]) -> np.ndarray:
    return np.array([s.features.speed_hz for s in seen if s.features.speed_hz is not None])


def _teeth(rig: Rig) -> tuple[int, int] | None:
    try:
        return rig.teeth
    except NotAvailable:
        return None


def _speed(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    speeds, nominal = _speeds(seen), rig.get("operating.pinion_speed_hz")
    if not speeds.size:
        reasons = dict.fromkeys(s.features.unavailable.get("speed_hz", "no encoder") for s in seen)
        yield Finding(
            level=PROBLEM,
            text=f"no speed in any window: {'; '.join(reasons)}",
            remedy="a tachometer or an encoder; or tooth counts and nominal speed in the rig file, so that the mesh "
            "lines give the speed",
        )  # fmt: skip
        return
    sources = dict.fromkeys(s.features.angle_from for s in seen if s.features.angle_from)
    text = f"speed of the pinion {_range(speeds)} Hz, from {', '.join(map(str, sources))}"
    if nominal is None:
        yield Finding(level=OK, text=text)
        return
    operating = speeds[speeds > 0.5 * nominal] if np.any(speeds > 0.5 * nominal) else speeds
    off = float(np.median(operating)) / nominal - 1
    if abs(off) <= limits.speed:
        yield Finding(level=OK, text=f"{text}; nominal {nominal:g} Hz")
    else:
        yield Finding(
            level=NOTE,
            text=f"{text}; the rig file's nominal speed is {nominal:g} Hz",
            remedy="another speed is no fault; if it is not the machine's: pulses a turn, sampling rate, rpm for Hz?",
        )


def _encoder_speed(edges: Edges) -> float | None:
    known = np.flatnonzero(np.isfinite(edges.times))
    if known.size < 2:
        return None
    first, last = int(known[0]), int(known[-1])
    return (last - first) / edges.per_rev / float(edges.times[last] - edges.times[first])


def _encoder_ratio(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    teeth = _teeth(rig)
    ratios = []
    for s in seen:
        speeds = [
            _encoder_speed(s.window.encoders[shaft]) for shaft in ("pinion", "gear") if shaft in s.window.encoders
        ]
        if len(speeds) == 2 and None not in speeds:
            ratios.append(speeds[0] / speeds[1])  # type: ignore[operator]
    if teeth is None or not ratios:
        return
    ratio, expected = float(np.median(ratios)), teeth[1] / teeth[0]
    if abs(ratio / expected - 1) <= limits.ratio:
        yield Finding(
            level=OK, text=f"the encoders turn in the ratio {ratio:.5g}; the tooth counts give {expected:.5g}"
        )
        return
    exchanged = abs(ratio * expected - 1) <= limits.ratio
    yield Finding(
        level=PROBLEM,
        text=f"the encoders turn in the ratio {ratio:.5g}, the tooth counts {teeth[0]}/{teeth[1]} give {expected:.5g}",
        remedy="the encoders of pinion and gear are exchanged" if exchanged else "edges a turn, or the tooth counts?",
        mistake="swapped",
    )


def _encoder_edges(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    teeth = _teeth(rig)
    if teeth is None:
        return
    for i, shaft in enumerate(("pinion", "gear")):
        counts = sorted({s.window.encoders[shaft].per_rev for s in seen if shaft in s.window.encoders})
        if not counts:
            continue
        resolved = int(USABLE_RATE * counts[0] / teeth[i])
        text = f"encoder/{shaft}: {counts[0]} edges a turn resolve {resolved} mesh harmonics"
        if resolved >= HARMONICS:
            yield Finding(level=OK, text=text)
        else:
            needed = -int(-HARMONICS * teeth[i] // USABLE_RATE)
            if counts[0] == 1:
                text = f"encoder/{shaft}: one pulse a turn"
            yield Finding(
                level=NOTE,
                text=f"{text}: it counts revolutions, but shows no transmission error",
                remedy=f"an encoder with at least {needed} edges a turn",
            )


def _mesh_lines(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    """Whether the accelerometer shows lines at tooth count times speed."""
    teeth, with_lines = _teeth(rig), [s.features for s in seen if s.features.acceleration is not None]
    if teeth is None or not with_lines:
        return
    clear = []
    for features in with_lines:
        assert features.acceleration is not None
        k, y, std = features.acceleration.mesh()
        clear.append(int(np.sum(np.abs(y[k <= MESH_BANDS]) > limits.mesh_line * std[k <= MESH_BANDS])))
    mesh = teeth[0] * float(_speeds(seen).max())
    share = int(np.median(clear))
    if share:
        yield Finding(
            level=OK, text=f"mesh frequency {mesh:.4g} Hz: {share} of its first {MESH_BANDS} harmonics are clear"
        )
        return
    yield Finding(
        level=PROBLEM,
        text=f"no line of the accelerometer stands out at the mesh frequency, {teeth[0]} teeth × "
        f"{mesh / teeth[0]:.4g} Hz = {mesh:.4g} Hz, or its harmonics",
        remedy="tooth counts, speed (pulses a turn) or sampling rate?",
        mistake="mesh",
    )


def _band(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    rates = {name: s.rate for one in seen for name, s in one.window.accelerations.items()}
    speeds, teeth, high = _speeds(seen), _teeth(rig), rig.band[1]
    for name, rate in sorted(rates.items()):
        usable = USABLE_RATE * rate
        if high > usable and rig.get("sensors.band_hz") is not None:
            yield Finding(
                level=NOTE,
                text=f"accel/{name}: sampled at {rate:g} Hz, usable to {usable:.4g} Hz; the rig file's band ends at "
                f"{high:g} Hz",
                remedy=f"sample at {high / USABLE_RATE:.4g} Hz or more, or end sensors.band_hz lower",
            )  # fmt: skip
        if not speeds.size or teeth is None:
            continue
        mesh = teeth[0] * float(speeds.max())
        harmonics = int(usable / mesh)
        text = (
            f"accel/{name}: sampled at {rate:g} Hz, {harmonics} mesh harmonics of {mesh:.4g} Hz below {usable:.4g} Hz"
        )
        if harmonics >= MESH_BANDS:
            yield Finding(level=OK, text=text)
        else:
            yield Finding(
                level=NOTE if harmonics else PROBLEM,
                text=f"{text}; {MESH_BANDS} are evaluated",
                remedy=f"sample at {MESH_BANDS * mesh / USABLE_RATE:.4g} Hz or more, behind an anti-aliasing filter",
            )


def _load(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    torques = np.array([s.features.torque_nm for s in seen if s.features.torque_nm is not None])
    nominal = rig.get("operating.input_torque")
    if not torques.size:
        if nominal is not None:
            yield Finding(
                level=NOTE,
                text=f"no torque is measured: the rig file's nominal {nominal:g} N·m is taken",
                remedy="a torque meter on the pinion's shaft",
            )
        return
    median = float(np.median(torques))
    text = f"torque {_range(torques)} N·m" + ("" if nominal is None else f"; nominal {nominal:g} N·m")
    contradiction = torque_contradiction(rig, median)
    if median < 0:
        yield Finding(
            level=PROBLEM, text=text, remedy="positive torque drives the pinion forward: polarity, or shaft?",
            mistake="polarity",
        )  # fmt: skip
    elif contradiction is not None:
        yield Finding(level=PROBLEM, text=contradiction, remedy="gain or unit of the torque meter, or another rig file")
    else:
        yield Finding(level=OK, text=text)


def _length(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    """How many turns a window holds against the periods of the pair."""
    teeth = _teeth(rig)
    turns = np.array([s.features.turns for s in seen if s.features.turns])
    if teeth is None or not turns.size:
        return
    gear_turn, hunting = teeth[1] / teeth[0], teeth[1] // gcd(*teeth)
    text = (
        f"{len(seen)} windows of {_range(turns)} pinion turns; one turn of the gear takes {gear_turn:.3g}, until the "
        f"same teeth meet again {hunting}"
    )
    if turns.min() >= gear_turn:
        yield Finding(level=OK, text=text)
    else:
        yield Finding(level=NOTE, text=text, remedy="record at least one turn of the gear in one piece, better five")


def _history(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    """Whether new gears, several loads and several stages of wear were recorded."""
    counted = np.array([s.features.revolutions for s in seen if s.features.revolutions is not None])
    if not counted.size:
        yield Finding(
            level=NOTE,
            text="no absolute count of revolutions: trends go over time, and there is no wear depth",
            remedy="a tachometer or encoder whose count goes on between recordings (first_edge_index of the mapping)",
        )
        return
    age = rig.gear_age
    counted = counted + age.revolutions
    new = sum(unworn(n, age.known) for n in counted.tolist())
    worn = counted.size - new
    of_new = f"{new} of new gears (first {NEWNESS.revolutions:.0f} turns), {worn} later"
    text = (
        f"windows at {counted.min():.0f} to {counted.max():.0f} revolutions: "
        f"{of_new if age.known else 'the age of the gears is not known'}"
    )
    remedies = []
    if not new:
        remedies.append(
            "a wear depth measured at a stop (`inspections`): no window is of new gears, so that what had worn before "
            "the first is not known"
        )
    if worn < limits.least_worn:
        remedies.append(f"at least {limits.least_worn} later windows: a wear rate needs them")
    yield Finding(level=NOTE if remedies else OK, text=text, remedy="; ".join(remedies))
    torques = np.array([s.features.torque_nm for s in seen if s.features.torque_nm is not None])
    if torques.size and np.ptp(torques) < limits.varied_load * abs(torques.mean()):
        yield Finding(
            level=NOTE,
            text=f"one load only ({_range(torques)} N·m): the compliance of the shafts is not measured",
            remedy="a run at a load that differs by a third or more",
        )


def _left_out(rig: Rig, seen: Sequence[Seen], limits: SuitabilityLimits) -> Iterator[Finding]:
    """What the features could not give, each reason once, and what was wrong with the data."""
    reasons: dict[str, int] = {}
    for s in seen:
        for reason in dict.fromkeys(s.features.unavailable.values()):
            reasons[reason] = reasons.get(reason, 0) + 1
    for reason, count in reasons.items():
        yield Finding(level=NOTE, text=f"{reason} ({count} of {len(seen)} windows)")
    faults: dict[tuple[str, str], list[str]] = {}
    for s in seen:
        for fault in s.window.faults:
            if fault.action in ("degraded", "refused"):
                faults.setdefault((fault.channel, fault.kind), []).append(fault.detail)
    for (channel, kind), details in faults.items():
        said = f": {details[0]}" if details[0] else ""
        yield Finding(level=PROBLEM, text=f"{channel}: {kind} in {len(details)} of {len(seen)} windows{said}")


def _range(values: np.ndarray) -> str:
    """A range as text, one number where it is narrow."""
    low, high = float(values.min()), float(values.max())
    return f"{low:.4g}" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.4g} to {high:.4g}"
