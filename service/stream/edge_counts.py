"""Lost and doubled counts of a window's encoders: put right where the intervals show them, else the window is refused.

| the intervals of one encoder | the counts of both, then | the window |
|---|---|---|
| show lost or doubled edges | agree within backlash and deflection | `degraded`: its edges are put right |
| show lost or doubled edges | drift apart, as they did before | refused |
| show lost or doubled edges | drift apart, as they did not before | as it was: the disc is made so |
| show none | drift apart | refused |

Between windows counts are lost, too, which nobody has seen. An encoder that has lost counts goes on from the window
before by the other encoder, to the nearest line, and by the line of its disc where counts are lost:

    n1 = (D_before − D)·P1          n2 = (D − D_before)·P2·z1/z2           D = N1/P1 − N2·z2/(P2·z1)

N   count of an encoder      P   lines of its disc      n   lines by which its count is moved

The nearest line is not certain where wear and deflection reach half a line, and nothing shows it on a machine with one
encoder: the window is `degraded` for that reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from service.stream.quality import grade_of
from twin.features.edge_counts import DEFAULT, CountDrift, EdgeCounts, count_drift, counts_put_right
from twin.rig import Rig
from twin.windows import SHAFTS, Edges, Fault, Window

KIND = "edge_count"


@dataclass(slots=True)
class EncoderCounts:
    """The counts of an asset's encoders by the end of a window; what the making of the next one needs of it."""

    counted: dict[str, int] = field(default_factory=dict)  # edges by the end of the last window, by channel
    moved: dict[str, int] = field(default_factory=dict)  # lines that the count of an encoder at fault is moved by
    line: dict[str, int] = field(default_factory=dict)  # of its disc, by the moved count
    mean: float | None = None  # D of the last window [turns of the pinion]

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact; nothing of faults where there was none."""
        out: dict[str, Any] = {"edges_counted": dict(self.counted)}
        if self.moved:
            out["edges_lost"] = {"moved": dict(self.moved), "line": dict(self.line)}
        return out if self.mean is None else out | {"counts_apart": self.mean}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> EncoderCounts:
        lost = data.get("edges_lost", {})
        return cls(
            counted={label: int(count) for label, count in data.get("edges_counted", {}).items()},
            moved={shaft: int(n) for shaft, n in lost.get("moved", {}).items()},
            line={shaft: int(n) for shaft, n in lost.get("line", {}).items()},
            mean=data.get("counts_apart"),
        )

    def followed(self, window: Window, rig: Rig | None) -> tuple[Window, EncoderCounts]:
        """The window that comes next with its encoders' counts put right, and the counts by its end.

        What was found is among its faults; where nothing was, it is the same window.
        """
        after = replace(self, counted=dict(self.counted), moved=dict(self.moved), line=dict(self.line))
        return after._follow(window, rig), after

    def _follow(self, window: Window, rig: Rig | None) -> Window:
        self._count(window)
        found = {shaft: counts_put_right(edges) for shaft, edges in window.encoders.items()}
        wrong = {shaft: counts for shaft, counts in found.items() if counts is not None}
        encoders = {**window.encoders, **{shaft: counts.edges for shaft, counts in wrong.items()}}
        drift = _drift(encoders, rig)
        if drift is not None and drift.impossible:
            before = _drift(window.encoders, rig)
            if wrong and before is not None and not before.impossible:
                return window  # what looked like lost counts is how the disc is made
            return _with(window, window.encoders, [_refused(drift)])
        drift = _known(drift)
        moves = self._moves(encoders, wrong, drift, rig)
        if not moves:
            self.mean = None if drift is None else drift.mean
            return window
        told = [self._fault(shaft, wrong.get(shaft), n, drift) for shaft, n in moves.items()]
        faults = [fault for fault in told if fault.count]
        for shaft, n in moves.items():
            encoders[shaft] = replace(encoders[shaft], first_index=encoders[shaft].first_index + n)
        again = _known(_drift(encoders, rig))
        self.moved |= moves
        self.mean = None if again is None else again.mean
        return _with(window, encoders, faults)

    def _count(self, window: Window) -> None:
        """Takes the counts as they came; what is known of faults ends where a counter has begun again."""
        for shaft, edges in window.encoders.items():
            if edges.first_index < self.counted.get(f"encoder/{shaft}", 0):
                self.moved, self.line, self.mean = {}, {}, None
            self.counted[f"encoder/{shaft}"] = edges.first_index + edges.times.size

    def _moves(
        self, encoders: Mapping[str, Edges], wrong: Mapping[str, EdgeCounts], drift: CountDrift | None, rig: Rig | None
    ) -> dict[str, int]:
        """By how many lines the count of every encoder that has lost counts is moved."""
        at_fault = [shaft for shaft in SHAFTS if shaft in encoders and (shaft in wrong or shaft in self.moved)]
        moves = {}
        for shaft in at_fault:
            per_rev, move = encoders[shaft].per_rev, self.moved.get(shaft, 0)
            told = len(at_fault) == 1 and drift is not None and self.mean is not None
            if told and drift is not None and self.mean is not None and rig is not None:
                scale = 1 if shaft == "pinion" else -rig.teeth[0] / rig.teeth[1]
                move = round((self.mean - drift.mean) * per_rev * scale)
            line = wrong[shaft].line if shaft in wrong else None
            if line is not None and shaft in self.line:
                off = (self.line[shaft] - line - move + per_rev // 2) % per_rev - per_rev // 2
                if abs(off) <= DEFAULT.near_line or not told:
                    move += off
            if line is not None:
                self.line.setdefault(shaft, (line + move) % per_rev)
            moves[shaft] = move
        return moves

    def _fault(self, shaft: str, counts: EdgeCounts | None, move: int, drift: CountDrift | None) -> Fault:
        """What was found of one encoder: within the window, or before it only."""
        channel, off = f"encoder/{shaft}", move - self.moved.get(shaft, 0)
        other = "the other encoder" if drift is not None else "the line of its disc"
        since = f"; its count is moved by {off:+d} lines since the window before, by {other}" if off else ""
        if counts is None:
            detail = f"encoder edge counts: none lost in this window, but before it{since}"
            return Fault(kind=KIND, channel=channel, count=abs(off), action="repaired", detail=detail)
        detail = f"{counts.text}; put right by the intervals between edges{since}"
        return Fault(kind=KIND, channel=channel, count=counts.lost + counts.doubled, action="degraded", detail=detail)


def _with(window: Window, encoders: Mapping[str, Edges], faults: list[Fault]) -> Window:
    every = (*window.faults, *faults)
    return replace(window, encoders=encoders, faults=every, quality=grade_of(every))


def _drift(encoders: Mapping[str, Edges], rig: Rig | None) -> CountDrift | None:
    """How far the counts of both encoders drift apart; None where a machine has one, or its teeth are not known."""
    if rig is None or set(encoders) != set(SHAFTS) or not rig.has("gears.pinion.teeth", "gears.gear.teeth"):
        return None
    radius = rig.get("gears.pinion.base_radius") or rig.get("gears.module", 0.0) * rig.teeth[0] / 2
    backlash = rig.get("gears.backlash", 0.0) / radius if radius else 0.0
    return count_drift(encoders["pinion"], encoders["gear"], rig.teeth, backlash)


def _known(drift: CountDrift | None) -> CountDrift | None:
    """The same; None where tooth numbers or lines of a disc are wrong, so that one count says nothing of the other."""
    return None if drift is None or drift.ratio_wrong else drift


def _refused(drift: CountDrift) -> Fault:
    pinion, gear = (abs(n) for n in drift.lines)
    detail = (
        f"the encoders' counts drift apart by {pinion:.1f} lines of the pinion's encoder, which is {gear:.1f} of the "
        f"gear's: {abs(drift.angle) * 1e3:.0f} mrad, where backlash and deflection allow {drift.possible * 1e3:.0f}; "
        "edges of one of them were lost or doubled"
    )
    return Fault(
        kind=KIND, channel="encoder/gear", count=max(1, round(min(pinion, gear))), action="refused", detail=detail
    )
