"""The board's assets on a network: each state is published at each change and answers queries."""

from __future__ import annotations

import json

from service.results.board import Board
from service.transport.protocol import Transport


class StatePublication:
    """States and alarms of the board as texts for a transport; a `StateSource`."""

    def __init__(self, transport: Transport, board: Board) -> None:
        self._transport, self._board = transport, board
        self._published: dict[str, str] = {}  # alarms as they were published last
        for asset in board.assets():
            transport.announce(asset)

    def assets(self) -> tuple[str, ...]:
        """The assets that have a state."""
        return self._board.assets()

    def state_text(self, asset: str) -> str | None:
        """The asset's state as the board has it, without its list of windows."""
        snapshot = self._board.get(asset)
        if snapshot is None:
            return None
        return json.dumps({k: v for k, v in snapshot.whole.items() if k != "windows"}, allow_nan=False)

    def alarms_text(self, asset: str) -> str | None:
        """The asset's open alarms as the board has them."""
        snapshot = self._board.get(asset)
        if snapshot is None:
            return None
        return json.dumps({"asset": asset, "alarms": list(snapshot.alarms)}, allow_nan=False)

    def withdraw(self, asset: str) -> None:
        """Ends the announcement of an asset that has another name now."""
        self._published.pop(asset, None)
        self._transport.withdraw(asset)

    def publish(self, asset: str) -> None:
        """Publishes the asset's state as the board has it, and its open alarms where they are others than before."""
        text, alarms = self.state_text(asset), self.alarms_text(asset)
        if text is None or alarms is None:
            return
        self._transport.announce(asset)
        self._transport.publish_state(asset, text)
        if self._published.get(asset) != alarms:
            self._published[asset] = alarms
            self._transport.publish_alarms(asset, alarms)
