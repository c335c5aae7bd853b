"""How long a verdict holds for windows that were not assessed; its usual time is that of verdict_window.py."""

from __future__ import annotations

from dataclasses import dataclass

from twin.thresholds import deciding

NS = 1e9  # in a second


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictAge:
    """How long a verdict holds for windows that were not assessed."""

    most: float = deciding(
        3.0,
        of="usual time between assessed windows of this machine",
        meaning="time since the latest assessed window after which its verdict no longer holds, where windows have "
        "come since that were not assessed",
        source="not derived: chosen so that two windows of an even stream may fail in a row",
    )
    steps: int = deciding(
        32,
        unit="windows",
        meaning="latest windows whose times make the usual time",
        source="not derived: chosen so that a pause of the machine is a small share of them",
    )
    memory: float = deciding(
        128.0,
        unit="windows",
        meaning="assessed windows within which the memory of a long step falls to 1/e",
        source="not derived: chosen so that a hoist which lifts for 30 windows in a row still remembers its lowering",
    )
    usual_step: float = deciding(
        0.75,
        meaning="share of the times between windows that the usual time is not shorter than",
        source="not derived: chosen so that pauses of the machine, up to a quarter of the steps, do not count",
    )


LIMITS = VerdictAge()


def outdated(age: float | None, usual: float | None, since: int, limits: VerdictAge = LIMITS) -> bool:
    """Whether a verdict no longer holds for the windows that have come since.

    age    time from the assessed window to the latest one [s]; None where no window has been assessed
    usual  time between assessed windows [s]; None where it is not known: a verdict then holds for its own window alone
    since  windows since, none of which was assessed
    """
    return bool(since) and (age is None or usual is None or age > limits.most * usual)
