"""What the twin can say of a machine: one file for each capability, each saying whether it applies to a window.

    for capability in CAPABILITIES:
        if capability.applies(context, draft):
            draft = capability.assess(context, draft)

Every capability takes the draft of the answer as those before it have left it, and returns it with its own parts.
"""

from __future__ import annotations

from typing import Protocol

from twin.capabilities import (
    baseline_comparison,
    condition_indicators,
    detectable,
    encoder_pair,
    learned_level,
    level_relation,
    likely_mistakes,
    mesh_bands,
    modelled,
    non_gear_content,
    shaft_modulation,
    unattributed_spacing,
)
from twin.capabilities.context import Context, Draft


class Capability(Protocol):
    """One capability: a module with these two functions."""

    def applies(self, context: Context, draft: Draft) -> bool:
        """Whether it has something to say of this window."""
        ...

    def assess(self, context: Context, draft: Draft) -> Draft:
        """The draft with what it says."""
        ...


CAPABILITIES: tuple[Capability, ...] = (
    modelled,
    mesh_bands,
    level_relation,
    non_gear_content,
    encoder_pair,
    baseline_comparison,
    unattributed_spacing,
    shaft_modulation,
    likely_mistakes,
    condition_indicators,
    detectable,
    learned_level,
)
