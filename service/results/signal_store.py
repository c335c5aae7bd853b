"""Raw signals of measurement windows, kept on disk for looking at and for learning baselines.

    <data>/signals/<asset>/<number>_<start>_<revolutions>_<mark>.mcap     mark: k kept, f something found, x refused

The file in which a window waited for its turn (segment_file.py), named by what the thinning needs to know, so that the
directory is its own index and no crash can leave the two apart. What an asset may take on disk is bounded;
signal_thinning.py says which windows are given up. The results of every window stay in the database.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from pathlib import Path

from service.errors import StoreError
from service.results.segment_file import SUFFIX
from service.results.signal_reading import KeptFile, KeptSignals, asset_of_folder, entry_of, folder_in, found_in
from service.results.signal_thinning import given_up

log = logging.getLogger(__name__)


class SignalStore(KeptSignals):
    """Raw windows of all assets under one directory. Safe to use from several threads of one process."""

    def __init__(self, folder: Path, limit: int) -> None:
        """limit  bytes that one asset may take; 0 keeps nothing"""
        self.folder, self.limit = Path(folder), limit
        self._lock = threading.Lock()
        self._kept: dict[str, dict[int, KeptFile]] = {}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for asset in sorted(p for p in self.folder.iterdir() if p.is_dir()):
                self._kept[asset_of_folder(asset.name)] = _opened(asset)
        except OSError as error:
            raise StoreError(f"{self.folder} cannot hold raw signals: {error.strerror or error}") from error

    def keep(
        self,
        asset: str,
        number: int,
        file: Path,
        start_ns: int,
        *,
        revolutions: float | None = None,
        found: bool = False,
        refused: bool = False,
    ) -> bool:
        """Moves the file of a window to those of its asset, and gives up others where there is no room.

        False where signals are not kept. OSError where it cannot be moved; what was kept before is then untouched.
        """
        if self.limit == 0:
            return False
        mark = "x" if refused else "f" if found else "k"
        turns = "none" if revolutions is None else f"{revolutions:.6g}"
        name = f"{number:08d}_{start_ns}_{turns}_{mark}{SUFFIX}"
        with self._lock:
            size = file.stat().st_size
            of_asset = self._kept.setdefault(asset, {})
            beside = next((path.parent for _, path in of_asset.values()), None)
            folder = beside or folder_in(self.folder, asset, make=True)
            folder.mkdir(exist_ok=True)
            path = folder / name
            file.replace(path)
            kept = entry_of(path, size)
            assert kept is not None
            before = of_asset.get(kept.number)
            of_asset[kept.number] = kept, path
            dropped = [of_asset.pop(w.number)[1] for w in given_up([w for w, _ in of_asset.values()], self.limit)]
            if before is not None and before[1] != path:
                dropped.append(before[1])
            for old in dropped:
                old.unlink(missing_ok=True)
        return True

    def files(self, asset: str) -> Mapping[int, KeptFile]:
        """What is kept of an asset, with the files."""
        with self._lock:
            return dict(self._kept.get(asset, {}))


def _opened(folder: Path) -> dict[int, KeptFile]:
    """What a folder holds; all files but the latest of one number are deleted."""
    found = found_in(folder)
    for path in folder.glob(f"*{SUFFIX}"):
        entry = entry_of(path, 0)
        if entry is not None and found[entry.number][1] != path:
            path.unlink(missing_ok=True)
    return found
