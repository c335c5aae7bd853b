"""The board's assets on a network: each state is published at each change and answers queries."""

from __future__ import annotations

import json

from service.results.board import Board
from service.transport.protocol import Transport


class StatePublication:
    """States and alarms of the board as texts for a transport; a `StateSource`."""

    def __init__(self, transport: Transport, board: Board) -> None:
        self._transport, self._board = transport, board
        self._published: dict[str, str] = {}  # alarms as they were published last, by name
        self._announced: dict[str, str] = {}  # by asset: under which name
        for asset in board.assets():
            self._announce(asset)

    def assets(self) -> tuple[str, ...]:
        """The names of the assets that have a state."""
        return self._board.names()

    def state_text(self, name: str) -> str | None:
        """The state of the asset of this name as the board has it, without its list of windows."""
        snapshot = self._board.find(name)
        if snapshot is None:
            return None
        return json.dumps({k: v for k, v in snapshot.whole.items() if k != "windows"}, allow_nan=False)

    def alarms_text(self, name: str) -> str | None:
        """The open alarms of the asset of this name as the board has them."""
        snapshot = self._board.find(name)
        if snapshot is None:
            return None
        return json.dumps({"asset": name, "alarms": list(snapshot.alarms)}, allow_nan=False)

    def publish(self, asset: str) -> None:
        """Publishes the asset's state as the board has it, and its open alarms where they are others than before."""
        name = self._announce(asset)
        text, alarms = self.state_text(name), self.alarms_text(name)
        if text is None or alarms is None:
            return
        self._transport.publish_state(name, text)
        if self._published.get(name) != alarms:
            self._published[name] = alarms
            self._transport.publish_alarms(name, alarms)

    def _announce(self, asset: str) -> str:
        """Announces an asset under its name, and no longer under an earlier one; the name."""
        snapshot = self._board.get(asset)
        name = asset if snapshot is None else snapshot.name
        before = self._announced.get(asset)
        if before is not None and before != name:
            self._published.pop(before, None)
            self._transport.withdraw(before)
        if snapshot is not None:
            self._announced[asset] = name
            self._transport.announce(name)
        return name
