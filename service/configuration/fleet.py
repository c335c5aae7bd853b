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
    fleet_address: str | None = Field(
        default=None,
        pattern=r"^\S+:\d{1,5}$",
        description="HOST:PORT of a cluster of Ray with a node on this machine; by default all hosts are this machine",
        examples=["ray-head:6379"],
    )
