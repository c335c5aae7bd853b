"""One finding of the status: its level, its reason and what to do."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from pydantic import Field

from service.contract.base import ContractModel

Level = Literal["normal", "no_verdict", "watch", "alarm", "end_of_life"]
SEVERITY: tuple[Level, ...] = ("normal", "no_verdict", "watch", "alarm", "end_of_life")


class Finding(ContractModel):
    """One rule that applies."""

    subject: str = Field(description="what it is about: `depth`, `life`, `effect/misalignment`, …")
    level: Level
    reason: str = Field(description="one sentence with figures and units")
    action: str = Field(description="what to do: one sentence in the imperative")


def by_severity(findings: Iterable[Finding]) -> list[Finding]:
    """Findings, most severe first; of the same level in the order given."""
    return sorted(findings, key=lambda f: -SEVERITY.index(f.level))


def sentence(text: str) -> str:
    """A text that ends as a sentence does."""
    return text if text.endswith((".", "?", "!")) else f"{text}."
