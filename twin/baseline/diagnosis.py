"""Changes of a recording against the healthy baseline, by the names of the effect table, with errors before and after.

Effects are found on whole windows. Errors are those of held-out turns: on the first half of every window's turns the
baseline is aligned, and effects are found and fitted again; the second half is predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np

from twin.assessment import ChannelErrors, HarmonicBand, ParameterValue, RawLimit, SpectralLine
from twin.baseline.findings import BaselineComparison, ShaftChange, compare
from twin.baseline.known_spacings import new_spacings
from twin.baseline.learned import Baseline
from twin.baseline.left_over import left_over
from twin.baseline.load_direction import fall_with_load
from twin.baseline.low_frequency import LowFrequencyRival, low_frequency_rival
from twin.baseline.named import Named, majority
from twin.baseline.off_line_findings import changes_of, nearly_changed, off_lines_named
from twin.baseline.raw_limit import raw_limit
from twin.baseline.reading import WindowReading
from twin.baseline.repeats import EXCHANGED
from twin.baseline.sensor_findings import faults_named, known_faults, sensor_faults, timing_named, without
from twin.baseline.sensor_timing import corrected, timing_changes
from twin.baseline.shaft_names import LOCAL_ALTERNATIVES, names_of, shaft_name
from twin.baseline.sufficiency import thin_for_teeth
from twin.baseline.transfer_path import Path, name_of_path
from twin.baseline.turn_impact_findings import impacts_named, impacts_of, nearly_impacts
from twin.baseline.verdict import (
    DEFAULT,
    DiagnosisThresholds,
    common_level,
    reassembled,
    unnamed,
    verdict_of,
    with_raw_limit,
)
from twin.effects import EFFECTS
from twin.errors import NotAvailable

SIDEBANDS = 2.0  # orders on either side that belong to a mesh harmonic's band
BANDS = 5
PULSE_POINTS = 201  # over a turn, to be drawn
MESH_CHANGE = "mesh_change"  # what every tooth does alike: no baseline tells those effects from one another
LOW_FREQUENCY = "the low-frequency response of {}, which makes the healthy lines of this shaft these"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WindowParts:
    """One window's lines: of all its turns, and of either half where they are long enough."""

    whole: WindowReading
    first: WindowReading | None = None
    second: WindowReading | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Diagnosis:
    """A recording compared with its baseline."""

    compared: tuple[BaselineComparison, ...]
    effects: tuple[Named, ...]
    errors: Mapping[str, ChannelErrors]  # by channel, on held-out turns
    bands: tuple[HarmonicBand, ...]
    verdict: str  # explained, unknown_effect or insufficient_data
    reason: str
    raw: RawLimit  # raw RMS and kurtosis beside their limits
    share: float | None  # of the energy that is left over the healthy scatter
    lines: tuple[SpectralLine, ...]  # the strongest that are left

    def error(self, name: str, channels: Sequence[str] | None = None) -> float | None:
        """Root mean square of one of the errors over channels, all of them by default; None where there are none."""
        values = [getattr(e, name) for c, e in self.errors.items() if channels is None or c in channels]
        return float(np.sqrt(np.mean(np.square(values)))) if values else None


