"""A generic gearbox around a pair of gears of which only the data sheet is known.

Everything but the teeth is sized as a designer would size it for the rated torque. The sizes are right within a factor
of two or three, and say so by their spread; what is known of the machine replaces them one by one.

    shafts       d = (16·T/(π·τ))^(1/3), within a share of the root diameter;   span L = W + 5·d
    torsion      k_t = 0.8·G·π·d⁴/(32·l),  l = L/2 + 3·d,  0.8 for joints and keyways;  bending k_b = 48·E·I/L³
    bearings     deep-groove balls: δ = c·(Q²/D)^(1/3), Q = 5·F/Z, k = 3·F/(2·δ), and a housing as soft as the bearing
    couplings    k = 50·T per radian (elastomer), torque meter 100·T
    gears        J = ρ·π·W·r⁴/2 and m = ρ·π·W·r², with the shaft between its bearings
    motor        J = 0.0026·P^1.37 of a four-pole motor of rated power P in kW; twice as much for the load
    contacts     τ = 2·ζ_m·sqrt(m_e/k_m),  1/m_e = r_b1²/J1 + r_b2²/J2
    wear         k of the lubrication;  K·τ_K = k/(W·ω1·r_b1),  τ_K = 2·b/(ω1·r_b1),  b half-width by Hertz

T, F     torque of a shaft [N·m]; radial force on one of two bearings, half of the mesh force [N]
D, Z     diameter and number of the balls, 0.3·bore and 8                    [m]
k_m      mean mesh stiffness by the potential-energy method                  [N/m]

Source   G. Niemann et al., Maschinenelemente 1 (2019), ch. 16 (rough sizing of shafts); T. A. Harris, M. N. Kotzalas,
         Rolling Bearing Analysis (2006), ch. 6–7 (Palmgren's deflection of ball bearings); R. Kasuba, J. W. Evans,
         J. Mech. Des. 103 (1981) 398–409 (mesh damping ratio 0.03–0.17); ISO 53:1998 (basic rack: addendum 1, dedendum
         1.25 modules); J. F. Archard, W. Hirst, Proc. R. Soc. A 236 (1956) 397–410 (specific wear rates); couplings,
         motor and bearing masses are fits by eye to makers' catalogues
Holds    one stage of spur gears on solid steel shafts between two bearings each
Ignores  casing, other stages, profile shift, webs and rims of the gears
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import degrees, pi, sqrt

from twin.geometry.gear_pair import GearPair
from twin.mesh.stiffness import PairStiffness

STEEL = {"youngs_modulus": 206e9, "poisson_ratio": 0.3, "density": 7850.0}
SHEAR_STRESS = 12e6  # permissible in the rough sizing of shafts, bending allowed for [Pa]
SHAFT_SHARE = (0.2, 0.65)  # of the root diameter, between which the shaft's diameter lies
JOINT = 0.8  # stiffness of a shaft half with its joint over that of the shaft alone
PALMGREN = 4.36e-8  # deflection of a ball bearing [m] for a ball's load [N]² over its diameter [m]: 4.36e-4 mm, D in mm
BALLS, BALL_SHARE = 8, 0.3
COUPLING, METER = 50.0, 100.0  # torsional stiffness over rated torque [1/rad]
MESH_DAMPING_RATIO = 0.1
MODAL_RATIO = 0.05
WORN_IN = 5.0  # half-width over which worn-in flanks touch, over that of Hertz
SPECIFIC_WEAR = {"dry": 1e-12, "grease": 1e-14, "oil": 1e-16}  # k [m²/N], within factors of ten and more
SPREADS = {  # standard deviations of the logarithm; the sizes of the reference rig lie within two of them
    "structure": 1.0,
    "inertias": 0.9,
    "bodies": 0.3,
    "damping": 0.7,
    "mesh": 0.15,
    "contact": 0.5,
    "wear": 3.0,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownGears:
    """What a data sheet says of a gearbox: index 1 is the driving gear."""

    teeth: tuple[int, int]
    module: float  # [m]
    pressure_angle: float  # [rad]
    face_width: float  # [m]
    speed_hz: float  # of the driving shaft [Hz]
    torque: float  # on the driving shaft [N·m]
    lubrication: str  # a key of SPECIFIC_WEAR
    material: Mapping[str, float] = field(default_factory=lambda: STEEL)
    shaft_diameter: tuple[float | None, float | None] = (None, None)  # next to the gears [m]
    bearing_span: float | None = None  # [m]

    @property
    def torques(self) -> tuple[float, float]:
        """On the driving and on the driven shaft [N·m]."""
        return self.torque, self.torque * self.teeth[1] / self.teeth[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Generic:
    """Values of a rig file by their dotted keys, with where each comes from."""

    derived: Mapping[str, float]  # by a formula or a standard
    assumed: Mapping[str, float]  # generic
    pair: GearPair
    mean_stiffness: float  # of the mesh [N/m]


def generic_structure(known: KnownGears) -> Generic:
    """Everything that a model of the gearbox needs beyond its data sheet."""
    d1, d2 = (shaft_diameter(known, wheel) for wheel in (0, 1))
    pair = gear_pair(known, (d1 / 2, d2 / 2))
    mesh = PairStiffness.of(pair).mesh_mean
    derived = {
        "gears.addendum": known.module,
        "gears.dedendum": 1.25 * known.module,
        "gears.backlash": pair.backlash,
        "wear.pinion_share": known.teeth[1] / sum(known.teeth),
    }
    bodies = _bodies(known, pair, (d1, d2))
    assumed = {
        "gears.pinion.bore_radius": d1 / 2,
        "gears.gear.bore_radius": d2 / 2,
        "mesh.stiffness_scale": 1.0,
        "mesh.relative_damping_time": damping_time(pair, mesh, (bodies["inertias.J5"], bodies["inertias.J10"])),
        "damping.modal_ratio": MODAL_RATIO,
        "shafts.gear_position_fraction": 0.5,
        **_shafts(known, pair, (d1, d2)),
        **_chain(known, (d1, d2)),
        **bodies,
        **_wear(known, pair),
    }
    return Generic(derived=derived, assumed=assumed, pair=pair, mean_stiffness=mesh)


def shaft_diameter(known: KnownGears, wheel: int) -> float:
    """d [m] of the shaft of the driving (0) or driven (1) gear: as known, else sized for its torque."""
    given = known.shaft_diameter[wheel]
    if given is not None:
        return given
    root = known.module * (known.teeth[wheel] - 2.5)
    low, high = (share * root for share in SHAFT_SHARE)
    return float(min(max((16 * known.torques[wheel] / (pi * SHEAR_STRESS)) ** (1 / 3), low), high))


def gear_pair(known: KnownGears, bore_radius: tuple[float, float]) -> GearPair:
    """The pair with the standard basic rack, and backlash of a twentieth of the module along the line of action."""
    return GearPair(
        teeth=known.teeth,
        module=known.module,
        pressure_angle=known.pressure_angle,
        face_width=known.face_width,
        addendum=known.module,
        dedendum=1.25 * known.module,
        bore_radius=bore_radius,
        youngs_modulus=known.material["youngs_modulus"],
        poisson_ratio=known.material["poisson_ratio"],
        backlash=known.module / 20,
    )


def damping_time(pair: GearPair, stiffness: float, inertia: tuple[float, float]) -> float:
    """τ [s] of the contacts that damps the pair's torsion against its mesh by MESH_DAMPING_RATIO."""
    (r1, r2), (J1, J2) = pair.base_radius, inertia
    return 2 * MESH_DAMPING_RATIO / sqrt(stiffness * (r1**2 / J1 + r2**2 / J2))


