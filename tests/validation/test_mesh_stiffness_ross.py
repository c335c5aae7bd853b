"""Mesh stiffness against ROSS 2.3.0, an independent program with the same energy method.

Stored by tests/validation/tools/ross_mesh_stiffness.py (command in tests/data/ross_mesh_stiffness.json).
Both integrate bending, shear and thrust over the same involute and fillet, take Hertz contact as a
constant and the body from Sainsot, Velex and Duverger. They differ in three things, all of them ROSS's:

1  θ of the body formula is taken where the fillet meets the root circle, but with the addendum for the
   dedendum in its expression (6 % too small). Ours are "fillet" (without that slip) and "flank", the
   default, which stays inside the formula's range for the 19-tooth pinion.
2  u is the height of the contact above the root circle, not of the point where the force's line cuts the
   tooth's centre line, as Sainsot has it: a softer body.
3  Over a mesh period the *pressure angle* of the contact runs evenly, from the form point of the tool; on
   a turning gear the *roll angle* does, from the tip of the mating gear. ROSS's contacts lie lower on the
   pinion, where it is stiffer.

With ROSS's three choices put in, our functions give ROSS's curve to round-off (the last test). As they
stand, mean and peak of the "fillet" reading are within 5 % of ROSS's, 2–3 % above. The "flank" reading
is 11–15 % below ROSS, from the root section alone, and is the one that the rig's own table was made with.
"""

import json

import numpy as np
import pytest

from benchmarks.quasi_static import nominal_mesh_stiffness
from tests.mesh_pairs import ROOT, standard_pair
from twin.mesh.foundation import body_factor
from twin.mesh.stiffness import PairStiffness
from twin.mesh.tooth_compliance import tooth_compliance

ROSS = json.loads((ROOT / "tests/data/ross_mesh_stiffness.json").read_text(encoding="utf-8"))
E, ν = ROSS["youngs_modulus"], ROSS["poisson_ratio"]
NAMES = list(ROSS["pairs"])


def pair_of(record):
    return standard_pair(
        *record["teeth"], record["module"], tuple(record["bore_radius"]), face_width=record["face_width"]
    )


def mesh_curve(pair, root_section):
    """Stiffness of all pairs inside the nominal path over a mesh period, as ROSS adds them; (4096,) [N/m]."""
    return nominal_mesh_stiffness(PairStiffness.of(pair, root_section=root_section), 4096)


def ross_body(pair, wheel, ξ):
    """Compliance of the body with ROSS's reading of u and θ; (n,) → (n,) [m/N]."""
    tooth = pair.tooth(wheel)
    slip = 2 * (pair.dedendum - pair.addendum) * np.tan(pair.pressure_angle) / (pair.module * tooth.teeth)
    β = ξ - tooth.base_half_angle
    height = tooth.flank_point(β)[1] - tooth.root_radius
    factor = body_factor(
        β, height, half_angle=tooth.root_half_angle - slip,
        root_radius=tooth.root_radius, bore_radius=pair.bore_radius[wheel],
    )  # fmt: skip
    return factor / (E * pair.face_width)


def beam(pair, wheel, ξ):
    return tooth_compliance(pair.tooth(wheel), ξ, youngs_modulus=E, poisson_ratio=ν, face_width=pair.face_width)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("wheel", [0, 1])
def test_one_tooth_bends_shears_and_shortens_as_in_ross(name, wheel):
    record = ROSS["pairs"][name]
    tooth = record["gears"][wheel]
    ours = beam(pair_of(record), wheel, np.tan(tooth["pressure_angle"]))
    assert ours.bending == pytest.approx(np.array(tooth["bending"]), rel=1e-8)
    assert ours.shear == pytest.approx(np.array(tooth["shear"]), rel=1e-8)
    assert ours.axial == pytest.approx(np.array(tooth["axial"]), rel=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_mean_and_peak_of_the_mesh_are_within_five_percent_of_ross(name):
    record = ROSS["pairs"][name]
    pair = pair_of(record)
    curve = mesh_curve(pair, "fillet")
    assert pair.contact_ratio == pytest.approx(record["contact_ratio"], rel=1e-12)
    assert curve.mean() == pytest.approx(record["mean"], rel=0.05)
    assert curve.max() == pytest.approx(record["peak"], rel=0.05)


@pytest.mark.parametrize(("name", "below"), [("19/52", 0.115), ("29/29", 0.149), ("23/46", 0.123)])
def test_the_default_root_section_lies_below_ross_by_a_known_share(name, below):
    """Pins what the choice of the root section costs; the figure stands in the docstring above."""
    record = ROSS["pairs"][name]
    assert mesh_curve(pair_of(record), "flank").mean() / record["mean"] == pytest.approx(1 - below, abs=5e-3)


@pytest.mark.parametrize("name", NAMES)
def test_rosss_three_choices_explain_all_of_the_difference(name):
    record = ROSS["pairs"][name]
    pair = pair_of(record)
    form = np.arctan(pair.tooth(0).form_roll_angle)
    tips = [np.arccos(r_b / r_a) for r_b, r_a in zip(pair.base_radius, pair.tip_radius, strict=True)]
    period = (tips[0] - form) / pair.contact_ratio

    def one_pair(turn):
        angles = form + turn, tips[1] - pair.teeth[0] / pair.teeth[1] * turn
        compliance = record["hertz"]
        for wheel, ξ in enumerate(np.tan(angles)):
            compliance = compliance + beam(pair, wheel, ξ).total + ross_body(pair, wheel, ξ)
        return 1 / compliance

    turn = np.linspace(0, period, 1000)[::4]
    both = turn <= period * (pair.contact_ratio - 1)
    curve = one_pair(turn) + np.where(both, one_pair(turn + period), 0.0)
    assert curve == pytest.approx(np.array(record["mesh_stiffness"]), rel=1e-8)
