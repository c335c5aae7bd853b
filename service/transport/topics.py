"""Topics of what is not a measurement: the same names on every network."""

from __future__ import annotations

from service.stream.wire.topics import NAME


def state_topic(asset: str, prefix: str) -> str:
    """Where an asset's state is published and asked for."""
    return f"{prefix}/{asset}/twin/state"


def alarms_topic(asset: str, prefix: str) -> str:
    """Where an asset's open alarms are published and asked for."""
    return f"{prefix}/{asset}/twin/alarms"


def position_topic(asset: str, prefix: str) -> str:
    """Where it is published and asked for how far an asset's stream is stored."""
    return f"{prefix}/{asset}/twin/position"


def asset_of_position_topic(topic: str, prefix: str) -> str | None:
    """The asset of a position's topic; None where the topic names none."""
    asset = topic.removeprefix(f"{prefix}/").removesuffix("/twin/position")
    return asset if NAME.fullmatch(asset) and topic == position_topic(asset, prefix) else None


def made_topic(topic: str, prefix: str) -> str:
    """Where a service publishes a frame of a topic that it has made itself, of a slow value."""
    asset, _, channel = topic.removeprefix(f"{prefix}/").partition("/")
    return f"{prefix}/{asset}/twin/made/{channel}"


def topic_of_made(topic: str, prefix: str) -> str:
    """The topic of a frame that a service has made."""
    asset, _, channel = topic.removeprefix(f"{prefix}/").partition("/twin/made/")
    return f"{prefix}/{asset}/{channel}"


def alive_topic(asset: str, prefix: str) -> str:
    """Where a service shows that it serves the asset."""
    return f"{prefix}/{asset}/twin/alive"


def rig_topic(asset: str, prefix: str) -> str:
    """Where an asset's rig file is published and asked for."""
    return f"{prefix}/{asset}/rig"


def asset_of_rig_topic(topic: str, prefix: str) -> str | None:
    """The asset of a rig file's topic; None where the topic names none."""
    asset = topic.removeprefix(f"{prefix}/").removesuffix("/rig")
    return asset if NAME.fullmatch(asset) and topic == rig_topic(asset, prefix) else None
