"""Archard wear between the windows: the load of a few turns, and its wear extrapolated.

    depth of one passage = k·(F/W)·|v_slide|/(ω1·rb1) = k·(F/W)·|s|·(1 + z1/z2)/rb1

the same on both flanks. F/W line force of the slice, s distance of the contact from the pitch point. A
pinion tooth is passed once a pinion revolution, a gear tooth z1/z2 times: the pinion has 1/(1 + z1/z2) of
the depth.

The wear of each gear can differ by a factor (its hardness), across the face (1 + 2·g·z, z from −½ to ½) and from
tooth to tooth.

The forces are those of the pair at rest under the mean load (`sweep`), or, with `dynamic_forces`, under the
mesh force of the turning machine, averaged over its mesh periods; every geometrical effect and friction
included, over TURNS turns of the present surfaces, on which every tooth of both gears is passed; each block
goes on from where the last one ended, so other teeth meet each time. The mean depth of one passage, spread
over a worn-in contact width, is extrapolated until the deepest point has gone `step` deeper. The spread is
elliptic, as the pressure of a contact is, on both flanks: applied twice, its effect on a corrugation is
never negative.

Ignores  dynamic forces unless asked for (a corrugation may grow with them at the mesh resonance), and always
         their difference from tooth to tooth; hardness profiles, temperature, lubrication
"""

from __future__ import annotations

from math import pi

import numpy as np
from scipy.ndimage import correlate1d

from recordings.generator.effects import Knobs
from recordings.generator.flanks import SPACING
from recordings.generator.machine import Condition, Machine

TURNS = 3.0  # of the pinion in one block: at least one of the gear
ANEW = 8e-6, 0.1  # wear after which the dynamic force is sought anew: depth [m], or share of the depth


def elliptic_kernel(half_width: float) -> np.ndarray:
    """Weights on a flank's points of two elliptic contacts of the given half-width [m]; their sum is 1."""
    n = int(half_width / SPACING)
    x = SPACING * np.arange(-n, n + 1)
    weight = np.sqrt(np.maximum(0.0, 1 - (x / half_width) ** 2))
    weight = np.convolve(weight, weight)
    return weight / weight.sum()


def coefficient(wear: dict, revolutions: float) -> float:
    """k [m²/N] at an age: falls (or rises) from a running-in factor towards its lasting value."""
    excess = (wear["running_in_factor"] - 1) * np.exp(-revolutions / wear["running_in_revolutions"])
    return wear["k_m2_per_n"] * (1 + excess)


def depth_per_revolution(machine: Machine, rates, k: float, hardness, kernel) -> tuple[np.ndarray, np.ndarray]:
    """Depth per pinion revolution [m] from force × distance [N·m] of one passage; pinion and gear.

    hardness  factor of each tooth's wear, of either gear: (teeth,), or (teeth, slices) where the face differs
    """
    z1, z2 = machine.pair.teeth
    per_newton_metre = k / (machine.pair.face_width / machine.slices) * (1 + z1 / z2) / machine.pair.base_radius[0]
    out = []
    for rate, hard, passages in zip(rates, hardness, (1.0, z1 / z2), strict=True):
        smooth = correlate1d(rate, kernel, axis=1, mode="constant")
        out.append(smooth * hard.reshape(len(hard), 1, -1) * per_newton_metre * passages)
    return out[0], out[1]


class Wearing:
    """Wears a machine: remembers which teeth met last, and the hardness of each."""

    def __init__(self, machine: Machine, wear: dict, rng: np.random.Generator):
        self.machine, self.wear = machine, wear
        self.kernel = elliptic_kernel(wear["contact_half_width_um"] * 1e-6)
        place = (np.arange(machine.slices) + 0.5) / machine.slices - 0.5
        face = 1 + 2 * wear.get("face_gradient", 0.0) * place
        self.hardness = tuple(
            np.maximum(0.0, 1 + wear["tooth_scatter"] * rng.normal(0, 1, z))[:, None] * wear.get(factor, 1.0) * face
            for z, factor in zip(machine.pair.teeth, ("pinion_factor", "gear_factor"), strict=True)
        )
        self.turns = max(TURNS, np.ceil(machine.pair.teeth[1] / machine.pair.teeth[0]))
        self.angle = 0.0
        self.ratio: np.ndarray | None = None  # of the dynamic force to its mean, over the mesh period
        self.sought = (0.0, 0.0, -1, 0.0)  # speed, torque, effects and depth [m] that it was sought at

    def advance(self, start: float, stop: float, condition: Condition, knobs: Knobs, active: int = 0) -> None:
        """Wears the flanks from pinion revolution `start` to `stop`, one condition and set of effects.

        `active` counts the effects at work: with another one the dynamic force is another.
        """
        done, machine = start, self.machine
        while done < stop:
            self._seek_ratio(condition, knobs, active)
            rates = machine.carried(condition, knobs, self.angle, self.turns, self.ratio)
            self.angle = (self.angle + 2 * pi * self.turns) % (2 * pi * machine.pair.teeth[1])
            k = coefficient(self.wear, done)
            pinion, gear = depth_per_revolution(machine, rates, k, self.hardness, self.kernel)
            fastest = (pinion.mean(0) + gear.mean(0)).max()
            turns = stop - done
            if fastest * turns > self.wear["step_um"] * 1e-6:
                turns = self.wear["step_um"] * 1e-6 / fastest
            machine.pinion_worn += turns * pinion
            machine.gear_worn += turns * gear
            done += turns

    def _seek_ratio(self, condition: Condition, knobs: Knobs, active: int) -> None:
        """The dynamic force anew, where the machine has changed enough since it was sought last."""
        if not self.wear["dynamic_forces"]:
            return
        depth = float((self.machine.pinion_worn.mean((0, 2)) + self.machine.gear_worn.mean((0, 2))).max())
        run_as = (condition.speed, condition.torque, active)
        least, share = ANEW
        if self.sought[:3] != run_as or depth - self.sought[3] > max(least, share * depth):
            self.ratio = self.machine.force_ratio(condition, knobs)
            self.sought = (*run_as, depth)


def depths(machine: Machine) -> dict[str, float]:
    """Depth of wear now [µm], along the active profile: means over teeth and face unless said otherwise."""
    s = machine.pair.points
    active = (s >= machine.pair.start) & (s <= machine.pair.end)
    pinion, gear = machine.pinion_worn.mean(0), machine.gear_worn.mean(0)
    both, face = pinion + gear, (pinion + gear).mean(1)
    tooth = machine.pinion_worn.mean(2).max(0) + machine.gear_worn.mean(2).max(0)
    outside = face[~active]
    return {
        "combined_um": float(face[active].max() * 1e6),
        "pinion_um": float(pinion.mean(1)[active].max() * 1e6),
        "gear_um": float(gear.mean(1)[active].max() * 1e6),
        "combined_any_slice_um": float(both[active].max() * 1e6),
        "combined_any_tooth_um": float(tooth[active].max() * 1e6),
        "combined_outside_active_um": float(outside.max() * 1e6),
    }


def profile(machine: Machine) -> dict[str, list]:
    """Depth along both flanks [µm], mean over teeth and face, at every other point s [mm]."""
    every = slice(None, None, 2)
    return {
        "s_mm": np.round(machine.pair.points[every] * 1e3, 4).tolist(),
        "pinion_um": np.round(machine.pinion_worn.mean((0, 2))[every] * 1e6, 3).tolist(),
        "gear_um": np.round(machine.gear_worn.mean((0, 2))[every] * 1e6, 3).tolist(),
        "active_mm": [machine.pair.start * 1e3, machine.pair.end * 1e3],
    }
