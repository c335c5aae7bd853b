"""Which rig file an asset has, and what happens where it is not the one that the asset's state was learned with.

The rig file of the settings goes before the stored one, and that before one offered on the network. A state that was
learned with other gears says nothing about these: people are asked (questions.py), and the earlier rig file holds until
they have answered. Any other change of the settings is adopted, and an event tells what has changed.

A rig file that is offered on the network is used for a new asset where new assets are adopted, until its first window
has been processed. Else, and where the asset has one, it is a proposal until a person has decided on it
(results/offers.py).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.files.rig import checked_rig
from service.files.rig_difference import differences
from service.results.asset_table import AssetTable
from service.results.names import Names
from service.results.sql_store import SqlStore
from service.results.store import StoredAsset
from service.runtime.rig_sources import GivenRigs, OfferedRigs
from service.runtime.routes import streams_of
from twin.rig import Rig

log = logging.getLogger(__name__)

IDENTITY = "gears."  # keys that make a machine another one
MOST_NAMED = 6  # changed keys that a message names


@dataclass(frozen=True, slots=True, kw_only=True)
class RigChange:
    """How a rig file differs from an earlier one: lines such as `gears.pinion.teeth = 23 (was 19)`."""

    identity: tuple[str, ...] = ()  # given before, and given otherwise or not at all now
    other: tuple[str, ...] = ()


def rig_change(before: Mapping[str, Any], now: Mapping[str, Any]) -> RigChange:
    """What differs between two rig files; a key that only adds what was not known before changes no identity."""
    identity: list[str] = []
    other: list[str] = []
    for each in differences(before, now):
        (identity if each.key.startswith(IDENTITY) and each.before is not None else other).append(str(each))
    return RigChange(identity=tuple(identity), other=tuple(other))


def other_gears(stored: StoredAsset, rig: Mapping[str, Any]) -> tuple[str, ...]:
    """How a rig file describes other gears than those that an asset's state was learned with; else empty."""
    if stored.rig is None or not stored.has_state:
        return ()
    return rig_change(stored.rig, rig).identity


def named_differences(stored: StoredAsset, rig: Mapping[str, Any]) -> list[str]:
    """How a rig file describes other gears than those of an asset so far, teeth first, absent values last."""
    lines = sorted(other_gears(stored, rig), key=lambda line: (".teeth =" not in line, "= absent" in line))
    more = [f"and {len(lines) - MOST_NAMED} more"] if len(lines) > MOST_NAMED else []
    return [*lines[:MOST_NAMED], *more]


class Rigs:
    """The rig files of all assets.

    given     those of the settings
    asks      whether people must decide on every rig file that is offered
    names     of the assets; None where each has its id alone
    proposed  those that have come for assets and may become proposals: see `offer_writer`
    """

    def __init__(
        self,
        store: SqlStore,
        table: AssetTable,
        given: GivenRigs,
        *,
        asks: bool = False,
        names: Names | None = None,
    ) -> None:
        self._store, self._table, self.given = store, table, given
        self.asks, self._names = asks, names
        self.proposed: dict[str, Mapping[str, Any]] = {}

    def given_of(self, asset: str) -> Mapping[str, Any] | None:
        """The rig file that the settings give for an asset, under its name or one that it had before."""
        return self.given.of(self._name_given(asset))

    def given_where(self, asset: str) -> str:
        """What that is called."""
        return self.given.where(self._name_given(asset))

    def lacks(self, asset: str) -> bool:
        """Whether neither the settings nor the store have a rig file of an asset."""
        return self.given_of(asset) is None and self._store.shown_asset(asset).rig is None

    def _name_given(self, asset: str) -> str:
        """The name under which the settings give an asset its own rig file; its id where they give none."""
        own, names = self.given.own, self._names
        if not own or names is None:
            return asset
        its = (name for name in (names.label(asset), asset, *own) if name in own)
        return next((name for name in its if (names.labelled(name) or name) == asset), asset)

    def differ(self, asset: str, rig: Mapping[str, Any]) -> bool:
        """Whether a rig file describes other gears than those of an asset so far."""
        return bool(other_gears(self._store.shown_asset(asset), rig))

    def of(self, asset: str, offered: OfferedRigs, stored: StoredAsset | None = None) -> Rig:
        """The rig of an asset; one of which nothing is known where there is none.

        stored  what is committed of the asset, where it has been read
        """
        stored = stored or self._store.asset(asset)
        given = self.given_of(asset)
        differs = given is not None and other_gears(stored, given)
        rig = (None if differs else given) or stored.rig
        if rig is None:
            found = self._offered_for(asset, offered)
            if found is not None and self.asks:
                self.propose(asset, found)
            else:
                rig = found
        if rig is None:
            log.warning(
                "no rig file is known for %s: only what needs none will be available", asset, extra={"asset": asset}
            )
            return Rig.from_mapping({})
        checked = checked_rig(rig, f"rig of {asset}")
        if rig != stored.rig:
            self._adopt(stored, rig)
            self._table.renewed(asset)
        return checked

    def _offered_for(self, asset: str, offered: OfferedRigs) -> Mapping[str, Any] | None:
        names = self._names
        streams = [asset] if names is None else streams_of(asset, names.routes())
        for stream in sorted(streams, key=lambda stream: names is None or stream != names.label(asset)):
            found = offered.find(stream)
            if found is not None:
                return found
        return None

    def propose(self, asset: str, rig: Mapping[str, Any]) -> None:
        """A rig file was offered for an asset: it waits for a person where it is another one, the newest alone."""
        self.proposed[asset] = rig

    def wants(self, asset: str, rig: Mapping[str, Any]) -> bool:
        """Whether a rig file would be another one for an asset that has begun."""
        snapshot = self._table.latest(asset)
        if snapshot is None or self.given_of(asset) is not None:
            return False
        return bool(differences(snapshot.rig or {}, rig))

    def _adopt(self, stored: StoredAsset, rig: Mapping[str, Any]) -> None:
        """Keeps a rig file, with an event where it replaces the one that a state was learned with."""
        if stored.rig is not None and stored.has_state:
            lines = rig_change(stored.rig, rig).other
            detail = f"the rig file has changed since the stored state was learned: {_named(lines)}"
            log.warning("%s: %s", stored.asset, detail, extra={"asset": stored.asset})
            fault = {
                "window": None, "kind": "rig_changed", "channel": "rig", "count": len(lines), "action": "none",
                "detail": detail,
            }  # fmt: skip
            self._store.note(stored.asset, [("data_fault", fault)])
        self._store.keep_rig(stored.asset, rig)


def _named(lines: tuple[str, ...]) -> str:
    more = f" and {len(lines) - MOST_NAMED} more" if len(lines) > MOST_NAMED else ""
    return ", ".join(lines[:MOST_NAMED]) + more
