"""What the service and the replay ask of a network, whatever its kind.

A network is added by one file in this folder that implements `Transport` (and `FramePublisher`, where recordings are
to be replayed over it), and is handed to `service.runtime.serve.run`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Protocol

from service.stream.inbox import Inbox
from service.stream.wire.topics import Channel

if TYPE_CHECKING:  # a service reads no recordings
    from service.stream.sources.mcap import RawFrame


class StateSource(Protocol):
    """Whose states are answered to queries."""

    def assets(self) -> tuple[str, ...]: ...

    def state_text(self, asset: str) -> str | None:
        """The asset's state as JSON text; None where the asset is not known."""
        ...

    def alarms_text(self, asset: str) -> str | None:
        """The asset's open alarms as JSON text; None where the asset is not known."""
        ...


class Transport(Protocol):
    """One open connection to a network. Callbacks may run in threads of the network."""

    def subscribe(self, inbox: Inbox) -> AbstractContextManager[object]:
        """Puts every frame of every asset into the inbox until left."""
        ...

    def publish_made(self, topic: str, payload: bytes) -> None:
        """Publishes a frame that this service has made, for whoever records; no service takes it in."""
        ...

    def subscribe_made(self, inbox: Inbox) -> AbstractContextManager[object]:
        """Puts every frame that services have made into the inbox until left."""
        ...

    def ask_again(self, channel: Channel, seconds: float, done: Callable[[], None]) -> None:
        """Has publishers send the frames of a channel that they still hold into the inbox; does not wait for them.

        done  called once, by any thread, when all have come or the time is over [s]
        """
        ...

    def answer_states(self, source: StateSource) -> AbstractContextManager[object]:
        """Answers queries for states and alarms until left."""
        ...

    def publish_state(self, asset: str, text: str) -> None:
        """Publishes an asset's state, JSON text."""
        ...

    def publish_alarms(self, asset: str, text: str) -> None:
        """Publishes an asset's open alarms, JSON text."""
        ...

    def publish_position(self, stream: str, text: str) -> None:
        """Publishes how far a stream is stored, JSON text."""
        ...

    def answer_positions(
        self, ask: Callable[[str, Callable[[str], None], str | None], None]
    ) -> AbstractContextManager[object]:
        """Passes on each question how far a stream is stored, with what takes the answer, until left.

        The third argument is the session that asks, where it goes on sending after the answer.
        """
        ...

    def announce(self, asset: str) -> None:
        """Shows that this service serves the asset, until the connection is closed; repeated calls change nothing."""
        ...

    def withdraw(self, asset: str) -> None:
        """Shows that the asset is no longer served under this name."""
        ...

    def watch_rigs(self, received: Callable[[str, bytes], None]) -> AbstractContextManager[object]:
        """Passes on each rig file that somebody publishes, as asset and TOML text, until left."""
        ...

    def ask_rig(self, asset: str, seconds: float) -> Iterable[bytes]:
        """The rig files that somebody offers for the asset within a time [s], TOML text."""
        ...

    def lost(self) -> str | None:
        """Why the network cannot be reached at present, or None; asked by any thread, and answered at once."""
        ...

    def interrupted(self) -> bool:
        """Whether publishers may be cut off, or on their way back: their silence means nothing; by any thread."""
        ...

    def counters(self) -> Mapping[str, int]:
        """`missed_frames` that the network knows of, and `callback_errors`."""
        ...


OpenTransport = Callable[[], AbstractContextManager[Transport]]
"""Opens a connection. Raises NotReachable where the other side may answer later, DeliveryError where it never will."""


class FramePublisher(Protocol):
    """Publishes frames of any channels, and asks how far they are stored."""

    def offer_rig(self, asset: str, text: bytes) -> None:
        """Answers requests for the asset's rig file while this is open, and publishes it once."""
        ...

    def declare(self, channels: Iterable[Channel]) -> None:
        """Announces channels and waits until each has a subscriber."""
        ...

    def publish(self, frame: RawFrame) -> None:
        """Sends one frame; may block for some seconds while the link is busy."""
        ...

    def linked(self, channel: Channel | None = None) -> bool:
        """Whether subscribers and link are the same as before: nothing sent has been lost with them.

        channel  the one that is looked at; of the others a change may be known a moment later. None: all are looked at
        """
        ...

    def relink(self, seconds: float) -> None:
        """Waits until each channel has a subscriber again; DeliveryError where one has none within a time [s]."""
        ...

    def ask(self, stream: str, seconds: float, *, sending: bool = False) -> Iterable[str | bytes]:
        """What those who store the stream say of its position within a time [s], behind all frames sent.

        The question is sent at once, and the answers are awaited when they are read: several streams can be asked
        about together.

        sending  whether frames follow after the answer
        """
        ...
