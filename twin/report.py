"""The twin's answer about a machine, in the names of the interface contract; JSON-safe data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import pi
from typing import Any

import numpy as np

from twin.errors import NotAvailable
from twin.features.window_features import WindowFeatures
from twin.geometry import GearPair
from twin.geometry.involute import roll_angle
from twin.model import Calibration
from twin.rig import Rig
from twin.updating.calibration import outliers
from twin.updating.memory import Memory
from twin.updating.remaining_life import remaining_life
from twin.updating.update import UpdateOutcome, reference_rate
from twin.wear.archard import pinion_share, specific_wear_rate
from twin.wear.curve import LINES
from twin.wear.profile import WornProfile

MICRO = 1e6
DOUBTFUL_MISFIT = 4.0  # of the depth's fit: the lines twice as far off as their scatter
EXPLAINED_SHARE = 10.0  # percent of the energy left over below which a residual counts as explained
STRONGEST = 8
RMS_SPREAD = 0.35  # relative, of work and rate that rest on the RMS alone


def not_available(reason: str) -> dict[str, str]:
    """What stands where a quantity cannot be given."""
    return {"status": "not available", "reason": reason}


def plain(value: Any) -> Any:
    """The value as strict JSON data: numpy numbers unwrapped, tuples as lists, what is not finite as None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def band(median: float, low: float, high: float) -> dict[str, float]:
    return {"median": float(median), "p05": float(low), "p95": float(high)}


def wear_report(rig: Rig, outcome: UpdateOutcome) -> dict[str, Any]:
    """`wear`: coefficient, specific rate, largest depths and the profile of both flanks."""
    pair = outcome.model.mesh.pair
    share = pinion_share(pair)
    flanks = {"combined": 1.0, "pinion": share, "gear": 1 - share}
    low, high = outcome.depth_band
    K = wear_coefficient(rig, outcome)
    τ, f = rig.require("the wear coefficient", "wear.dwell_time", "operating.pinion_speed_hz")
    loss = outcome.curve.loss_from
    return {
        "k_wear_per_n": K,
        "dwell_time_s": τ,
        "dwell_time_at_hz": f,
        "specific_wear_rate_m2_per_n": specific_wear_rate(pair, K, τ, f),
        "max_depth_um": {
            name: band(outcome.depth * part * MICRO, low * part * MICRO, high * part * MICRO)
            for name, part in flanks.items()
        },
        "profile": profile_report(pair, outcome.curve.profile(outcome.depth), share),
        "from": outcome.method,
        "validity": {
            "contact_loss_from_um": None if loss is None else loss * MICRO,
            "steady_state_to_um": outcome.curve.valid_to * MICRO,
            "valid": bool(outcome.depth <= outcome.curve.valid_to and (loss is None or outcome.depth < loss)),
        },
        "ways": ways_report(rig, outcome),
    }


def wear_coefficient(rig: Rig, outcome: UpdateOutcome) -> float:
    """K [1/N] by the way in use."""
    rate = outcome.memory.rms_track.rate if outcome.method == "rms" else outcome.memory.track.rate
    return rate / reference_rate(rig)


def ways_report(rig: Rig, outcome: UpdateOutcome) -> dict[str, Any]:
    """Both ways of updating side by side."""
    reference = reference_rate(rig)
    out: dict[str, Any] = {}
    if outcome.estimate is not None:
        out["fused"] = {
            "k_wear_per_n": outcome.memory.track.rate / reference,
            "wear_depth_um": outcome.estimate.depth * MICRO,
            "std_um": outcome.estimate.std * MICRO,
            "from_lines_um": outcome.estimate.from_lines * MICRO,
            "misfit": outcome.estimate.misfit,
        }
    if outcome.rms_result is not None:
        out["paper"] = {
            "k_wear_per_n": outcome.memory.rms_track.rate / reference,
            "wear_depth_um": outcome.rms_depth * MICRO,
            "rms_predicted": outcome.rms_result.rms_predicted,
            "rms_after": outcome.rms_result.rms_after,
            "updated": outcome.rms_result.updated,
            "converged": outcome.rms_result.converged,
            "iterations": outcome.rms_result.iterations,
        }
    return out


