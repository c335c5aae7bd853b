"""Recordings that are stored: files, folders and object stores, each as what `assess` reads as one recording.

In folders and under URLs, segments of one asset that follow one another are one recording: `{asset}/{start_ns}.mcap`
(`raw_segments.py`), and `{asset}/{asset}_{time}.mcap` (`service/results/raw_recordings.py`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import urlsplit

from service.errors import InputError, StoreError
from service.file_faults import reading
from service.results.asset_folders import asset_of_folder
from service.results.object_store import ObjectStore, is_url
from service.results.scratch import scratch
from service.stream.frames import NS

SUFFIX = ".mcap"
_BY_NUMBER = re.compile(r"(\d{16,20})(?:_(\d+))?\.mcap")
_BY_TIME = re.compile(r"_(\d{8}T\d{6})\.(\d{3})Z(?:_(\d+))?\.mcap")


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One file or object.

    place  the URL under which it is; None for a file
    name   within the place, or the path of the file
    tag    changes with the content
    """

    place: str | None
    name: str
    size: int
    tag: str

    @property
    def where(self) -> str:
        return self.name if self.place is None else f"{self.place}/{self.name}"

    @contextmanager
    def fetched(self) -> Iterator[Path]:
        """The recording as a file of this machine. StoreError where it cannot be had, or is not what was listed."""
        if self.place is not None:
            with scratch() as folder:
                path = folder / Path(self.name).name
                ObjectStore(self.place).read_to(path, self.name, self.tag)
                yield path
            return
        path = Path(self.name)
        self._demand_unchanged(path)
        yield path
        self._demand_unchanged(path)

    def _demand_unchanged(self, path: Path) -> None:
        try:
            with path.open("rb"):
                now = part_of(path)
        except OSError as error:
            raise StoreError(f"{path}: cannot be read: {(error.strerror or 'fault').lower()}") from None
        if now != self:
            raise StoreError(f"{path} has changed since it was listed")


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredRecording:
    """What is assessed as one recording.

    where  for people
    label  its name below what was given
    parts  in order of time
    """

    where: str
    label: str
    parts: tuple[Part, ...]

    @property
    def identity(self) -> list[list[str | int]]:
        """What it is made of; another content has another identity."""
        return [[part.where, part.size, part.tag] for part in self.parts]


def part_of(path: Path) -> Part:
    """A file; OSError where it is not there."""
    about = path.stat()
    return Part(place=None, name=str(path), size=about.st_size, tag=str(about.st_mtime_ns))


def stored_recordings(given: Iterable[str]) -> list[StoredRecording]:
    """The recordings of files, folders and URLs; InputError where one of them has none."""
    found: dict[tuple[Part, ...], StoredRecording] = {}
    for where in given:
        here = _of_url(where) if is_url(where) else _of_path(Path(where).absolute())
        if not here:
            raise InputError(f"{where}: holds no recording (*{SUFFIX})")
        for recording in here:
            found.setdefault(recording.parts, recording)
    return list(found.values())


def _of_path(path: Path) -> list[StoredRecording]:
    with reading(path):
        if path.is_dir():
            return _grouped(str(path), [(str(p.relative_to(path)), part_of(p)) for p in path.rglob(f"*{SUFFIX}")])
        return [_single(path.name, part_of(path))]


def _of_url(url: str) -> list[StoredRecording]:
    if urlsplit(url).path.endswith(SUFFIX):
        place, _, name = url.rpartition("/")
        entry = ObjectStore(place).entry(name)
        if entry is None:
            raise InputError(f"{url}: there is no such object")
        return [_single(name, Part(place=place, name=name, size=entry.size, tag=entry.tag))]
    store = ObjectStore(url)
    listed = [
        (entry.name, Part(place=store.where, name=entry.name, size=entry.size, tag=entry.tag))
        for entry in store.entries()
        if entry.name.endswith(SUFFIX)
    ]
    return _grouped(store.where, listed)


def _single(label: str, part: Part) -> StoredRecording:
    return StoredRecording(where=part.where, label=label.removesuffix(SUFFIX), parts=(part,))


def _grouped(root: str, listed: list[tuple[str, Part]]) -> list[StoredRecording]:
    """Segments of one folder together, everything else alone; sorted by name."""
    alone: list[StoredRecording] = []
    segments: dict[str, list[tuple[tuple[int, int], Part]]] = {}
    for name, part in sorted(listed):
        folder, _, file = name.rpartition("/")
        asset = asset_of_folder((folder or root).rpartition("/")[2])
        moment = moment_of(file, asset)
        if moment is None:
            alone.append(_single(name, part))
        else:
            segments.setdefault(folder, []).append((moment, part))
    for folder, timed in segments.items():
        parts = tuple(part for _, part in sorted(timed, key=lambda each: each[0]))
        where = f"{root}/{folder}" if folder else root
        alone.append(StoredRecording(where=where, label=folder or root.rpartition("/")[2], parts=parts))
    return sorted(alone, key=lambda recording: recording.where)


def moment_of(file: str, asset: str) -> tuple[int, int] | None:
    """When a segment begins [ns], and its number among those that begin then; None where it is no segment's name."""
    numbered = _BY_NUMBER.fullmatch(file)
    if numbered:
        return int(numbered[1]), int(numbered[2] or 1)
    timed = _BY_TIME.fullmatch(file.removeprefix(asset)) if file.startswith(asset) else None
    if timed is None:
        return None
    try:
        seconds = datetime.strptime(timed[1], "%Y%m%dT%H%M%S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None
    return round(seconds) * NS + int(timed[2]) * 10**6, int(timed[3] or 1)
