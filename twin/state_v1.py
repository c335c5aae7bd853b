"""A state of schema version 1, brought to the present version: the one place that knows its names.

Version 1 kept the latest answer in the names and units of the interface contract (`standing`), the memory of the twin
in use twice, and what a trace had found as an untyped dictionary. Wear, life, residual, calibration, what is
unexplained, and the changes against a healthy baseline are carried over; the section of an encoder pair is made again
by the next window that shows the pair's motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from twin.updating.migration import migrate_memory_v1, migrate_window_input_v1

MICROMETRE, MILLIMETRE, PERCENT, HOUR, DEGREE = 1e-6, 1e-3, 0.01, 3600.0, 0.017453292519943295
METHODS = {"fused": "fused", "paper": "rms"}
SIGNS = {"strange": "unattributed"}


def migrated_state(data: Mapping[str, Any]) -> dict[str, Any]:
    """The dictionary of a `State` of the present version from one of version 1."""
    standing = data.get("standing") or {}
    memory = migrate_memory_v1(data["memory"])
    wear = standing.get("wear") or {}
    return {
        "windows_seen": data["windows_seen"],
        "recent": [_window_residual(r) for r in data["recent"]],
        "latest": _latest(standing),
        "levels": dict(wear.get("levels") or {}),
        "tracing": _tracing(data.get("tracing") or {}, memory),
    }


def _tracing(data: Mapping[str, Any], memory: dict[str, Any]) -> dict[str, Any]:
    """The attribution's memory; `memory` is that of the twin in use."""
    stages = [{**s, "memory": migrate_memory_v1(s["memory"])} for s in data.get("stages", [])]
    if stages:
        stages[-1]["memory"] = memory
    elif memory["track"]["windows"] or memory["segments"] or memory["fit"]:
        stages = [{"memory": memory, "depth": memory["depth"], "depths": [], "life": None}]
    elif not data:
        return {}
    names = ("measured", "next_search", "next_trace", "phase", "turns", "found", "decisions", "unknown")
    empty: dict[str, Any] = {
        "measured": 0,
        "next_search": 3,
        "next_trace": 3,
        "phase": None,
        "unknown": "",
        "decisions": {},
    }
    standing = data.get("standing") or {}
    pairs = [_errors(e) for e in data.get("errors", [])]
    return {
        **{name: data.get(name, empty.get(name, [])) for name in names},
        "history": [migrate_window_input_v1(t) for t in data.get("history", [])],
        "stages": stages,
        "signs": {SIGNS.get(name, name): value for name, value in data.get("signs", {}).items()},
        "refuted": {},  # what was refused is asked again
        "errors": [{"before": a, "after": b} for a, b in pairwise(pairs)],
        "error": pairs[-1] if pairs else None,
        "residual": _held_out_residual(data.get("residual")),
        "unattributed": [_line(line) for line in data.get("strange", [])],
        "latest": {
            "reason": standing.get("reason"),
            "candidates": standing.get("candidates", []),
            "other_structure": standing.get("other_structure", False),
            "misfit_before": standing.get("misfit_before"),
            "misfit_after": standing.get("misfit_after"),
            "held_out": standing.get("held_out", []),
            "fitted": standing.get("fitted", []),
            "skipped": [],
        },
        "log": [_event(entry) for entry in data.get("log", [])],
    }


def _latest(standing: Mapping[str, Any]) -> dict[str, Any]:
    """The parts of the latest answer that later windows may carry over."""
    compared = standing.get("baseline") is not None
    effects = [_baseline_effect(e) for e in standing.get("effects", [])] if compared else []
    residual = _available(standing.get("residual"), _residual)
    unexplained = standing.get("unexplained")
    parts = {
        "residual": residual,
        "effects": effects,
        "unexplained": _unexplained(unexplained) if unexplained else None,
        "baseline": None,
        "unattributed_lines": [],
    }
    whole = compared and parts["residual"] is not None and parts["unexplained"] is not None
    return {
        "wear": _available(standing.get("wear"), _wear),
        "life": _available(standing.get("rul"), _life),
        "residual": None if compared else residual,
        "unexplained": None if compared else parts["unexplained"],
        "calibration": _available(standing.get("calibration"), _calibration),
        "baseline": parts if whole else None,
        "encoder_pair": None,
    }


