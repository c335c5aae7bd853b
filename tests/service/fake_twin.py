"""A twin with no physics: every figure is a plain function of the windows it was given, in their order.

Run as a program it is `gear-twin serve` with this twin in place of the real one, set by the environment.
"""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from service.contract.answer import NO_WINDOW
from service.contract.estimate import Estimate
from service.contract.status import none_yet
from service.runtime.twin_port import Twin
from twin.errors import NotAvailable
from twin.fallen_count import CountFellError

FALL = 150.0  # turns of the pinion by which a count must fall to raise the question
JOINED = 0.5  # how long channels that nobody knows of are awaited by services of the tests: there are none [s]
SLOW = float(os.environ.get("FAKE_TWIN_SECONDS", "0"))  # what one window costs [s]
MOST = Path(os.environ.get("FAKE_TWIN_MOST", ""))  # a file that says how many windows of an asset are processed
DISK = os.environ.get("FAKE_TWIN_DISK", "")  # a pipe: while it is there, the folder of waiting windows does not answer


@dataclass(frozen=True)
class FakeFallen:
    """A count that has fallen."""

    revolutions: float
    refusals: int
    ignored: bool


@dataclass(frozen=True)
class FakeState:
    """What the fake remembers."""

    windows_seen: int = 0
    total: float = 0.0
    decided: tuple = ()  # every decision and every change carried out, in order
    inspected: tuple = ()  # every depth inspected, in order [µm]
    last: float = 0.0  # revolutions by the latest window
    offset: float = 0.0  # of the counter
    fallen: FakeFallen | None = None

    def to_dict(self):
        return asdict(self)

    @classmethod
    def from_dict(cls, data):
        decided, inspected = tuple(tuple(d) for d in data["decided"]), tuple(data.get("inspected", ()))
        fallen = data.get("fallen")
        fallen = fallen and FakeFallen(**fallen)
        return cls(**{**data, "decided": decided, "inspected": inspected, "fallen": fallen})


def step(rig, state, window, options):
    """Depth grows with revolutions; `total` is wrong if any window is missing, double or out of order."""
    time.sleep(SLOW)
    while MOST.is_file() and state.windows_seen >= int(MOST.read_text() or 0):
        time.sleep(0.05)
    state = state if isinstance(state, FakeState) else FakeState()
    edges = window.encoders["pinion"]
    revolutions = state.offset + (edges.first_index + edges.times.size / 2) / edges.per_rev
    before = state.fallen
    goes_on = before is not None and before.refusals > 1 and revolutions >= before.revolutions
    if revolutions < state.last - FALL or goes_on:
        fallen = FakeFallen(revolutions, 1 + (before.refusals if before else 0), bool(before and before.ignored))
        raise CountFellError("the count has fallen", replace(state, fallen=fallen), state.last)
    rms = float(np.sqrt(np.nanmean(window.accelerations["y6"].values ** 2)))
    seen = state.windows_seen + 1
    total = 0.75 * state.total + rms * seen
    depth = 0.026 * revolutions
    record = {
        "index": seen - 1,
        "kind": "measurement",
        "revolutions": revolutions,
        "speed_hz": 10.0,
        "torque_nm": float(np.nanmean(window.torques["pinion"].values)),
        "rms_measured": rms,
        "rms_predicted": total,
        "error_percent": 100 * (total - rms) / rms,
        "updated": seen % 3 == 0,
        "rms_after": rms,
        "error_after_percent": float("nan"),  # what is not finite must not reach JSON
        "k_wear_per_n": 2.7e-6,
        "wear_depth_um": depth,
    }
    if rig.has("gears.module"):
        band = {"median": depth, "p05": 0.9 * depth, "p95": 1.1 * depth}
        wear = {"k_wear_per_n": 2.7e-6, "max_depth_um": {"combined": band}}
        rul = {"criterion": "max_depth", "hours": {"median": 1 / depth, "p05": 0.5 / depth, "p95": 2 / depth}}
    else:
        wear = rul = {"status": "not available", "reason": "the rig file does not give gears.module"}
    report = {"wear": wear, "rul": rul, "residual": {"rms_error_percent": float("inf")}, "effects": []}
    events = (("window", record), ("rul", rul))
    report["effects"], report["status"] = effects(state.decided), none_yet(NO_WINDOW)
    state = replace(state, windows_seen=seen, total=total, last=revolutions, fallen=None)
    return state, Estimate(record=record, report=report, events=events)


