"""The course of an asset's depth or vibration level in at most 30 numbers, kept up to date window by window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from service.results.sql_store import SqlStore

POINTS = 30  # numbers of a sparkline at most, the newest included
REFUSED = "refused"


@dataclass(frozen=True, slots=True, kw_only=True)
class SparkPoint:
    """What one window adds."""

    index: int
    depth: float | None  # [µm]
    level: float | None  # [m/s²]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sparkline:
    """Windows whose index is a multiple of the stride, and the newest; the stride doubles as the history grows."""

    stride: int = 1
    points: tuple[SparkPoint, ...] = ()
    newest: SparkPoint | None = None

    @classmethod
    def from_store(cls, store: SqlStore, asset: str, newest: int) -> Sparkline:
        """The same as window by window, read from as many windows as are shown; `newest` is the latest index."""
        stride = 1
        while newest // stride >= POINTS - 1:
            stride *= 2
        line = cls(stride=stride)
        for window in store.windows(asset, limit=2 * POINTS, every=stride):
            line = line.with_record(window.record)
        return line

    def with_record(self, record: Mapping[str, Any]) -> Sparkline:
        """With one more window; calibration windows and refused ones are left out."""
        kind, quality = record.get("kind"), record.get("quality")
        point = SparkPoint(
            index=record["index"], depth=record.get("wear_depth_um"), level=record.get("rms_measured")
        )  # fmt: skip
        if kind == "calibration" or quality == REFUSED:
            return self
        points, stride = self.points, self.stride
        if point.index % stride == 0:
            points = (*points, point)
        while len(points) > POINTS - 1:
            stride *= 2
            points = tuple(p for p in points if p.index % stride == 0)
        return replace(self, stride=stride, points=points, newest=point)

    def as_json(self) -> dict[str, Any] | None:
        """`quantity`, `unit` and `values`, oldest first; None before the first window."""
        shown = [*self.points]
        if self.newest is not None and (not shown or shown[-1] != self.newest):
            shown.append(self.newest)
        depths = [p.depth for p in shown if p.depth is not None]
        levels = [p.level for p in shown if p.level is not None]
        if depths and 2 * len(depths) >= len(levels):
            return {"quantity": "wear depth", "unit": "µm", "values": depths}
        if levels:
            return {"quantity": "vibration RMS", "unit": "m/s²", "values": levels}
        return None
