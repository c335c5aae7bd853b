"""Sizes of the effects: small, medium and large of each, and what is drawn anew for every campaign.

Small lies near where an effect is expected to be seen at all, large where nobody would overlook it. A campaign
scales the size by a factor of its own draw (SPREAD), so no two campaigns have the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.trace_campaigns.benches import BENCHES, Bench

LEVELS = ("small", "medium", "large")
SPREAD = (0.88, 1.14)  # factor of the drawn size on the level's
_PHASE = (0.0, 6.28)

SIZES: Mapping[str, tuple[Mapping[str, float], ...]] = {
    "pinion_eccentricity": ({"e_um": 10.0}, {"e_um": 28.0}, {"e_um": 65.0}),
    "gear_eccentricity": ({"e_um": 14.0}, {"e_um": 40.0}, {"e_um": 90.0}),
    "misalignment": ({"lead_um": 11.0}, {"lead_um": 24.0}, {"lead_um": 42.0}),
    "tooth_friction": ({"mu": 0.03}, {"mu": 0.065}, {"mu": 0.11}),
    "pitch_error": (
        {"pinion_um": 1.0, "gear_um": 0.8},
        {"pinion_um": 2.5, "gear_um": 2.0},
        {"pinion_um": 5.0, "gear_um": 4.0},
    ),
    "profile_error": ({"tip_relief_um": 5.0}, {"tip_relief_um": 12.0}, {"tip_relief_um": 25.0}),
    "tooth_crack": ({"loss": 0.2}, {"loss": 0.4}, {"loss": 0.65}),
    "mass_unbalance": ({"pinion_g_mm": 1500.0}, {"pinion_g_mm": 6000.0}, {"pinion_g_mm": 20000.0}),
    "torque_ripple": ({"amplitude_nm": 0.12}, {"amplitude_nm": 0.5}, {"amplitude_nm": 1.5}),
    "bearing_defect": ({"force_n": 1.2}, {"force_n": 4.0}, {"force_n": 12.0}),
    "backlash_rattle": ({"severity": 0.95}, {"severity": 1.25}, {"severity": 1.8}),
    "mesh_stiffness_loss": ({"loss": 0.14}, {"loss": 0.25}, {"loss": 0.4}),
    "mesh_damping": ({"factor": 2.0}, {"factor": 3.5}, {"factor": 7.0}),
    "sensor_gain": ({"change": 0.1}, {"change": 0.2}, {"change": 0.4}),
    "sensor_resonance": ({"frequency_hz": 3200.0}, {"frequency_hz": 1900.0}, {"frequency_hz": 1100.0}),
    "mains_interference": ({"level": 0.6}, {"level": 1.5}, {"level": 4.0}),
    "order_tone": ({"amplitude": 0.8}, {"amplitude": 2.0}, {"amplitude": 5.0}),
    "level_modulation": ({"depth": 0.15}, {"depth": 0.3}, {"depth": 0.5}),
    "random_impacts": ({"amplitude": 5.0}, {"amplitude": 15.0}, {"amplitude": 40.0}),
    "rub": ({"amplitude": 1.0}, {"amplitude": 3.0}, {"amplitude": 8.0}),
    "drifting_tone": ({"amplitude": 0.8}, {"amplitude": 2.0}, {"amplitude": 5.0}),
    "second_mesh": ({"amplitude": 0.8}, {"amplitude": 2.0}, {"amplitude": 5.0}),
    "loose_bearing": (
        {"play_um": 15.0, "slack": 0.4},
        {"play_um": 40.0, "slack": 0.6},
        {"play_um": 90.0, "slack": 0.8},
    ),
    "coupling_misalignment": (
        {"offset_mm": 0.15, "angle_deg": 0.7, "jaw_scatter": 0.1},
        {"offset_mm": 0.4, "angle_deg": 1.5, "jaw_scatter": 0.2},
        {"offset_mm": 1.0, "angle_deg": 3.0, "jaw_scatter": 0.35},
    ),
    "shaft_rub": ({"force_n": 3.0}, {"force_n": 10.0}, {"force_n": 40.0}),
    "loose_foot": ({"unbalance_g_mm": 2500.0}, {"unbalance_g_mm": 6000.0}, {"unbalance_g_mm": 14000.0}),
    "loose_accelerometer": (
        {"spread": 0.15, "ease": 0.012},
        {"spread": 0.3, "ease": 0.03},
        {"spread": 0.55, "ease": 0.08},
    ),
    "time_shift": (
        {"shift_ms": 0.12, "drift_ms_per_hour": 4.0},
        {"shift_ms": 0.7, "drift_ms_per_hour": 20.0},
        {"shift_ms": 4.0, "drift_ms_per_hour": 80.0},
    ),
    "wrong_polarity": ({}, {}, {}),
    "lost_encoder_line": ({"share": 0.1}, {"share": 0.4}, {"share": 0.85}),
    "doubled_encoder_line": ({"share": 0.1}, {"share": 0.4}, {"share": 0.85}),
}

HIDDEN = 3
VISIBLE_FROM: Mapping[str, int] = {"tooth_crack": 1, "mass_unbalance": 1, "sensor_gain": 1, "sensor_resonance": 1} | {
    name: HIDDEN for name in ("mesh_stiffness_loss", "mesh_damping")
}
"""The first of LEVELS that is seen in one operating condition; small ones where not given.