def effects(decided):
    """One effect, until it is rejected; its parameter counts the decisions."""
    rejected = [name for name, verb in decided if verb == "reject"]
    parameters = {"lead_gap": {"value": len(decided) * 1e-6, "unit": "m", "std": 1e-6}}
    return [] if "misalignment" in rejected else [{"name": "misalignment", "parameters": parameters}]


def decide(rig, state, decision, options):
    """Carries out any decision on a misalignment; no other effect is there, and one has a fault of the program."""
    time.sleep(SLOW)
    if decision.name == "tooth_crack":
        raise ZeroDivisionError("a fault")
    if decision.name != "misalignment":
        raise NotAvailable(f"{decision.name} is not in the twin")
    state = replace(state, decided=(*state.decided, (decision.name, decision.verb)))
    event = ("effect", {"action": decision.verb, "name": decision.name})
    return state, Estimate(record={}, report={"effects": effects(state.decided)}, events=(event,))


def inspect(rig, state, inspection, options):
    """Believes every inspection; `k_wear_per_n` counts them, and depths over 1000 µm are a fault of the program."""
    time.sleep(SLOW)
    depth = inspection["max_depth_um"]
    if depth > 1000:
        raise ZeroDivisionError("a fault")
    state = replace(state, inspected=(*state.inspected, depth))
    band = {"median": depth, "p05": depth - 1, "p95": depth + 1}
    compared = [{**inspection, "contradicts": depth > 500}]
    result = {"contradictions": ["The inspection contradicts."] * (depth > 500), "compared": compared}
    wear = {"k_wear_per_n": float(len(state.inspected)), "max_depth_um": {"combined": band}, "inspections": result}
    return state, Estimate(record={}, report={"wear": wear}, events=(("rul", {"hours": band}),))


def change(rig, state, made, options):
    """Replaced gears have no depth; a counter that was reset goes on; every change is listed as a decision is."""
    time.sleep(SLOW)
    state = replace(state, decided=(*state.decided, (made.kind, str(made.sensor))), fallen=None)
    if made.kind == "gears_replaced":
        state = replace(state, last=0.0, total=0.0)
    if made.kind == "counter_reset":
        state = replace(state, offset=state.last)
    missing = {"status": "not available", "reason": f"{made.kind}: no window since"}
    wear = missing if made.kind == "gears_replaced" else {"max_depth_um": {"combined": {"median": state.last}}}
    status = {"level": "no_verdict", "reasons": [made.kind], "findings": []}
    return state, Estimate(record={}, report={"wear": wear, "rul": missing, "effects": [], "status": status})


def ignore(state):
    """Windows of the fallen count are refused without asking again."""
    return state if state.fallen is None else replace(state, fallen=replace(state.fallen, ignored=True))


def forget(state):
    """The fallen count was another machine's."""
    return replace(state, fallen=None)


TWIN = Twin(
    step=step, new_state=FakeState, load_state=FakeState.from_dict, decide=decide, inspect=inspect,
    change=change, ignore=ignore, forget=forget,
)  # fmt: skip


if __name__ == "__main__":  # the service is not imported before: worker processes import this file
    from one_partition import serve

    from service.results import window_jobs

    def sync_folder(folder, real=window_jobs.sync_folder):
        """Waits for a disk that does not answer: a pipe that nobody reads."""
        if DISK and os.path.exists(DISK):
            with open(DISK, "wb"):
                real(folder)
        else:
            real(folder)

    window_jobs.sync_folder = sync_folder
    serve(TWIN, JOINED)
