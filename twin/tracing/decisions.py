"""What an engineer has decided about effects: accepted, rejected or pinned."""

from __future__ import annotations

from dataclasses import dataclass

from twin.errors import ParameterError

VERBS = ("accept", "reject", "pin", "release")


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """One decision.

    accept   the effect stays as found, marked as confirmed
    reject   it leaves the twin and is not added again
    pin      it stays, whatever later windows say
    release  the effect is judged by the data again
    """

    name: str
    verb: str

    def __post_init__(self) -> None:
        from twin.effects import EFFECTS  # loads half of the twin: programs that only pass decisions on do without

        if self.name not in EFFECTS or self.name == "none":
            known = ", ".join(n for n in EFFECTS if n != "none")
            raise ParameterError(f"{self.name!r} is no effect; known are {known}")
        if self.verb not in VERBS:
            raise ParameterError(f"{self.verb!r} is no decision; one of {', '.join(VERBS)}")