def _available(part: Mapping[str, Any] | None, convert) -> dict[str, Any] | None:
    """A part of the answer, or the reason why it is not available."""
    if not part:
        return None
    return {"reason": part["reason"]} if part.get("status") == "not available" else convert(part)


def _wear(wear: Mapping[str, Any]) -> dict[str, Any]:
    depths = wear["max_depth_um"]
    if wear.get("way") == "level":
        return {
            "depth": _interval(depths["combined"], MICROMETRE),
            "relation": _relation(wear["relation"]),
            "levels": wear["levels"],
            "reason": wear.get("reason"),
            "flank_reason": depths["pinion"]["reason"],
        }
    validity, profile = wear["validity"], wear["profile"]
    return {
        "wear_coefficient": wear["k_wear_per_n"],
        "specific_wear_rate": wear["specific_wear_rate_m2_per_n"],
        "dwell_time": wear["dwell_time_s"],
        "dwell_time_speed": wear["dwell_time_at_hz"],
        "depth": {flank: _interval(depths[flank], MICROMETRE) for flank in ("combined", "pinion", "gear")},
        "profile": {
            "path_position": _times(profile["path_position_mm"], MILLIMETRE),
            **{flank: _flank(profile[flank]) for flank in ("pinion", "gear")},
        },
        "method": wear["from"],
        "methods": _methods(wear["ways"]),
        "validity": {
            "contact_loss_from": _scaled(validity["contact_loss_from_um"], MICROMETRE),
            "steady_state_to": validity["steady_state_to_um"] * MICROMETRE,
            "valid": validity["valid"],
        },
    }


def _relation(relation: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "asset": relation["asset"],
        "causes": relation["causes"],
        "sensor": relation["sensor"],
        "band": relation["band_hz"],
        "note": relation["note"],
    }


def _flank(flank: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "radius": _times(flank["radius_mm"], MILLIMETRE),
        "roll_angle": _times(flank["roll_angle_deg"], DEGREE),
        "depth": _times(flank["depth_um"], MICROMETRE),
    }


