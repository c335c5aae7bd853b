"""One finding of the status: its level, its reason and what to do."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

from pydantic import Field

from service.contract.base import ContractModel

Level = Literal["normal", "no_verdict", "watch", "alarm", "end_of_life"]
NO_ACTION = "No action needed."
SEVERITY: tuple[Level, ...] = ("normal", "no_verdict", "watch", "alarm", "end_of_life")


_QUANTITY = re.compile(r"^(the )?[a-z ]{3,30} (is|are) not available: (?=.)")  # at the start of a reason


class Finding(ContractModel):
    """One rule that applies."""

    subject: str = Field(description="what it is about: `depth`, `life`, `effect/misalignment`, …")
    level: Level
    reason: str = Field(description="one sentence with figures and units")
    action: str = Field(description="what to do: one sentence in the imperative")
    share: float | None = Field(
        default=None, description="of what is measured, 0 to 1, that it explains or lies beyond its limit"
    )


def by_severity(findings: Iterable[Finding]) -> list[Finding]:
    """Findings, most severe first; of the same level, by what they explain; then in the order given."""
    return sorted(findings, key=lambda f: (-SEVERITY.index(f.level), -(f.share or 0.0)))


def cause(reason: str) -> str:
    """A reason without the quantity that it is the reason of: "wear is not available: no module" is "no module"."""
    return _QUANTITY.sub("", reason)


def sentence(text: str) -> str:
    """A text that ends as a sentence does."""
    return text if text.endswith((".", "?", "!")) else f"{text}."


MOST_WORDS = 25  # of a state's summary


def shortened(text: str) -> str:
    """A sentence of at most so many words: the text up to the last of its clauses that ends within them."""
    words = text.split()
    if len(words) <= MOST_WORDS:
        return text
    kept = words[:MOST_WORDS]
    ends = [i for i, word in enumerate(kept, 1) if word.endswith((".", ";", ":", ","))]
    if ends and ends[-1] >= MOST_WORDS // 3:
        return sentence(" ".join(kept[: ends[-1]]).rstrip(".;:,"))
    return f"{' '.join(kept[:-1])} …"
