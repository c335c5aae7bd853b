"""One machine of each kind on a board, as its page is tested and looked at."""

from __future__ import annotations

import json
from dataclasses import dataclass

import service_fakes as fakes

from service.contract.parts import EncoderPair
from tests.claims.test_encoder_pair import counted
from twin.encoder_pair.assessing import assess_pair
from twin.rig import Rig
from twin.windows import Window


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """How a kind of machine is shown."""

    shown_as: str
    first: str  # heading of its first card


KINDS = {
    "model": Kind(shown_as="model", first="Largest wear depth"),
    "worn-out": Kind(shown_as="model", first="Largest wear depth"),
    "baseline": Kind(shown_as="baseline", first="Changes since the healthy baseline"),
    "encoders": Kind(shown_as="encoders", first="Gear ratio"),
    "level": Kind(shown_as="level", first="Vibration RMS"),
    "preliminary": Kind(shown_as="model", first="Largest wear depth"),
    "cracked": Kind(shown_as="model", first="Largest wear depth"),
    "retired": Kind(shown_as="model", first="Largest wear depth"),
    "asking": Kind(shown_as="model", first="Largest wear depth"),
}
WAITING = "waiting"  # an asset without any window

NOT_GIVEN = "the rig file does not give gears.module, gears.face_width"
SUDDEN = "the wear rate changed suddenly, 1 window ago"

LINES = {
    "frequency_hz": 39.597, "frequency_std_hz": 0.001, "order": 1.188, "part": 3, "geared": None, "spectrum": [],
    "sidebands": [{"channel": "ch11", "harmonic": 1, "multiple": 2, "amplitude": 1.1, "depth": 0.083}],
    "causes": [{"name": "mains of 50 Hz", "possible": False, "detail": "13.199 Hz"}],
}  # fmt: skip

MODULATION = {
    "channel": "accel/a1", "shaft": "pinion", "per_turn": 1, "frequency_hz": 24.48, "depth_percent": 18.87,
    "depth_std_percent": 0.11, "kind": "amplitude", "possible_causes": "run-out or eccentricity of the pinion",
    "sidebands": [{"mesh_harmonic": 1, "mesh_amplitude": 1.95, "lower_amplitude": 0.15, "upper_amplitude": 0.16,
                   "depth_percent": 16.0, "depth_std_percent": 0.1}],
}  # fmt: skip

CHANGE = {
    "name": "tooth_crack", "label": "a cracked tooth", "parameters": {"tooth": {"value": 7, "unit": "", "std": None}},
    "evidence": {"log_evidence": 81.0, "over_runner_up": 30.0, "runner_up": "pitch_error", "detail": "once a turn",
                 "indistinguishable_from": ["pitch_error"]},
    "error_before": {"rms_percent": 40.0, "waveform_percent": 80.0},
    "error_after": {"rms_percent": 12.0, "waveform_percent": 30.0},
    "wear_depth_um_before": None, "wear_depth_um_after": None, "onset_revolutions": None, "channels": ["a4"],
    "windows": [3], "curves": {},
}  # fmt: skip


def status(level: str, reason: str, action: str) -> dict:
    finding = {"subject": "effect", "level": level, "reason": reason, "action": action}
    return {"level": level, "reasons": [reason], "action": action, "findings": [] if level == "normal" else [finding],
            "since": {"time": "2023-11-15T00:23:20.000000000Z", "revolutions": 1500.0}}  # fmt: skip


def show_machine(store, board, kind: str) -> None:
    """The machine under its kind's name, with a dozen windows."""
    made = {
        "model": _model, "worn-out": _worn_out, "baseline": _baseline, "encoders": _encoders, "level": _level,
        "preliminary": _preliminary, "cracked": _cracked, "retired": _retired, "asking": _asking,
    }  # fmt: skip
    made[kind](store, board)


def _model(store, board):
    fakes.campaign(store, board, "model")
    report = fakes.traced_report(19500.0, 12)
    report["effects"][1]["evidence"]["indistinguishable_from"] = ["mesh_stiffness_loss"]
    hours = [0.05 * k for k in range(1, 12)]
    report["rul"] |= {
        "distribution": {"probability": [0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95], "hours": hours,
                         "revolutions": [36000 * h for h in hours]},
        "date": {"median": "2023-11-16T10:00:00Z", "p05": "2023-11-15T18:00:00Z", "p95": "2023-11-18T02:00:00Z",
                 "since": "2023-11-15T00:23:20Z", "hours_per_day": 0.2, "source": "observed"},
    }  # fmt: skip
    report["status"] = status("watch", "Misalignment was found: lead gap 40 µm.", "Align the shafts at the next stop.")
    fakes.take(store, board, "model", 90, 19500.0, updated=True, report=report)


