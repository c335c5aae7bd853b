"""No effect: the gearbox as it was made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.effects.facts import Facts
from twin.effects.parameter import Parameter
from twin.effects.setup import Setup
from twin.effects.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True)
class NoEffect:
    """Changes nothing."""

    parameters: ClassVar[tuple[Parameter, ...]] = ()
    period: ClassVar[str] = "mesh"

    def apply(self, setup: Setup) -> Setup:
        return setup

    signature: ClassVar[Signature] = Signature(shape="none", channels=())
    facts: ClassVar[Facts] = Facts(
        label="no effect",
        action="No action needed.",
        acts_on="nothing",
        periods=("mesh",),
        detector="",
        alarm_class="none",
        changes_mesh_lines=False,
    )
