"""One campaign of the table, and the generator's spec that it stands for.

A row says what is in a campaign; everything else, the machine, the operating condition, the depth, the sizes
within their level, is drawn from its seed.

What keeps a campaign at a quarter of a minute of one core: five slices across the face instead of nine (seven
where the face is misaligned), five to seven windows of 2.5 s, and a march to the end of life in steps of 5 µm, which
moves it by 0.02 %. The integration, the contact and the wear up to the last window are those of longer campaigns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.trace_campaigns.levels import drawn
from recordings.generator.spec import SCHEMA

UNKNOWN = "unknown_effect"
CONTRACT_EFFECTS = (
    "pinion_eccentricity", "gear_eccentricity", "misalignment", "tooth_friction", "pitch_error",
    "profile_error", "tooth_crack", "mass_unbalance", "torque_ripple", "bearing_defect", "backlash_rattle",
    "mesh_stiffness_loss", "mesh_damping", "sensor_gain", "sensor_resonance",
)  # fmt: skip

SPEED, TORQUE = (9.0, 16.0), (8.0, 15.0)  # of the operating condition [Hz], [N·m]
DEPTH, WORN = (25.0, 60.0), (6000.0, 9000.0)  # combined depth at the end [µm], revolutions until there
REFERENCE = 1.2e-12, 9000.0, 10.0, 46.7  # k [m²/N], revolutions, torque [N·m] and the depth they wear [µm]
SECONDS = 2.5  # of a window
NEW = 60.0  # revolutions before wear begins: the first window is on new gears
SPREADS = {  # keys of the generator's spec that say how far a healthy machine is from its rig file
    "machine": ("stiffness_spread", "mass_spread", "damping_spread"),
    "wear": ("tooth_scatter",),
    "sensors": ("pinion_graduation_um", "gear_graduation_um"),
}
DETUNED = 1.27, 0.8  # speed and torque of the second operating condition, against the first


@dataclass(frozen=True, slots=True)
class Put:
    """One effect put into a campaign; onset as a share of the campaign, 0 from the start."""

    name: str
    level: str
    onset: float = 0.0
    given: Mapping[str, Any] = field(default_factory=dict)  # parameters that are not drawn


@dataclass(frozen=True, slots=True)
class Row:
    """One campaign. `kind` is single, pair, unknown or clean; `extra` is merged over the spec drawn."""

    name: str
    seed: int
    kind: str
    effects: tuple[Put, ...] = ()
    windows: int = 6
    calibrated: bool = False
    running_in: bool = False
    two_conditions: bool = False
    tolerated: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def expected(self) -> tuple[str, ...]:
        """Names that the tracing should give, sorted; an effect on no list is `unknown_effect`."""
        names = {put.name if put.name in CONTRACT_EFFECTS else UNKNOWN for put in self.effects}
        return tuple(sorted(names))

    @property
    def level(self) -> str:
        return "+".join(put.level for put in self.effects) or "–"


def spec_of(row: Row, *, two_conditions: bool | None = None, spreads: float = 1.0) -> dict[str, Any]:
    """The generator's spec of a row.

    two_conditions  overrides the row's own
    spreads         times the generator's own spreads of structure and instruments: the machine is then that much
                    farther from the rig file than the twin takes it to be
    """
    rng = np.random.default_rng([row.seed, 11])
    speed, torque = round(rng.uniform(*SPEED), 2), round(rng.uniform(*TORQUE), 2)
    depth, worn = rng.uniform(*DEPTH), round(rng.uniform(*WORN), -2)
    k, revolutions, load, reached = REFERENCE
    at = np.round(np.linspace(0.0, worn, row.windows))
    spec: dict[str, Any] = {
        "schema": "gear-campaign/1",
        "asset": "unsw-rig",
        "description": "wear campaign, measurement windows",
        "seed": row.seed,
        "wear": {
            "k_m2_per_n": float(f"{k * depth / reached * load / torque * revolutions / worn:.4g}"),
            "from_revolutions": NEW,
            "dynamic_forces": True,
            "contact_half_width_um": round(rng.uniform(150, 260)),
        },
        "machine": {
            "mesh_stiffness_scale": round(rng.uniform(0.88, 1.06), 3),
            "slices": 7 if any(put.name == "misalignment" for put in row.effects) else 5,
        },
        "conditions": [{"speed_hz": speed, "torque_nm": torque}],
        "windows": {"seconds": SECONDS, "at_revolutions": at.tolist()},
        "effects": [
            {
                "name": put.name,
                "onset_revolutions": float(round(put.onset * worn)),
                **drawn(put.name, put.level, np.random.default_rng([row.seed, 12, i]), speed, torque),
                **put.given,
            }
            for i, put in enumerate(row.effects)
        ],
        "truth": {"to_end_of_life": True, "life_step_um": 10.0},
    }
    if row.calibrated:
        spec["calibration"] = [{"speed_hz": 2.0, "torque_nm": t, "seconds": 3.0} for t in (10.0, 20.0)]
        spec["wear"]["from_revolutions"] = NEW + 35.0
    if row.running_in:
        spec["wear"] |= {"running_in_factor": round(rng.uniform(1.4, 2.2), 2), "running_in_revolutions": worn / 4}
    if row.two_conditions if two_conditions is None else two_conditions:
        spec["conditions"] = alternating(speed, torque, at.tolist())
    return merged(merged(spec, wider(spreads)), row.extra)


def wider(spreads: float) -> dict[str, Any]:
    """Spreads of structure, teeth and discs, so many times the generator's own; nothing to change for 1."""
    if spreads == 1:
        return {}
    out: dict[str, Any] = {}
    for table, keys in SPREADS.items():
        usual = {key: SCHEMA[table][key].default for key in keys}
        out[table] = {
            key: [spreads * v for v in value] if isinstance(value, tuple) else spreads * value
            for key, value in usual.items()
        }
    return out


def alternating(speed: float, torque: float, at: Sequence[float]) -> list[dict[str, float]]:
    """Conditions that change halfway between the windows, there and back."""
    fast, light = DETUNED
    other = {"speed_hz": round(min(speed * fast, 17.0), 2), "torque_nm": round(torque * light, 2)}
    both = ({"speed_hz": speed, "torque_nm": torque}, other)
    ends = [(a + b) / 2 for a, b in pairwise(at)]
    rows = [{**both[i % 2], "until_revolutions": float(end)} for i, end in enumerate(ends)]
    return [*rows, dict(both[len(ends) % 2])]


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """`below` with the entries of `above` put over it, table by table."""
    out = dict(below)
    for key, value in above.items():
        mine = out.get(key)
        out[key] = merged(mine, value) if isinstance(value, Mapping) and isinstance(mine, Mapping) else value
    return out