def _worn_out(store, board):
    fakes.campaign(store, board, "worn-out")
    report = fakes.report(22000.0, 12)
    report["rul"] |= {"reached": True, "hours": dict.fromkeys(("median", "p05", "p95"), 0.0)}
    report["status"] = status(
        "end_of_life", "The wear depth has reached 523.1 µm of 500.0 µm.", "STOP: replace the pair of gears."
    )
    fakes.take(store, board, "worn-out", 90, 22000.0, report=report)


def _preliminary(store, board):
    """At its limit by a figure that is preliminary."""
    fakes.campaign(store, board, "preliminary")
    report = fakes.report(22000.0, 12)
    left = {"median": 0.0, "p05": 0.0, "p95": 0.05}
    why = {"reasons": [SUDDEN], "remedies": ["record 2 more windows at this speed and load", "measure the wear depth"]}
    report["wear"] |= {"preliminary": why}
    report["rul"] |= {"reached": True, "hours": left, "preliminary": why}
    reason = (
        f"The wear depth has reached the end of life: 523.1 µm of 500.0 µm, but the figure is preliminary: {SUDDEN}."
    )
    report["status"] = status("watch", reason, "Measure the wear depth at the next stop.")
    fakes.take(store, board, "preliminary", 90, 22000.0, report=report)


def _cracked(store, board):
    """A cracked tooth on a machine whose wear is far from its limit."""
    fakes.campaign(store, board, "cracked", windows=6)
    found = CHANGE | {
        "label": None, "channels": None, "onset_revolutions": 3000.0,
        "wear_depth_um_before": 33.0, "wear_depth_um_after": 33.0,
        "parameters": {"stiffness_loss": {"value": 0.532, "unit": "", "std": 0.044},
                       "tooth": {"value": 9.0, "unit": "", "std": 1.4e-129}},
    }  # fmt: skip
    report = fakes.report(6000.0, 12) | {
        "effects": [found],
        "status": status("alarm", "A cracked tooth was found: tooth 9.", "Stop the machine and inspect the teeth."),
    }
    fakes.take(store, board, "cracked", 90, 20000.0, report=report)


def show_waiting(store, board) -> None:
    """An asset that is known and has sent nothing."""
    store.keep_rig(WAITING, {"name": "new"})
    board.update(WAITING, rig={"name": "new"})


def _retired(store, board):
    fakes.campaign(store, board, "retired", windows=6)
    sent = {"since": "2023-11-16T08:00:00.000000000Z", "by": "A. Fitter", "note": "sold"}
    board.update("retired", retired=sent)


def _asking(store, board):
    fakes.campaign(store, board, "asking", windows=6)
    question = {
        "kind": "revolutions_fell", "text": "Gears replaced, or another machine?",
        "since": "2023-11-16T08:00:00.000000000Z",
        "detail": "The revolutions fall from 18,000 to 12.", "waiting": 4, "left_out": 0,
        "answers": ["gears_replaced", "counter_reset", "other_machine", "ignore"],
    }  # fmt: skip
    report = fakes.report(6000.0, 12)
    report["status"] = status("no_verdict", question["text"], "Answer the open question: windows wait for it.")
    board.update("asking", report=report, question=question)


def _poor(store, board, name: str, given: dict, windows: int = 12) -> None:
    for index in range(windows):
        fakes.take(store, board, name, index, 900.0 * (index + 1), report=fakes.little_known_report() | given)


def _baseline(store, board):
    known = {
        "baseline": {"recordings": ["h0", "h20", "h40", "h60"],
                     "operating_points": {"torque": {"from": 0.0, "to": 40.0}}, "shafts": [1.0, 0.4],
                     "channels": ["a1", "a4"],
                     "sufficiency": {"recordings": 4, "recordings_needed": 5, "load_percent": [0, 40],
                                     "not_judged": [{"what": "teeth", "reason": "4 of at least 5 recordings"}]}},
        "effects": [CHANGE],
        "unexplained": {"share_percent": 0.4, "orders": [], "verdict": "insufficient_data",
                        "reason": "4 of at least 5 recordings", "limit_percent": 30.0},
        "status": status("alarm", "A cracked tooth was found in a4: tooth 7.", "STOP: inspect the teeth."),
    }  # fmt: skip
    _poor(store, board, "baseline", known)


def _encoders(store, board):
    pinion, gear = counted(1)
    window = Window(start_time_ns=1, encoders={"pinion": pinion, "gear": gear})
    pair = EncoderPair.of(assess_pair(Rig.from_mapping({}), window, 0)).as_json()
    found = status("normal", "The encoders' ratio agrees with the rig file.", "No action needed.")
    _poor(store, board, "encoders", {"pair": json.loads(json.dumps(pair)), "status": found}, 3)


def _level(store, board):
    found = status("no_verdict", f"The machine cannot be judged: wear is not available: {NOT_GIVEN}.",
                   "Add a rig file or a healthy baseline.")  # fmt: skip
    found["reasons"].append(f"The vibration is not explained yet: wear is not available: {NOT_GIVEN}.")
    _poor(store, board, "level", {"unattributed_lines": [LINES], "modulation": [MODULATION], "status": found})
