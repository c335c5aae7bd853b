"""The recorder: a process of its own that keeps what comes on the network as rolling MCAP files.

It subscribes by itself, so that neither the service's queues nor its end take frames from it. Where the disk is slower
than the stream, frames are left out of the recordings, counted and logged; where it is full or fails, the recording
stops, says so, and is tried again with growing pauses.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from service.errors import NotReachable
from service.logs import logging_by
from service.results.database import Database
from service.results.raw_recordings import RawLimits, RawRecordings
from service.runtime.recorded_assets import RecordedAssets
from service.runtime.recorder import Recorded, Recorder
from service.runtime.rig_sources import GivenRigs, OfferedRigs
from service.settings import HOUR, Settings
from service.stream.inbox import MANY_STREAMS, Arrival, Inbox
from service.stream.left_out import NO_ROOM
from service.transport.protocol import OpenTransport, Transport

if TYPE_CHECKING:  # what moves recordings is not loaded where they stay
    from service.results.raw_segments import SegmentSender

log = logging.getLogger(__name__)

WAITING_BYTES = 64 * 2**20  # frames that wait to be written, together
PAUSES = (1.0, 60.0)  # shortest and longest pause before the disk is tried again [s]
SAY_EVERY = 60.0  # that frames are left out is logged so often at most [s]
END_WAIT = 5.0  # how long what waits is written at the end [s]
FIRST_LOOK = 2.0  # how long a database is waited for that says which frames are recorded [s]
FOLDER = "raw"  # in the data directory, where recordings wait for the object store and no other folder is set
_POLL = 0.5  # [s]


class RawRecorder:
    """Frames on their way from an inbox into the recordings of a folder; for one thread.

    asset_of  the asset of a stream; None where its frames are not recorded
    sender    moves completed files to an object store; None where they stay
    lost      why nothing comes from the network, or None
    """

    def __init__(
        self,
        inbox: Inbox,
        recordings: RawRecordings,
        *,
        asset_of: Callable[[str], str | None] = lambda stream: stream,
        sender: SegmentSender | None = None,
        lost: Callable[[], str | None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._inbox, self._recordings, self._sender, self._lost, self._clock = inbox, recordings, sender, lost, clock
        self.recorder = Recorder(recordings, asset_of)
        self._left_out = self._shed = 0
        self._said = float("-inf")
        self._fault: str | None = "not yet begun"
        self._again, self._pause = 0.0, PAUSES[0]

    def turn(self, timeout: float = _POLL) -> None:
        """Records what has come, or waits for it for a while [s]."""
        try:
            self._turn(timeout)
        except Exception as error:  # a disk that is full or fails, or anything else
            self._stop(error)

    def end(self) -> None:
        """Writes what waits and completes the files, as far as that takes no more than a few seconds."""
        until = self._clock() + END_WAIT
        while not self._inbox.empty and self._clock() < until:
            self.turn(0.0)
        if self._fault is None:
            try:
                self._recordings.close()
            except OSError as error:
                self._stop(error)
        if self._sender is not None:
            self._sender.end()

    @property
    def left_out(self) -> int:
        """Frames that are missing in the recordings."""
        return self._left_out + self._inbox.refused[NO_ROOM] + self._inbox.refused[MANY_STREAMS]

    def figures(self) -> Mapping[str, float]:
        """Figures for /metrics; for any thread."""
        recordings = self._recordings
        return {
            "raw_recordings": recordings.files,
            "raw_recording_bytes": recordings.size,
            "raw_recording_newest_seconds": recordings.newest_ns / 1e9,
            "raw_recording_stopped": float(self._fault is not None or self._lost() is not None),
            "raw_frames_recorded": self.recorder.frames,
            "raw_frames_left_out": self.left_out,
            "raw_recordings_deleted": recordings.deleted,
            **({} if self._sender is None else self._sender.figures()),
        }

    def _turn(self, timeout: float) -> None:
        if self._fault is not None and self._clock() >= self._again:
            self._recordings.begin()
            if self._pause > PAUSES[0]:
                log.info("raw recordings in %s go on", self._recordings.folder)
            self._fault, self._pause = None, PAUSES[0]
        item = self._inbox.take(timeout)
        if self._inbox.refused[NO_ROOM] > self._shed:
            self._shed = self._inbox.refused[NO_ROOM]
            self._say("the disk is slower than the stream")
        if self._fault is not None:
            if isinstance(item, Arrival):
                self._left_out += 1
                self._say(self._fault)
            return
        if item is not None:
            try:
                self.recorder.take(item)
            except BaseException:
                self._left_out += 1
                self._say("the disk cannot be used")
                raise
        self._recordings.turn()
        if self._sender is not None:
            self._sender.turn(self._recordings)

    def _stop(self, error: Exception) -> None:
        """The disk cannot be used now."""
        self._fault = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        self._again = self._clock() + self._pause
        self._recordings.abandon()
        log.error(
            "raw recordings in %s cannot be written: %s; it is tried again in %g s",
            self._recordings.folder, self._fault, self._pause,
        )  # fmt: skip
        self._pause = min(2 * self._pause, PAUSES[1])

    def _say(self, why: str) -> None:
        if self._clock() - self._said >= SAY_EVERY:
            self._said = self._clock()
            log.warning("frames are left out of the raw recordings: %s", why)


def folder_of(settings: Settings) -> Path:
    """The folder of the recordings."""
    return settings.raw_folder or settings.data / FOLDER


def limits_of(settings: Settings) -> RawLimits:
    """How large recordings become, and what they may take."""
    keep_gb = settings.raw_keep_gb if settings.raw_url is None else settings.raw_spool_gb
    return RawLimits(
        roll_bytes=round(settings.raw_roll_mb * 1e6),
        roll_seconds=settings.raw_roll_hours * HOUR,
        keep_bytes=round(keep_gb * 1e9),
        keep_seconds=settings.raw_keep_days * 24 * HOUR,
        spare_bytes=round(settings.raw_spare_gb * 1e9),
    )


def record(settings: Settings, **given: Any) -> Recorded:
    """The role: as `keep_recording`, and logs by the settings."""
    with logging_by(settings):
        return keep_recording(settings, **given)


def keep_recording(
    settings: Settings,
    open_transport: OpenTransport,
    *,
    stop: Event,
    beat: Callable[[], None] = lambda: None,
    open_database: Callable[[], Database] | None = None,
    prefix: str | None = None,
    here: Callable[[str], bool] = lambda stream: True,
) -> Recorded:
    """Records by the settings until `stop` is set.

    beat           called with each turn
    open_database  opens the database of the service whose streams are recorded; None where there is none
    prefix         first part of the topics in the recordings; None for that of the settings
    here           whether a stream that is in no row would be one of this service
    """
    prefix = prefix or settings.prefix
    network: Transport | None = None

    def lost() -> str | None:
        return "not yet connected" if network is None else network.lost()

    assets = RecordedAssets(
        open_database,
        asks=open_database is not None and settings.rule_of_new_assets[0] == "ask",
        given=GivenRigs.read(settings.rig, settings.asset_rigs),
        here=here,
        figures=lambda: recorder.figures(),
    )
    inbox = Inbox(settings.queue_frames, WAITING_BYTES, settings.prefix, assets.admits)
    recordings = RawRecordings(
        folder_of(settings), limits_of(settings), rig_text_of=assets.rig_text, prefix=prefix, turned=beat
    )
    sender = None
    if settings.raw_url is not None:
        from service.results.raw_segments import SegmentSender

        sender = SegmentSender.of(settings, recordings, prefix)
    recorder = RawRecorder(inbox, recordings, asset_of=assets.asset_of, sender=sender, lost=lost)
    assets.start()
    assets.looked.wait(FIRST_LOOK)
    try:
        with ExitStack() as stack:
            while network is None and not stop.is_set():
                beat()
                recorder.turn(0.0)  # what an earlier run has left is completed, and moved
                try:
                    network = stack.enter_context(open_transport())
                except NotReachable as error:
                    log.info("the recorder waits for the network: %s", error)
            if network is not None:
                assets.offered = stack.enter_context(OfferedRigs(network).watching())
                stack.enter_context(network.subscribe_made(inbox))
                stack.enter_context(network.subscribe(inbox))
                assets.say()
            while not stop.is_set():
                beat()
                recorder.turn()
            missed = 0 if network is None else network.counters().get("missed_frames", 0)
    finally:
        recorder.end()
        assets.end()
    return Recorded(recorder.recorder.frames, recorder.recorder.refused, recorder.left_out, missed)