def profile_report(pair: GearPair, profile: WornProfile, share: float) -> dict[str, Any]:
    """Depth of both flanks along the nominal path, by path position, radius and roll angle."""
    s = np.linspace(pair.path_start, pair.path_end, 65)
    depth, _ = profile.at(s)
    ρ = pair.curvature_radius(s)
    out: dict[str, Any] = {"path_position_mm": (s * 1e3).tolist()}
    for flank, rb, curvature, part in zip(("pinion", "gear"), pair.base_radius, ρ, (share, 1 - share), strict=True):
        radius = np.hypot(rb, curvature)
        out[flank] = {
            "radius_mm": (radius * 1e3).tolist(),
            "roll_angle_deg": np.degrees(roll_angle(radius, rb)).tolist(),
            "depth_um": (depth * part * MICRO).tolist(),
        }
    return out


def rul_report(rig: Rig, outcome: UpdateOutcome) -> dict[str, Any]:
    """`rul`: revolutions and hours to the rig's end-of-life criterion at the present condition."""
    end = rig.get("end_of_life.max_depth")
    if end is None:
        return not_available("remaining life is not available: the rig file gives no end_of_life.max_depth")
    track = outcome.memory.track
    if not (outcome.memory.rms_track.updates if outcome.method == "rms" else track.windows):
        return not_available("remaining life is not available: no worn window has been seen yet")
    if outcome.method == "rms":
        paper = outcome.memory.rms_track
        spread = RMS_SPREAD
        track = replace(
            track, work=paper.work, rate=paper.rate, var_work=(spread * paper.work) ** 2, cov=0.0,
            var_rate=(spread * paper.rate) ** 2,
        )  # fmt: skip
    common = 0.0
    if outcome.method != "rms" and outcome.estimate is not None and outcome.estimate.depth > 0:
        common = min(outcome.estimate.std / outcome.estimate.depth, 1.0)
    life = remaining_life(track, outcome.curve, outcome.memory.segments[-1].start_work, end, common)
    hours = 1 / (3600 * outcome.condition.speed_hz)
    return {
        "criterion": rig.get("end_of_life.criterion", "max_depth"),
        "max_depth_um": end * MICRO,
        "reached": life.reached,
        "revolutions": band(life.median, life.p05, life.p95),
        "hours": band(life.median * hours, life.p05 * hours, life.p95 * hours),
        "speed_hz": outcome.condition.speed_hz,
        "torque_nm": outcome.condition.torque,
    }


def comparison(features: WindowFeatures, outcome: UpdateOutcome, teeth: tuple[int, int]) -> dict[str, Any] | None:
    """One window's residual, line by line: energies, bands and what is left; None without acceleration lines."""
    lines, rms = features.acceleration, outcome.rms_measured
    if lines is None or rms is None:
        return None
    phase, speed = outcome.memory.phase, outcome.condition.speed_hz
    top = np.inf if features.band is None else features.band[1]
    measured = left = noise = 0.0
    orders = []
    for key, order, y, std in zip(lines.keys, lines.orders, lines.amplitudes, lines.std, strict=True):
        frequency = order * speed
        if not 0 < frequency <= top or key[0] > LINES:
            continue
        rest = y
        if key[1] == key[2] == 0 and key[0] > 0 and phase is not None:
            rest = y - outcome.lines[key[0] - 1] * np.exp(1j * key[0] * phase)
        measured += abs(y) ** 2
        left += abs(rest) ** 2
        noise += 2 * std**2
        orders.append((abs(rest) ** 2, order, frequency))
    bands = [
        {
            "harmonic": k,
            "frequency_hz": k * teeth[0] * speed,
            "measured": None if features.mesh_bands is None else features.mesh_bands[k - 1],
            "predicted": float(abs(outcome.lines[k - 1]) / np.sqrt(2)),
        }
        for k in range(1, 6)
        if features.mesh_bands is not None and k <= len(features.mesh_bands)
    ]
    orders.sort(reverse=True)
    return {
        "rms_error_percent": 100 * (outcome.rms_after / rms - 1),
        "measured": float(measured),
        "left": float(left),
        "noise": float(noise),
        "phase_known": phase is not None,
        "bands": bands,
        "orders": [
            {"order": float(o), "frequency_hz": float(f), "share_percent": float(100 * e / measured)}
            for e, o, f in orders[:STRONGEST]
        ],
    }


