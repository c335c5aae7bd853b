"""What stands beside a baseline, in the names of the contract: JSON-safe but for NumPy's numbers."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from twin.baseline.causes import causes_of
from twin.baseline.diagnosis import Diagnosis, Named, Parts, diagnose, shaft_name
from twin.baseline.findings import BaselineComparison
from twin.baseline.learned import Baseline
from twin.baseline.reading import TURNS_PER_PERIOD, angle_of, read
from twin.baseline.spacing import Spacing, unattributed_spacing
from twin.errors import NotAvailable
from twin.features.angle import AngleTrack
from twin.rig import Rig
from twin.windows import Window

NO_DEPTH = "the rig file gives no model of the machine: a baseline tells what is new, not how deep the wear is"


def told_of(baseline: Baseline, rig: Rig, window: Window, name: str) -> dict[str, Any]:
    """What one window holds beyond the baseline: `residual`, `effects`, `unexplained`, `strange` and `baseline`.

    Raises TwinError where they cannot be compared.
    """
    if rig.teeth != baseline.rig.teeth:
        raise NotAvailable(f"the rig file has {rig.teeth} teeth, the baseline's {baseline.rig.teeth}: which are right?")
    track = angle_of(rig, window)
    found = diagnose(baseline, [parts_of(baseline, window, name, track)])
    spacing = unattributed_spacing(window.accelerations, track, rig.teeth, baseline.shafts)
    return sections(baseline, found) | {
        "baseline": described(baseline) | {"window": record(0, found.compared[0])},
        "strange": strange_of(baseline, [(name, spacing, track)]),
    }


def strangers_of(rig: Rig, window: Window, name: str) -> dict[str, Any]:
    """Lines of one window that neither gear makes: `strange`, and `unexplained` where no further shaft makes them.

    Nothing where there are none; raises TwinError where the pinion's angle cannot be told.
    """
    z1, z2 = rig.teeth
    shafts = (Fraction(1), Fraction(int(z1), int(z2)))
    track = angle_of(rig, window)
    spacing = unattributed_spacing(window.accelerations, track, rig.teeth, shafts)
    found = strange([(name, spacing, track)], shafts, ("pinion", "gear"))
    if spacing is None or not found:
        return {}
    if spacing.ratio is not None:
        return {"strange": found}
    orders: dict[float, dict[str, Any]] = {}
    for side in spacing.sidebands:
        for sign in (-1, 1) if side.harmonic else (1,):
            order = side.harmonic * z1 + sign * side.multiple * spacing.order
            line = {"order": order, "frequency_hz": order * track.speed, "share_percent": None}
            orders.setdefault(round(order, 6), line)
    unexplained = {
        "share_percent": None,
        "orders": list(orders.values()),
        "verdict": "unknown_effect",
        "reason": f"lines spaced by {spacing.order * track.speed:.3f} Hz belong to no shaft of the rig file",
    }
    return {"strange": found, "unexplained": unexplained}


def sections(baseline: Baseline, found: Diagnosis) -> dict[str, Any]:
    """`residual`, `effects` and `unexplained` of the contract."""
    return {
        "residual": {
            "rms_error_percent": _pooled(found, "rms_after"),
            "waveform_error_percent": _pooled(found, "waveform_after"),
            "channels": found.errors,
            "bands": list(found.bands),
            "orders": list(found.orders),
        },
        "effects": [_effect(e, found) for e in found.effects],
        "unexplained": {
            "share_percent": found.share_percent,
            "orders": list(found.orders),
            "verdict": found.verdict,
            "reason": found.reason,
        },
    }


def strange_of(baseline: Baseline, seen: Sequence[tuple[str, Spacing | None, AngleTrack]]) -> list[dict[str, Any]]:
    """Spacings of lines that no shaft of a baseline makes."""
    return strange(seen, baseline.shafts, [shaft_name(s, baseline) for s in baseline.shafts])


def parts_of(baseline: Baseline, window: Window, name: str, track: AngleTrack) -> Parts:
    """A window's lines, of all its turns and of either half."""
    rig, shafts = baseline.rig, baseline.shafts
    whole = read(rig, window, shafts, name, track)
    if whole.turns < 2 * TURNS_PER_PERIOD * whole.period:
        return Parts(whole=whole)
    halves = [read(rig, window, shafts, name, track, part) for part in ((0.0, 0.5), (0.5, 1.0))]
    return Parts(whole=whole, first=halves[0], second=halves[1])