def diagnose(baseline: Baseline, windows: Sequence[WindowParts], limits: DiagnosisThresholds = DEFAULT) -> Diagnosis:
    """Findings over all windows of a recording; NotAvailable where its channels are not those of the baseline."""
    faults = [sensor_faults(baseline, w.whole) for w in windows]
    usable = [_each(w, partial(without, faults=found)) for w, found in zip(windows, faults, strict=True)]
    by_pattern = baseline.repeats.pattern_compared
    timing = [timing_changes(baseline, w.whole) if by_pattern else () for w in usable]
    measured = [w.whole for w in usable]
    usable = [_each(w, partial(corrected, changes=found)) for w, found in zip(usable, timing, strict=True)]
    for w in usable:
        pair = baseline.swapped(w.whole) if by_pattern else None
        if pair is not None and pair.over > baseline.repeats.factor(EXCHANGED):
            raise NotAvailable(
                f"{w.whole.name}: {' and '.join(pair.channels)} seem exchanged: the pattern of the teeth fits "
                "the baseline much better with each as the other; is the mapping right?"
            )
    compared = [compare(baseline, w.whole) for w in usable]
    thin = thin_for_teeth(baseline)
    errors, bands = _errors(baseline, usable)
    paths = [_if_nearer(path, errors, limits) for path in _paths(compared)]
    sensors = [*faults_named(baseline, faults), *timing_named(timing, measured, compared)]
    off_lines = changes_of(baseline, compared)
    known = [*sensors, *([] if thin else paths), *_shafts(baseline, compared)]
    impacts = impacts_of(baseline, compared, known)
    struck = impacts_named(baseline, compared, impacts, known)
    beside = [*struck, *off_lines_named(baseline, compared, off_lines, known, struck)]
    effects = [*(e for e in known if not _pulse_instead(e, beside)), *beside]
    share, misfit, lines = left_over(compared)
    near = "" if effects else nearly_impacts(baseline, compared, impacts) or nearly_changed(baseline, off_lines)
    given = [w.whole for w in windows]
    verdict, reason = verdict_of(baseline, compared, effects, misfit, near, new_spacings(baseline, given), limits)
    verdict, reason, raw = with_raw_limit(verdict, reason, raw_limit(baseline, given), effects)
    reasons = (
        reason, unnamed(paths if thin else []), common_level(compared), reassembled(effects, compared, limits),
        known_faults(baseline, faults),
    )  # fmt: skip
    return Diagnosis(
        compared=tuple(compared),
        effects=tuple(effects),
        errors=errors,
        bands=tuple(bands),
        verdict=verdict,
        reason="; ".join(r for r in reasons if r),
        raw=raw,
        share=share,
        lines=tuple(lines),
    )


def _pulse_instead(effect: Named, beside: Sequence[Named]) -> bool:
    """Whether lines of a shaft without a common angle come from impacts once a turn that were found by their band."""
    order = effect.parameters.get("shaft_order")
    return (
        order is not None
        and "angle" not in effect.parameters
        and any("shaft_order" in e.parameters and e.parameters["shaft_order"].value == order.value for e in beside)
    )


def _if_nearer(path: Named, errors: Mapping[str, ChannelErrors], limits: DiagnosisThresholds) -> Named:
    """A changed path by its name where that brings the waveform of held-out turns nearer, else as an unknown effect."""
    error = errors.get(path.channels[0])
    if error is None or error.waveform_after <= limits.nearer * error.waveform_before:
        return path
    return replace(
        path,
        name="unknown_effect",
        parameters={},
        indistinguishable_from=(path.name, *path.indistinguishable_from),
        detail=f"{path.detail}; with it the waveform of held-out turns is no nearer",
    )


def _each(window: WindowParts, change: Callable[[WindowReading], WindowReading]) -> WindowParts:
    """A window with a change of its readings."""
    first, second = (None if part is None else change(part) for part in (window.first, window.second))
    return WindowParts(whole=change(window.whole), first=first, second=second)


def _paths(compared: Sequence[BaselineComparison]) -> list[Named]:
    """Changed transfer paths."""
    out = []
    for channel in compared[0].expected.lines:
        paths = {i: p for i, c in enumerate(compared) for p in c.paths if p.channel == channel and p.changed}
        if not majority(list(paths), len(compared)):
            continue
        i, path = max(paths.items(), key=lambda item: item[1].change)
        named = name_of_path(path, compared[i].reading.speed_hz)
        others = ["another mount, cable or place of the sensor"]
        if len(compared[i].paths) == 1:
            others.append("the machine as a whole: a single sensor cannot separate it from its own transfer path")
        if not compared[i].expected.interpolated:
            others.append("a load or speed for which the baseline does not hold")
        out.append(
            Named(
                name=named.name,
                channels=(channel,),
                parameters={n: ParameterValue(value=v, unit=u, std=s) for n, (v, u, s) in named.parameters.items()},
                log_evidence=_path_evidence(compared[i], path),
                runner_up=None,
                over_runner_up=None,
                indistinguishable_from=tuple(others),
                detail=(
                    f"the transfer path to {channel} has changed for the lines of all shafts alike, by a factor of "
                    f"{np.exp(path.change):.2f} (rms; usual {np.exp(path.usual):.2f}); {100 * named.left:.0f} % of the "
                    "change is not explained by this name"
                ),
                windows=tuple(paths),
                curves={
                    "frequency": (path.orders * compared[i].reading.speed_hz).tolist(),
                    "gain": np.abs(path.gain).tolist(),
                    "fitted": named.fitted,
                },
            )
        )
    return out