def _methods(ways: Mapping[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {"fused": None, "rms": None}
    for way, values in ways.items():
        own = {k: v for k, v in values.items() if not k.endswith("_um") and k != "k_wear_per_n"}
        own |= {"wear_coefficient": values["k_wear_per_n"], "depth": values["wear_depth_um"] * MICROMETRE}
        if way == "fused":
            own |= {
                "depth_std": _scaled(values["std_um"], MICROMETRE),
                "depth_from_lines": values["from_lines_um"] * MICROMETRE,
            }
        out[METHODS[way]] = own
    return out


def _life(rul: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "criterion": rul["criterion"],
        "limit": rul["max_depth_um"] * MICROMETRE,
        "reached": rul["reached"],
        "revolutions": _interval(rul["revolutions"]),
        "time": _interval(rul["hours"], HOUR),
        "speed": rul["speed_hz"],
        "torque": rul["torque_nm"],
    }


def _calibration(calibration: Mapping[str, Any]) -> dict[str, Any]:
    std = calibration["std_percent"]
    return {
        "source": calibration["from"],
        "values": calibration["values"],
        "std": None if std is None else {name: value * PERCENT for name, value in std.items()},
        "windows": calibration["windows"],
        "misfit": calibration.get("misfit"),
        "doubts": calibration.get("doubts", []),
        "compliance_scale": calibration.get("compliance_scale"),
        "mesh_phase": _scaled(calibration.get("mesh_phase_deg"), DEGREE),
        "path_lines_learned": calibration.get("path_lines_learned"),
        "mesh_stiffness": None,
    }


def _residual(residual: Mapping[str, Any]) -> dict[str, Any]:
    channels = residual.get("channels")
    return {
        "rms_error": _scaled(residual["rms_error_percent"], PERCENT),
        "waveform_error": _scaled(residual["waveform_error_percent"], PERCENT),
        "windows": residual.get("windows"),
        "bands": [_band(b) for b in residual["bands"]],
        "lines": [_line(line) for line in residual["orders"]],
        "channels": None
        if channels is None
        else {name: {k: v * PERCENT for k, v in errors.items()} for name, errors in channels.items()},
        "reason": residual.get("reason"),
    }


def _window_residual(residual: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "rms_error": residual["rms_error_percent"] * PERCENT,
        **{name: residual[name] for name in ("measured", "left", "noise", "phase_known")},
        "bands": [_band(b) for b in residual["bands"]],
        "lines": [_line(line) for line in residual["orders"]],
    }


def _unexplained(unexplained: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "verdict": unexplained["verdict"],
        "share": _scaled(unexplained["share_percent"], PERCENT),
        "lines": [_line(line) for line in unexplained["orders"]],
        "reason": unexplained.get("reason") or "",
    }


def _baseline_effect(effect: Mapping[str, Any]) -> dict[str, Any]:
    evidence = effect["evidence"]
    return {
        "name": effect["name"],
        "parameters": effect["parameters"],
        "evidence": {
            "log_evidence": evidence["log_evidence"],
            "runner_up": evidence["runner_up"],
            "over_runner_up": evidence["over_runner_up"],
            "indistinguishable_from": evidence["not_told_from"],
            "detail": evidence["detail"],
        },
        "status": effect.get("status"),
        "error_before": _errors(effect["error_before"]),
        "error_after": _errors(effect["error_after"]),
        "depth_before": None,
        "depth_after": None,
        "life_before": None,
        "life_after": None,
        "onset_revolutions": effect.get("onset_revolutions"),
        "channels": effect.get("channels", []),
        "windows": effect.get("windows", []),
        "curves": effect.get("curves", {}),
    }


def _errors(errors: Mapping[str, Any]) -> dict[str, Any]:
    names = {
        "rms": "rms_percent",
        "waveform": "waveform_percent",
        "noise": "noise_percent",
        "transmission_error": "transmission_error_percent",
    }
    return {
        **{name: _scaled(errors.get(old), PERCENT) for name, old in names.items()},
        "windows": errors.get("windows", []),
        "note": "",
    }


def _held_out_residual(residual: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if residual is None:
        return None
    return {
        "window": residual["window"],
        "bands": [_renamed(b) for b in residual["bands"]],
        "lines": [_renamed(line) for line in residual["orders"]],
    }


def _event(entry: Mapping[str, Any]) -> dict[str, Any]:
    evidence = None
    if "log_evidence" in entry:
        evidence = {
            "log_evidence": entry["log_evidence"],
            "runner_up": entry.get("runner_up"),
            "over_runner_up": entry.get("over_runner_up"),
            "indistinguishable_from": [],
            "detail": "",
        }
    return {
        "action": entry["action"],
        "name": entry["name"],
        "window": entry.get("window"),
        "revolutions": entry.get("revolutions"),
        "parameters": entry.get("parameters"),
        "evidence": evidence,
        "onset_revolutions": entry.get("onset_revolutions"),
    }


def _band(band: Mapping[str, Any]) -> dict[str, Any]:
    return {"predicted_before": None, "channel": None, **_renamed(band)}


def _line(line: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "order": line["order"],
        "frequency": line["frequency_hz"],
        "share": _scaled(line.get("share_percent"), PERCENT),
        "kind": line.get("kind", ""),
    }


def _renamed(values: Mapping[str, Any]) -> dict[str, Any]:
    return {"frequency" if name == "frequency_hz" else name: value for name, value in values.items()}


def _interval(band: Mapping[str, Any], unit: float = 1.0) -> dict[str, Any]:
    return {name: _scaled(band[name], unit) for name in ("median", "p05", "p95")}


def _times(values: list[float], unit: float) -> list[float]:
    return [value * unit for value in values]


def _scaled(value: float | None, unit: float) -> float | None:
    return None if value is None else value * unit
