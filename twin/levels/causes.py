"""Causes that make the level curves of a machine differ from those of its rig file.

    twin                as the rig file describes the machine
    contact kept        the teeth stick together: the linear response to the quasi-static transmission error
    sliding wear        depth by the sliding distance alone, without load sharing
    even wear           a part of the depth lies evenly over the flank
    uneven teeth        gear teeth are worn to different depths
    other shaft's load  the torque stated was that of the other shaft
    other sensor        the levels are those on the other shaft, where the sensor is not stated
    lower band          the levels are of a band to 2 kHz, where the band is not stated
    other values        of the numbers that the rig file estimates: other resonances, damping, contact width

Source   hypotheses on published series of worn gears (README of the data)
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from math import log
from typing import Any

import numpy as np

from twin.errors import ParameterError
from twin.levels.curve import LevelCurve, level_curve, linear_curve
from twin.levels.wear import Wear, by_load_sharing, by_sliding, with_even_part
from twin.model import Calibration, Condition, Model
from twin.rig import Rig

Curves = Mapping[str, LevelCurve]

NUMBERED = " #"  # between the name of a cause and which of several it is
EVEN_WEAR, OTHER_VALUES = "even wear", "other values"
STEP = 50e-6  # between the depths of a curve, closer where wear begins [m]
FIRST = (10e-6, 20e-6, 40e-6, 60e-6, 80e-6)
EVEN_SHARES = (0.25, 0.5)
UNEVENNESS = 0.15  # standard deviation of the depth from tooth to tooth
DURATION = 1.2  # of the motion that is evaluated at every depth [s]
UNEVEN_DURATION = 2.4  # [s]: the hunting-tooth period of slow gears is long
OTHER_SHAFT = {"y4": "y9", "y9": "y4", "y6": "y11", "y11": "y6"}  # bearings of either shaft by the model's coordinates
LOWER_BAND = 2000.0  # upper end of the band of the published experiments [Hz]


def depths_to(deepest: float) -> np.ndarray:
    """Depths of a curve up to and beyond the deepest case [m]."""
    return np.concatenate(([0.0], FIRST, np.arange(FIRST[-1] + 40e-6, deepest + STEP, STEP)))


def drawn(rig: Rig, spreads: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """The rig with every estimated value times a factor between 1/spread and spread, even in its logarithm."""
    for path, spread in spreads.items():
        value = rig.get(path)
        if not spread > 1:
            raise ParameterError(f"estimated.{path} = {spread:g} must be above 1: a factor")
        if not isinstance(value, (int, float)):
            raise ParameterError(f"estimated.{path}: the rig file gives no such number")
        rig = with_value(rig, path, value * float(np.exp(rng.uniform(-1, 1) * log(spread))))
    return rig


def with_value(rig: Rig, path: str, value: Any) -> Rig:
    """The rig with another value at a dotted path."""
    values = deepcopy(dict(rig.values))
    *tables, key = path.split(".")
    node = values
    for table in tables:
        node[table] = dict(node[table])
        node = node[table]
    node[key] = value
    return Rig.from_mapping(values)


@dataclass(frozen=True, eq=False, kw_only=True)
class Machine:
    """One rig under the conditions of a series."""

    model: Model
    conditions: Mapping[str, Condition]
    depths: np.ndarray

    @classmethod
    def of(cls, rig: Rig, conditions: Mapping[str, Condition], depths: np.ndarray) -> Machine:
        return cls(model=Model.of(rig, Calibration.prior(rig)), conditions=conditions, depths=depths)

    def worn(self) -> Wear:
        return by_load_sharing(self.model, next(iter(self.conditions.values())), float(self.depths[-1]))

    def curves(self, wear: Wear, unevenness: float = 0.0, duration: float | None = None) -> Curves:
        duration = DURATION if duration is None else duration
        return {
            k: level_curve(
                self.model, c, wear, self.depths, band=self.model.rig.band, unevenness=unevenness, duration=duration
            )
            for k, c in self.conditions.items()
        }

    def closed(self, wear: Wear) -> Curves:
        return {
            k: linear_curve(self.model, c, wear, self.depths, band=self.model.rig.band)
            for k, c in self.conditions.items()
        }


def causes_of(rig: Rig, stated: Collection[str]) -> dict[str, tuple[str, Callable[[Machine, Wear], Curves]]]:
    """Causes that make other curves: a sentence on each, and how its curves are computed."""

    def even(share: float) -> Callable[[Machine, Wear], Curves]:
        return lambda machine, wear: machine.curves(with_even_part(wear, share))

    def sliding(machine: Machine, wear: Wear) -> Curves:
        return machine.curves(by_sliding(machine.model))

    def uneven(machine: Machine, wear: Wear) -> Curves:
        return machine.curves(wear, unevenness=UNEVENNESS, duration=UNEVEN_DURATION)

    def seen(path: str, value: Any) -> Callable[[Machine, Wear], Curves]:
        other = with_value(rig, path, value)
        return lambda machine, wear: replace(machine, model=Model.of(other, machine.model.calibration)).curves(wear)

    causes = {
        "twin": ("as the rig file says", Machine.curves),
        "contact kept": ("no loss of contact: the linear response", Machine.closed),
        "sliding wear": ("depth by the sliding distance alone", sliding),
        "uneven teeth": (f"gear teeth differ by {100 * UNEVENNESS:.0f} % of the depth", uneven),
        "other shaft's load": ("the torque stated is the other shaft's", lambda machine, wear: _loaded(machine)),
        **{f"{EVEN_WEAR}{NUMBERED}{q:g}": ("", even(q)) for q in EVEN_SHARES},
    }
    if "sensor" not in stated and rig.accelerometer in OTHER_SHAFT:
        causes["other sensor"] = (
            "the level is that on the other shaft",
            seen("sensors.accelerometer", OTHER_SHAFT[rig.accelerometer]),
        )
    if "band" not in stated and rig.band[1] > LOWER_BAND:
        causes["lower band"] = (
            f"the level is of a band to {LOWER_BAND:g} Hz",
            seen("sensors.band_hz", [rig.band[0], LOWER_BAND]),
        )
    return causes


def _loaded(machine: Machine) -> Curves:
    """Under the load that the torques would be if they were those of the other shaft."""
    z1, z2 = machine.model.mesh.pair.teeth
    heavier = {k: replace(c, torque=c.torque * z2 / z1) for k, c in machine.conditions.items()}
    other = replace(machine, conditions=heavier)
    return other.curves(other.worn())
