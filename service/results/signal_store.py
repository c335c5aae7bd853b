"""Raw signals of measurement windows, kept on disk for looking at and for learning baselines.

    <data>/signals/<asset>/<number>_<start>_<revolutions>_<mark>.npz     mark: k kept, f something found, x refused

One file a window (window_file.py), named by what the thinning needs to know, so that the directory is its own index
and no crash can leave the two apart. What an asset may take on disk is bounded; signal_thinning.py says which windows
are given up. The results of every window stay in the database.
"""

from __future__ import annotations

import re
import threading
from pathlib import Path

from service.errors import NotKept, StoreError
from service.results.signal_thinning import KeptWindow, given_up
from service.results.window_file import SUFFIX, UNFINISHED, read_window, write_window
from twin.windows import Window

MARKS = {"k": {}, "f": {"found": True}, "x": {"refused": True}}
NAME = re.compile(r"(\d+)_(-?\d+)_([^_]+)_([kfx])\.npz")
MOST_NAMED = 12  # numbers that a message lists


class SignalStore:
    """Raw windows of all assets under one directory. Safe to use from several threads of one process."""

    def __init__(self, folder: Path, limit: int) -> None:
        """limit  bytes that one asset may take; 0 keeps nothing"""
        self.folder, self.limit = Path(folder), limit
        self._lock = threading.Lock()
        self._kept: dict[str, dict[int, tuple[KeptWindow, Path]]] = {}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for asset in sorted(p for p in self.folder.iterdir() if p.is_dir()):
                self._kept[_asset_of(asset.name)] = _opened(asset)
        except OSError as error:
            raise StoreError(f"{self.folder} cannot hold raw signals: {error.strerror or error}") from error

    def keep(
        self,
        asset: str,
        number: int,
        window: Window,
        *,
        revolutions: float | None = None,
        found: bool = False,
        file: Path | None = None,
    ) -> bool:
        """Keeps one window, and gives up others where there is no room; False where signals are not kept.

        file  the window as a file, which is moved here in place of being written again; `window` needs no signals then

        OSError where it cannot be written; what was kept before is then untouched.
        """
        if self.limit == 0 or (file is None and not (window.accelerations or window.torques or window.encoders)):
            return False
        mark = "x" if window.quality == "refused" else "f" if found else "k"
        turns = "none" if revolutions is None else f"{revolutions:.6g}"
        folder = self.folder / folder_of(asset)
        path = folder / f"{number:08d}_{window.start_time_ns}_{turns}_{mark}{SUFFIX}"
        folder.mkdir(exist_ok=True)
        if file is None:
            size = write_window(path, window)
        else:
            size = file.stat().st_size
            file.replace(path)
        kept = _entry(path, size)
        assert kept is not None
        with self._lock:
            of_asset = self._kept.setdefault(asset, {})
            before = of_asset.get(number)
            of_asset[number] = kept, path
            dropped = [of_asset.pop(w.number)[1] for w in given_up([w for w, _ in of_asset.values()], self.limit)]
        if before is not None and before[1] != path:
            dropped.append(before[1])
        for old in dropped:
            old.unlink(missing_ok=True)
        return True

    def rename(self, asset: str, name: str) -> None:
        """Gives what is kept of an asset to another name, of which nothing is kept."""
        with self._lock:
            old, new = self.folder / folder_of(asset), self.folder / folder_of(name)
            if old.is_dir():
                old.replace(new)
                self._kept.pop(asset, None)
                self._kept[name] = _opened(new)

    def kept(self, asset: str) -> tuple[KeptWindow, ...]:
        """What is kept of an asset, by number."""
        with self._lock:
            return tuple(w for _, (w, _) in sorted(self._kept.get(asset, {}).items()))

    def indices(self, asset: str) -> tuple[int, ...]:
        """Indices of the windows that are kept, rising."""
        return tuple(w.number for w in self.kept(asset))

    def window(self, asset: str, index: int) -> Window:
        """One window as it was processed; NotKept, which says what is kept, where it is not there."""
        with self._lock:
            found = self._kept.get(asset, {}).get(index)
        if found is None:
            raise NotKept(f"the raw signals of window {index} of {asset} are not kept; {self._listed(asset)}")
        try:
            return read_window(found[1])
        except FileNotFoundError:
            raise NotKept(f"the raw signals of window {index} of {asset} have been deleted") from None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise NotKept(
                f"the raw signals of window {index} of {asset} cannot be read: {found[1].name} is damaged "
                f"({type(error).__name__}: {error})"
            ) from error

    def _listed(self, asset: str) -> str:
        indices = self.indices(asset)
        if not indices:
            return "none of this asset's windows are kept"
        shown = ", ".join(map(str, indices[-MOST_NAMED:]))
        return f"kept are {'…, ' if len(indices) > MOST_NAMED else ''}{shown}"


def _opened(folder: Path) -> dict[int, tuple[KeptWindow, Path]]:
    """What a folder holds; files that a crash left unfinished, and all but the latest of one number, are deleted."""
    found: dict[int, tuple[KeptWindow, Path]] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix == UNFINISHED:
            path.unlink(missing_ok=True)
            continue
        entry = _entry(path, path.stat().st_size)
        if entry is None:
            continue
        other = found.get(entry.number)
        if other is not None:
            older, path = sorted((other[1], path), key=lambda p: p.stat().st_mtime_ns)
            older.unlink()
            entry = _entry(path, path.stat().st_size) or entry
        found[entry.number] = entry, path
    return found


def _entry(path: Path, size: int) -> KeptWindow | None:
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


def _asset_of(folder: str) -> str:
    return folder.removeprefix("~")