Stated from the sets `tune` and `judge`. A lighter crack or gain stays within what teeth and structures scatter; an
unbalance of 1500 g·mm shakes the housing by less than the noise; a mount at 3.2 kHz lies above the lines that carry
the level. Uniform loss of stiffness looks like a small misalignment, and damping of the contact, up to sevenfold,
moves the strong lines by less than a structure's tolerance does.
"""


def visible(name: str, level: str) -> bool:
    """Whether an effect of a level lies above its limit of visibility."""
    return LEVELS.index(level) >= VISIBLE_FROM.get(name, 0)


def drawn(
    name: str,
    level: str,
    rng: np.random.Generator,
    speed_hz: float = 10.0,
    torque_nm: float = 10.0,
    bench: Bench = BENCHES["unsw"],
) -> dict[str, Any]:
    """Parameters of the generator for an effect of a level, with this campaign's own size and position.

    Whether a load rattles or a foot lifts off depends on the operating condition; all else leaves it aside.
    """
    sizes = {key: _rounded(value * rng.uniform(*SPREAD)) for key, value in SIZES[name][LEVELS.index(level)].items()}
    for key, factor in (("amplitude_nm", bench.load), ("force_n", bench.force)):
        if key in sizes and factor != 1.0:
            sizes[key] = _rounded(sizes[key] * factor)
    if name == "backlash_rattle":
        return _rattling(sizes["severity"], rng, speed_hz, torque_nm, bench.first_mode)
    if name == "loose_foot":
        return _lifting(sizes, rng, speed_hz, torque_nm, bench)
    shape = _SHAPES.get(name)
    return sizes if shape is None else shape(sizes, rng)


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def _phased(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {**sizes, "phase": _rounded(rng.uniform(*_PHASE))}


def _sided(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"lead_um": sizes["lead_um"] * float(rng.choice([-1.0, 1.0]))}


def _relieved(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    slope = sizes["tip_relief_um"] * rng.uniform(-0.3, 0.3)
    return {**sizes, "relief_length_mm": _rounded(rng.uniform(1.0, 2.2)), "slope_um": _rounded(slope)}


def _cracked(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"tooth": int(rng.integers(0, 19)), "remaining_stiffness": _rounded(1 - sizes["loss"])}


def _rippling(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return _phased({**sizes, "order": float(rng.choice([2.0, 3.0, 4.0, 6.0, 8.0]))}, rng)


def _rolling(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Outer or inner race of a ball bearing with 8 or 9 balls."""
    order = float(rng.choice([3.05, 3.58, 4.95, 5.42])) * rng.uniform(0.99, 1.01)
    return {**sizes, "order": round(order, 3), "slip": _rounded(rng.uniform(0.004, 0.015))}


def _rattling(
    severity: float, rng: np.random.Generator, speed_hz: float, torque_nm: float, first_mode: float
) -> dict[str, Any]:
    """A load that pulsates once a pinion turn: its swing, swollen by the first torsional mode, over its mean.

    From a severity of about 0.8 on the teeth part at every turn.
    """
    swing = severity * torque_nm * abs(1 - (speed_hz / first_mode) ** 2)
    return {
        "load_ripple_nm": _rounded(swing),
        "extra_backlash_um": _rounded(rng.uniform(20, 120)),
        "order": 1.0,
    }


def _gained(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"gain": _rounded(1 + sizes["change"] * float(rng.choice([-1.0, 1.0])))}


