"""One change of a machine that people have made; what it ends of the twin's memory: machine_changes.py."""

from __future__ import annotations

from dataclasses import dataclass

from twin.errors import ParameterError


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineChange:
    """One change of a machine.

    gears_replaced  another pair of the same geometry, unworn
    sensor_moved    an accelerometer at another place, or another one, or mounted otherwise
    oil_changed     other oil
    counter_reset   the revolution count began again; the gears are the same
    reassembled     the same gears taken out and put together again
    """

    kind: str
    sensor: str | None = None  # of sensor_moved
    at: float | None = None  # gears_replaced: encoder's count then; counter_reset: revolutions since new then [turns]
    began: float = 0.0  # of counter_reset: what the counter was set to [turns]

    def __post_init__(self) -> None:
        from twin.effects.facts import CHANGES  # loads half of the twin: programs that only pass changes on do without

        if self.kind not in CHANGES:
            raise ParameterError(f"{self.kind!r} is no change of a machine; one of {', '.join(CHANGES)}")
        if (self.kind == "sensor_moved") != (self.sensor is not None):
            raise ParameterError("a sensor belongs to sensor_moved, and to no other change: which one was moved?")
