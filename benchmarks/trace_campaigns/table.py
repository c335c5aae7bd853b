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

from benchmarks.trace_campaigns.benches import BENCHES
from benchmarks.trace_campaigns.levels import drawn
from recordings.generator.spec import SCHEMA

UNKNOWN = "unknown_effect"
CONTRACT_EFFECTS = (
    "pinion_eccentricity", "gear_eccentricity", "misalignment", "tooth_friction", "pitch_error",
    "profile_error", "tooth_crack", "mass_unbalance", "torque_ripple", "bearing_defect", "backlash_rattle",
    "mesh_stiffness_loss", "mesh_damping", "sensor_gain", "sensor_resonance",
)  # fmt: skip

DEPTH, WORN = (25.0, 60.0), (6000.0, 9000.0)  # combined depth at the end [µm], revolutions until there
SECONDS = 2.5  # of a window
NEW = 60.0  # revolutions before wear begins: the first window is on new gears
SPREADS = {  # keys of the generator's spec that say how far a healthy machine is from its rig file
    "machine": ("stiffness_spread", "mass_spread", "damping_spread"),
    "wear": ("tooth_scatter",),
    "sensors": ("pinion_graduation_um", "gear_graduation_um"),
}
STEPPED = 1.35  # times the torque after a step
DETUNED = 1.27, 0.8  # speed and torque of the second operating condition, against the first


@dataclass(frozen=True, slots=True)
class Put:
    """One effect put into a campaign; onset as a share of the campaign, 0 from the start.

    full  where it has grown to its size, as a share of the campaign; 0 where it has it from its onset
    """

    name: str
    level: str
    onset: float = 0.0
    given: Mapping[str, Any] = field(default_factory=dict)  # parameters that are not drawn
    full: float = 0.0


@dataclass(frozen=True, slots=True)
class Row:
    """One campaign. `kind` says how it is scored (`tracing_score`); `extra` is merged over the spec drawn."""

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
    bench: str = "unsw"
    given_names: tuple[str, ...] | None = None  # names expected where they are not those of the effects
    place: str = ""  # words, one of which names where an unknown effect sits, apart by |
    group: str = ""  # how the machine wears and is run, for depth and life
    spreads: float | None = None  # of its own, whatever is asked for
    stepped: bool = False  # the load rises at the middle of the campaign, and stays so

    @property
    def expected(self) -> tuple[str, ...]:
        """Names that the tracing should give, sorted; an effect on no list is `unknown_effect`."""
        if self.given_names is not None:
            return tuple(sorted(self.given_names))
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
    bench = BENCHES[row.bench]
    speed, torque = round(rng.uniform(*bench.speed), 2), round(rng.uniform(*bench.torque), 2)
    depth, worn = rng.uniform(*DEPTH), round(rng.uniform(*WORN), -2)
    k, revolutions, load, reached = bench.reference
    at = np.round(np.linspace(0.0, worn, row.windows))
    spec: dict[str, Any] = {
        "schema": "gear-campaign/1",
        "asset": bench.asset,
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
                **({"full_revolutions": float(round(put.full * worn))} if put.full else {}),
                **drawn(put.name, put.level, np.random.default_rng([row.seed, 12, i]), speed, torque, bench),
                **put.given,
            }
            for i, put in enumerate(row.effects)
        ],
        "truth": {"to_end_of_life": True, "life_step_um": 10.0},
    }
    if row.calibrated:
        spec["calibration"] = [
            {"speed_hz": 2.0, "torque_nm": times * bench.rated_torque, "seconds": 3.0} for times in (1.0, 2.0)
        ]
        spec["wear"]["from_revolutions"] = NEW + 35.0
    if row.running_in:
        spec["wear"] |= {"running_in_factor": round(rng.uniform(1.4, 2.2), 2), "running_in_revolutions": worn / 4}
    if row.two_conditions if two_conditions is None else two_conditions:
        spec["conditions"] = alternating(speed, torque, at.tolist(), bench.fastest)
    if row.stepped:
        spec["conditions"] = [
            {"speed_hz": speed, "torque_nm": torque, "until_revolutions": worn / 2},
            {"speed_hz": speed, "torque_nm": round(STEPPED * torque, 2)},
        ]
    return merged(merged(spec, wider(spreads if row.spreads is None else row.spreads)), row.extra)


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


def alternating(speed: float, torque: float, at: Sequence[float], fastest: float = 17.0) -> list[dict[str, float]]:
    """Conditions that change halfway between the windows, there and back."""
    fast, light = DETUNED
    other = {"speed_hz": round(min(speed * fast, fastest), 2), "torque_nm": round(torque * light, 2)}
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