def hertz_half_width(pair: GearPair, force: float) -> float:
    """b [m] of the contact at the pitch point under the whole normal force [N]."""
    ρ1, ρ2 = pair.curvature_radius(0.0)
    reduced = pair.youngs_modulus / (2 * (1 - pair.poisson_ratio**2))
    return float(sqrt(4 * force / pair.face_width / (pi * reduced) / (1 / ρ1 + 1 / ρ2)))


def bearing_stiffness(bore: float, force: float) -> float:
    """k [N/m] of a deep-groove ball bearing under a radial force [N], in a housing that is as soft."""
    load = 5 * force / BALLS
    deflection = PALMGREN * (load**2 / (BALL_SHARE * bore)) ** (1 / 3)
    return 0.5 * 1.5 * force / deflection


def _span(known: KnownGears, diameter: float) -> float:
    return known.face_width + 5 * diameter if known.bearing_span is None else known.bearing_span


def _shafts(known: KnownGears, pair: GearPair, diameters: tuple[float, float]) -> dict[str, float]:
    """Stiffness of shafts and bearings."""
    E, ν = pair.youngs_modulus, pair.poisson_ratio
    G = E / (2 * (1 + ν))
    force = known.torque / pair.base_radius[0] / 2
    out: dict[str, float] = {}
    halves = (("input", "k_3_5", "k_5_7"), ("output", "k_8_10", "k_10_12"))
    for d, (shaft, *springs) in zip(diameters, halves, strict=True):
        L = _span(known, d)
        out[f"shafts.bending_stiffness_{shaft}"] = 48 * E * pi * d**4 / 64 / L**3
        half = JOINT * G * pi * d**4 / 32 / (L / 2 + 3 * d)
        out |= {f"torsional_stiffness.{spring}": half for spring in springs}
        out |= {f"bearings.k{axis}_{shaft}": bearing_stiffness(d, force) for axis in "xy"}
    return out