def _resonant(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {**sizes, "damping_ratio": _rounded(rng.uniform(0.02, 0.06))}


def _mains(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """50 or 60 Hz with odd harmonics."""
    base = float(rng.choice([50.0, 60.0]))
    amplitudes = [_rounded(sizes["level"] * a * rng.uniform(0.8, 1.2)) for a in (1.0, 0.8, 0.5)]
    return {"frequencies_hz": [base, 3 * base, 5 * base], "amplitudes": amplitudes}


def _belted(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """A belt's ratio, between the orders of the shafts."""
    return {**sizes, "order": round(rng.uniform(4.1, 17.9) // 1 + rng.uniform(0.3, 0.7), 3), "harmonics": 2}


def _breathing(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Tens of hertz, as the 39.6 Hz of a measured rig at 33 Hz."""
    return {**sizes, "frequency_hz": _rounded(rng.uniform(21, 47))}


def _striking(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {**sizes, "rate_hz": _rounded(rng.uniform(4, 12)), "frequency_hz": _rounded(rng.uniform(700, 2200))}


def _rubbing(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {**sizes, "share": _rounded(rng.uniform(0.15, 0.4))}


def _lifting(
    sizes: dict[str, Any], rng: np.random.Generator, speed_hz: float, torque_nm: float, bench: Bench
) -> dict[str, Any]:
    """A foot on which the torque leaves about half of what the shaft's unbalance lifts."""
    lift = sizes["unbalance_g_mm"] * 1e-6 * (2 * np.pi * speed_hz) ** 2
    load = rng.uniform(0.35, 0.65) * lift + bench.reaction * (torque_nm - bench.rated_torque)
    return {**sizes, "load_n": _rounded(max(load, 0.3 * lift)), "natural_hz": _rounded(rng.uniform(30, 60))}


def _slack(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {
        "play_um": sizes["play_um"],
        "stiffness": _rounded(1 - min(sizes["slack"], 0.93)),
        "exponent": _rounded(rng.uniform(1.5, 2.2)),
        "bearing": int(rng.choice([4, 6])),
    }


def _eased(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    frequency = _rounded(rng.uniform(1500, 3500))
    return {"spread": sizes["spread"], "hold": _rounded(1 / sizes["ease"]), "frequency_hz": frequency}


def _drifting(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """A fan's or a pump's tone, anywhere in the band."""
    return {
        **sizes,
        "frequency_hz": _rounded(rng.uniform(90, 900)),
        "between": _rounded(rng.uniform(0.01, 0.05)),
        "within": _rounded(rng.uniform(-0.03, 0.03)),
    }


def _neighbour(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {
        **sizes,
        "teeth": int(rng.integers(17, 46)),
        "shaft_hz": _rounded(rng.uniform(8, 25)),
        "slip": _rounded(rng.uniform(0.005, 0.03)),
    }


def _coupled(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {**sizes, "jaws": int(rng.choice([3, 4, 6]))}


def _touching(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return _phased({**sizes, "share": _rounded(rng.uniform(0.08, 0.4))}, rng)


def _shifted(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """A fixed shift or a clock that drifts, to either side."""
    side, fixed = float(rng.choice([-1.0, 1.0])), bool(rng.integers(2))
    shift = side * sizes["shift_ms"] if fixed else 0.0
    return {"shift_ms": shift, "drift_ms_per_hour": 0.0 if fixed else side * sizes["drift_ms_per_hour"]}


def _lined(sizes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {**sizes, "shaft": str(rng.choice(["pinion", "gear"])), "line": int(rng.integers(0, 500))}


_SHAPES: Mapping[str, Callable[[dict[str, Any], np.random.Generator], dict[str, Any]]] = {
    "pinion_eccentricity": _phased,
    "gear_eccentricity": _phased,
    "misalignment": _sided,
    "profile_error": _relieved,
    "tooth_crack": _cracked,
    "mass_unbalance": _phased,
    "torque_ripple": _rippling,
    "bearing_defect": _rolling,
    "sensor_gain": _gained,
    "sensor_resonance": _resonant,
    "mains_interference": _mains,
    "order_tone": _belted,
    "level_modulation": _breathing,
    "random_impacts": _striking,
    "rub": _rubbing,
    "drifting_tone": _drifting,
    "second_mesh": _neighbour,
    "loose_bearing": _slack,
    "coupling_misalignment": _coupled,
    "shaft_rub": _touching,
    "loose_accelerometer": _eased,
    "time_shift": _shifted,
    "lost_encoder_line": _lined,
    "doubled_encoder_line": _lined,
}
