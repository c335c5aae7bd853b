"""Units as measurement files write them: kind of channel, unit of a mapping file, and the scale between the two.

Of other quantities: why they have no channel.
"""

from __future__ import annotations

ACCEL, TORQUE, TEMPERATURE = "accel", "torque", "temperature"
UNITS: dict[str, tuple[str, str, float]] = {
    "g": (ACCEL, "g", 1.0), "mg": (ACCEL, "g", 1e-3), "gn": (ACCEL, "g", 1.0), "gs": (ACCEL, "g", 1.0),
    "m/s2": (ACCEL, "m/s2", 1.0), "m/s^2": (ACCEL, "m/s2", 1.0), "m/s²": (ACCEL, "m/s2", 1.0),
    "m/s**2": (ACCEL, "m/s2", 1.0), "ms-2": (ACCEL, "m/s2", 1.0), "m·s-2": (ACCEL, "m/s2", 1.0),
    "mm/s2": (ACCEL, "m/s2", 1e-3), "mm/s^2": (ACCEL, "m/s2", 1e-3), "mm/s²": (ACCEL, "m/s2", 1e-3),
    "nm": (TORQUE, "Nm", 1.0), "n·m": (TORQUE, "Nm", 1.0), "n.m": (TORQUE, "Nm", 1.0), "n*m": (TORQUE, "Nm", 1.0),
    "n-m": (TORQUE, "Nm", 1.0), "knm": (TORQUE, "Nm", 1e3), "ncm": (TORQUE, "Nm", 1e-2),
    "lbf.in": (TORQUE, "Nm", 0.1129848), "in-lb": (TORQUE, "Nm", 0.1129848), "ft-lb": (TORQUE, "Nm", 1.355818),
    "degc": (TEMPERATURE, "degC", 1.0), "°c": (TEMPERATURE, "degC", 1.0), "degf": (TEMPERATURE, "degF", 1.0),
    "°f": (TEMPERATURE, "degF", 1.0), "k": (TEMPERATURE, "K", 1.0), "pa": (ACCEL, "Pa", 1.0),
}  # fmt: skip
OTHER_UNITS = {
    "mm/s": "vibration velocity has no channel", "m/s": "vibration velocity has no channel",
    "um": "a displacement has no channel", "µm": "a displacement has no channel", "mm": "a displacement has no channel",
    "rpm": "a measured speed has no channel: give the pulses it came from", "1/min": "a measured speed has no channel",
    "hz": "a measured speed has no channel", "a": "a current has no channel", "ma": "a current has no channel",
    "w": "a power has no channel", "kw": "a power has no channel", "%": "a share has no channel",
    "deg": "an angle has no channel: give encoder edges or pulses", "°": "an angle has no channel",
    "rad": "an angle has no channel: give encoder edges or pulses",
}  # fmt: skip
UNIT_NAMES = {*UNITS, *OTHER_UNITS} | {
    "", "-", "s", "sec", "ms", "us", "µs", "μs", "ns", "min", "h", "v", "mv", "µv", "ms^-2", "m", "/min", "min-1",
    "rev/min", "u/min", "1/s", "khz", "kpa", "bar", "rev", "count", "counts", "c",
}  # fmt: skip
