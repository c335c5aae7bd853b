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
from recordings.generator.foreign import DriftingTone, LevelModulation, OrderTone, RandomImpacts, Rub, SecondMesh
from recordings.generator.housing import LooseFoot
from recordings.generator.knobs import Knobs
from recordings.generator.schema import REQUIRED, Number, Numbers, Text
from recordings.generator.sensor_faults import Clock, DiscLine, LooseAccelerometer
from recordings.generator.turning import Coupling, ShaftRub, jaws


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect: its parameters and what it does to the knobs.

    grows    the parameters that are its size, with the value of each at which there is no effect
    edition  raised when the same parameters give another recording: what was made before is then made anew
    """

    parameters: Mapping[str, Number | Numbers | Text]
    apply: Callable[[Knobs, Mapping[str, Any], Pair, np.random.Generator], None]
    grows: Mapping[str, float] = field(default_factory=dict)
    edition: int = 1


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


def _drifting_tone(knobs, p, pair, rng):
    """A tone that comes and goes by per cents of its frequency."""
    knobs.foreign.append(DriftingTone(*(p[k] for k in ("amplitude", "frequency_hz", "between", "within", "harmonics"))))


def _second_mesh(knobs, p, pair, rng):
    """Another machine's gears, heard through the floor."""
    knobs.foreign.append(
        SecondMesh(*(p[k] for k in ("amplitude", "teeth", "shaft_hz", "slip", "modulation", "harmonics")))
    )


def _loose_bearing(knobs, p, pair, rng):
    """A bearing of the pinion's shaft sits loosely: play, and a seat that stiffens with the load as δ^n beyond it."""
    if p["bearing"] not in (4, 6):
        raise SpecError(f"loose_bearing has bearing = {p['bearing']}, must be 4 (drive side) or 6 (free side)")
    knobs.play = (p["bearing"], p["play_um"] * 1e-6, p["exponent"], p["stiffness"])


def _coupling_misalignment(knobs, p, pair, rng):
    """The coupling's hubs are apart and at an angle; its jaws are not alike."""
    stiffness = jaws(p["jaws"], p["jaw_stiffness"], p["jaw_scatter"], rng)
    offset, angle = p["offset_mm"] * 1e-3, np.radians(p["angle_deg"])
    knobs.turning.append(Coupling(offset, float(angle), stiffness, p["radius_mm"] * 1e-3))


def _shaft_rub(knobs, p, pair, rng):
    """The pinion's shaft runs against a fixed part over a share of every turn."""
    knobs.turning.append(
        ShaftRub(p["force_n"], p["share"], p["phase"], p["friction"], p["radius_mm"] * 1e-3, p["roughness"])
    )


def _loose_foot(knobs, p, pair, rng):
    """A foot of the housing lifts off its foundation at every turn."""
    knobs.foot = LooseFoot(
        p["mass_kg"], p["natural_hz"], p["damping_ratio"], p["load_n"], p["open_share"],
        p["unbalance_g_mm"] * 1e-6, p["mesh_share"], p["span_m"],
    )  # fmt: skip


def _loose_accelerometer(knobs, p, pair, rng):
    """The accelerometer's stud has come loose."""
    knobs.loose_accelerometer = LooseAccelerometer(p["frequency_hz"], p["damping_ratio"], p["hold"], p["spread"])


def _time_shift(knobs, p, pair, rng):
    """The accelerometer's samples carry the time of another clock than the encoders' edges."""
    knobs.clock = Clock(p["shift_ms"] * 1e-3, p["drift_ms_per_hour"] * 1e-3 / 3600)


def _wrong_polarity(knobs, p, pair, rng):
    """The accelerometer is mounted or wired the other way round."""
    knobs.gain *= -1


def _disc_line(knobs, p, pair, rng, twice):
    if p["shaft"] not in ("pinion", "gear"):
        raise SpecError(f"an encoder's line has shaft = {p['shaft']!r}, must be 'pinion' or 'gear'")
    ratio = 1.0 if p["shaft"] == "pinion" else pair.teeth[0] / pair.teeth[1]
    fault = DiscLine(p["line"], twice, p["share"], ratio * p["onset_revolutions"])
    knobs.disc_lines.setdefault(p["shaft"], []).append(fault)


def _lost_line(knobs, p, pair, rng):
    """A line of an encoder's disc is not seen: the count falls behind by one every turn."""
    _disc_line(knobs, p, pair, rng, twice=False)


def _doubled_line(knobs, p, pair, rng):
    """A scratch beside a line of an encoder's disc is seen as one more line in every turn."""
    _disc_line(knobs, p, pair, rng, twice=True)


