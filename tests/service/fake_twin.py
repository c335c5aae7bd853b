"""A twin with no physics: every figure is a plain function of the windows it was given, in their order.

Run as a program it is `gear-twin serve` with this twin in place of the real one, set by the environment.
"""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass, replace

import numpy as np

from service.__main__ import leave
from service.contract.estimate import Estimate
from service.runtime.serve import run
from service.runtime.twin_port import Twin
from service.settings import Settings
from twin.errors import NotAvailable

SLOW = float(os.environ.get("FAKE_TWIN_SECONDS", "0"))  # what one window costs [s]


@dataclass(frozen=True)
class FakeState:
    """What the fake remembers."""

    windows_seen: int = 0
    total: float = 0.0
    decided: tuple = ()  # every decision carried out, in order
    inspected: tuple = ()  # every depth inspected, in order [µm]

    def to_dict(self):
        return asdict(self)

    @classmethod
    def from_dict(cls, data):
        decided, inspected = tuple(tuple(d) for d in data["decided"]), tuple(data.get("inspected", ()))
        return cls(**{**data, "decided": decided, "inspected": inspected})


def step(rig, state, window, options):
    """Depth grows with revolutions; `total` is wrong if any window is missing, double or out of order."""
    time.sleep(SLOW)
    state = state if isinstance(state, FakeState) else FakeState()
    edges = window.encoders["pinion"]
    revolutions = (edges.first_index + edges.times.size / 2) / edges.per_rev
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
    report["effects"] = effects(state.decided)
    state = replace(state, windows_seen=seen, total=total)
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


TWIN = Twin(step=step, new_state=FakeState, load_state=FakeState.from_dict, decide=decide, inspect=inspect)

if __name__ == "__main__":
    leave(run(Settings(), twin=TWIN))
