"""The verdict on a recording beside its baseline, and what is said with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.assessment import RawLimit
from twin.baseline.findings import BaselineComparison
from twin.baseline.learned import Baseline
from twin.baseline.named import Named, majority
from twin.baseline.operating import DEFAULT as OPERATING
from twin.baseline.operating import UNITS
from twin.baseline.repeats import MISFIT
from twin.baseline.shaft_names import shaft_name
from twin.baseline.sufficiency import digits_apart, range_of, thin_for_teeth
from twin.thresholds import deciding

PATHS_OF_SENSORS = ("sensor_gain", "sensor_resonance")


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisThresholds:
    """When a comparison with the baseline is a verdict."""

    misfit: float = deciding(
        4.0, unit="variances", meaning="misfit of the lines to the healthy scatter that is an unidentified effect",
        source="convention: two standard deviations of every line; held-out healthy recordings have about 1",
    )  # fmt: skip
    nearer: float = deciding(
        0.98, of="waveform error before", meaning="waveform error on held-out turns that a named path must reach",
        source="convention: two per cent; what leaves the waveform as wrong as before is no finding",
    )  # fmt: skip
    nearly: float = deciding(
        0.6, of="evidence required", meaning="evidence of a shaft's lines from which a recording is not said to be "
        "explained", source="convention: a change should not pass from nothing to a finding at once",
    )  # fmt: skip
    least_reassembled: int = deciding(
        2, meaning="transfer paths that have changed at once that raise the question of a reassembly",
        source="derivation: one sensor is remounted by itself",
    )  # fmt: skip


DEFAULT = DiagnosisThresholds()


def verdict_of(
    baseline: Baseline,
    compared: Sequence[BaselineComparison],
    effects: Sequence[Named],
    misfit: float,
    nearly: str,
    spacings: str,
    limits: DiagnosisThresholds,
) -> tuple[str, str]:
    """Verdict and reason, the gravest first.

    nearly    what is near a change beside the lines of the shafts
    spacings  what is new of lines that no shaft makes
    """
    if not all(c.same_teeth for c in compared):
        correlation = min(c.expected.alignment.correlation for c in compared if c.expected.alignment is not None)
        return "unknown_effect", (
            f"the pattern of the teeth is not the baseline's (correlation {correlation:.2f}): other gears, another "
            "assembly, tooth counts that are not this machine's, or a fault that drowns it"
        )
    beyond = max(c.extrapolated for c in compared) ** 2
    if misfit > limits.misfit * beyond * baseline.repeats.factor(MISFIT):
        return "unknown_effect", f"the lines differ {misfit:.1f} times as much as healthy recordings do"
    unknown = next((e for e in effects if e.name == "unknown_effect"), None)
    if unknown is not None:
        return "unknown_effect", unknown.detail
    if spacings:
        return "unknown_effect", spacings
    near = nearly_believed(baseline, compared, limits) or nearly
    far = all(c.expected.beyond > OPERATING.far for c in compared)
    reasons = (beyond_range(baseline, compared[0]) if far else "", thin_for_teeth(baseline) or "", near)
    said = "; ".join(reason for reason in reasons if reason)
    return ("insufficient_data", said) if said else ("explained", "")


def with_raw_limit(verdict: str, reason: str, raw: RawLimit, effects: Sequence[Named]) -> tuple[str, str, RawLimit]:
    """Verdict and reason with the limit on raw RMS and kurtosis, which decides where nothing else has."""
    if not raw.exceeded or effects or verdict == "unknown_effect":
        return verdict, reason, raw
    measures = ", ".join(
        f"{'RMS' if m.name == 'rms' else m.name} of {m.channel} {m.value:.3g} (healthy {m.low:.3g} to {m.high:.3g})"
        for m in raw.exceeded
    )
    said = (
        f"the limit on raw levels alone decides: {measures}; no line, tooth or sensor that is compared shows what has "
        "changed"
    )
    return "unknown_effect", "; ".join(r for r in (said, reason) if r), replace(raw, decides_alone=True)


def nearly_believed(baseline: Baseline, compared: Sequence[BaselineComparison], limits: DiagnosisThresholds) -> str:
    """That lines of a shaft have nearly changed by as much as would be reported; empty where none have."""
    found = []
    for window in compared:
        believed = set(map(id, window.believed))
        near = [
            c
            for c in window.changes
            if id(c) not in believed and c.kind != "alike" and c.log_evidence > limits.nearly * window.least_evidence(c)
        ]
        found += [(c, window.least_evidence(c)) for c in near[:1]]
    if not majority(range(len(found)), len(compared)):
        return ""
    change, least = max(found, key=lambda item: item[0].log_evidence)
    return (
        f"the lines of the {shaft_name(change.shaft, baseline)} in {change.channel} differ from the baseline's by "
        f"{change.log_evidence:.0f} nat, where {least:.0f} are a change"
    )


def unnamed(paths: Sequence[Named]) -> str:
    """Changes of transfer paths that a baseline too thin for the teeth does not name; empty where there are none."""
    channels = [channel for path in paths for channel in path.channels]
    if not channels:
        return ""
    return (
        f"the transfer paths to {', '.join(channels)} differ from the baseline's: by a changed sensor, mount or gear, "
        "which cannot be distinguished yet"
    )


def beyond_range(baseline: Baseline, compared: BaselineComparison) -> str:
    """That a window's operating point lies outside the learned ones."""
    at = baseline.operating_point(compared.reading)
    here = ", ".join(
        f"{v:.{digits_apart(v, *baseline.range[axis])}g} {UNITS[axis]}"
        for axis, v in zip(baseline.axes, at, strict=True)
    )
    return (
        f"the operating point ({here}) lies beyond the baseline's ({range_of(baseline, at)}): "
        "another load or speed, or a wrong sampling rate; small effects would not be seen"
    )


def common_level(compared: Sequence[BaselineComparison]) -> str:
    """That all sensors have moved alike; empty where they have not."""
    paths = [p for c in compared for p in c.paths]
    common = max((p.common_power for p in paths), key=abs, default=0.0)
    if not paths or abs(common) <= paths[0].limits.least_common:
        return ""
    return (
        f"all sensors are at {np.exp(common):.2f} times the baseline's level for this operating point: a load for "
        "which the baseline does not hold, or the machine as a whole has changed"
    )


def reassembled(effects: Sequence[Named], compared: Sequence[BaselineComparison], limits: DiagnosisThresholds) -> str:
    """That several mounts have changed at once; empty where they have not."""
    changed = sorted({c for e in effects if e.name in PATHS_OF_SENSORS for c in e.channels})
    of = len(compared[0].expected.lines)
    if len(changed) < limits.least_reassembled or 2 * len(changed) <= of:
        return ""
    return (
        f"the transfer paths to {', '.join(changed)} have changed at once, {len(changed)} of {of}: was the machine "
        "reassembled or opened? Then the lines of the gears may have changed with it"
    )
