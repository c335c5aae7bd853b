"""What the spec may put into a machine or its instruments: one class an effect, one table.

Every effect turns the knobs of `Knobs`, and knows nothing of the other effects. Phases are in radians.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from recordings.generator.errors import SpecError
from recordings.generator.flanks import Pair
from recordings.generator.foreign import Felt, LevelModulation, OrderTone, RandomImpacts, Rub
from recordings.generator.schema import REQUIRED, Number, Numbers, Text


@dataclass(slots=True)
class Knobs:
    """Everything that effects may turn; SI. As made, a healthy machine with perfect instruments."""

    pinion_eccentricity: tuple[float, float] = (0.0, 0.0)  # [m], high point [rad]
    gear_eccentricity: tuple[float, float] = (0.0, 0.0)
    lead: float = 0.0  # across the whole face [m]
    friction: float = 0.0
    stiffness: float = 1.0  # of the mesh
    damping: float = 1.0  # of the mesh
    backlash: float = 0.0  # added [m]
    tooth_stiffness: dict[int, float] = field(default_factory=dict)  # of pinion teeth
    gear_tooth_stiffness: dict[int, float] = field(default_factory=dict)
    pinion_form: np.ndarray | float = 0.0  # missing material, broadcast to (teeth, points) [m]
    gear_form: np.ndarray | float = 0.0
    pinion_unbalance: tuple[float, float] = (0.0, 0.0)  # [kg·m], phase
    gear_unbalance: tuple[float, float] = (0.0, 0.0)
    ripple: tuple[float, float, float] = (0.0, 1.0, 0.0)  # motor torque [N·m], order, phase
    load_ripple: tuple[float, float] = (0.0, 1.0)  # brake torque at the pinion [N·m], order of the pinion
    bearing: tuple[float, float, float] = (0.0, 0.0, 0.0)  # blow [N], order of the pinion, slip
    gain: float = 1.0  # of the accelerometer
    resonance: tuple[float, float] = (0.0, 0.0)  # of the accelerometer's mounting [Hz], damping ratio
    tones: list[tuple[float, float]] = field(default_factory=list)  # (Hz, m/s²) added to the acceleration
    foreign: list[Felt] = field(default_factory=list)  # what else shakes the housing


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect: its parameters and what it does to the knobs."""

    parameters: Mapping[str, Number | Numbers | Text]
    apply: Callable[[Knobs, Mapping[str, Any], Pair, np.random.Generator], None]


def _um(low: float, high: float, default=REQUIRED) -> Number:
    return Number("µm", low, high, default)


_PHASE = Number("rad", -10, 10, 0.0)


def _pinion_eccentricity(knobs, p, pair, rng):
    """The pinion's teeth turn about a point beside their centre; approach, centre distance, corners move."""
    knobs.pinion_eccentricity = (p["e_um"] * 1e-6, p["phase"])


def _gear_eccentricity(knobs, p, pair, rng):
    knobs.gear_eccentricity = (p["e_um"] * 1e-6, p["phase"])


def _misalignment(knobs, p, pair, rng):
    """The gap opens linearly across the face by lead_um from end to end."""
    knobs.lead += p["lead_um"] * 1e-6


def _tooth_friction(knobs, p, pair, rng):
    """Coulomb friction along the flanks, turning round at the pitch point."""
    knobs.friction += p["mu"]


def _pitch_error(knobs, p, pair, rng):
    """Every tooth is displaced on its own, normally distributed with the given standard deviation."""
    for form, key, z in (
        ("pinion_form", "pinion_um", pair.teeth[0]),
        ("gear_form", "gear_um", pair.teeth[1]),
    ):
        shift = rng.normal(0.0, 1.0, z) * p[key] * 1e-6
        setattr(knobs, form, getattr(knobs, form) + (shift - shift.mean())[:, None])


