"""What was true of a campaign: kept apart from its recording, for scoring only."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Any

import numpy as np

from recordings.generator.errors import SimulationError
from recordings.generator.machine import Condition, Machine
from recordings.generator.sensors import rms_below
from recordings.generator.wear import depths, profile

BAND = 2000.0  # of the RMS that is compared [Hz]
MARK = 25.0  # depths at which the age is noted on the way to the end of life [µm]


def window_truth(machine: Machine, record, clean, recorded, rate: float, cycles: float) -> dict[str, Any]:
    """What was true during one window.

    record (steps, 8) of `integrate.run`, clean and recorded acceleration at `rate` [Hz]; `cycles` rounds of
    all tooth pairs have been taken out of the angles.
    """
    rb = machine.pair.base_radius
    error = rb[0] * record[:, 2] - rb[1] * record[:, 3]
    force = record[:, 4]
    turned = record[:, 2] / (2 * pi) + cycles * machine.pair.teeth[1]
    return {
        "revolutions": float(turned[len(turned) // 2]),
        "speed_hz": float((turned[-1] - turned[0]) / (len(turned) - 1) / machine.dt),
        "torque_nm": float(record[:, 1].mean()),
        "rms_true": float(clean.std()),
        "rms_true_2k": rms_below(clean, rate, BAND),
        "rms_recorded": float(recorded.std()),
        "rms_recorded_2k": rms_below(recorded, rate, BAND),
        "mesh_force": {
            "mean": float(force.mean()),
            "rms": float(force.std()),
            "max": float(force.max()),
            "lost_contact_share": float((force == 0).mean()),
            "back_contact_share": float((record[:, 5] > 0).mean()),
        },
        "transmission_error_mean_um": float(error.mean() * 1e6),
        "transmission_error_pp_um": float(np.ptp(error) * 1e6),
    }


def whole_truth(spec: dict[str, Any], machine: Machine, windows: list[dict[str, Any]]) -> dict[str, Any]:
    """The truth of a campaign up to its last window."""
    meta = ("name", "onset_revolutions", "full_revolutions")
    return {
        "asset": spec["asset"],
        "seed": spec["seed"],
        "effects": [
            {
                "name": e["name"],
                "onset_revolutions": e["onset_revolutions"],
                **({"full_revolutions": e["full_revolutions"]} if e["full_revolutions"] else {}),
                "parameters": {k: v for k, v in e.items() if k not in meta},
            }
            for e in spec["effects"]
        ],
        "conditions": [[c["speed_hz"], c["torque_nm"]] for c in spec["conditions"]],
        "wear": {
            **spec["wear"],
            "law": "equal depth per contact on both flanks",
            "definition": "depth per pass = k * (F/W) * |v_slide| / (omega1*rb1)",
        },
        "plant": {
            "mesh_stiffness_scale": machine.stiffness_scale,
            "mesh_damping_time": machine.damping_time,
            "natural_frequencies_without_mesh_hz": (machine.structure.frequency / (2 * pi)).tolist(),
            "damping_ratios": machine.structure.damping_ratio.tolist(),
            "step_rate_hz": 1 / machine.dt,
            "slices": machine.slices,
        },
        "instruments": spec["sensors"],
        "faults": [dict(f) for f in spec["faults"]],
        "windows": windows,
        "final": depths(machine),
        "profile": profile(machine),
    }


def end_of_life(
    machine: Machine, wear_to: Callable[[float], None], age: float, limit: float, condition: Condition
) -> dict[str, Any]:
    """Wears on until the combined depth reaches the limit [m]: at which age, and marks on the way."""
    limit_um, passed = limit * 1e6, {}
    depth = depths(machine)["combined_um"]
    stride = max(50.0, 5 * age / max(depth, 1.0))
    for _ in range(2000):
        if depth >= limit_um:
            break
        wear_to(age + stride)
        new = depths(machine)["combined_um"]
        for mark in (*np.arange(MARK, limit_um, MARK), limit_um):
            if depth < mark <= new:
                passed[f"{mark:g}"] = float(age + stride * (mark - depth) / (new - depth))
        depth, age = new, age + stride
    else:
        raise SimulationError(f"{limit_um:g} µm is not reached by {age:.0f} revolutions, at {depth:.1f} µm")
    end = passed.get(f"{limit_um:g}", age)
    return {
        "criterion": "max_depth",
        "limit_um": limit_um,
        "measure": "combined_um",
        "method": "simulated on with the last condition",
        "revolutions": end,
        "revolutions_to_depth_um": passed,
        "hours": end / (condition.speed / (2 * pi)) / 3600,
    }