_LEVEL = Number("m/s²", 0, 1000)
_LINE: dict[str, Number | Numbers | Text] = {
    "shaft": Text("gear"),
    "line": Number("", 0, 1e7, integer=True),
    "share": Number("", 0, 1, 1.0),
}

EFFECTS: dict[str, Effect] = {
    "pinion_eccentricity": Effect({"e_um": _um(0, 500), "phase": _PHASE}, _pinion_eccentricity, {"e_um": 0.0}),
    "gear_eccentricity": Effect({"e_um": _um(0, 500), "phase": _PHASE}, _gear_eccentricity, {"e_um": 0.0}),
    "misalignment": Effect({"lead_um": _um(-500, 500)}, _misalignment, {"lead_um": 0.0}),
    "tooth_friction": Effect({"mu": Number("", 0, 0.5)}, _tooth_friction, {"mu": 0.0}),
    "pitch_error": Effect(
        {"pinion_um": _um(0, 100), "gear_um": _um(0, 100)}, _pitch_error, {"pinion_um": 0.0, "gear_um": 0.0}
    ),
    "profile_error": Effect(
        {
            "tip_relief_um": _um(0, 100),
            "gear_tip_relief_um": _um(0, 100, None),
            "relief_length_mm": Number("mm", 0.05, 20, 1.0),
            "slope_um": _um(-100, 100, 0.0),
        },
        _profile_error,
        {"tip_relief_um": 0.0, "gear_tip_relief_um": 0.0, "slope_um": 0.0},
    ),
    "tooth_crack": Effect(
        {
            "tooth": Number("", 0, 1000, integer=True),
            "remaining_stiffness": Number("", 0.05, 1),
            "shaft": Text("pinion"),
        },
        _tooth_crack,
        {"remaining_stiffness": 1.0},
    ),
    "mass_unbalance": Effect(
        {
            "pinion_g_mm": Number("g·mm", 0, 1e5),
            "gear_g_mm": Number("g·mm", 0, 1e5, 0.0),
            "phase": _PHASE,
        },
        _mass_unbalance,
        {"pinion_g_mm": 0.0, "gear_g_mm": 0.0},
    ),
    "torque_ripple": Effect(
        {"amplitude_nm": Number("N·m", 0, 100), "order": Number("", 0.1, 100), "phase": _PHASE},
        _torque_ripple,
        {"amplitude_nm": 0.0},
    ),
    "bearing_defect": Effect(
        {
            "force_n": Number("N", 0, 1e4),
            "order": Number("", 0.1, 50),
            "slip": Number("", 0, 0.1, 0.01),
        },
        _bearing_defect,
        {"force_n": 0.0},
    ),
    "sensor_gain": Effect({"gain": Number("", 0.01, 100)}, _sensor_gain, {"gain": 1.0}),
    "sensor_resonance": Effect(
        {"frequency_hz": Number("Hz", 50, 20000), "damping_ratio": Number("", 0.001, 1, 0.03)},
        _sensor_resonance,
    ),
    "mesh_damping": Effect({"factor": Number("", 0, 20)}, _mesh_damping, {"factor": 1.0}),
    "mesh_stiffness_loss": Effect({"loss": Number("", 0, 0.9)}, _mesh_stiffness_loss, {"loss": 0.0}),
    "backlash_rattle": Effect(
        {
            "extra_backlash_um": _um(0, 1000, 0.0),
            "load_ripple_nm": Number("N·m", 0, 100),
            "order": Number("", 0.1, 50, 1.0),
        },
        _backlash_rattle,
        {"extra_backlash_um": 0.0, "load_ripple_nm": 0.0},
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
        {"amplitude": 0.0},
    ),
    "level_modulation": Effect(
        {"depth": Number("", 0, 1), "frequency_hz": Number("Hz", 0.5, 2000)}, _level_modulation, {"depth": 0.0}
    ),
    "random_impacts": Effect(
        {
            "amplitude": _LEVEL,
            "rate_hz": Number("1/s", 0, 1000),
            "frequency_hz": Number("Hz", 50, 5000),
            "damping_ratio": Number("", 0.001, 0.9, 0.03),
        },
        _random_impacts,
        {"amplitude": 0.0},
    ),
    "rub": Effect(
        {
            "amplitude": _LEVEL,
            "low_hz": Number("Hz", 50, 20000, 800.0),
            "high_hz": Number("Hz", 60, 50000, 3000.0),
            "share": Number("", 0.05, 0.95, 0.3),
        },
        _rub,
        {"amplitude": 0.0},
    ),
    "drifting_tone": Effect(
        {
            "amplitude": _LEVEL,
            "frequency_hz": Number("Hz", 1, 5000),
            "between": Number("", 0, 0.3, 0.02),
            "within": Number("", -0.3, 0.3, 0.0),
            "harmonics": Number("", 1, 10, 2, integer=True),
        },
        _drifting_tone,
        {"amplitude": 0.0},
    ),
    "second_mesh": Effect(
        {
            "amplitude": _LEVEL,
            "teeth": Number("", 5, 500, integer=True),
            "shaft_hz": Number("Hz", 0.5, 100),
            "slip": Number("", 0, 0.2, 0.02),
            "modulation": Number("", 0, 1, 0.3),
            "harmonics": Number("", 1, 10, 3, integer=True),
        },
        _second_mesh,
        {"amplitude": 0.0},
    ),
    "loose_bearing": Effect(
        {
            "play_um": _um(0, 500),
            "bearing": Number("", 4, 6, 6, integer=True),
            "exponent": Number("", 1, 3, 1.5),
            "stiffness": Number("", 0.02, 1, 0.5),
        },
        _loose_bearing,
        {"play_um": 0.0, "exponent": 1.0, "stiffness": 1.0},
    ),
    "coupling_misalignment": Effect(
        {
            "offset_mm": Number("mm", 0, 5),
            "angle_deg": Number("°", 0, 10, 0.0),
            "jaws": Number("", 2, 12, 3, integer=True),
            "jaw_stiffness": Number("N/m", 1e3, 1e9, 5e5),
            "jaw_scatter": Number("", 0, 0.9, 0.15),
            "radius_mm": Number("mm", 2, 500, 25.0),
        },
        _coupling_misalignment,
        {"offset_mm": 0.0, "angle_deg": 0.0, "jaw_scatter": 0.0},
    ),
    "shaft_rub": Effect(
        {
            "force_n": Number("N", 0, 1e4),
            "share": Number("", 0.02, 0.98, 0.2),
            "phase": _PHASE,
            "friction": Number("", 0, 1, 0.2),
            "radius_mm": Number("mm", 1, 500, 10.0),
            "roughness": Number("", 0, 2, 0.3),
        },
        _shaft_rub,
        {"force_n": 0.0},
    ),
    "loose_foot": Effect(
        {
            "load_n": Number("N", 0, 1e5),
            "unbalance_g_mm": Number("g·mm", 0, 1e6),
            "mass_kg": Number("kg", 0.1, 1e5, 15.0),
            "natural_hz": Number("Hz", 2, 2000, 45.0),
            "damping_ratio": Number("", 0.001, 1, 0.05),
            "open_share": Number("", 0, 1, 0.15),
            "mesh_share": Number("", 0, 1, 0.05),
            "span_m": Number("m", 0.01, 10, 0.3),
        },
        _loose_foot,
        {"unbalance_g_mm": 0.0, "mesh_share": 0.0},
    ),
    "loose_accelerometer": Effect(
        {
            "hold": Number("m/s²", 0.01, 1e5),
            "frequency_hz": Number("Hz", 100, 20000, 2500.0),
            "damping_ratio": Number("", 0.001, 1, 0.04),
            "spread": Number("", 0, 0.9, 0.3),
        },
        _loose_accelerometer,
    ),
    "time_shift": Effect(
        {"shift_ms": Number("ms", -40, 40), "drift_ms_per_hour": Number("ms/h", -1000, 1000, 0.0)},
        _time_shift,
        {"shift_ms": 0.0, "drift_ms_per_hour": 0.0},
    ),
    "wrong_polarity": Effect({}, _wrong_polarity),
    "lost_encoder_line": Effect(_LINE, _lost_line),
    "doubled_encoder_line": Effect(_LINE, _doubled_line),
}


def grown(effect: Mapping[str, Any], revolutions: float) -> Mapping[str, Any]:
    """The parameters that an effect has at an age: its size rises evenly from its onset until `full_revolutions`."""
    begin, full = effect["onset_revolutions"], effect.get("full_revolutions", 0.0)
    if full <= begin or revolutions >= full:
        return effect
    share = max(0.0, (revolutions - begin) / (full - begin))
    sizes = {
        key: none + share * (effect[key] - none)
        for key, none in EFFECTS[effect["name"]].grows.items()
        if effect[key] is not None
    }
    return {**effect, **sizes}


def knobs_at(effects: tuple[Mapping, ...], revolutions: float, pair: Pair, seed: int) -> tuple[Knobs, list[str]]:
    """The knobs with every effect turned on whose onset has come, and the names of those."""
    knobs, active = Knobs(), []
    for i, effect in enumerate(effects):
        if revolutions >= effect["onset_revolutions"]:
            rng = np.random.default_rng([seed, 7, i])  # of its own: an effect's draw never depends on others
            EFFECTS[effect["name"]].apply(knobs, grown(effect, revolutions), pair, rng)
            active.append(effect["name"])
    return knobs, active
