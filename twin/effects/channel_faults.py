"""What a measuring channel may do by itself: names that a comparison with a healthy baseline reports.

They act on samples, not on the gearbox, so that no `Setup` has them and the solvers do not know them. With a model, a
reversed or late accelerometer is part of `unknown_effect` (its `polarity` and `delay`).
"""

from __future__ import annotations

from dataclasses import dataclass

from twin.effects.facts import Facts


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelFault:
    """A name of the table."""

    label: str  # for people, in a sentence
    action: str  # what to do about it: one sentence in the imperative
    acts_on: str = "sensor"
    alarm_class: str = "watch"


CHANNEL_FAULTS: dict[str, ChannelFault] = {
    "sensor_polarity": ChannelFault(
        label="a reversed sensor",
        action="Check the wiring and the direction of mounting of the sensor.",
    ),
    "sensor_delay": ChannelFault(
        label="a delayed sensor",
        action="Check the clock, the filter and the converter of the channel against the others.",
    ),
    "sensor_dead": ChannelFault(
        label="a dead sensor",
        action="Replace the sensor, or its cable or supply.",
    ),
    "sensor_unit": ChannelFault(
        label="a wrong unit of all sensors",
        action="Check the unit, the sensitivity and the scale of the accelerometers.",
    ),
    "sensor_dead_time": ChannelFault(
        label="an interrupted sensor",
        action="Check the cable and the data link of the channel for interruptions.",
    ),
    "sensor_clipping": ChannelFault(
        label="a clipped sensor",
        action="Raise the measuring range of the channel.",
    ),
    "sensor_noise": ChannelFault(
        label="noise of a sensor",
        action="Check the cable, the shield and the amplifier of the channel.",
    ),
    "encoder_disc": ChannelFault(
        label="an encoder's disc",
        action="Check the encoder's disc: how it is centred on its shaft, and its lines.",
    ),
    "hum": ChannelFault(
        label="hum of the mains",
        action="Check the earth and the shield of the channel, and what runs at this frequency nearby.",
    ),
}


def label_of(name: str) -> str | None:
    """What people call an effect or a channel's fault; None where neither table has this name."""
    known = facts_of(name)
    return None if known is None else str(known.label)


def facts_of(name: str) -> Facts | ChannelFault | None:
    """What is declared of an effect (`Facts`) or of a channel's fault; None where neither table has this name."""
    from twin.effects import EFFECTS

    return EFFECTS[name].facts if name in EFFECTS else CHANNEL_FAULTS.get(name)
