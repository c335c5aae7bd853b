"""The thread that keeps what the service has used as rolling MCAP files, so that no frame waits for the disk.

A frame is offered when it is put in order for its window. Where the disk is slower than the stream, frames are left out
of the recordings, counted and logged; where it is full or fails, the recording stops, says so, and is tried again with
growing pauses. Windows and results do not depend on it.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from service.operation.health import RAW_RECORDINGS, Health
from service.results.asset_table import AssetTable
from service.settings import HOUR, Settings
from service.setup.toml_text import document_text
from service.stream.frames import Frame

if TYPE_CHECKING:  # what writes recordings is not loaded where none are kept
    from service.results.raw_recordings import RawRecordings
    from service.results.raw_segments import SegmentSender

log = logging.getLogger(__name__)

WAITING_BYTES = 64 * 2**20  # frames that wait to be written, together
PAUSES = (1.0, 60.0)  # shortest and longest pause before the disk is tried again [s]
SAY_EVERY = 60.0  # that frames are left out is logged so often at most [s]
END_WAIT = 5.0  # how long the files are waited for at the end [s]
FOLDER = "raw"  # in the data directory, where recordings wait for the object store and no other folder is set
_POLL = 0.5  # [s]


class RawRecorder:
    """Frames on their way into the recordings of a folder."""

    def __init__(
        self,
        recordings: RawRecordings,
        waiting_bytes: int = WAITING_BYTES,
        clock: Callable[[], float] = time.monotonic,
        sender: SegmentSender | None = None,
    ) -> None:
        """sender  moves completed files to an object store; None where they stay"""
        self._recordings, self._room, self._clock, self._sender = recordings, waiting_bytes, clock, sender
        self._queue: queue.SimpleQueue[Frame | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting = 0  # bytes in the queue
        self._frames = self._left_out = 0
        self._said = float("-inf")
        self._fault: str | None = "not yet begun"
        self._again, self._pause = 0.0, PAUSES[0]
        self._ended = False
        self.thread = threading.Thread(target=self._run, name="raw recordings", daemon=True)
        self.thread.start()

    def offer(self, frame: Frame) -> None:
        """Hands a frame over; never waits."""
        with self._lock:
            room = self._waiting + frame.nbytes <= self._room
            self._waiting += frame.nbytes if room else 0
        if room:
            self._queue.put(frame)
        else:
            self._leave_out("the disk is slower than the stream")

    def end(self) -> None:
        """Writes what waits and completes the files, as far as that takes no more than a few seconds."""
        self._queue.put(None)
        self.thread.join(END_WAIT)
        if self._sender is not None:
            self._sender.end()

    def figures(self) -> Mapping[str, float]:
        """Figures for /metrics."""
        recordings = self._recordings
        return {
            "raw_recordings": recordings.files,
            "raw_recording_bytes": recordings.size,
            "raw_recording_newest_seconds": recordings.newest_ns / 1e9,
            "raw_recording_stopped": float(self._fault is not None),
            "raw_frames_recorded": self._frames,
            "raw_frames_left_out": self._left_out,
            "raw_recordings_deleted": recordings.deleted,
            **({} if self._sender is None else self._sender.figures()),
        }

    def _run(self) -> None:
        while not self._ended:
            try:
                self._turn()
            except Exception as error:  # a disk that is full or fails, or anything else: windows do not depend on it
                self._stop(error)
        if self._fault is None:
            try:
                self._recordings.close()
            except OSError as error:
                self._stop(error)

    def _turn(self) -> None:
        if self._fault is not None and self._clock() >= self._again:
            self._recordings.begin()
            if self._pause > PAUSES[0]:
                log.info("raw recordings in %s go on", self._recordings.folder)
            self._fault, self._pause = None, PAUSES[0]
        try:
            frame = self._queue.get(timeout=_POLL)
        except queue.Empty:
            frame = None
        else:
            if frame is None:
                self._ended = True
                return
            with self._lock:
                self._waiting -= frame.nbytes
        if self._fault is not None:
            if frame is not None:
                self._leave_out(self._fault)
            return
        if frame is not None:
            try:
                self._recordings.write(frame)
            except BaseException:
                self._leave_out("the disk cannot be used")
                raise
            self._frames += 1
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

    def _leave_out(self, why: str) -> None:
        self._left_out += 1
        if self._clock() - self._said >= SAY_EVERY:
            self._said = self._clock()
            log.warning("frames are left out of the raw recordings: %s", why)


@contextmanager
def recording_raw(
    settings: Settings, table: AssetTable, health: Health, *, prefix: str | None = None
) -> Iterator[RawRecorder | None]:
    """The recorder of a service, by its settings, until left; None where frames are not kept.

    prefix  first part of the topics in the recordings; None for that of the settings
    """
    if settings.raw_folder is None and settings.raw_url is None:
        yield None
        return
    from service.results.raw_recordings import RawLimits, RawRecordings

    keep_gb = settings.raw_keep_gb if settings.raw_url is None else settings.raw_spool_gb
    limits = RawLimits(
        roll_bytes=round(settings.raw_roll_mb * 1e6),
        roll_seconds=settings.raw_roll_hours * HOUR,
        keep_bytes=round(keep_gb * 1e9),
        keep_seconds=settings.raw_keep_days * 24 * HOUR,
        spare_bytes=round(settings.raw_spare_gb * 1e9),
    )
    folder = settings.raw_folder or settings.data / FOLDER
    prefix = prefix or settings.prefix
    recordings = RawRecordings(folder, limits, rig_text_of=rig_texts(table), prefix=prefix)
    sender = None
    if settings.raw_url is not None:
        from service.results.raw_segments import SegmentSender

        sender = SegmentSender.of(settings, recordings, prefix)
    recorder = RawRecorder(recordings, sender=sender)
    health.thread(RAW_RECORDINGS, recorder.thread)
    try:
        yield recorder
    finally:
        recorder.end()


def rig_texts(table: AssetTable) -> Callable[[str], bytes | None]:
    """The rig file that holds for an asset, as TOML; written again only where another one holds."""
    written: dict[str, tuple[Mapping[str, Any], bytes]] = {}

    def rig_text(asset: str) -> bytes | None:
        snapshot = table.latest(asset)
        rig = None if snapshot is None else snapshot.rig
        if not rig:
            return None
        if asset not in written or written[asset][0] is not rig:
            written[asset] = rig, document_text(rig).encode()
        return written[asset][1]

    return rig_text
