"""Settings of which assets there are: those that are declared, and what becomes of one that is not known."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from service.access.addresses import is_local_endpoint, is_loopback
from service.configuration.tables import Table

AssetName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.\-]{1,64}$")]
Rule = Literal["adopt", "ask"]

# what a setting with a pattern must be like
READ = dict.fromkeys(("assets", "asset_rigs"), "must be names of 1 to 64 letters, digits, '_', '-' or '.'")


class NewAssets(Table):
    """Which assets there are."""

    TABLE: ClassVar[str] = "assets"
    KEYS: ClassVar[dict[str, str]] = {
        "new_assets": "new",
        "assets": "declared",
        "asset_rigs": "rigs",
        "unknown_assets": "unknown",
        "unknown_expire": "unknown_expire",
    }

    new_assets: Rule | None = Field(
        default=None,
        description="what becomes of an asset that is not known: adopt: its first frame makes it one; ask: it is "
        "listed until a person adopts it. Without it: adopt while only this computer can reach the service, else ask",
        examples=["ask"],
    )
    assets: list[AssetName] = Field(
        default=[], description="assets that are known from the start", examples=[["press-1", "press-2"]]
    )
    asset_rigs: dict[AssetName, Path] = Field(
        default={},
        description="rig file of single assets, which are known from the start, too. An asset that is renamed keeps it",
        examples=[{"press-1": "press-1.toml"}],
    )
    unknown_assets: int = Field(
        default=100, ge=1, le=1000, description="unknown assets that are listed; beyond, the quietest is left out"
    )
    unknown_expire: float = Field(
        default=86_400.0,
        gt=0,
        le=1e8,
        description="time without a frame after which an unknown asset leaves the list, and during which a dismissed "
        "one is not listed again [s]",
    )


def rule_of(
    new_assets: Rule | None, http_host: str, listen: Iterable[str], connect: Iterable[str]
) -> tuple[Rule, str | None]:
    """What becomes of an unknown asset, and why where it is not set."""
    if new_assets is not None:
        return new_assets, None
    if not is_loopback(http_host):
        return "ask", f"other computers can reach http = {http_host}"
    connect = list(connect)  # with it, the embedded router is off
    name = "connect" if connect else "listen"
    open_to_others = [endpoint for endpoint in connect or listen if not is_local_endpoint(endpoint)]
    if open_to_others:
        return "ask", f"other computers can reach {name} = {open_to_others[0]}"
    return "adopt", "only this computer can reach the service"