def _path_evidence(compared: BaselineComparison, path: Path) -> float:
    """Evidence of a changed path in a channel's lines [nat]."""
    x, σ = compared.expected.lines[path.channel], compared.expected.std[path.channel]
    y = compared.reading.channels[path.channel].lines[: x.size]
    g = path.at(np.arange(1, x.size + 1) / compared.reading.period)
    gained = (np.abs(y - x) ** 2 - np.abs(y - g * x) ** 2) / σ**2
    return float(np.sum(gained) - path.gain.size)  # one nat for every band's complex gain


def _shafts(baseline: Baseline, compared: Sequence[BaselineComparison]) -> list[Named]:
    """Changes of single shafts, and of the mesh."""
    out = []
    for shaft in (*baseline.shafts, Fraction(int(baseline.rig.teeth[0]))):
        changes = {i: [c for c in w.believed if c.shaft == shaft] for i, w in enumerate(compared)}
        found = [i for i, cs in changes.items() if cs]
        if not majority(found, len(compared)):
            continue
        strongest = max((c for cs in changes.values() for c in cs), key=lambda c: c.log_evidence)
        channels = tuple(dict.fromkeys(c.channel for cs in changes.values() for c in cs))
        others = [c.log_evidence for w in compared for c in w.changes if c.shaft != shaft]
        rivals = {
            c.channel: None if c.kind == "alike" else low_frequency_rival(compared[i], c)
            for i, cs in changes.items()
            for c in cs
        }
        strongest_rival = rivals[strongest.channel]
        fall = fall_with_load(baseline, compared, list(changes.values()), strongest)
        kind = _against_load(_kind(baseline, shaft, strongest), fall)
        name, detail, alternatives = _against_sensors(kind, rivals)
        size = float(np.sqrt(0.5 * np.sum(np.abs(strongest.lines[strongest.strong]) ** 2)))
        out.append(
            Named(
                name=name,
                channels=channels,
                parameters=_parameters(strongest, size),
                log_evidence=strongest.log_evidence,
                runner_up="the same of another shaft"
                if strongest_rival is None
                else "a sensor's low-frequency response",
                over_runner_up=strongest.log_evidence
                - (max(others, default=0.0) if strongest_rival is None else strongest_rival.log_evidence),
                indistinguishable_from=alternatives,
                detail=detail,
                windows=tuple(found),
                curves=_pulse(strongest),
            )
        )
    return out


def _against_load(kind: tuple[str, str, tuple[str, ...]], fall: float | None) -> tuple[str, str, tuple[str, ...]]:
    """Name, description and alternatives, where the lines fall with load: no effect whose lines rise with it."""
    name, detail, alternatives = kind
    if fall is None or name not in EFFECTS or EFFECTS[name].signature.load != "rises":
        return kind
    label = EFFECTS[name].facts.label
    said = f"over the learned loads these lines fall to {fall:.2f} of their size, while those of {label} rise"
    return "unknown_effect", f"{detail}; {said}", (name, *alternatives)


def _against_sensors(
    kind: tuple[str, str, tuple[str, ...]], rivals: Mapping[str, LowFrequencyRival | None]
) -> tuple[str, str, tuple[str, ...]]:
    """Name, description and alternatives, beside a response of the sensors that explains the change as well.

    rivals  of every channel in which the change was found
    """
    name, detail, alternatives = kind
    explained = {channel: rival for channel, rival in rivals.items() if rival is not None}
    if len(explained) < len(rivals):
        return kind
    places = "; ".join(
        f"{channel}: {', '.join(f'{g:.2f} at {f:.1f} Hz' for g, f in zip(r.gain, r.frequencies, strict=True))}"
        for channel, r in explained.items()
    )
    others = (LOW_FREQUENCY.format(", ".join(explained)), name, *alternatives)
    return (
        "unknown_effect",
        f"{detail}; the healthy machine has these lines, too, and a smooth gain makes them these ({places}; "
        f"it leaves {100 * max(r.left for r in explained.values()):.0f} % of the change): a fault of the gears and a "
        "changed sensor cannot be distinguished",
        tuple(dict.fromkeys(o for o in others if o != "unknown_effect")),
    )


