"""Motion of the machine: classical Runge-Kutta of order 4 in the modes of the linear structure.

    u'' = −ω²u − 2ζωu' + Φᵀ f(t, u, u')

f holds the mesh (drive and back flanks, friction), the speed-controlled motor, the brake, and what effects
add: unbalance, torque ripple, blows in a bearing, play in a bearing, and forces that are a function of the
pinion's angle (couplings, rubs). Fixed step, a few times shorter than the fastest mode.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from recordings.generator.contact import back_force, forces


class Linear(NamedTuple):
    """The structure as the integrator reads it: rows of Φ for what is pushed or looked at; n = 21."""

    ω2: np.ndarray  # (n,)
    c: np.ndarray  # 2ζω (n,)
    mesh: np.ndarray  # Φᵀg
    back: np.ndarray  # Φᵀb
    tangent: np.ndarray  # Φᵀt
    th1: np.ndarray
    th5: np.ndarray
    th7: np.ndarray
    th8: np.ndarray
    th10: np.ndarray
    th13: np.ndarray
    x5: np.ndarray
    y5: np.ndarray
    x10: np.ndarray
    y10: np.ndarray
    bearing: np.ndarray  # of the node that a damaged bearing strikes
    loose_x: np.ndarray  # of the bearing that may have play
    loose_y: np.ndarray
    accelerometer: np.ndarray
    torque_meter: np.ndarray


class Drive(NamedTuple):
    """What drives and brakes, on a time grid of one value a step and one more."""

    speed: np.ndarray  # set speed of the motor [rad/s]
    brake: np.ndarray  # torque on the brake's rotor, against the rotation [N·m]
    bearing: np.ndarray  # force on the damaged bearing [N]
    feed_forward: float  # motor torque at rest of the control [N·m]
    proportional: float  # [N·m·s/rad]
    integral: float  # [N·m/rad]
    ripple: np.ndarray  # motor torque ripple: amplitude [N·m], order of the motor's turn, phase
    eccentricity: np.ndarray  # pinion [m], its high point [rad], gear [m], its high point
    unbalance: np.ndarray  # pinion m·e [kg·m], phase, gear, phase
    loose: np.ndarray  # bearing with play: kx, ky [N/m], play, δ0 [m], exponent − 1, share s of kx and ky at δ0
    turn: np.ndarray  # modal forces over one pinion turn, its start again at the end; (bins + 1, n), (0, n) none
    rough: np.ndarray  # factor of the modal forces over a turn, one a step and one more
    sin: float  # of the pressure angle
    cos: float


@nb.njit(cache=True, inline="always")
def _dot(a, b):
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@nb.njit(cache=True)
def loose_force(x, y, loose):
    """What play takes off the linear force of a bearing at its displacement (x, y) [m]; (fx, fy) [N].

    Outside the play the bearing carries, in the direction of its displacement,
    s·k·δ·(δ/δ0)^p with δ the displacement beyond the play; inside nothing.
    """
    r = np.sqrt(x * x + y * y)
    off = 1.0
    if r > loose[2]:
        δ = r - loose[2]
        off = 1.0 - loose[5] * δ / r * (δ / loose[3]) ** loose[4]
    return loose[0] * x * off, loose[1] * y * off


@nb.njit(cache=True)
def _add_loose_and_turning(lin, drive, u, θ1, rough, out):
    """Adds what play in a bearing and forces over the turn do to the modal accelerations."""
    if drive.loose[0] != 0.0:
        fx, fy = loose_force(_dot(lin.loose_x, u), _dot(lin.loose_y, u), drive.loose)
        for i in range(u.size):
            out[i] += lin.loose_x[i] * fx + lin.loose_y[i] * fy
    if drive.turn.shape[0] > 0:
        at = θ1 / (2.0 * np.pi)
        at = (at - np.floor(at)) * (drive.turn.shape[0] - 1)
        low = int(at)
        w = at - low
        for i in range(u.size):
            out[i] += rough * ((1.0 - w) * drive.turn[low, i] + w * drive.turn[low + 1, i])


@nb.njit(cache=True)
def _acceleration(lin, mesh, drive, u, v, integral, speed, brake, blow, rough, out, sums, slices, state):
    """Modal accelerations into out (n,); state (4,): drive force, back force, approach d, motor speed."""
    θ1, θ2 = _dot(lin.th5, u), _dot(lin.th10, u)
    ω1, ω2 = _dot(lin.th5, v), _dot(lin.th10, v)
    d, rate = _dot(lin.mesh, u), _dot(lin.mesh, v)
    db, rate_b = _dot(lin.back, u), _dot(lin.back, v)
    away = 0.0
    e1, e2 = drive.eccentricity[0], drive.eccentricity[2]
    if e1 != 0.0 or e2 != 0.0:  # the centres turn clockwise with the pinion, the other way with the gear
        a1, a2 = θ1 + drive.eccentricity[1], θ2 + drive.eccentricity[3]
        x = e1 * np.cos(a1) - e2 * np.cos(a2)
        y = -e1 * np.sin(a1) - e2 * np.sin(a2)
        vx = -e1 * np.sin(a1) * ω1 + e2 * np.sin(a2) * ω2
        vy = -e1 * np.cos(a1) * ω1 - e2 * np.cos(a2) * ω2
        d += x * drive.sin - y * drive.cos
        rate += vx * drive.sin - vy * drive.cos
        db += x * drive.sin + y * drive.cos
        rate_b += vx * drive.sin + vy * drive.cos
        away = -x
    forces(mesh, θ1, d, rate, away, sums, slices)
    back = back_force(mesh, θ1, db, rate_b)
    motor_speed = _dot(lin.th1, v)
    motor = drive.feed_forward + drive.proportional * (speed - motor_speed) + drive.integral * integral
    if drive.ripple[0] != 0.0:
        motor += drive.ripple[0] * np.sin(drive.ripple[1] * _dot(lin.th1, u) + drive.ripple[2])
    state[0], state[1], state[2], state[3] = sums[0], back, d, motor_speed
    for i in range(u.size):
        a = -lin.ω2[i] * u[i] - lin.c[i] * v[i] - lin.mesh[i] * sums[0] - lin.back[i] * back
        a += lin.th1[i] * motor - lin.th13[i] * brake
        out[i] = a
    if mesh.friction != 0.0:
        for i in range(u.size):
            out[i] += lin.tangent[i] * sums[1] - lin.th5[i] * sums[2] + lin.th10[i] * sums[3]
    if blow != 0.0:
        for i in range(u.size):
            out[i] += lin.bearing[i] * blow
    if drive.unbalance[0] != 0.0 or drive.unbalance[2] != 0.0:
        f1, f2 = drive.unbalance[0] * ω1 * ω1, drive.unbalance[2] * ω2 * ω2
        a1, a2 = θ1 + drive.unbalance[1], θ2 + drive.unbalance[3]
        for i in range(u.size):
            out[i] += f1 * (lin.x5[i] * np.cos(a1) - lin.y5[i] * np.sin(a1))
            out[i] += f2 * (lin.x10[i] * np.cos(a2) + lin.y10[i] * np.sin(a2))
    _add_loose_and_turning(lin, drive, u, θ1, rough, out)


@nb.njit(cache=True)
def run(lin, mesh, drive, u, v, control, dt, steps, record, slices):
    """Takes u, v (n,) and control (1,) forward by `steps` steps, in place.

    record (steps, 8) or (0, 8), before each step: acceleration, sensed torque, th7, th8, mesh force,
    back force, approach, motor speed.
    """
    n = u.size
    k = np.zeros((4, n))
    us, vs = u.copy(), v.copy()
    velocities = np.zeros((4, n))
    sums, state = np.zeros(4), np.zeros(4)
    rates = np.zeros(4)
    for step in range(steps):
        s0, s1 = drive.speed[step], drive.speed[step + 1]
        b0, b1 = drive.brake[step], drive.brake[step + 1]
        f0, f1 = drive.bearing[step], drive.bearing[step + 1]
        r0, r1 = drive.rough[step], drive.rough[step + 1]
        for stage in range(4):
            at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            w = control[0]
            if stage == 0:
                us[:] = u
                vs[:] = v
            else:
                h = at * dt
                for i in range(n):
                    us[i] = u[i] + h * velocities[stage - 1, i]
                    vs[i] = v[i] + h * k[stage - 1, i]
                w += h * rates[stage - 1]
            velocities[stage] = vs
            speed = s0 + at * (s1 - s0)
            _acceleration(
                lin, mesh, drive, us, vs, w, speed, b0 + at * (b1 - b0), f0 + at * (f1 - f0),
                r0 + at * (r1 - r0), k[stage], sums, slices, state,
            )  # fmt: skip
            rates[stage] = speed - state[3]
            if stage == 0 and record.shape[0] > 0:
                record[step, 0] = _dot(lin.accelerometer, k[0])
                record[step, 1] = _dot(lin.torque_meter, us)
                record[step, 2] = _dot(lin.th7, us)
                record[step, 3] = _dot(lin.th8, us)
                for i in range(4):
                    record[step, 4 + i] = state[i]
        for i in range(n):
            total_v = velocities[0, i] + 2.0 * (velocities[1, i] + velocities[2, i]) + velocities[3, i]
            u[i] += dt / 6.0 * total_v
            v[i] += dt / 6.0 * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i])
        control[0] += dt / 6.0 * (rates[0] + 2.0 * (rates[1] + rates[2]) + rates[3])
