"""Settings of a fleet."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from service.configuration.tables import Table


class Fleet(Table):
    """Many machines: `gear-twin fleet`."""

    TABLE: ClassVar[str] = "fleet"
    PREFIX: ClassVar[str] = "fleet_"

    fleet_partitions: int | None = Field(
        default=None,
        ge=1,
        le=1000,
        description="partitions into which the assets are divided, fixed when the fleet is created; by default 8 then",
        examples=[64],
    )
    fleet_workers: int = Field(
        default=1, ge=1, le=64, description="nodes that fleet up starts on its own machine, where it joins no cluster"
    )
    fleet_room: int | None = Field(
        default=None,
        ge=1,
        le=1000,
        description="partitions that one of these nodes may serve; by default all, so that any node can take over",
        examples=[8],
    )
    fleet_cores: int | None = Field(
        default=None,
        ge=1,
        le=1000,
        description="searches for effects that one of these nodes makes at a time, a core each; by default its share "
        "of the machine's cores",
        examples=[4],
    )
    fleet_address: str | None = Field(
        default=None,
        pattern=r"^\S+:\d{1,5}$",
        description="HOST:PORT of a cluster of Ray that fleet up joins, rather than starting its own",
        examples=["ray-head:6379"],
    )
