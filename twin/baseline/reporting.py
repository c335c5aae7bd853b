"""Comparisons with a baseline as JSON-safe data, until the contract's models read the assessment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from twin.assessment import BaselineWindow, EffectAssessment, HeldOutErrors, SpectralLine, UnattributedLines
from twin.baseline.comparison import BaselineResult, compare_with_baseline, lines_without_shaft, tracked
from twin.baseline.comparison import described as described_of
from twin.baseline.learned import Baseline
from twin.rig import Rig
from twin.windows import Window


def told_of(baseline: Baseline, rig: Rig, window: Window, name: str) -> dict[str, Any]:
    result = compare_with_baseline(baseline, rig, [tracked(rig, window, name, baseline.shafts)])
    return sections(result) | {
        "baseline": described(baseline) | {"window": record(result.windows[0])},
        "strange": strange(result.unattributed_lines),
    }


def strangers_of(rig: Rig, window: Window, name: str) -> dict[str, Any]:
    found = lines_without_shaft(rig, window, name)
    if found is None:
        return {}
    out: dict[str, Any] = {"strange": strange(found.lines)}
    if found.unexplained is not None:
        out["unexplained"] = {
            "share_percent": None,
            "orders": _lines(found.unexplained.lines),
            "verdict": found.unexplained.verdict,
            "reason": found.unexplained.reason,
        }
    return out


def sections(result: BaselineResult) -> dict[str, Any]:
    residual = result.residual
    return {
        "residual": {
            "rms_error_percent": _percent(residual.rms_error),
            "waveform_error_percent": _percent(residual.waveform_error),
            "channels": {
                name: {
                    "waveform_before": 100 * e.waveform_before,
                    "waveform_after": 100 * e.waveform_after,
                    "rms_before": 100 * e.rms_before,
                    "rms_after": 100 * e.rms_after,
                }
                for name, e in (residual.channels or {}).items()
            },
            "bands": [
                {
                    "channel": b.channel,
                    "harmonic": b.harmonic,
                    "frequency_hz": b.frequency,
                    "measured": b.measured,
                    "predicted_before": b.predicted_before,
                    "predicted": b.predicted,
                }
                for b in residual.bands
            ],
            "orders": _lines(residual.lines),
        },
        "effects": [_effect(e) for e in result.effects],
        "unexplained": {
            "share_percent": _percent(result.unexplained.share),
            "orders": _lines(result.unexplained.lines),
            "verdict": result.unexplained.verdict,
            "reason": result.unexplained.reason,
        },
    }


def strange(found: Sequence[UnattributedLines]) -> list[dict[str, Any]]:
    return [
        {
            "window": s.window,
            "order": s.order,
            "order_std": s.order_std,
            "frequency_hz": s.frequency,
            "frequency_std_hz": s.frequency_std,
            "part": s.part,
            "geared": s.geared,
            "clearness": s.clearness,
            "next_clearness": s.next_clearness,
            "sidebands": [
                {
                    "channel": b.channel,
                    "harmonic": b.harmonic,
                    "multiple": b.multiple,
                    "amplitude": b.amplitude,
                    "depth": b.depth,
                }
                for b in s.sidebands
            ],
            "spectrum": [
                {
                    "channel": e.channel,
                    "harmonic": e.harmonic,
                    "from_hz": e.start,
                    "step_hz": e.step,
                    "amplitude": list(e.amplitude),
                }
                for e in s.spectrum
            ],
            "causes": [{"name": c.name, "possible": c.possible, "detail": c.detail} for c in s.causes],
        }
        for s in found
    ]


def described(baseline: Baseline) -> dict[str, Any]:
    found = described_of(baseline)
    return {
        "recordings": list(found.recordings),
        "operating_points": {axis: {"from": low, "to": high} for axis, (low, high) in found.operating_points.items()},
        "shafts": list(found.shafts),
        "channels": list(found.channels),
    }


def record(window: BaselineWindow) -> dict[str, Any]:
    return {
        "index": window.index,
        "name": window.name,
        "start_time_ns": window.start_time_ns,
        "speed_hz": window.speed,
        "speed_std_hz": window.speed_std,
        "speed_from": window.speed_source,
        "torque_nm": window.torque,
        "between": list(window.between),
        "interpolated": window.interpolated,
        "pattern_correlation": window.pattern_correlation,
        "same_teeth": window.same_teeth,
    }


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _lines(lines: Sequence[SpectralLine]) -> list[dict[str, Any]]:
    return [
        {"order": line.order, "frequency_hz": line.frequency, "share_percent": _percent(line.share)} for line in lines
    ]


def _errors(errors: HeldOutErrors) -> dict[str, Any]:
    return {"rms_percent": _percent(errors.rms), "waveform_percent": _percent(errors.waveform)}


def _effect(effect: EffectAssessment) -> dict[str, Any]:
    evidence = effect.evidence
    return {
        "name": effect.name,
        "channels": list(effect.channels),
        "parameters": {n: {"value": p.value, "unit": p.unit, "std": p.std} for n, p in effect.parameters.items()},
        "evidence": {
            "log_evidence": evidence.log_evidence,
            "over_runner_up": evidence.over_runner_up,
            "runner_up": evidence.runner_up,
            "not_told_from": list(evidence.indistinguishable_from),
            "detail": evidence.detail,
        },
        "error_before": _errors(effect.error_before),
        "error_after": _errors(effect.error_after),
        "wear_depth_um_before": None,
        "wear_depth_um_after": None,
        "onset_revolutions": None,
        "windows": list(effect.windows),
        "curves": {name: list(values) for name, values in effect.curves.items()},
    }
