"""Compiled time integration: run-ups, transients, and the proof of the harmonic balance.

The structure is integrated in the coordinates of its modes without the contacts,

    η_r'' + 2ζω_r·η_r' + ω_r²·η_r = φ_rᵀ(f − g·F − Σ_c a_c·A_c),

by the classical Runge–Kutta method of order 4 with a fixed step. The contacts are tabulated over one period of
their phase; the phase follows the nominal rotation, at constant or linearly changing speed. At constant speed
and with a step of two samples every stage falls on a sample and nothing is interpolated; between samples
the tables are linear.

Source   E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., ch. II.1
Holds    steps that resolve the fastest mode: ω_max·step below about 1
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin import compiled
from twin.dynamics.harmonic_balance import Contacts, SteadyState
from twin.dynamics.structure import RIGID_HZ, Structure
from twin.errors import ParameterError

STABILITY = 2.78  # limit of ω·step of the method on the imaginary axis


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Motion:
    """What an integration returns, at every `keep`-th step."""

    time: np.ndarray  # (m,) [s]
    displacement: np.ndarray  # of each response direction (m, r)
    acceleration: np.ndarray  # (m, r)
    deflection: np.ndarray  # d (m,) [m]
    mesh_force: np.ndarray  # F (m,) [N]
    modal: tuple[np.ndarray, np.ndarray]  # final η and η' (21,), to go on from


def modal_start(structure: Structure, deflection: float) -> tuple[np.ndarray, np.ndarray]:
    """Modal coordinates at rest with a given mesh deflection [m], taken up by rigid rotation."""
    ω, Φ = structure.modes
    rigid = ω <= 2 * np.pi
    g = Φ.T @ structure.mesh
    η = np.where(rigid, g, 0.0)
    return η * deflection / (g @ η), np.zeros_like(η)


def steady_start(
    structure: Structure, steady: SteadyState, load: np.ndarray, sample: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Modal coordinates and rates (21,) of a steady state at one of its samples, under the loads that keep it up.

    A transient goes on from there. The rotation of the whole is left at 0; that of the mesh follows d.
    """
    ω_r, Φ = structure.modes
    ω = steady.omega[1:]
    phase = np.exp(1j * ω * (2 * np.pi / steady.omega[1]) * sample / steady.deflection.size)
    η, rate = np.zeros(ω_r.size), np.zeros(ω_r.size)
    for r in range(ω_r.size):
        lines = steady.lines(structure, structure.mass @ Φ[:, r]) * phase  # η_r = φ_rᵀ M q
        η[r], rate[r] = lines.real.sum(), (1j * ω * lines).real.sum()
    vibrating = ω_r > 2 * np.pi * RIGID_HZ
    constant = Φ.T @ (load - structure.mesh * steady.force_lines[0].real)
    for a, lines in zip(steady.directions, steady.action_lines, strict=True):
        constant -= Φ.T @ (a * lines[0].real)
    η[vibrating] += constant[vibrating] / ω_r[vibrating] ** 2
    closing = modal_start(structure, float(steady.deflection[sample]) - float(structure.mesh @ Φ @ η))[0]
    return η + closing, rate


def longest_step(structure: Structure, contacts: Contacts) -> float:
    """Longest stable step [s] with the contacts of two pairs closed."""
    return STABILITY / (2 * np.pi * structure.natural_frequencies(_stiffest(contacts)).max())


def _stiffest(contacts: Contacts) -> float:
    return float(contacts.stiffness.max()) * 2


def integrate(
    structure: Structure,
    contacts: Contacts,
    load: np.ndarray,
    duration: float,
    responses: np.ndarray,
    *,
    keep: int = 1,
    samples_per_step: float = 2.0,
    first_sample: float = 0.0,
    speed_change: float = 0.0,
    start: tuple[np.ndarray, np.ndarray] | None = None,
) -> Motion:
    """Integrates the motion under constant loads.

    contacts          tables over one period of the phase, at the speed that their `period` corresponds to
    load              constant generalised forces (21,): torques in and out in balance
    responses         directions to report (r, 21)
    keep              every how many steps to report
    samples_per_step  step in samples of the tables at the starting speed
    speed_change      relative change of speed per second (a run-up), ≥ −1/duration
    start             modal coordinates and rates to go on from; at rest, closed under load, where None
    Raises ParameterError where the step cannot be stable.
    """
    ω, Φ = structure.modes
    h = samples_per_step * contacts.period / contacts.samples
    limit, stiffest = longest_step(structure, contacts), _stiffest(contacts)
    if h > limit:
        raise ParameterError(
            f"a step of {h:.2e} s is too long for the fastest mode at {STABILITY / limit / 2 / np.pi:.0f} Hz "
            f"(at most {limit:.2e} s): more samples a period or fewer a step"
        )
    steps = round(duration / h)
    if start is None:
        mean = load @ structure.mesh / (structure.mesh @ structure.mesh)
        start = modal_start(structure, float(np.max(-contacts.separation[0])) + max(mean, 0.0) / stiffest)
    rate_of_phase = contacts.samples / contacts.period
    actions = np.array([a.direction @ Φ for a in contacts.actions]).reshape(-1, ω.size)
    weights = np.array([a.weight for a in contacts.actions]).reshape(-1, *contacts.stiffness.shape)
    modal = {
        "omega2": np.where(ω > 2 * np.pi, ω**2, 0.0), "damping": structure.modal_damping_terms,
        "mesh": Φ.T @ structure.mesh, "load": Φ.T @ load, "directions": actions, "seen": responses @ Φ,
    }  # fmt: skip
    tables = {
        "stiffness": contacts.stiffness, "separation": contacts.separation,
        "separation_rate": contacts.separation_rate, "side": contacts.side, "weights": weights,
    }  # fmt: skip
    phase = {
        "damping_time": contacts.damping_time, "first": first_sample, "speed": rate_of_phase,
        "speed_rate": rate_of_phase * speed_change, "step": h,
    }  # fmt: skip
    x, a, d, force, η, rate = compiled.integrate(modal, tables, phase, steps, keep, start)
    time = np.arange(d.size) * keep * h
    return Motion(time=time, displacement=x, acceleration=a, deflection=d, mesh_force=force, modal=(η, rate))
