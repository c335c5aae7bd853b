"""What shafts are called, and which effects of the table show on them in a given shape."""

from __future__ import annotations

from fractions import Fraction

from twin.baseline.learned import Baseline
from twin.effects import EFFECTS
from twin.effects.signature import Signature
from twin.features.shaft_orders import FRACTION, owner_of

LOCAL_ALTERNATIVES = ("a coupling, a seat or a load of that shaft that pushes once a turn",)


def shaft_name(shaft: Fraction, baseline: Baseline) -> str:
    """The name of a shaft."""
    z1, z2 = baseline.rig.teeth
    if shaft == 1:
        return "pinion"
    if shaft == z1:
        return "mesh"
    return "gear" if shaft == Fraction(z1, z2) else f"shaft of order {float(shaft):g}"


def belonging(order: float, teeth: tuple[int, int], width: float) -> str:
    """What lines at or spaced by an order belong to, as the rest of a sentence about them.

    width  distance [order] within which two orders cannot be told apart
    """
    owner = owner_of(order, teeth, width)
    return "belong to no known shaft" if owner is None else f"belong to {'a' if owner == FRACTION else 'the'} {owner}"


def names_of(shape: str, shaft: str) -> tuple[str, ...]:
    """Effects of the table that an accelerometer sees with this shape on this shaft, by their signatures."""
    role = shaft if shaft in ("pinion", "gear", "mesh") else "other"
    signatures: dict[str, Signature] = {name: effect.signature for name, effect in EFFECTS.items()}
    return tuple(
        name
        for name, signature in signatures.items()
        if signature.shape == shape
        and "acceleration" in signature.channels
        and (role in signature.shafts or shape == "alike")
    )
