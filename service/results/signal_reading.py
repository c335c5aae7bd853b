"""Reading raw signals of windows that are kept as files: which there are, and each as it was used."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from service.errors import NotKept
from service.results.segment_file import SUFFIX, read_segment
from service.results.signal_thinning import KeptWindow
from service.results.sql_store import SqlStore
from service.stream.edge_counts import EncoderCounts
from service.stream.segment import Segment
from service.stream.window import MadeWindow, window_of
from twin.rig import Rig
from twin.windows import Window

MARKS = {"k": {}, "f": {"found": True}, "x": {"refused": True}}
NAME = re.compile(r"(\d+)_(-?\d+)_([^_]+)_([kfx])\.mcap")
APART = re.compile(r"~((?:[0-9a-f]{2})+)")  # a folder's name that every file system keeps apart from others
MOST_NAMED = 12  # numbers that a message lists

KeptFile = tuple[KeptWindow, Path]
Making = Callable[[Segment, Rig, EncoderCounts], MadeWindow]


class KeptSignals(ABC):
    """Raw windows of all assets, for looking at."""

    @abstractmethod
    def files(self, asset: str) -> Mapping[int, KeptFile]:
        """What is kept of an asset, with the files."""

    def kept(self, asset: str) -> tuple[KeptWindow, ...]:
        """What is kept of an asset, by number."""
        return tuple(w for _, (w, _) in sorted(self.files(asset).items()))

    def indices(self, asset: str) -> tuple[int, ...]:
        """Indices of the windows that are kept, rising."""
        return tuple(w.number for w in self.kept(asset))

    def window(self, asset: str, index: int, rig: Rig, store: SqlStore, make: Making = window_of) -> Window:
        """One window, made once more from its frames, by the rig as it is now; NotKept."""
        segment = self.segment(asset, index)
        return make(segment, rig, EncoderCounts.from_dict(store.before(asset, segment.start_ns))).window

    def segment(self, asset: str, index: int) -> Segment:
        """The frames of one window; NotKept, which says what is kept, where it is not there."""
        found = self.files(asset).get(index)
        if found is None:
            raise NotKept(f"the raw signals of window {index} are not kept; {self._listed(asset)}")
        try:
            return read_segment(found[1])
        except FileNotFoundError:
            raise NotKept(f"the raw signals of window {index} have been deleted") from None
        except (OSError, ValueError) as error:
            raise NotKept(
                f"the raw signals of window {index} cannot be read: {found[1].name} is damaged "
                f"({type(error).__name__}: {error})"
            ) from error

    def _listed(self, asset: str) -> str:
        indices = self.indices(asset)
        if not indices:
            return "none of this asset's windows are kept"
        shown = ", ".join(map(str, indices[-MOST_NAMED:]))
        return f"kept are {'…, ' if len(indices) > MOST_NAMED else ''}{shown}"


def found_in(folder: Path) -> dict[int, KeptFile]:
    """What the folder of an asset holds, of one number the latest; nothing where there is none."""
    found: dict[int, tuple[int, KeptFile]] = {}
    with suppress(FileNotFoundError):
        for path in folder.glob(f"*{SUFFIX}"):
            with suppress(FileNotFoundError):  # it has just been given up
                stat = path.stat()
                entry = entry_of(path, stat.st_size)
                if entry is not None and (entry.number not in found or found[entry.number][0] < stat.st_mtime_ns):
                    found[entry.number] = stat.st_mtime_ns, (entry, path)
    return {number: kept for number, (_, kept) in found.items()}


def entry_of(path: Path, size: int) -> KeptWindow | None:
    """What a file's name says; None where it is not a window's."""
    read = NAME.fullmatch(path.name)
    if read is None:
        return None
    try:
        turns = None if read[3] == "none" else float(read[3])
    except ValueError:
        return None
    return KeptWindow(number=int(read[1]), start_ns=int(read[2]), revolutions=turns, bytes=size, **MARKS[read[4]])


def folder_of(asset: str) -> str:
    """The asset's name, but for the two that a file system keeps for itself; `~` is not allowed in a name."""
    return f"~{asset}" if asset in (".", "..") else asset


def folder_in(parent: Path, asset: str, *, make: bool = False) -> Path:
    """The folder of an asset. Where the file system gives its name to another asset (`Press` and `press`) or to none
    (`CON`, `x.`), as shares of Windows do, it is that of the name's bytes in digits.

    make  whether it is made where there is none
    """
    own, apart = parent / folder_of(asset), parent / f"~{asset.encode().hex()}"
    if (found := _there(parent, own, apart)) is not None or not make:
        return found or apart
    with suppress(OSError):
        own.mkdir()
    if _there(parent, own) is None:
        apart.mkdir(exist_ok=True)
        return apart
    return own


def _there(parent: Path, *folders: Path) -> Path | None:
    """The first folder that is listed: a folder of another name may say that it is there, too."""
    names = os.listdir(parent) if parent.is_dir() else ()
    return next((folder for folder in folders if folder.name in names), None)


def asset_of_folder(folder: str) -> str:
    """The asset of a folder's name."""
    apart = APART.fullmatch(folder)
    return bytes.fromhex(apart[1]).decode(errors="replace") if apart else folder.removeprefix("~")