def _chain(known: KnownGears, diameters: tuple[float, float]) -> dict[str, float]:
    """Couplings, hubs, encoders, motor and load."""
    ρ = known.material["density"]
    (T1, T2), (d1, d2) = known.torques, diameters
    motor = 0.0026 * (2.5 * known.torque * 2 * pi * known.speed_hz / 1e3) ** 1.37

    def disc(diameter: float, length: float) -> float:
        return ρ * pi / 32 * diameter**4 * length

    return {
        "torsional_stiffness.k_1_2": COUPLING * T1,
        "torsional_stiffness.k_2_3": METER * T1,
        "torsional_stiffness.k_12_13": COUPLING * T2,
        "inertias.J1": motor,
        "inertias.J2": disc(3 * d1, 3 * d1),
        "inertias.J3": disc(2.5 * d1, 1.5 * d1),
        "inertias.J7": disc(1.75 * d1, 0.5 * d1) + disc(d1, 3 * d1),
        "inertias.J8": disc(1.75 * d2, 0.5 * d2) + disc(d2, 3 * d2),
        "inertias.J12": disc(2.5 * d2, 1.5 * d2),
        "inertias.J13": 2 * motor,
    }


def _bodies(known: KnownGears, pair: GearPair, diameters: tuple[float, float]) -> dict[str, float]:
    """Inertia and mass of the gears with their shafts, and of what moves with the bearings."""
    ρ, W = known.material["density"], known.face_width
    out: dict[str, float] = {}
    for d, r, (gear, *bearings) in zip(diameters, pair.pitch_radius, ((5, 4, 6), (10, 9, 11)), strict=True):
        L = _span(known, d)
        out[f"inertias.J{gear}"] = ρ * pi / 2 * (W * r**4 + L * (d / 2) ** 4)
        out[f"masses.m{gear}"] = ρ * pi * (W * r**2 + 17 / 35 * L * (d / 2) ** 2)
        # ring and balls of a light-series bearing, 0.1 kg at 20 mm bore, and the shaft's end
        out |= {f"masses.m{node}": 0.1 * (d / 0.02) ** 3 + ρ * pi / 4 * d**2 * 2 * d for node in bearings}
    return out


def _wear(known: KnownGears, pair: GearPair) -> dict[str, float]:
    """Wear coefficient with its dwell time, and the width over which the flanks touch."""
    b = hertz_half_width(pair, known.torque / pair.base_radius[0])
    rolling = 2 * pi * known.speed_hz * pair.base_radius[0]
    return {
        "wear.K": SPECIFIC_WEAR[known.lubrication] / (2 * b * known.face_width),
        "wear.dwell_time": 2 * b / rolling,
        "wear.contact_half_width": WORN_IN * b,
    }


def gear_tables(known: KnownGears) -> dict[str, float]:
    """What the data sheet itself says, by the keys of a rig file."""
    return {
        "gears.pinion.teeth": known.teeth[0],
        "gears.gear.teeth": known.teeth[1],
        "gears.module": known.module,
        "gears.pressure_angle_deg": degrees(known.pressure_angle),
        "gears.face_width": known.face_width,
        **{f"gears.{key}": value for key, value in known.material.items()},
        "operating.pinion_speed_hz": known.speed_hz,
        "operating.input_torque": known.torque,
    }
