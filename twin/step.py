"""One measurement window in, one estimate out.

    state, estimate = step(rig, state, window)

No hidden memory: the same three things give the same answer. `State.to_dict()` is a checkpoint.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any

from twin import report
from twin.baseline.learned import Baseline
from twin.baseline.reporting import strangers_of, told_of
from twin.encoder_pair.reporting import pair_of
from twin.errors import NotAvailable, NotConverged, ParameterError, TwinError, WindowError
from twin.features.extract import extract
from twin.features.non_gear import non_gear_features
from twin.features.window_features import WindowFeatures
from twin.levels.relation import Relation
from twin.levels.reporting import NO_RATE, wear_by_level
from twin.rig import Rig
from twin.tracing.attribution_loop import LoopResult, attribute_window, listen
from twin.tracing.attribution_loop import decide as follow_decision
from twin.tracing.decisions import Decision
from twin.tracing.reporting import effects_report, tracing_report, unexplained_with
from twin.tracing.state import Tracing
from twin.updating.conditions import kind_of
from twin.updating.history import UpdateOptions, WindowInput, replay_history, update_window
from twin.updating.memory import Memory
from twin.updating.update import NEEDED, UpdateOutcome
from twin.windows import Window

UPDATES = ("fused", "rms")
LEVEL_FAULTS = ("clipping", "stuck")  # faults of an accelerometer that falsify its level
RATTLE = "the teeth part and strike: no steady mesh tells the depth, so neither it nor the life may be relied on"
RECENT = 3  # windows that `residual` speaks of


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How the twin is updated."""

    update: str = "fused"  # what sets the wear depth: the encoders ("fused") or the RMS ("rms")
    error_threshold: float = 0.05  # relative RMS error above which a window updates the twin (paper 4.2)
    update_until: float = inf  # pinion revolutions after which the twin only predicts
    trace: bool = True  # whether effects that the model lacks are sought and added
    baseline: Baseline | None = None  # what a machine without a model does when it is well
    relation: Relation | None = None  # of level and wear depth, for machines without a model

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
    tracing: Tracing = field(default_factory=Tracing)  # effects, with what they rest on

    def to_dict(self) -> dict[str, Any]:
        """The state as JSON-safe data."""
        return {
            "windows_seen": self.windows_seen,
            "memory": self.memory.to_dict(),
            "recent": [dict(r) for r in self.recent],
            "standing": dict(self.standing),
            "tracing": self.tracing.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> State:
        return cls(
            windows_seen=int(data["windows_seen"]),
            memory=Memory.from_dict(data["memory"]),
            recent=tuple(data["recent"]),
            standing=data["standing"],
            tracing=Tracing.from_dict(data.get("tracing", {})),
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
    pair = None if rig.has(*NEEDED) else pair_of(rig, window)
    if features.rms is None and features.speed_hz is None and (pair is None or "ratio" not in pair):
        reasons = [*features.unavailable.values(), *([] if pair is None else [pair["reason"]])]
        raise WindowError(f"the window tells neither level nor speed: {'; '.join(dict.fromkeys(reasons))}")
    taken = WindowInput(
        index=state.windows_seen,
        features=features,
        level_fault=_level_fault(window, features.sensor),
        non_gear=non_gear_features(rig, window) if options.trace else None,
    )
    try:
        outcome = update_window(rig, state.memory, taken, _taking(options))
    except (NotAvailable, NotConverged) as reason:
        return _without_twin(rig, state, taken, window, str(reason), options, pair)
    followed = LoopResult(tracing=state.tracing, outcome=outcome)
    if options.trace:
        followed = attribute_window(rig, state.tracing, taken, outcome, _taking(options))
    outcome = followed.outcome
    recent = _recent(rig, state.recent, ((taken, outcome),))
    if followed.again:
        recent = _recent(rig, (), followed.again)
    record = _record(rig, taken.index, features, outcome)
    if _rattles(followed.tracing):
        record |= dict.fromkeys(_OF_WEAR) | {"notes": [*record["notes"], RATTLE]}
    answer = _answer(rig, followed.tracing, recent, outcome)
    events: list[tuple[str, Mapping[str, Any]]] = [("window", record), *followed.events]
    if outcome.updated:
        events.append(("update", {k: record[k] for k in _UPDATE_FIELDS}))
    if outcome.kind == "measurement" and "revolutions" in answer["rul"]:
        events.append(("rul", answer["rul"]))
    estimate = _estimate(record, answer, events)
    state = State(
        windows_seen=taken.index + 1,
        memory=outcome.memory,
        recent=recent,
        standing=estimate.report,
        tracing=followed.tracing,
    )
    return state, estimate


def decide(rig: Rig, state: State, decision: Decision, options: Options = Options()) -> tuple[State, Estimate]:
    """Takes an engineer's decision about an effect; the estimate has no record of a window.

    Raises NotAvailable where it cannot be followed: nothing is traced yet, or the effect is not in the twin.
    """
    history = state.tracing.history
    if not history or not state.standing:
        raise NotAvailable("no effect can be decided on before the first window has been taken and traced")
    latest = history[-1]
    _, outcomes = replay_history(rig, state.memory.effects, history, _taking(options))
    known = [(t, o) for t, o in zip(history, outcomes, strict=True) if o is not None]
    if not known:
        raise NotAvailable(f"the history up to window {latest.index} has no steady state")
    outcome = replace(known[-1][1], memory=state.memory)
    followed = follow_decision(rig, state.tracing, decision, outcome, _taking(options))
    recent = _recent(rig, (), followed.again or tuple(known))
    answer = _answer(rig, followed.tracing, recent, followed.outcome)
    events = [*followed.events, ("effect", {"action": decision.verb, "name": decision.name, "window": latest.index})]
    estimate = _estimate({}, answer, events)
    return (
        replace(
            state,
            memory=followed.outcome.memory,
            recent=recent,
            standing=estimate.report,
            tracing=followed.tracing,
        ),
        estimate,
    )


def _taking(options: Options) -> UpdateOptions:
    return UpdateOptions(threshold=options.error_threshold, update=options.update, update_until=options.update_until)


def _recent(
    rig: Rig, before: tuple[Mapping[str, Any], ...], windows: Iterable[tuple[WindowInput, UpdateOutcome]]
) -> tuple[Mapping[str, Any], ...]:
    """The latest windows' residuals with more windows."""
    recent = before
    for taken, outcome in windows:
        if outcome.kind == "measurement":
            compared = report.comparison(taken.features, outcome, rig.teeth)
            if compared is not None:
                recent = (*recent, report.plain(compared))[-RECENT:]
    return recent


def _answer(
    rig: Rig, tracing: Tracing, recent: tuple[Mapping[str, Any], ...], outcome: UpdateOutcome
) -> dict[str, Any]:
    """The twin's present answer."""
    answer: dict[str, Any] = {
        "wear": report.wear_report(rig, outcome),
        "rul": report.rul_report(rig, outcome),
        "residual": report.residual_report(recent),
        "effects": effects_report(tracing),
        "unexplained": report.unexplained_report(recent, report.doubts(rig, outcome)),
        "calibration": report.calibration_report(rig, outcome.memory),
    }
    if _rattles(tracing):
        answer["wear"] = answer["rul"] = report.not_available(RATTLE)
    if tracing.history:
        answer["unexplained"] = unexplained_with(tracing, answer["unexplained"])
        answer["tracing"] = tracing_report(tracing)
    return answer


def _rattles(tracing: Tracing) -> bool:
    return any(found.addition.effect.facts.separates_teeth for found in tracing.found)


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


_OF_WEAR = ("k_wear_per_n", "wear_depth_um", "wear_depth_p05_um", "wear_depth_p95_um", "depth_from", "ways")
_UPDATE_FIELDS = ("index", "revolutions", "error_percent", "rms_after", "k_wear_per_n", "wear_depth_um")


def _record(rig: Rig, index: int, features: WindowFeatures, outcome: UpdateOutcome) -> dict[str, Any]:
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
        "depth_from": outcome.method,
        "ways": report.ways_report(rig, outcome),
        "contact_loss_percent": None if outcome.expectation is None else _percent(outcome.expectation.contact_loss),
        "notes": list(outcome.notes),
        "not_available": dict(features.unavailable),
    }


def _error_percent(predicted: float, measured: float | None) -> float | None:
    return None if measured is None else 100 * (predicted / measured - 1)


def _percent(share: float) -> float | None:
    return None if share != share else 100 * share


def _without_twin(
    rig: Rig,
    state: State,
    taken: WindowInput,
    window: Window,
    reason: str,
    options: Options,
    pair: Mapping[str, Any] | None,
) -> tuple[State, Estimate]:
    """What can be said where no model of the machine can be built, or the window lacks what it needs.

    Level, speed and bands, what two encoders tell of the pair, and what is new beside a baseline; of wear and life what
    earlier windows told, where there are any.
    """
    features = taken.features
    moving = pair if pair is not None and "ratio" in pair else None  # its speed is the mean through run-up and stop
    teeth = rig.get("gears.pinion.teeth")
    mesh_frequency = None if features.speed_hz is None or teeth is None else features.speed_hz * teeth
    record = {
        "index": state.windows_seen,
        "kind": kind_of(features, rig),
        "start_time_ns": features.start_time_ns,
        "revolutions": features.revolutions,
        "speed_hz": features.speed_hz if moving is None else moving["speed_hz"]["mean"],
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
        "mesh_frequency_hz": mesh_frequency,
        "mesh_bands": None if features.mesh_bands is None else list(features.mesh_bands),
        "notes": [reason, *_contradicted(moving)],
        "not_available": dict(features.unavailable),
    }
    missing = report.not_available(reason)
    residual: dict[str, Any] = missing
    if features.mesh_bands is not None and mesh_frequency is not None:
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
    standing = state.standing
    if options.relation is not None:
        wear = _by_level(options.relation, rig, features, state)
        answer |= {"wear": wear, "rul": report.not_available(NO_RATE)}
        standing = {**standing, **report.plain({"wear": wear, "rul": answer["rul"]})}
        if "max_depth_um" in wear:
            record["wear_depth_um"] = wear["max_depth_um"]["combined"]["median"]
    events: list[tuple[str, Mapping[str, Any]]] = [("window", record)]
    tracing = state.tracing
    if options.trace and features.speed_hz is not None:
        tracing, told = listen(rig, tracing, taken)
        events += told
        if not tracing.stages:
            answer["effects"] = effects_report(tracing)
            answer["unexplained"] = unexplained_with(tracing, answer["unexplained"])
            answer["tracing"] = tracing_report(tracing)
    if pair is not None and (moving is not None or "pair" not in standing):
        told_pair = report.plain({"window": state.windows_seen, **pair})
        answer["pair"] = told_pair
        standing = {**standing, "pair": told_pair} if moving is not None else standing
    if options.baseline is not None and not tracing.stages:
        new, found = _beside(options.baseline, rig, window, state, effects_report(tracing))
        answer |= new
        events += found
        standing = {**standing, **report.plain(new)}
    elif options.trace and not tracing.stages:
        try:
            new = strangers_of(rig, window, f"window {state.windows_seen}")
        except TwinError:  # the record says already why there is no speed
            new = {}
        answer |= new
    estimate = _estimate(record, answer, events)
    return replace(state, windows_seen=state.windows_seen + 1, tracing=tracing, standing=standing), estimate


def _contradicted(pair: Mapping[str, Any] | None) -> list[str]:
    """That the encoders contradict the rig file's ratio, where they do."""
    stated = None if pair is None else pair["stated"]
    if pair is None or stated is None or not stated["contradicted"]:
        return []
    ratio = pair["ratio"]
    return [f"the encoders' ratio {ratio['value']:.4f} ± {ratio['std']:.4f} contradicts {stated['from']}"]


def _by_level(relation: Relation, rig: Rig, features: WindowFeatures, state: State) -> dict[str, Any]:
    """`wear` by the relation of level and depth, or why it is not available."""
    try:
        return wear_by_level(relation, rig, features, state.standing.get("wear", {}), state.windows_seen)
    except NotAvailable as missing:
        return report.not_available(str(missing))


def _beside(
    baseline: Baseline, rig: Rig, window: Window, state: State, heard: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Any], list[tuple[str, Mapping[str, Any]]]]:
    """What a window holds beyond a baseline, and what of it is there for the first time.

    heard  effects that need no baseline
    """
    index = state.windows_seen
    try:
        told = told_of(baseline, rig, window, f"window {index}")
    except TwinError as fault:
        doubt: dict[str, Any] = {
            "share_percent": None,
            "orders": [],
            "verdict": "insufficient_data",
            "reason": str(fault),
        }
        return {"unexplained": doubt}, []
    names = {effect["name"] for effect in told["effects"]}
    told["effects"] = [*told["effects"], *(effect for effect in heard if effect["name"] not in names)]
    before = {_named(effect) for effect in state.standing.get("effects", ())}
    events: list[tuple[str, Mapping[str, Any]]] = [
        ("effect", {"action": "found", "name": effect["name"], "window": index, "evidence": effect["evidence"]})
        for effect in told["effects"]
        if _named(effect) not in before
    ]
    return told, events


def _named(effect: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """What makes two reports the same effect: its name and where it is seen."""
    return effect["name"], tuple(effect.get("channels", ()))
