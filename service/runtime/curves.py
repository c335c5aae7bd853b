"""Wear curves on their way between the processes that compute: each is computed once, wherever its asset goes on.

A curve is named by what it was made from, and kept as compressed points. Whoever needs one that it does not have looks
for it by name where they are kept; where none is found, it is computed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from hashlib import blake2b
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from zipfile import BadZipFile

import numpy as np
import zstandard

import twin
from service.errors import InputError
from twin.errors import ParameterError

if TYPE_CHECKING:  # loads the twin's equations, which only those do who compute
    from twin.updating.model_cache import PathKey
    from twin.wear.kept_points import KeptPoints
    from twin.wear.path import WearPath

log = logging.getLogger(__name__)

LEAST_POINTS = 8  # of a curve that is kept: shorter ones are computed as fast
GROWN = 1.25  # times as many points as were kept last, before a curve is kept again
MOST_BYTES = 48 * 2**20  # of a curve that is kept, compressed
LEVEL = 1  # of the compression
SOURCES = ("*.py", "*.c", "*.h")  # the equations that a curve was computed by


class CurveStore(Protocol):
    """Where curves are kept; can be handed to another process."""

    def read(self, asset: str, name: str) -> bytes | None:
        """A curve by its name, compressed; None where there is none, or it cannot be read."""
        ...

    def keep(self, asset: str, curves: Curves) -> None:
        """Keeps an asset's new curves, and deletes those that it no longer uses; as far as that is possible now."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """An asset's present curves.

    names  of all that are long enough to be kept
    new    those that have been computed since the last time: name and compressed points
    """

    names: frozenset[str]
    new: tuple[tuple[str, bytes], ...]


class WorkerCurves:
    """The curves of one process that computes.

    store  where others find them; None for nowhere
    """

    def __init__(self, store: CurveStore | None) -> None:
        self._store, self._asset = store, ""
        self._kept: dict[str, dict[PathKey, int]] = {}  # by asset and key: how many points have been kept

    def at(self, asset: str | None, curves_of: Callable[[str], Mapping[PathKey, WearPath]]) -> None:
        """An asset is worked on from now on, whose curves are read; or none any more, and its new ones are kept.

        curves_of  those of an asset that are at hand
        """
        if self._store is None:
            return
        from twin.updating.model_cache import PATHS

        if asset is not None:
            self._asset, PATHS.known = asset, self._known
            return
        PATHS.known = lambda key: None
        new = self._new_of(self._asset, curves_of(self._asset))
        if new is not None:
            self._store.keep(self._asset, new)

    def _known(self, key: PathKey) -> KeptPoints | None:
        """A curve that this process lacks."""
        assert self._store is not None
        packed = None if not key.furthest else self._store.read(self._asset, name_of(key))
        if packed is None:
            return None
        try:
            points = unpacked(packed)
        except InputError as error:
            log.warning("a wear curve that was kept cannot be read, and is computed again: %s", error)
            return None
        self._kept.setdefault(self._asset, {})[key] = len(points.depth)
        return points

    def _new_of(self, asset: str, curves: Mapping[PathKey, WearPath]) -> Curves | None:
        """What is to be kept of an asset's curves; None where nothing is new."""
        points = {key: len(path.points[0]) for key, path in curves.items()}
        before = self._kept.get(asset, {})
        long = {key: count for key, count in points.items() if count >= LEAST_POINTS}
        due = {key for key, count in long.items() if count >= GROWN * before.get(key, 1)}
        if not due:
            return None
        data = {key: packed(curves[key].kept) for key in due}
        self._kept[asset] = {key: count if key in due else before[key] for key, count in long.items()}
        new = tuple((name_of(key), one) for key, one in data.items() if len(one) <= MOST_BYTES)
        return Curves(names=frozenset(name_of(key) for key in long), new=new)


def packed(points: KeptPoints) -> bytes:
    """Points as compressed bytes, exact."""
    made = BytesIO()
    np.savez(made, allow_pickle=False, **{f.name: np.asarray(getattr(points, f.name)) for f in fields(points)})
    return zstandard.ZstdCompressor(LEVEL).compress(made.getvalue())


def unpacked(data: bytes) -> KeptPoints:
    """Points from what `packed` gave; InputError for anything else."""
    from twin.wear.kept_points import KeptPoints

    try:
        with np.load(BytesIO(zstandard.ZstdDecompressor().decompress(data)), allow_pickle=False) as read:
            given: dict[str, Any] = {f.name: read[f.name] for f in fields(KeptPoints)}
        return KeptPoints(**given | {name: bool(given[name]) for name in ("ended", "converged")})
    except (ValueError, KeyError, OSError, EOFError, BadZipFile, ParameterError, zstandard.ZstdError) as error:
        raise InputError(f"these are no points of a wear path: {error}") from error


def name_of(key: PathKey) -> str:
    """The name of the curve of a key, by the present equations."""
    return blake2b(key.text, key=_equations(), digest_size=16).hexdigest()


@cache
def _equations() -> bytes:
    """The same for programs with the same equations alone: of all source files of the twin."""
    root, found = Path(twin.__file__).parent, blake2b(digest_size=16)
    for path in sorted(path for kind in SOURCES for path in root.rglob(kind)):
        found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return found.digest()
