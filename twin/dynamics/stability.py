"""Whether a steady state lasts: its Floquet multipliers.

A small departure from a steady state follows the linear equations with the slopes of the contacts that are closed,

    η_r'' + 2ζω_r·η_r' + ω_r²·η_r = −(φ_rᵀg·t(t) + Σ_c φ_rᵀa_c·t_c(t))·(δd + τ·δd'),        δd = Σ_r φ_rᵀg·η_r

Over one period it is multiplied by the monodromy matrix, whose eigenvalues are the multipliers; a departure grows where
one is greater than 1. The two of the free rotation of all shafts together are 1 and are left out. The period is passed
sample by sample: the modes exactly, the contacts as impulses (Strang's splitting, second order).

Source   A. H. Nayfeh, B. Balachandran, Applied Nonlinear Dynamics, Wiley 1995, ch. 7; G. Strang, SIAM J. Numer. Anal.
         5 (1968) 506–517
Ignores  contacts that open or close because of the departure: at a transversal crossing their force is zero there
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from twin.compiled import monodromy
from twin.dynamics.harmonic_balance import Contacts, SteadyState
from twin.dynamics.structure import Structure

NEUTRAL = 2  # multipliers of the free rotation


def largest_multiplier(structure: Structure, contacts: Contacts, steady: SteadyState) -> float:
    """Modulus of the largest multiplier but those of the free rotation; above 1 a departure grows."""
    multipliers = floquet_multipliers(structure, contacts, steady)
    order = np.argsort(np.abs(multipliers - 1))
    return float(np.abs(multipliers[order[NEUTRAL:]]).max())


def floquet_multipliers(structure: Structure, contacts: Contacts, steady: SteadyState) -> np.ndarray:
    """Eigenvalues of the monodromy matrix (42,)."""
    n = contacts.samples
    ω, Φ = structure.modes
    closed = contacts.stiffness * (steady.contact_forces > 0)
    directions = np.array([structure.mesh @ Φ, *(action.direction @ Φ for action in contacts.actions)])
    slopes = np.array([closed.sum(axis=0), *((a.weight * closed).sum(axis=0) for a in contacts.actions)])
    step = contacts.period / n
    modes = np.array([
        expm(step * np.array([[0.0, 1.0], [-(w**2), -damping]]))
        for w, damping in zip(ω, structure.modal_damping_terms, strict=True)
    ])  # fmt: skip
    return np.linalg.eigvals(monodromy(modes, directions, step * slopes, contacts.damping_time))