def _pulse(change: ShaftChange) -> dict[str, Sequence[float]]:
    """The added signal over one turn of the shaft, in the baseline's angle, by its strong lines."""
    turn = np.linspace(0, 1, PULSE_POINTS)
    n, δ = change.multiples[change.strong], change.lines[change.strong]
    return {"turn": turn.tolist(), "added": (np.exp(2j * np.pi * np.outer(turn + change.zero, n)) @ δ).real.tolist()}


def _parameters(change: ShaftChange, size: float) -> dict[str, ParameterValue]:
    """Place and size of a change."""
    std = size / float(np.median(change.ratio[change.strong]))
    out = {
        "shaft_order": ParameterValue(value=float(change.shaft), unit="", std=0.0),
        "rms": ParameterValue(value=size, unit="m/s²", std=std),
    }
    if change.kind == "local":
        out["angle"] = ParameterValue(value=change.angle, unit="turn", std=change.width / 4)
        out["width"] = ParameterValue(value=change.width, unit="turn", std=0.0)
    return out


def _kind(baseline: Baseline, shaft: Fraction, change: ShaftChange) -> tuple[str, str, tuple[str, ...]]:
    """Name, description, and alternatives that this comparison cannot exclude."""
    where = shaft_name(shaft, baseline)
    strong = ", ".join(f"{n * float(shaft):g}" for n in change.multiples[change.strong])
    names = names_of(change.kind, where)
    descriptions = {
        "alike": f"the mesh lines have changed and no shaft's lines: all teeth have changed alike (orders {strong})",
        "run_out": f"run-out of the {where} (order {strong})",
        "local": (
            f"once a turn of the {where}, at one angle (lines in phase to {change.in_phase:.2f}; orders {strong}; four "
            f"fifths of it within {change.width:.2f} of a turn): one tooth of that shaft, or a similar impact"
        ),
        "all_round": f"teeth all around the {where} have changed (orders {strong})",
        "few": f"few lines of the {where} have changed (orders {strong})",
    }
    described = descriptions[change.kind]
    if change.kind == "alike":
        return MESH_CHANGE, described, ("wear", *names)
    if not names:
        return "unknown_effect", f"{described}; no known effect has this signature there", ()
    return names[0], described, (*names[1:], *(LOCAL_ALTERNATIVES if change.kind == "local" else ()))


def _errors(baseline: Baseline, windows: Sequence[WindowParts]) -> tuple[dict[str, ChannelErrors], list[HarmonicBand]]:
    """Errors on the second halves of what was fitted on the first; and bands of the latest window."""
    sums: dict[str, np.ndarray] = {}
    bands: list[HarmonicBand] = []
    for parts in windows:
        if parts.first is None or parts.second is None:
            continue
        fitted = compare(baseline, parts.first)
        bands = []
        for channel, x in fitted.expected.lines.items():
            y = parts.second.channels[channel].lines[: x.size]
            x, after = x[: y.size], fitted.explained(channel)[: y.size]
            powers = np.abs(y) ** 2, fitted.expected.power[channel][: y.size], fitted.explained_power(channel)[: y.size]
            energies = [float(p.sum()) for p in (*powers, np.abs(y - x) ** 2, np.abs(y - after) ** 2)]
            sums[channel] = sums.get(channel, np.zeros(5)) + np.array(energies)
            bands += _bands(channel, powers, parts.second.period, baseline.rig.teeth[0], parts.second.speed_hz)
    out = {}
    for channel, (measured, before, after, off_before, off_after) in sums.items():
        out[channel] = ChannelErrors(
            waveform_before=float(np.sqrt(off_before / measured)),
            waveform_after=float(np.sqrt(off_after / measured)),
            rms_before=float(np.sqrt(before / measured) - 1),
            rms_after=float(np.sqrt(after / measured) - 1),
        )
    return out, bands


def _bands(channel: str, powers: Sequence[np.ndarray], period: int, z1: int, speed_hz: float) -> list[HarmonicBand]:
    """RMS of the mesh harmonics' bands, from powers measured, expected, and with what was found."""
    orders = np.arange(1, powers[0].size + 1) / period
    out = []
    for k in range(1, BANDS + 1):
        inside = np.abs(orders - k * z1) <= SIDEBANDS
        if inside.any():
            measured, expected, explained = (float(np.sqrt(0.5 * p[inside].sum())) for p in powers)
            out.append(
                HarmonicBand(
                    channel=channel,
                    harmonic=k,
                    frequency=k * z1 * speed_hz,
                    measured=measured,
                    predicted=explained,
                    predicted_before=expected,
                )
            )
    return out
