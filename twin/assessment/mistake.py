"""A likely mistake in a recording: what was seen, and what would be right."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistake:
    """One likely mistake of units, wiring, clocks, speed or tooth counts."""

    kind: str  # unit, polarity, swapped, shifted, aliasing, mesh, hum, offset
    channels: tuple[str, ...]  # accel/a1, encoder/gear, …
    evidence: str  # what was seen, with figures
    remedy: str  # what is likely and would be right

    @property
    def text(self) -> str:
        """Both in one line."""
        return f"{', '.join(self.channels)}: {self.evidence}; {self.remedy}"