def residual_report(recent: tuple[Mapping[str, Any], ...]) -> dict[str, Any]:
    """`residual` over the latest windows, newest last."""
    if not recent:
        return not_available("the residual is not available: no measurement window has been compared yet")
    measured = sum(r["measured"] for r in recent)
    left = sum(r["left"] for r in recent)
    waveform = 100 * float(np.sqrt(left / measured)) if recent[-1]["phase_known"] else None
    return {
        "rms_error_percent": float(np.sqrt(np.mean([r["rms_error_percent"] ** 2 for r in recent]))),
        "waveform_error_percent": waveform,
        "windows": len(recent),
        "bands": recent[-1]["bands"],
        "orders": recent[-1]["orders"],
    }


def doubts(rig: Rig, outcome: UpdateOutcome) -> list[str]:
    """What speaks against the twin's picture of the machine, a sentence each."""
    out = [] if outcome.memory.fit is None else outliers(rig, outcome.memory.fit)
    estimate = outcome.estimate
    if estimate is not None and estimate.misfit > DOUBTFUL_MISFIT:
        out.append(
            f"the encoders' mesh lines miss the model by {np.sqrt(estimate.misfit):.1f} times what the rig file's "
            "tolerance allows: another structure, or an effect that the model lacks"
        )
    return out


def unexplained_report(recent: tuple[Mapping[str, Any], ...], doubted: list[str]) -> dict[str, Any]:
    """`unexplained`: what is left of the measured energy over the noise floor; explained only without doubts."""
    if not recent or not recent[-1]["phase_known"]:
        return {
            "share_percent": None, "orders": [], "verdict": "insufficient_data",
            "reason": "no window with the mesh phase known has been compared yet",
        }  # fmt: skip
    measured = sum(r["measured"] for r in recent)
    share = 100 * max(0.0, sum(r["left"] - r["noise"] for r in recent)) / measured
    reasons = list(doubted)
    if share >= EXPLAINED_SHARE:
        reasons.append("the lines that are left have not been traced to an effect")
    return {
        "share_percent": share,
        "orders": recent[-1]["orders"],
        "verdict": "insufficient_data" if reasons else "explained",
        "reason": "; ".join(reasons),
    }


def calibration_report(rig: Rig, memory: Memory) -> dict[str, Any]:
    """`calibration`: values with their relative uncertainty and what they rest on."""
    if memory.fit is None:
        try:
            prior = Calibration.prior(rig)
        except NotAvailable as missing:
            return not_available(str(missing))
        return {"from": "rig file", "values": prior.to_dict(), "std_percent": None, "windows": 0}
    fit = memory.fit
    return {
        "from": "windows",
        "values": fit.calibration.to_dict(),
        "std_percent": {name: 100 * value for name, value in fit.std.items()},
        "windows": fit.windows,
        "misfit": fit.misfit,
        "doubts": outliers(rig, fit),
        "compliance_scale": memory.compliance_scale,
        "mesh_phase_deg": None if memory.phase is None else memory.phase * 180 / pi,
        "path_lines_learned": len(memory.path),
    }
