"""A housing that stands on a loose foot: motion of the whole gearbox, added to what its accelerometer feels.

    m·z'' = −N(z) − c·z' + U·ω²·cos θ + a·(F − F̄),      N = k·z where z < lift, else k·lift + r·k·(z − lift)

z is upwards from where the foot rests under its load, which lifts off at z = lift = P/k: from there only the bolt's
remaining stiffness r·k holds. P is the foot's load: what the rated torque leaves of it, and less by the reaction
of the gears' torques where the machine carries more. Unbalance U of the pinion's shaft and a share a of the
mesh force shake it. Once it lifts off, harmonics and fractions of the shaft's order come.

With r and no load the period is that of half an oscillation at either stiffness: 2·f1·f2/(f1 + f2).

Source   S. W. Shaw, P. J. Holmes, J. Sound Vib. 90 (1983) 129-155 (oscillator with piecewise linear stiffness);
         A. Muszynska, Rotordynamics (2005), ch. 6 (looseness of a foot: fractions and multiples of the speed)
Ignores  what the foot's motion does to the gears: the housing is taken to be heavy beside them
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numba as nb
import numpy as np

SETTLING = 12.0  # periods of the resting foot that are played before the record
LEAST_LOAD = 0.05  # of the foot's rated load that a heavy torque leaves on it


@nb.njit(cache=True)
def bilinear(push, dt, mass, stiffness, damping, open_share, lift, z, v):
    """Acceleration [m/s²] of a mass on a spring that is softer beyond `lift` [m]; (n,) forces [N] → (n,)."""
    out = np.empty(push.size)
    for step in range(push.size):
        f0 = push[step]
        f1 = push[min(step + 1, push.size - 1)]
        total_z, total_v, a, kz, kv = 0.0, 0.0, 0.0, 0.0, 0.0
        for stage in range(4):
            h = 0.0 if stage == 0 else (dt if stage == 3 else 0.5 * dt)
            at, speed = z + h * kz, v + h * kv
            spring = stiffness * at if at < lift else stiffness * (lift + open_share * (at - lift))
            a = (f0 + h / dt * (f1 - f0) - spring - damping * speed) / mass
            kz, kv = speed, a
            weight = 1.0 if stage == 0 or stage == 3 else 2.0
            total_z += weight * kz
            total_v += weight * kv
            if stage == 0:
                out[step] = a
        z += dt / 6.0 * total_z
        v += dt / 6.0 * total_v
    return out


@dataclass(frozen=True, slots=True)
class LooseFoot:
    """One foot of the housing that its bolt no longer holds down; SI."""

    mass: float  # m [kg]
    frequency: float  # of the resting foot [Hz]
    damping_ratio: float
    load: float  # P at the rated torque [N]
    open_share: float  # r
    unbalance: float  # U [kg·m]
    mesh_share: float  # a
    span: float  # between the feet [m]

    def __call__(self, record, dt: float, torque: float, rated: float, ratio: float) -> np.ndarray:
        """Vertical acceleration [m/s²] at every step of a record of `integrate.run`; (steps,).

        torque, rated  of the pinion's shaft [N·m]; ratio  z2/z1
        """
        ω0 = 2 * pi * self.frequency
        stiffness = self.mass * ω0**2
        load = max(self.load - (torque - rated) * (1 + ratio) / self.span, LEAST_LOAD * self.load)
        θ, mesh = record[:, 2], record[:, 4]
        speed = (θ[-1] - θ[0]) / (dt * (len(θ) - 1))
        push = self.unbalance * speed**2 * np.cos(θ) + self.mesh_share * (mesh - mesh.mean())
        lead = int(SETTLING / self.frequency / dt)  # played backwards first, so that no start is heard
        push = np.concatenate([push[min(lead, push.size - 1) : 0 : -1], push])
        damping = 2 * self.damping_ratio * ω0 * self.mass
        out = bilinear(push, dt, self.mass, stiffness, damping, self.open_share, load / stiffness, 0.0, 0.0)
        return out[-len(θ) :]
