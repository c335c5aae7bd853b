"""Topics: `gearbox/{asset}/{kind}/{name}`, the same as Zenoh key and as MCAP topic."""

from __future__ import annotations

import re
from typing import NamedTuple

from service.errors import FrameError
from service.stream.channels import CHANNEL_KINDS

PREFIX = "gearbox"
NAME = re.compile(r"[A-Za-z0-9_.\-]{1,64}")


class Channel(NamedTuple):
    """One signal of one machine."""

    asset: str
    kind: str  # a key of CHANNEL_KINDS
    name: str  # the sensor, the shaft or the place

    @property
    def label(self) -> str:
        """The channel within its asset, such as `accel/y6`."""
        return f"{self.kind}/{self.name}"


def topic_of(channel: Channel, prefix: str = PREFIX) -> str:
    """The topic of a channel."""
    return f"{prefix}/{channel.asset}/{channel.kind}/{channel.name}"


def parse_topic(topic: str, prefix: str = PREFIX) -> Channel | None:
    """The channel of a topic; None for a topic that carries no measurement.

    Raises FrameError for one that should, but whose names break the contract.
    """
    parts = topic.removeprefix(f"{prefix}/").split("/")
    if not topic.startswith(f"{prefix}/") or len(parts) != 3 or parts[1] not in CHANNEL_KINDS:
        return None
    asset, segment, name = parts
    kind = CHANNEL_KINDS[segment]
    for what, value in (("asset", asset), (kind.named_by, name)):
        if not NAME.fullmatch(value):
            raise FrameError(f"{topic}: {what} = {value!r} must be 1 to 64 letters, digits, '_', '-' or '.'")
    if kind.names and name not in kind.names:
        raise FrameError(f"{topic}: {kind.named_by} = {name!r} must be one of {', '.join(kind.names)}")
    return Channel(asset, segment, name)
