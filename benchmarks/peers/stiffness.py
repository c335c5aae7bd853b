"""Stiffness of the reference pair's mesh at 1000 points of a period, by the energy method."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_dynamics import reference_model
from benchmarks.peers.asking import Ask
from benchmarks.peers.programs.exchange import shortest, write_problem
from benchmarks.peers.rows import Row, off, row
from benchmarks.quasi_static import mesh_period, nominal_mesh_stiffness, pair_positions
from twin.geometry import GearPair
from twin.mesh.stiffness import PairStiffness, pair_stiffness

POINTS = 1000
ROOT_SECTION = "fillet"  # where ROSS takes the root section too


def at_every_point(pair: GearPair) -> np.ndarray:
    """The same without the spline: every point integrated; (1000,) [N/m]."""
    s = pair_positions(pair, mesh_period(pair, POINTS))
    inside = (s >= pair.path_start) & (s <= pair.path_end)
    k = np.zeros(s.shape)
    k[inside] = pair_stiffness(pair, s[inside], ROOT_SECTION)
    return k.sum(axis=0)


def agreement(own: np.ndarray, values: Mapping[str, Any]) -> str:
    other = np.asarray(values["stiffness"])
    return f"mean {off(other[:-1].mean(), own.mean())}, peak {off(other.max(), own.max())}"


def rows(ask: Ask, folder: Path) -> list[Row]:
    pair = reference_model(1024).rig.gear_pair()
    problem = write_problem(
        folder / "stiffness.npz", teeth=np.array(pair.teeth), module=pair.module, face_width=pair.face_width,
        pressure_angle=pair.pressure_angle, bore_radius=np.array(pair.bore_radius),
        youngs_modulus=pair.youngs_modulus, poisson_ratio=pair.poisson_ratio,
    )  # fmt: skip
    answer = ask("ross", "stiffness", problem)

    def splined() -> np.ndarray:
        return nominal_mesh_stiffness(PairStiffness.of(pair, root_section=ROOT_SECTION), POINTS)

    spline, every = splined(), at_every_point(pair)
    return [
        row("mesh stiffness, 1000 points, by a spline", shortest(splined), answer, "mesh",
            lambda values: agreement(spline, values)),
        row("mesh stiffness, 1000 points, each integrated", shortest(lambda: at_every_point(pair)), answer, "mesh",
            lambda values: agreement(every, values)),
    ]  # fmt: skip
