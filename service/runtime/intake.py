"""What the service does with frames between the pump and the reception: learning, and counters that are shown."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace

from service.errors import FrameError, NameTaken
from service.runtime.learning_phase import LearningPhase
from service.runtime.reception import Reception
from service.runtime.storage_watch import StorageWatch
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import Frame
from service.stream.left_out import UNOPENED, Growing, Missing
from service.stream.position import Position, earliest
from service.stream.wire.topics import Channel

HELD_BYTES = 64 * 2**20  # frames of new assets that wait for storage, together [bytes]
SHOW_EVERY = 1.0  # how often counters are shown while frames come [s]


class Intake:
    """Hands frames to the reception, and shows each asset's counters once a second while frames come.

    show_quality  shows the counters of an asset
    heard         called for each frame that comes, valid or not, of a channel that makes windows
    begins        called before an asset is opened for its first frame; NameTaken where there is none of its name
    """

    def __init__(
        self,
        reception: Reception,
        show_quality: Callable[[str], None],
        *,
        heard: Callable[[str], None] = lambda asset: None,
        begins: Callable[[str], None] = lambda asset: None,
        storage: StorageWatch | None = None,
        learning: LearningPhase | None = None,
        held_bytes: int = HELD_BYTES,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._reception, self._show_quality, self._clock = reception, show_quality, clock
        self._heard, self._begins, self._storage = heard, begins, storage
        self.left_out = 0  # frames of new assets for which there was no room while the storage could not be used
        self._unopened: dict[str, list[Frame]] = {}  # the first frames of new assets that wait for storage
        self._unopened_bytes, self._held_bytes = 0, held_bytes
        self._missing: dict[str, Growing] = {}  # frames of those assets that were left out meanwhile
        self._learning = learning or LearningPhase()
        self._known = set(reception.assets)
        self._shown: dict[str, float] = {}  # when an asset's counters were shown; absent where they are up to date

    def feed(self, frame: Frame) -> None:
        """Takes one frame in."""
        asset, now = frame.channel.asset, self._clock()
        self._note(frame.channel)
        if asset not in self._known:
            if not self._open(asset):
                self._hold(frame)
                return
            self._begin(asset, now)
        if self._hand_on(frame, now) and self._clock() - self._shown.get(asset, float("-inf")) > SHOW_EVERY:
            self._show(asset)

    def _begin(self, asset: str, now: float) -> None:
        """The first of an asset has come: its channels are learned, and what has waited for the storage goes on."""
        self._known.add(asset)
        self._learning.begin(asset, now)
        if asset in self._missing:
            self._reception.leave_out(asset, self._missing.pop(asset).missing)
        for held in self._unopened.pop(asset, ()):
            self._unopened_bytes -= held.nbytes
            self._hand_on(held, now)

    def _hold(self, frame: Frame) -> None:
        """Keeps a frame of a new asset until the storage can be used; later ones are left out where there is no room.

        The first ones are kept, so that what was left out is a gap that the publisher is asked to fill.
        """
        asset = frame.channel.asset
        if self._unopened_bytes + frame.nbytes > self._held_bytes:
            self.left_out += 1
            growing = self._missing.setdefault(asset, Growing(UNOPENED))
            growing.add(frame.channel.label, frame.sequence, frame.start_time_ns)
            return
        self._unopened_bytes += frame.nbytes
        self._unopened.setdefault(asset, []).append(frame)

    def _hand_on(self, frame: Frame, now: float) -> bool:
        """Hands a frame to the reception; False where it is held to learn the asset's channels."""
        if not self._learning.holds(frame.channel.asset):
            self._reception.feed(frame)
            return True
        return self._feed_learned(frame.channel.asset, self._learning.add(frame, now))

    def reject(self, channel: Channel, error: FrameError) -> None:
        """Counts a frame that breaks the contract."""
        self._note(channel)
        if not self._open(channel.asset):
            return
        if channel.asset not in self._known:
            self._begin(channel.asset, self._clock())
        self._reception.reject(channel, error)
        self._show(channel.asset)

    def leave_out(self, asset: str, missing: Missing) -> None:
        """Frames of a stretch of time were left out before they came here."""
        if not self._open(asset):
            self._missing.setdefault(asset, Growing(UNOPENED)).join(missing)
            return
        if asset not in self._known:
            self._begin(asset, self._clock())
        self._reception.leave_out(asset, missing)
        self._show(asset)

    def note_publishers(self, asset: str, label: str, two: tuple[str, str]) -> None:
        """Two publishers send on a channel's key in turn."""
        if asset in self._known:
            self._reception.note_publishers(asset, label, two)

    def note_recorded(self, asset: str, recorded: bool) -> None:
        """The frames that follow are of a recording, or of a live stream."""
        if asset in self._known:
            self._reception.note_recorded(asset, recorded)

    def flush(self, asset: str) -> None:
        """Closes the asset's window in progress, after silence."""
        self._feed_learned(asset, self._learning.end(asset))
        self._reception.flush(asset)

    def waiting(self, asset: str) -> bool:
        """Whether frames of the asset wait. Asked in silence: the counters of the last frames are shown now."""
        if self._learning.holds(asset) or self._reception.waiting(asset):
            return True
        if asset in self._shown:
            self._show(asset)
            del self._shown[asset]
        return False

    def position(self, asset: str) -> Position | None:
        """How far the asset's stream has come, with the frames that are held to learn its channels."""
        found, held = self._reception.position(asset), self._learning.earliest(asset)
        if found is None or held is None:
            return found
        return replace(
            found,
            unsettled_from_ns=earliest([found.unsettled_from_ns, held]),
            channels={**found.channels, **self._learning.newest(asset)},
        )

    def channels(self, asset: str) -> Collection[str]:
        """The channels that the asset's windows wait for."""
        return self._reception.channels(asset)

    def expect(self, asset: str, labels: Iterable[str]) -> None:
        """Waits for these channels too; not for those of an asset that is unknown yet, whose frames are left out."""
        if asset in self._known:
            self._reception.expect(asset, labels)

    def wait_only_for(self, asset: str, labels: Iterable[str]) -> None:
        """Lets the asset's windows close without the channels that have fallen silent."""
        self._reception.wait_only_for(asset, labels)

    def know(self, asset: str) -> None:
        """An asset whose channels another one's stream has shown."""
        self._known.add(asset)

    def _open(self, asset: str) -> bool:
        """Looks for a new asset's rig file now: who offers it may be gone later. False where that must wait.

        NameTaken where it is a name that another asset has been given meanwhile.
        """

        def look() -> None:
            self._begins(asset)
            self._reception.open(asset)

        if asset in self._known:
            return True
        try:
            if self._storage is not None:
                return self._storage.attempt(look)[0]
            look()
        except NameTaken:
            self._unopened_bytes -= sum(held.nbytes for held in self._unopened.pop(asset, ()))
            self._missing.pop(asset, None)
            raise
        return True

    def _note(self, channel: Channel) -> None:
        if not CHANNEL_KINDS[channel.kind].slow:  # slow values go on between windows
            self._heard(channel.asset)

    def _feed_learned(self, asset: str, frames: list[Frame]) -> bool:
        """Hands on the frames of a learning phase that has ended, whose channels are known now; whether it has."""
        if frames:
            self._reception.expect(asset, {frame.channel.label for frame in frames})
        for frame in frames:
            self._reception.feed(frame)
        return bool(frames)

    def _show(self, asset: str) -> None:
        self._shown[asset] = self._clock()
        self._show_quality(asset)
