"""A step of time integration of the 21-DOF model with its contacts, at 50 µm of wear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_dynamics import contacts, master_curve, reference_model, torques
from benchmarks.peers.asking import Answer, Ask
from benchmarks.peers.programs.exchange import per_step, write_problem
from benchmarks.peers.rows import Row, row, within
from twin.dynamics.harmonic_balance import Contacts
from twin.dynamics.integrator import integrate, modal_start
from twin.model import Model

SAMPLES = 1024  # of the contact tables in a mesh period; a step is two of them
CHECKED = SAMPLES  # steps after which the deflections are compared: two mesh periods
SHORT, LONG = 5_000, 20_000  # steps; the time of a step is that of the difference
START = 2e-6  # deflection at rest [m]
DEPTH = 50e-6  # of wear [m]


def deflection(model: Model, table: Contacts, steps: int) -> float:
    """After so many steps from rest [m]."""
    motion = integrate(
        model.structure, table, torques(model), steps * 2 * table.period / table.samples, np.empty((0, 21)),
        keep=steps, start=modal_start(model.structure, START),
    )  # fmt: skip
    return float(motion.deflection[-1])


def compared(own: float, name: str, values: Mapping[str, Any]) -> str:
    return f"deflection after {CHECKED} steps {within(values[name], own)}"


def of_exudyn(answer: Answer, own: dict[str, float], ends: dict[str, float]) -> list[Row]:
    return [
        row(f"step of 21 DOF with contacts, {how}", own["contacts"], answer, name,
            lambda values, name=name: compared(ends["contacts"], name, values))  # type: ignore[misc]
        for how, name in (
            ("force in Python", "python"), ("force by numba", "numba"), ("symbolic force", "symbolic"),
        )
    ] + [
        row("step of 21 DOF without contacts", own["linear"], answer, "linear",
            lambda values: compared(ends["linear"], "linear", values))
    ]  # fmt: skip


def rows(ask: Ask, folder: Path) -> list[Row]:
    model = reference_model(SAMPLES)
    closed = contacts(model, master_curve(model, DEPTH)[-1].profile)
    tables = {"contacts": closed, "linear": replace(closed, stiffness=np.zeros_like(closed.stiffness))}
    structure = model.structure
    step = 2 * closed.period / closed.samples
    problem = write_problem(
        folder / "transient.npz", mass=structure.mass, damping=structure.damping, stiffness_matrix=structure.stiffness,
        mesh=structure.mesh, load=torques(model), start=structure.modes[1] @ modal_start(structure, START)[0],
        side=closed.side, stiffness=closed.stiffness, samples=closed.samples, period=closed.period, step=step,
        open_by=closed.separation + closed.damping_time * closed.separation_rate, damping_time=closed.damping_time,
        short=SHORT, long=LONG, checked=CHECKED,
    )  # fmt: skip
    exudyn, ross = ask("exudyn", "transient", problem), ask("ross", "transient", problem)
    own, ends = {}, {}
    for name, table in tables.items():
        own[name] = per_step(lambda steps, table=table: deflection(model, table, steps), SHORT, LONG)  # type: ignore[misc]
        ends[name] = deflection(model, table, CHECKED)
    return [
        *of_exudyn(exudyn, own, ends),
        row("step of a geared rotor, constant mesh", own["contacts"], ross, "newmark",
            lambda values: f"not the same: an example of {values['degrees_of_freedom']} DOF, linear, Newmark"),
    ]  # fmt: skip
