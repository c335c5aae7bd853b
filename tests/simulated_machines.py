"""Campaigns of machines whose structure is drawn from what `gear-twin init` states, by the independent simulator."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from recordings import simulate_file
from tests.estimated_machines import rig_of
from twin.mesh.stiffness import PairStiffness
from twin.rig import Rig
from twin.structure_spread import drawn

SPEC = """schema = "gear-campaign/1"
rig = "machine.toml"
asset = "drawn"
seed = {seed}
[wear]
k_m2_per_n = {k}
from_revolutions = 60
[machine]
stiffness_spread = 0.0
mass_spread = 0.0
damping_spread = 0.0
[[conditions]]
speed_hz = {speed}
torque_nm = {torque}
[sensors]
torque_range_nm = {range}
[windows]
seconds = {seconds}
at_revolutions = {revolutions}
"""


def simulated(name: str, seed: int, folder: Path, revolutions: list[int], k: float, seconds: float = 1.2) -> Path:
    """A recording, and its truth in `truth/NAME.json`, of a machine that the rig file of these answers may describe."""
    rig = drawn(rig_of(name), np.random.default_rng(seed))
    (folder / "machine.toml").write_text(_rig_text(rig), encoding="utf-8")
    speed, torque = rig.require("the condition", "operating.pinion_speed_hz", "operating.input_torque")
    spec = SPEC.format(
        seed=seed, k=k, speed=speed, torque=torque, range=5 * torque, seconds=seconds, revolutions=revolutions
    )
    (folder / "spec.toml").write_text(spec, encoding="utf-8")
    out = folder / f"{name}-{seed}.mcap"
    truth = folder / "truth" / f"{out.stem}.json"
    truth.parent.mkdir(exist_ok=True)
    simulate_file(folder / "spec.toml", out, truth, lambda share, note: None)
    return out


def _rig_text(rig: Rig) -> str:
    """A rig file with what the simulator asks for beyond what the model needs."""
    pair = rig.gear_pair()
    s = np.linspace(pair.path_start, pair.path_end, 21)
    values: dict[str, Any] = {
        k: dict(v) if isinstance(v, dict) else v for k, v in rig.values.items() if k != "estimated"
    }
    values["mesh"] |= {"pair_s": s.tolist(), "pair_stiffness": PairStiffness.of(pair)(s).tolist()}
    for wheel, radius in zip(("pinion", "gear"), pair.base_radius, strict=True):
        values["gears"][wheel] = dict(values["gears"][wheel]) | {"base_radius": radius}
    return "\n".join(_lines(values, ""))


def _lines(table: dict[str, Any], path: str) -> list[str]:
    """TOML in full precision: the ratio of the base radii must be that of the tooth counts."""
    lines = [f"[{path[:-1]}]"] if path else []
    lines += [f"{k} = {json.dumps(v)}" for k, v in table.items() if not isinstance(v, dict)]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += _lines(value, f"{path}{key}.")
    return lines