def strange(
    seen: Sequence[tuple[str, Spacing | None, AngleTrack]], shafts: Sequence[Fraction], names: Sequence[str]
) -> list[dict[str, Any]]:
    """Spacings of lines that no known shaft makes, with the causes tried.

    seen  name, spacing and angle of every window
    """
    out = []
    for window, s, track in seen:
        if s is None or s.ratio in shafts:
            continue
        tried = causes_of(s.order / s.part, s.std / s.part, track.speed, shafts, names)
        out.append(
            {
                "window": window,
                "order": s.order,
                "order_std": s.std,
                "frequency_hz": s.order * track.speed,
                "frequency_std_hz": float(np.hypot(s.std * track.speed, s.order * track.speed_std)),
                "part": s.part,
                "geared": None if s.ratio is None else str(s.ratio),
                "clearness": s.score,
                "next_clearness": s.next_score,
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
                        "from_hz": e.start * track.speed,
                        "step_hz": e.step * track.speed,
                        "amplitude": [float(f"{a:.4g}") for a in e.amplitude],
                    }
                    for e in s.excerpts
                ],
                "causes": [{"name": c.name, "possible": c.possible, "detail": c.detail} for c in tried],
            }
        )
    return out


def described(baseline: Baseline) -> dict[str, Any]:
    """What a baseline was learned from."""
    return {
        "recordings": [r.name for r in baseline.readings],
        "operating_points": {axis: {"from": low, "to": high} for axis, (low, high) in baseline.range.items()},
        "shafts": [float(s) for s in baseline.shafts],
        "channels": sorted(baseline.std),
    }


def record(index: int, compared: BaselineComparison) -> dict[str, Any]:
    """A window beside a baseline."""
    reading, expected = compared.reading, compared.expected
    return {
        "index": index,
        "name": reading.name,
        "start_time_ns": reading.start_time_ns,
        "speed_hz": reading.speed_hz,
        "speed_std_hz": reading.speed_std_hz,
        "speed_from": reading.angle_from,
        "torque_nm": reading.torque_nm,
        "between": list(expected.between),
        "interpolated": expected.interpolated,
        "pattern_correlation": None if expected.alignment is None else expected.alignment.correlation,
        "same_teeth": compared.same_teeth,
    }


def _pooled(found: Diagnosis, name: str) -> float | None:
    values = [e[name] for e in found.errors.values()]
    return float(np.sqrt(np.mean(np.square(values)))) if values else None


def _effect(effect: Named, found: Diagnosis) -> dict[str, Any]:
    errors = [found.errors[c] for c in effect.channels if c in found.errors]

    def pooled(name: str) -> float | None:
        return float(np.sqrt(np.mean([e[name] ** 2 for e in errors]))) if errors else None

    return {
        "name": effect.name,
        "channels": list(effect.channels),
        "parameters": {n: {"value": v, "unit": u, "std": s} for n, (v, u, s) in effect.parameters.items()},
        "evidence": {
            "log_evidence": effect.log_evidence,
            "over_runner_up": effect.over_runner_up,
            "runner_up": effect.runner_up,
            "not_told_from": list(effect.not_told_from),
            "detail": effect.detail,
        },
        "error_before": {"rms_percent": pooled("rms_before"), "waveform_percent": pooled("waveform_before")},
        "error_after": {"rms_percent": pooled("rms_after"), "waveform_percent": pooled("waveform_after")},
        "wear_depth_um_before": None,
        "wear_depth_um_after": None,
        "onset_revolutions": None,
        "windows": list(effect.windows),
        "curves": {name: list(values) for name, values in effect.curves.items()},
    }
