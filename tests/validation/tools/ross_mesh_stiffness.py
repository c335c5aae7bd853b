"""Mesh stiffness of three gear pairs by ROSS's energy method, stored for the validation tests.

ROSS is a peer to compare with, never a dependency: it runs in an environment of its own.

    python -m venv ross-env
    ross-env/bin/pip install ross-rotordynamics==2.3.0 "plotly<6"
    ross-env/bin/python tests/validation/tools/ross_mesh_stiffness.py tests/data/ross_mesh_stiffness.json

Stored for each pair:
  mesh_stiffness  one mesh period as `Mesh.stiffness_range` gives it, 250 of its 1000 points
  gears           compliances of a single tooth [m/N] at seven pressure angles of the flank, term by term
"""

import json
import sys
import warnings

import numpy as np
import ross
from ross.gear_element import GearElementTVMS, Mesh

COMMAND = "ross-env/bin/python tests/validation/tools/ross_mesh_stiffness.py tests/data/ross_mesh_stiffness.json"
# teeth, module [m], face width [m], bore radii [m]; 20 degrees, addendum 1 module, clearance 0.25 module
PAIRS = {
    "19/52": ((19, 52), 2.0e-3, 20e-3, (7e-3, 10e-3)),
    "29/29": ((29, 29), 3.065e-3, 20e-3, (15e-3, 15e-3)),
    "23/46": ((23, 46), 3.0e-3, 20e-3, (12e-3, 20e-3)),
}
YOUNGS_MODULUS, POISSON_RATIO = 205e9, 0.29


def tooth_terms(gear):
    """Compliances [m/N] of one tooth at seven pressure angles [rad] between form point and tip."""
    low, high = gear.pr_angles_dict["start_point"], gear.pr_angles_dict["addendum"]
    angles = np.linspace(low + 0.3 * (high - low), high, 7)
    taus = [gear._to_tau(angle) for angle in angles]
    return {
        "teeth": gear.n_teeth,
        "root_half_angle": float(gear.tooth_dict["root_angle"]),
        "pressure_angle": [float(angle) for angle in angles],
        "bending": [float(gear._inv_kb(tau)) for tau in taus],
        "shear": [float(gear._inv_ks(tau)) for tau in taus],
        "axial": [float(gear._inv_ka(tau)) for tau in taus],
        "foundation": [float(gear._inv_kf(tau)) for tau in taus],
    }


def pair_record(teeth, module, width, bores):
    """Everything stored for one gear pair."""
    steel = ross.Material(name="steel", rho=7850, E=YOUNGS_MODULUS, Poisson=POISSON_RATIO)
    gears = [
        GearElementTVMS(
            n=node, material=steel, width=width, bore_diameter=2 * bore,
            module=module, n_teeth=z, pr_angle=np.radians(20),
        )
        for node, z, bore in zip((0, 2), teeth, bores, strict=True)
    ]  # fmt: skip
    mesh = Mesh(*gears)
    period = np.asarray(mesh.stiffness_range, float)
    return {
        "teeth": teeth,
        "module": module,
        "face_width": width,
        "bore_radius": bores,
        "contact_ratio": float(mesh.contact_ratio),
        "mean": float(period[:-1].mean()),
        "peak": float(period.max()),
        "mesh_stiffness": [float(k) for k in period[::4]],
        "hertz": 1 / float(mesh.hertzian_stiffness),
        "gears": [tooth_terms(gear) for gear in gears],
    }


def main(path):
    warnings.simplefilter("ignore")  # ROSS warns where Sainsot's polynomials are extrapolated
    record = {
        "command": COMMAND,
        "source": f"ross-rotordynamics {ross.__version__}, GearElementTVMS and Mesh",
        "youngs_modulus": YOUNGS_MODULUS,
        "poisson_ratio": POISSON_RATIO,
        "pressure_angle_deg": 20.0,
        "pairs": {name: pair_record(*pair) for name, pair in PAIRS.items()},
    }
    with open(path, "w", encoding="utf-8") as file:
        json.dump(record, file, indent=1)
        file.write("\n")


if __name__ == "__main__":
    main(sys.argv[1])
