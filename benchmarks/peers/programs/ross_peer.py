"""ROSS: mesh stiffness by the energy method, and a transient of geared rotors.

ROSS computes the stiffness of a mesh period at 1000 points when a `Mesh` of two `GearElementTVMS` is made; there is no
faster way to it. Its Newmark integrator is compiled by numba before it is timed. Its rotors cannot have the masses and
springs of the 21-DOF model, so its own example of two geared rotors is integrated: a time, not the same problem.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import ross
from exchange import Found, per_step, serve, shortest
from ross.gear_element import GearElementTVMS, Mesh
from ross.multi_rotor import two_shaft_rotor_example


def stiffness(problem: dict[str, Any]) -> Found:
    steel = ross.Material(
        name="steel", rho=7850, E=problem["youngs_modulus"], Poisson=problem["poisson_ratio"]
    )  # the density does not matter here
    gears = [
        GearElementTVMS(
            n=node, material=steel, width=problem["face_width"], bore_diameter=2 * bore, module=problem["module"],
            n_teeth=int(teeth), pr_angle=problem["pressure_angle"],
        )
        for node, teeth, bore in zip((0, 2), problem["teeth"], problem["bore_radius"], strict=True)
    ]  # fmt: skip
    mesh = Mesh(*gears)
    taken = shortest(lambda: Mesh(*gears), times=3)
    return {"mesh": taken}, {"stiffness": np.asarray(mesh.stiffness_range, float)}


def transient(problem: dict[str, Any]) -> Found:
    rotor = two_shaft_rotor_example()
    step = problem["step"]

    def run(steps: int) -> None:
        force = np.zeros((steps, rotor.ndof))
        force[:, 0] = 1.0
        rotor.run_time_response(50.0, force, step * np.arange(steps), method="newmark")

    return {"newmark": per_step(run, 1000, 3000)}, {"degrees_of_freedom": int(rotor.ndof)}


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    serve("ross-rotordynamics", {"stiffness": stiffness, "transient": transient})
