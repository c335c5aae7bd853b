"""Numbers that decide a verdict: each with its unit, its meaning and where it comes from.

    @dataclass(frozen=True, slots=True, kw_only=True)
    class RattleThresholds:
        parting_share: float = deciding(
            0.6, of="rated torque", meaning="swing of the torque that separates the teeth",
            source="derivation: at 1 the torque changes sign; the margin is tuned on T01–T58",
        )

A set stands beside the code that uses it and is passed in, so that it can be varied; `twin/threshold_register.py` lists
all sets. A number is dimensionless, or is a share of a quantity of the machine at hand (`of`): `Scales` holds these
quantities for one rig file, in SI.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

KEY = "deciding"


@dataclass(frozen=True, slots=True, kw_only=True)
class Deciding:
    """What is known of one deciding number."""

    unit: str  # SI; "" for a pure number; "nat" for evidence
    of: str  # the quantity of the machine that it is a share of; "" where it is used as it is
    meaning: str
    source: str  # standard, derivation, measured noise, or "tuned on …"


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdRow:
    """One line of the register."""

    group: str
    name: str
    value: Any
    about: Deciding


def deciding(value: Any, *, meaning: str, source: str, unit: str = "", of: str = "") -> Any:
    """A dataclass field that holds a deciding number."""
    about = Deciding(unit=unit, of=of, meaning=meaning, source=source)
    if isinstance(value, (list, dict, set)):
        raise TypeError("a deciding number must be immutable: use a tuple")
    return field(default=value, metadata={KEY: about})


def rows_of(thresholds: Any) -> Iterator[ThresholdRow]:
    """The numbers of one set (class or instance), in the order of definition."""
    kind = thresholds if isinstance(thresholds, type) else type(thresholds)
    for item in fields(kind):
        value = item.default if thresholds is kind else getattr(thresholds, item.name)
        yield ThresholdRow(group=kind.__name__, name=item.name, value=value, about=item.metadata[KEY])
