"""The model compared with what is known of it: natural frequencies, mesh stiffness, wear.

python -m benchmarks.physics
"""

from __future__ import annotations

import json
import tomllib
from math import pi
from pathlib import Path

import numpy as np

from benchmarks.quasi_static import nominal_mesh_stiffness
from twin.dynamics.structure import Structure
from twin.geometry import GearPair
from twin.mesh.stiffness import PairStiffness
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.wear.archard import pinion_share, specific_wear_rate
from twin.wear.curve import MasterCurve

ROOT = Path(__file__).parents[1]
PAPER_DEPTH = 156e-6  # at 6000 revolutions, both flanks [m]; Feng et al. 2019, section 5
ROOT_SECTIONS = ("flank", "fillet")


def reference_rig() -> Rig:
    """The rig of the paper."""
    return Rig.from_mapping(tomllib.loads((ROOT / "recordings/rigs/unsw.toml").read_text(encoding="utf-8")))


def natural_frequencies(rig: Rig) -> list[tuple[float, float, float]]:
    """Measured, the paper's model and this one's lowest vibrating frequencies [Hz]."""
    f = Structure.from_rig(rig).natural_frequencies(rig.get("mesh.mean_stiffness"))
    table = rig.get("reference.natural_frequencies_hz")
    return list(zip(table["measured"], table["paper_model"], f[f > 0].tolist(), strict=False))


def rigid_modes(rig: Rig) -> tuple[int, int]:
    """Rigid-body modes with the mesh closed and without it."""
    structure = Structure.from_rig(rig)
    closed, free = (
        np.count_nonzero(structure.natural_frequencies(k) == 0) for k in (rig.get("mesh.mean_stiffness"), 0)
    )
    return int(closed), int(free)


def stiffness_beside_ross() -> list[tuple[str, str, float, float]]:
    """Pair, reading of the root section, mean and peak mesh stiffness relative to the stored values of ROSS."""
    stored = json.loads((ROOT / "tests/data/ross_mesh_stiffness.json").read_text(encoding="utf-8"))
    out = []
    for name, ross in stored["pairs"].items():
        pair = GearPair(
            teeth=tuple(ross["teeth"]), module=ross["module"], pressure_angle=np.radians(stored["pressure_angle_deg"]),
            face_width=ross["face_width"], addendum=ross["module"], dedendum=1.25 * ross["module"],
            bore_radius=tuple(ross["bore_radius"]), youngs_modulus=stored["youngs_modulus"],
            poisson_ratio=stored["poisson_ratio"], backlash=0.0,
        )  # fmt: skip
        for section in ROOT_SECTIONS:
            k = nominal_mesh_stiffness(PairStiffness.of(pair, root_section=section), 4096)
            out.append((name, section, float(k.mean() / ross["mean"] - 1), float(k.max() / ross["peak"] - 1)))
    return out


def wear_at_6000(rig: Rig) -> tuple[float, float, float]:
    """Combined depth [m] at 6000 revolutions with the paper's K, the pinion's share, and k [m²/N]."""
    speed, torque, K, τ = rig.require(
        "wear", "operating.pinion_speed_hz", "operating.input_torque", "wear.K", "wear.dwell_time"
    )
    model = Model.of(rig, Calibration.prior(rig))
    curve = MasterCurve.build(model, Condition(speed_hz=speed, torque=torque), model.unworn, 1.2 * PAPER_DEPTH)
    pair = rig.gear_pair()
    depth = curve.depth_at(K * τ * 2 * pi * speed * 6000)
    return depth, pinion_share(pair), specific_wear_rate(pair, K, τ, speed)


def main() -> None:
    rig = reference_rig()
    print("natural frequencies [Hz]   measured   paper's model        here        off")
    for i, (measured, paper, here) in enumerate(natural_frequencies(rig), 1):
        print(f"{i:<24} {measured:>10.2f} {paper:>15.2f} {here:>11.2f} {100 * (here / measured - 1):>+9.3f} %")
    closed, free = rigid_modes(rig)
    print(f"rigid-body modes: {closed} with the mesh closed, {free} without\n")
    print("mesh stiffness against ROSS 2.3.0  root section        mean        peak")
    for name, section, mean, peak in stiffness_beside_ross():
        print(f"{name:<34} {section:<12} {100 * mean:>+9.1f} % {100 * peak:>+9.1f} %")
    depth, share, k = wear_at_6000(rig)
    print(f"\n6000 revolutions with the paper's K: {depth * 1e6:.1f} µm (paper {PAPER_DEPTH * 1e6:.0f}), ", end="")
    print(f"{100 * share:.1f} % of it on the pinion (paper 73); k = {k:.3g} m²/N")


if __name__ == "__main__":
    main()
