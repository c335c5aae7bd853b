"""One change against the healthy baseline, as it is named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from twin.assessment import ParameterValue


@dataclass(frozen=True, slots=True, kw_only=True)
class Named:
    """One effect."""

    name: str
    channels: tuple[str, ...]
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    log_evidence: float | None  # over the baseline alone [nat]; None where the samples themselves say so
    runner_up: str | None = None
    over_runner_up: float | None = None
    indistinguishable_from: tuple[str, ...] = ()
    detail: str
    windows: tuple[int, ...]  # in which it was found
    curves: Mapping[str, Sequence[float]] = field(default_factory=dict)  # to be drawn: of a path, of a shaft's turn


def majority(found: Sequence[int], of: int) -> bool:
    """Whether a change was found in most windows."""
    return 2 * len(found) > of
