"""The wear law that a rig file names, with its parameters."""

from __future__ import annotations

from twin.errors import ParameterError
from twin.rig import Rig
from twin.wear.laws import LAWS
from twin.wear.laws.archard import Archard
from twin.wear.laws.law import WearLaw


def law_of(rig: Rig) -> WearLaw:
    """The wear law of a rig file, `[wear] law`, Archard's where it names none.

    NotAvailable where a parameter of the law is missing, ParameterError where parameters of another law are given.
    """
    law = LAWS[rig.get("wear.law", Archard.name)]
    for other in LAWS.values():
        if other is not law and other.parameters and rig.get(f"wear.{other.name}") is not None:
            raise ParameterError(
                f"[wear.{other.name}] is given, but wear.law = {law.name!r} does not use it: "
                f"set law = {other.name!r} or leave the table out"
            )
    keys = [p.key for p in law.parameters]
    given = rig.require(f"the wear law {law.name!r}", *(f"wear.{law.name}.{key}" for key in keys)) if keys else ()
    return law.of(dict(zip(keys, given, strict=True)))
