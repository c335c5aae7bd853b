"""One measurement window in, one estimate out.

    state, estimate = step(rig, state, window)

No hidden memory: the same three things give the same answer. `State.to_dict()` is a checkpoint.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any

from twin import report
from twin.errors import NotAvailable, NotConverged, ParameterError, WindowError
from twin.features.extract import extract
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.updating.conditions import kind_of
from twin.updating.memory import Memory
from twin.updating.update import Outcome, take
from twin.windows import Window

UPDATES = ("fused", "paper")
LEVEL_FAULTS = ("clipping", "stuck")  # faults of an accelerometer that falsify its level
RECENT = 3  # windows that `residual` speaks of


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How the twin is updated."""

    update: str = "fused"  # what sets the wear depth: the encoders ("fused") or the RMS ("paper")
    error_threshold: float = 0.05  # relative RMS error above which a window updates the twin (paper 4.2)
    update_until: float = inf  # pinion revolutions after which the twin only predicts

    def __post_init__(self) -> None:
        if self.update not in UPDATES:
            raise ParameterError(f"update = {self.update!r} must be one of {', '.join(UPDATES)}")
        if not 0 < self.error_threshold < 1:
            raise ParameterError(f"error_threshold = {self.error_threshold} is outside (0, 1); percent?")
        if not self.update_until >= 0:
            raise ParameterError(f"update_until = {self.update_until} revolutions must not be negative")


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """What the twin remembers of a machine; plain serialisable data."""

    windows_seen: int = 0
    memory: Memory = field(default_factory=Memory)
    recent: tuple[Mapping[str, Any], ...] = ()  # the latest windows' residuals
    standing: Mapping[str, Any] = field(default_factory=dict)  # the answer, for windows that have none of their own

    def to_dict(self) -> dict[str, Any]:
        """The state as JSON-safe data."""
        return {
            "windows_seen": self.windows_seen,
            "memory": self.memory.to_dict(),
            "recent": [dict(r) for r in self.recent],
            "standing": dict(self.standing),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> State:
        return cls(
            windows_seen=int(data["windows_seen"]),
            memory=Memory.from_dict(data["memory"]),
            recent=tuple(data["recent"]),
            standing=data["standing"],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What one window told.

    record   the window's record, names of the contract's `windows[]` (JSON-safe)
    report   the twin's present answer: `wear`, `rul`, `residual`, `effects`, `unexplained`, … (JSON-safe)
    events   what happened: (kind, data) with kind `window`, `update`, `effect`, `rul` or `data_fault`
    """

    record: Mapping[str, Any]
    report: Mapping[str, Any]
    events: tuple[tuple[str, Mapping[str, Any]], ...] = ()


def step(rig: Rig, state: State, window: Window, options: Options = Options()) -> tuple[State, Estimate]:
    """Takes one window into the twin; raises WindowError where the window cannot be used at all.

    What the rig file or the channels do not allow is reported as not available, with the reason.
    """
    features = extract(rig, window)
    if features.rms is None and features.speed_hz is None:
        reasons = "; ".join(dict.fromkeys(features.unavailable.values()))
        raise WindowError(f"the window tells neither level nor speed: {reasons}")
    index = state.windows_seen
    try:
        outcome = take(
            rig,
            state.memory,
            features,
            index,
            threshold=options.error_threshold,
            update=options.update,
            update_until=options.update_until,
            level_fault=_level_fault(window, features.sensor),
        )
    except (NotAvailable, NotConverged) as reason:
        return _without_twin(rig, state, features, str(reason))
    recent = state.recent
    if outcome.kind == "measurement":
        compared = report.comparison(features, outcome, rig.teeth)
        if compared is not None:
            recent = (*recent, report.plain(compared))[-RECENT:]
    wear = report.wear_report(rig, outcome)
    rul = report.rul_report(rig, outcome)
    record = _record(rig, index, features, outcome)
    answer = {
        "wear": wear,
        "rul": rul,
        "residual": report.residual_report(recent),
        "effects": [],
        "unexplained": report.unexplained_report(recent, report.doubts(rig, outcome)),
        "calibration": report.calibration_report(rig, outcome.memory),
    }
    events: list[tuple[str, Mapping[str, Any]]] = [("window", record)]
    if outcome.updated:
        events.append(("update", {k: record[k] for k in _UPDATE_FIELDS}))
    if outcome.kind == "measurement" and "revolutions" in rul:
        events.append(("rul", rul))
    estimate = _estimate(record, answer, events)
    return State(windows_seen=index + 1, memory=outcome.memory, recent=recent, standing=estimate.report), estimate


def _level_fault(window: Window, sensor: str | None) -> str | None:
    """Why the level of the reference accelerometer may not be compared; None where it may."""
    for fault in window.faults:
        if fault.channel == f"accel/{sensor}" and fault.action == "degraded" and fault.kind in LEVEL_FAULTS:
            return f"{fault.channel}: {fault.kind}, {fault.detail}"
    return None


def _estimate(record: Mapping[str, Any], answer: Mapping[str, Any], events) -> Estimate:
    return Estimate(
        record=report.plain(record),
        report=report.plain(answer),
        events=tuple((kind, report.plain(data)) for kind, data in events),
    )


_UPDATE_FIELDS = ("index", "revolutions", "error_percent", "rms_after", "k_wear_per_n", "wear_depth_um")


def _record(rig: Rig, index: int, features: WindowFeatures, outcome: Outcome) -> dict[str, Any]:
    low, high = outcome.depth_band
    return {
        "index": index,
        "kind": outcome.kind,
        "start_time_ns": features.start_time_ns,
        "revolutions": features.revolutions,
        "speed_hz": features.speed_hz,
        "torque_nm": features.torque_nm,
        "rms_measured": features.rms,
        "rms_predicted": outcome.rms_predicted,
        "error_percent": _error_percent(outcome.rms_predicted, outcome.rms_measured),
        "updated": outcome.updated,
        "rms_after": outcome.rms_after,
        "error_after_percent": _error_percent(outcome.rms_after, outcome.rms_measured),
        "k_wear_per_n": report.wear_coefficient(rig, outcome),
        "wear_depth_um": outcome.depth * 1e6,
        "wear_depth_p05_um": low * 1e6,
        "wear_depth_p95_um": high * 1e6,
        "depth_from": outcome.way,
        "ways": report.ways_report(rig, outcome),
        "contact_loss_percent": None if outcome.expectation is None else _percent(outcome.expectation.contact_loss),
        "notes": list(outcome.notes),
        "not_available": dict(features.unavailable),
    }


def _error_percent(predicted: float, measured: float | None) -> float | None:
    return None if measured is None else 100 * (predicted / measured - 1)


def _percent(share: float) -> float | None:
    return None if share != share else 100 * share


def _without_twin(rig: Rig, state: State, features: WindowFeatures, reason: str) -> tuple[State, Estimate]:
    """What can be said where no model of the machine can be built, or the window lacks what it needs.

    Level, speed and bands; of wear and life what earlier windows told, where there are any.
    """
    record = {
        "index": state.windows_seen,
        "kind": kind_of(features, rig),
        "start_time_ns": features.start_time_ns,
        "revolutions": features.revolutions,
        "speed_hz": features.speed_hz,
        "torque_nm": features.torque_nm,
        "rms_measured": features.rms,
        "rms_predicted": None,
        "error_percent": None,
        "updated": False,
        "rms_after": None,
        "k_wear_per_n": None,
        "wear_depth_um": None,
        "speed_std_hz": features.speed_std_hz,
        "speed_from": features.angle_from,
        "mesh_frequency_hz": None if features.speed_hz is None else features.speed_hz * rig.teeth[0],
        "mesh_bands": None if features.mesh_bands is None else list(features.mesh_bands),
        "notes": [reason],
        "not_available": dict(features.unavailable),
    }
    missing = report.not_available(reason)
    residual: dict[str, Any] = missing
    if features.mesh_bands is not None and features.speed_hz is not None:
        mesh_frequency = features.speed_hz * rig.teeth[0]
        residual = {
            "rms_error_percent": None,
            "waveform_error_percent": None,
            "reason": reason,
            "bands": [
                {"harmonic": k, "frequency_hz": k * mesh_frequency, "measured": b, "predicted": None}
                for k, b in enumerate(features.mesh_bands, 1)
            ],
            "orders": [],
        }
    answer = {
        "wear": missing,
        "rul": missing,
        "residual": residual,
        "effects": [],
        "unexplained": {"share_percent": None, "orders": [], "verdict": "insufficient_data", "reason": reason},
        "calibration": missing,
        **state.standing,
    }
    state = replace(state, windows_seen=state.windows_seen + 1)
    return state, _estimate(record, answer, [("window", record)])
