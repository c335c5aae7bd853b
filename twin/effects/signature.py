"""What an effect does to orders, to the angle and to channels: what it is told by where the machine has no model.

Used by `twin/baseline/diagnosis.py`; that the model makes just this is claimed in `tests/claims/test_effects_table.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

SHAPES = {
    "run_out": "the first order of a shaft",
    "one_order": "one order of a shaft and no other",
    "local": "many orders of a shaft, in phase at one angle of it",
    "all_round": "many orders of a shaft, in phase nowhere",
    "alike": "the mesh orders: every tooth alike",
    "path": "all orders alike, by a smooth function of frequency, in one channel",
    "own": "multiples of an order of its own, in the envelope: it repeats, but not to the phase",
    "parting": "noise between all orders, where teeth strike",
    "none": "nothing",
}
EVERY = ("acceleration", "encoder", "torque")


@dataclass(frozen=True, slots=True, kw_only=True)
class Signature:
    """Where an effect shows."""

    shape: str  # of `SHAPES`
    shafts: tuple[str, ...] = ()  # "pinion", "gear", or "other" for any further one; where the shape is one of a shaft
    channels: tuple[str, ...] = EVERY  # that see it
    load: str = ""  # "rises" where its lines grow with load whatever the machine; "" where that is not so, or not known

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise ValueError(f"shape = {self.shape!r} must be one of {', '.join(SHAPES)}")
        if self.load not in ("", "rises"):
            raise ValueError(f"load = {self.load!r} must be 'rises' or ''")
