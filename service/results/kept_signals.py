"""Signals of windows that are kept, for looking at and for learning baselines: the row of a window names its segment.

The file in which a window waited for its turn stays where it is. The transaction that commits the window names it in
the window's row, and takes the names of those that are given up (signal_thinning.py) from theirs. A file that no row
names is deleted after that transaction, or by the next start (window_jobs.py). What is kept is in the rows alone, so
that several processes commit, and others read, at the same time. The results of every window stay in the database.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sqlalchemy import bindparam, func, select, update

from service.errors import NotKept
from service.results.json_columns import salvage
from service.results.schema import WINDOWS
from service.results.segment_file import read_segment
from service.results.signal_thinning import REFUSED, KeptWindow, given_up
from service.results.store import Tables
from service.stream.edge_counts import EncoderCounts
from service.stream.segment import Segment
from service.stream.window import MadeWindow, window_of
from twin.rig import Rig
from twin.windows import Window

MOST_NAMED = 12  # numbers that a message lists

Making = Callable[[Segment, Rig, EncoderCounts], MadeWindow]

_HAS = (WINDOWS.c.asset == bindparam("of"), WINDOWS.c.segment.is_not(None))
_TAKEN = select(func.sum(WINDOWS.c.segment_bytes), func.sum(WINDOWS.c.refused)).where(*_HAS)
_KEPT = (
    select(
        *(WINDOWS.c[n] for n in ("number", "start_ns", "revolutions", "segment_bytes", "found", "refused", "segment"))
    )
    .where(*_HAS)
    .order_by(WINDOWS.c.number)
)
_ONE = select(WINDOWS.c.segment, WINDOWS.c.before).where(*_HAS, WINDOWS.c.number == bindparam("at"))
_GIVE_UP = update(WINDOWS).where(*_HAS, WINDOWS.c.number == bindparam("at")).values(segment=None)


class KeptSignals:
    """Signals of windows of all assets."""

    def __init__(self, database: Tables, folder: Path, limit: int = 0) -> None:
        """folder  of segments
        limit  bytes that one asset may take; 0: no more are kept
        """
        self._database, self._folder, self.limit = database, folder, limit

    def thin(self, asset: str) -> list[Path]:
        """Gives up what an asset has beyond its limit, within the transaction that keeps one more; the files, which are
        to be deleted once that is committed.
        """
        ((size, refused),) = self._database.rows(_TAKEN, {"of": asset})
        if (size or 0) <= self.limit and (refused or 0) <= REFUSED:
            return []
        files = dict(self._named(asset))
        gone = given_up(list(files), self.limit)
        if gone:
            with self._database.transaction() as db:
                db.execute(_GIVE_UP, [{"of": asset, "at": window.number} for window in gone])
        return [self._folder / files[window] for window in gone]

    def kept(self, asset: str) -> tuple[KeptWindow, ...]:
        """What is kept of an asset, by number, as far as the files are there."""
        return tuple(window for window, file in self._named(asset) if (self._folder / file).exists())

    def indices(self, asset: str) -> tuple[int, ...]:
        """Indices of the windows that are kept, rising."""
        return tuple(w.number for w in self.kept(asset))

    def window(self, asset: str, index: int, rig: Rig, make: Making = window_of) -> Window:
        """One window, made once more from its frames, by the rig as it is now; NotKept, which says what is kept, where
        they are not there.
        """
        rows = self._database.rows(_ONE, {"of": asset, "at": index})
        if not rows:
            raise NotKept(f"the raw signals of window {index} are not kept; {self._listed(asset)}")
        file, before = rows[0]
        try:
            segment = read_segment(self._folder / file)
        except FileNotFoundError:
            raise NotKept(f"the raw signals of window {index} have been deleted") from None
        except (OSError, ValueError) as error:
            raise NotKept(
                f"the raw signals of window {index} cannot be read: {file} is damaged ({type(error).__name__}: {error})"
            ) from error
        counts = EncoderCounts.from_dict(salvage(before, f"window {index} of {asset}") or {})
        return make(segment, rig, counts).window

    # -- within --------------------------------------------------------------------------------------

    def _named(self, asset: str) -> list[tuple[KeptWindow, str]]:
        """The windows whose rows name a file, by number, with the names."""
        return [
            (
                KeptWindow(
                    number=number, start_ns=start_ns, revolutions=revolutions, bytes=size, found=bool(found),
                    refused=bool(refused),
                ),
                file,
            )
            for number, start_ns, revolutions, size, found, refused, file in self._database.rows(_KEPT, {"of": asset})
        ]  # fmt: skip

    def _listed(self, asset: str) -> str:
        indices = self.indices(asset)
        if not indices:
            return "none of this asset's windows are kept"
        shown = ", ".join(map(str, indices[-MOST_NAMED:]))
        return f"kept are {'…, ' if len(indices) > MOST_NAMED else ''}{shown}"