def _profile_error(knobs, p, pair, rng):
    """Tip relief (parabolic from its start to the tip), the gear's as the pinion's unless given, and a slope."""
    s, length = pair.points, p["relief_length_mm"] * 1e-3
    relief, slope = p["tip_relief_um"] * 1e-6, p["slope_um"] * 1e-6
    on_gear = relief if p["gear_tip_relief_um"] is None else p["gear_tip_relief_um"] * 1e-6
    lean = slope * (s - pair.start) / (pair.end - pair.start)
    pinion = relief * np.clip((s - pair.end + length) / length, 0, None) ** 2 + lean
    gear = on_gear * np.clip((pair.start + length - s) / length, 0, None) ** 2
    knobs.pinion_form = knobs.pinion_form + pinion[None, :]
    knobs.gear_form = knobs.gear_form + gear[None, :]


def _tooth_crack(knobs, p, pair, rng):
    """One tooth, of the pinion or the gear, keeps only a share of its pair's stiffness."""
    if p["shaft"] not in ("pinion", "gear"):
        raise SpecError(f"tooth_crack has shaft = {p['shaft']!r}, must be 'pinion' or 'gear'")
    cracked, z = (
        (knobs.tooth_stiffness, pair.teeth[0])
        if p["shaft"] == "pinion"
        else (knobs.gear_tooth_stiffness, pair.teeth[1])
    )
    cracked[p["tooth"] % z] = p["remaining_stiffness"]


def _mass_unbalance(knobs, p, pair, rng):
    knobs.pinion_unbalance = (p["pinion_g_mm"] * 1e-6, p["phase"])
    knobs.gear_unbalance = (p["gear_g_mm"] * 1e-6, p["phase"])


def _torque_ripple(knobs, p, pair, rng):
    """The motor's torque pulsates with its own angle."""
    knobs.ripple = (p["amplitude_nm"], p["order"], p["phase"])


def _bearing_defect(knobs, p, pair, rng):
    """A short blow on the bearing beside the accelerometer whenever a rolling element passes, with slip."""
    knobs.bearing = (p["force_n"], p["order"], p["slip"])


def _sensor_gain(knobs, p, pair, rng):
    knobs.gain *= p["gain"]


def _sensor_resonance(knobs, p, pair, rng):
    """The accelerometer sits on a soft mount: one degree of freedom between housing and sensor."""
    knobs.resonance = (p["frequency_hz"], p["damping_ratio"])


def _mesh_damping(knobs, p, pair, rng):
    knobs.damping *= p["factor"]


def _mesh_stiffness_loss(knobs, p, pair, rng):
    knobs.stiffness *= 1 - p["loss"]


def _backlash_rattle(knobs, p, pair, rng):
    """Wider backlash under a load that pulsates with the pinion's turn; with low torque the teeth part."""
    knobs.backlash += p["extra_backlash_um"] * 1e-6
    knobs.load_ripple = (p["load_ripple_nm"], p["order"])


def _mains_interference(knobs, p, pair, rng):
    """Tones that do not come from the machine, on the accelerometer alone."""
    frequencies, amplitudes = p["frequencies_hz"], p["amplitudes"]
    if len(frequencies) != len(amplitudes):
        raise SpecError(f"mains_interference has {len(frequencies)} frequencies_hz and {len(amplitudes)} amplitudes")
    knobs.tones.extend(zip(frequencies, amplitudes, strict=True))


def _order_tone(knobs, p, pair, rng):
    """A part driven by belt, in no whole ratio to the shafts."""
    knobs.foreign.append(OrderTone(p["amplitude"], p["order"], p["harmonics"]))


def _level_modulation(knobs, p, pair, rng):
    """All vibration at the sensor breathes at a rate that no shaft turns at."""
    knobs.foreign.append(LevelModulation(p["depth"], p["frequency_hz"]))


def _random_impacts(knobs, p, pair, rng):
    """Something loose strikes the housing now and then."""
    knobs.foreign.append(RandomImpacts(p["amplitude"], p["rate_hz"], p["frequency_hz"], p["damping_ratio"]))


def _rub(knobs, p, pair, rng):
    """Something brushes along the housing over a share of every pinion turn."""
    knobs.foreign.append(Rub(p["amplitude"], p["low_hz"], p["high_hz"], p["share"]))


_LEVEL = Number("m/s²", 0, 1000)

