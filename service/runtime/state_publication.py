"""The assets on a network: each state is published at each change and answers queries."""

from __future__ import annotations

import json

from service.results.asset_table import AssetTable
from service.results.snapshot import Snapshot
from service.transport.protocol import Transport


class StatePublication:
    """States and alarms of the assets as texts for a transport; a `StateSource`."""

    def __init__(self, transport: Transport, table: AssetTable) -> None:
        self._transport, self._table = transport, table
        self._published: dict[str, str] = {}  # alarms as they were published last, by name
        self._names: dict[str, str] = {}  # by asset: under which name it is announced
        self._assets: dict[str, str] = {}  # by that name
        for snapshot in table.every():
            self._announce(snapshot)

    def assets(self) -> tuple[str, ...]:
        """The names of the assets that have a state."""
        return tuple(sorted(self._assets))

    def state_text(self, name: str) -> str | None:
        """The state of the asset of this name, without its list of windows."""
        snapshot = self._find(name)
        return None if snapshot is None else _state_text(snapshot)

    def alarms_text(self, name: str) -> str | None:
        """The open alarms of the asset of this name."""
        snapshot = self._find(name)
        return None if snapshot is None else _alarms_text(snapshot)

    def publish(self, asset: str) -> None:
        """Publishes the asset's state, and its open alarms where they are others than before."""
        snapshot = self._table.latest(asset)
        if snapshot is None:
            return
        self._announce(snapshot)
        name, alarms = snapshot.name, _alarms_text(snapshot)
        self._transport.publish_state(name, _state_text(snapshot))
        if self._published.get(name) != alarms:
            self._published[name] = alarms
            self._transport.publish_alarms(name, alarms)

    def _find(self, name: str) -> Snapshot | None:
        asset = self._assets.get(name)
        return None if asset is None else self._table.latest(asset)

    def _announce(self, snapshot: Snapshot) -> None:
        """Announces an asset under its name, and no longer under an earlier one."""
        name, before = snapshot.name, self._names.get(snapshot.asset)
        if before not in (None, name):
            self._published.pop(str(before), None)
            self._assets.pop(str(before), None)
            self._transport.withdraw(str(before))
        self._names[snapshot.asset], self._assets[name] = name, snapshot.asset
        self._transport.announce(name)


def _state_text(snapshot: Snapshot) -> str:
    return json.dumps({k: v for k, v in snapshot.whole.items() if k != "windows"}, allow_nan=False)


def _alarms_text(snapshot: Snapshot) -> str:
    return json.dumps({"asset": snapshot.name, "alarms": list(snapshot.alarms)}, allow_nan=False)
