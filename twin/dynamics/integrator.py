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
from numba import njit

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


@njit(cache=True, fastmath=False)
def _run(omega2, damping, mesh, load, actions, responses, k, e, e_rate, side, weights, tau,  # noqa: C901, PLR0915 - one compiled loop
         first, speed, speed_rate, h, steps, keep, eta, rate, out_x, out_a, out_d, out_f):  # fmt: skip
    modes = omega2.size
    rows, n = k.shape
    n_actions = actions.shape[0]
    stage_eta = np.empty(modes)
    stage_rate = np.empty(modes)
    acc = np.empty(modes)
    total = np.zeros(n_actions)
    k_eta = np.zeros((4, modes))
    k_rate = np.zeros((4, modes))
    offsets = np.array([0.0, 0.5, 0.5, 1.0])
    kept = 0
    for step in range(steps + 1):
        t = step * h
        for stage in range(4):
            ts = t + offsets[stage] * h
            if stage == 0:
                stage_eta[:] = eta
                stage_rate[:] = rate
            else:
                c = offsets[stage] * h
                for r in range(modes):
                    stage_eta[r] = eta[r] + c * k_eta[stage - 1, r]
                    stage_rate[r] = rate[r] + c * k_rate[stage - 1, r]
            d = 0.0
            d_rate = 0.0
            for r in range(modes):
                d += mesh[r] * stage_eta[r]
                d_rate += mesh[r] * stage_rate[r]
            # phase in samples, and how fast it runs against the speed that the tables' rates are given at
            u = first + speed * ts + 0.5 * speed_rate * ts * ts
            ratio = (speed + speed_rate * ts) / speed if speed > 0.0 else 0.0
            whole = np.floor(u + 1e-7)
            part = u - whole
            if part < 1e-6:
                part = 0.0
            i = int(whole) % n
            j = (i + 1) % n
            force = 0.0
            for c in range(n_actions):
                total[c] = 0.0
            for p in range(rows):
                # a row that jumps between two samples hands over to the next pair: hold it
                w = part if abs(e[p, j] - e[p, i]) < 1e-5 else 0.0
                sep = e[p, i] + w * (e[p, j] - e[p, i])
                sep_rate = (e_rate[p, i] + w * (e_rate[p, j] - e_rate[p, i])) * ratio
                x = side[p] * (d + tau * d_rate) + sep + tau * sep_rate
                if x > 0.0:
                    f = side[p] * (k[p, i] + w * (k[p, j] - k[p, i])) * x
                    force += f
                    for c in range(n_actions):
                        total[c] += weights[c, p, i] * f
            for r in range(modes):
                a = load[r] - mesh[r] * force - damping[r] * stage_rate[r] - omega2[r] * stage_eta[r]
                for c in range(n_actions):
                    a -= actions[c, r] * total[c]
                acc[r] = a
                k_eta[stage, r] = stage_rate[r]
                k_rate[stage, r] = a
            if stage == 0 and step % keep == 0:
                out_d[kept] = d
                out_f[kept] = force
                for q in range(responses.shape[0]):
                    x = 0.0
                    a = 0.0
                    for r in range(modes):
                        x += responses[q, r] * stage_eta[r]
                        a += responses[q, r] * acc[r]
                    out_x[kept, q] = x
                    out_a[kept, q] = a
                kept += 1
        if step == steps:
            break
        for r in range(modes):
            eta[r] += h / 6 * (k_eta[0, r] + 2 * k_eta[1, r] + 2 * k_eta[2, r] + k_eta[3, r])
            rate[r] += h / 6 * (k_rate[0, r] + 2 * k_rate[1, r] + 2 * k_rate[2, r] + k_rate[3, r])
    return kept


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
    stiffest = float(contacts.stiffness.max()) * 2
    fastest = 2 * np.pi * structure.natural_frequencies(stiffest).max()
    if fastest * h > STABILITY:
        raise ParameterError(
            f"a step of {h:.2e} s is too long for the fastest mode at {fastest / 2 / np.pi:.0f} Hz "
            f"(at most {STABILITY / fastest:.2e} s): more samples a period or fewer a step"
        )
    steps = round(duration / h)
    if start is None:
        mean = load @ structure.mesh / (structure.mesh @ structure.mesh)
        start = modal_start(structure, float(np.max(-contacts.separation[0])) + max(mean, 0.0) / stiffest)
    rate_of_phase = contacts.samples / contacts.period
    actions = np.array([a.direction @ Φ for a in contacts.actions]).reshape(-1, ω.size)
    weights = np.array([a.weight for a in contacts.actions]).reshape(-1, *contacts.stiffness.shape)
    m = steps // keep + 1
    out_x, out_a = np.empty((m, len(responses))), np.empty((m, len(responses)))
    out_d, out_f = np.empty(m), np.empty(m)
    eta, rate = start[0].copy(), start[1].copy()
    _run(
        np.where(ω > 2 * np.pi, ω**2, 0.0), structure.modal_damping_terms, Φ.T @ structure.mesh, Φ.T @ load,
        actions, np.ascontiguousarray(responses @ Φ), contacts.stiffness, contacts.separation,
        contacts.separation_rate, contacts.side, weights, contacts.damping_time, first_sample, rate_of_phase,
        rate_of_phase * speed_change, h, steps, keep, eta, rate, out_x, out_a, out_d, out_f,
    )  # fmt: skip
    return Motion(
        time=np.arange(m) * keep * h,
        displacement=out_x,
        acceleration=out_a,
        deflection=out_d,
        mesh_force=out_f,
        modal=(eta, rate),
    )