EFFECTS: dict[str, Effect] = {
    "pinion_eccentricity": Effect({"e_um": _um(0, 500), "phase": _PHASE}, _pinion_eccentricity),
    "gear_eccentricity": Effect({"e_um": _um(0, 500), "phase": _PHASE}, _gear_eccentricity),
    "misalignment": Effect({"lead_um": _um(-500, 500)}, _misalignment),
    "tooth_friction": Effect({"mu": Number("", 0, 0.5)}, _tooth_friction),
    "pitch_error": Effect({"pinion_um": _um(0, 100), "gear_um": _um(0, 100)}, _pitch_error),
    "profile_error": Effect(
        {
            "tip_relief_um": _um(0, 100),
            "gear_tip_relief_um": _um(0, 100, None),
            "relief_length_mm": Number("mm", 0.05, 20, 1.0),
            "slope_um": _um(-100, 100, 0.0),
        },
        _profile_error,
    ),
    "tooth_crack": Effect(
        {
            "tooth": Number("", 0, 1000, integer=True),
            "remaining_stiffness": Number("", 0.05, 1),
            "shaft": Text("pinion"),
        },
        _tooth_crack,
    ),
    "mass_unbalance": Effect(
        {
            "pinion_g_mm": Number("g·mm", 0, 1e5),
            "gear_g_mm": Number("g·mm", 0, 1e5, 0.0),
            "phase": _PHASE,
        },
        _mass_unbalance,
    ),
    "torque_ripple": Effect(
        {"amplitude_nm": Number("N·m", 0, 100), "order": Number("", 0.1, 100), "phase": _PHASE},
        _torque_ripple,
    ),
    "bearing_defect": Effect(
        {
            "force_n": Number("N", 0, 1e4),
            "order": Number("", 0.1, 50),
            "slip": Number("", 0, 0.1, 0.01),
        },
        _bearing_defect,
    ),
    "sensor_gain": Effect({"gain": Number("", 0.01, 100)}, _sensor_gain),
    "sensor_resonance": Effect(
        {"frequency_hz": Number("Hz", 50, 20000), "damping_ratio": Number("", 0.001, 1, 0.03)},
        _sensor_resonance,
    ),
    "mesh_damping": Effect({"factor": Number("", 0, 20)}, _mesh_damping),
    "mesh_stiffness_loss": Effect({"loss": Number("", 0, 0.9)}, _mesh_stiffness_loss),
    "backlash_rattle": Effect(
        {
            "extra_backlash_um": _um(0, 1000, 0.0),
            "load_ripple_nm": Number("N·m", 0, 100),
            "order": Number("", 0.1, 50, 1.0),
        },
        _backlash_rattle,
    ),
    "mains_interference": Effect(
        {
            "frequencies_hz": Numbers(Number("Hz", 0.1, 50000)),
            "amplitudes": Numbers(Number("m/s²", 0, 1000)),
        },
        _mains_interference,
    ),
    "order_tone": Effect(
        {"amplitude": _LEVEL, "order": Number("", 0.05, 200), "harmonics": Number("", 1, 10, 1, integer=True)},
        _order_tone,
    ),
    "level_modulation": Effect({"depth": Number("", 0, 1), "frequency_hz": Number("Hz", 0.5, 2000)}, _level_modulation),
    "random_impacts": Effect(
        {
            "amplitude": _LEVEL,
            "rate_hz": Number("1/s", 0, 1000),
            "frequency_hz": Number("Hz", 50, 5000),
            "damping_ratio": Number("", 0.001, 0.9, 0.03),
        },
        _random_impacts,
    ),
    "rub": Effect(
        {
            "amplitude": _LEVEL,
            "low_hz": Number("Hz", 50, 20000, 800.0),
            "high_hz": Number("Hz", 60, 50000, 3000.0),
            "share": Number("", 0.05, 0.95, 0.3),
        },
        _rub,
    ),
}


def knobs_at(effects: tuple[Mapping, ...], revolutions: float, pair: Pair, seed: int) -> tuple[Knobs, list[str]]:
    """The knobs with every effect turned on whose onset has come, and the names of those."""
    knobs, active = Knobs(), []
    for i, effect in enumerate(effects):
        if revolutions >= effect["onset_revolutions"]:
            rng = np.random.default_rng([seed, 7, i])  # of its own: an effect's draw never depends on others
            EFFECTS[effect["name"]].apply(knobs, effect, pair, rng)
            active.append(effect["name"])
    return knobs, active
