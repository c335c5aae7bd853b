"""Objects in a store that a URL names: S3, Google Cloud Storage, Azure, or a folder.

Credentials, region and endpoint come from the environment, by the names that the tools of each store use
(`AWS_ACCESS_KEY_ID`, `AWS_REGION`, `AWS_ENDPOINT_URL` and so on); they are never part of the URL.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from service.errors import StoreError
from service.results.store_faults import is_of_bucket, refusal, said

SCHEMES = ("s3", "s3a", "gs", "az", "abfs", "abfss", "file")
ANSWER_WAIT, CONNECT_WAIT, RETRY_WAIT = 60.0, 5.0, 20.0  # of one request, and of all its attempts together [s]
RETRIES = 3
PIECE = 4 * 2**20  # of an object that is read into a file [bytes]


def is_url(where: str) -> bool:
    """Whether this names an object store; a folder otherwise."""
    return re.match(r"[a-z0-9+.\-]+://", where) is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One object, as a listing has it.

    tag      changes with the content
    written  Unix time [s]
    """

    name: str
    size: int
    tag: str
    written: float


class ObjectStore:
    """The objects under one URL or in one folder. StoreError of all methods: it cannot be used now, or not at all."""

    def __init__(self, where: str | Path, *, make: bool = False) -> None:
        """make  whether a folder that is not there is made"""
        self.where = _without_slash(str(where)) if is_url(str(where)) else str(Path(where).absolute())
        folder = self._folder()
        with self._faults():
            if folder is None:
                self._store = _remote(self.where)
            else:
                from obstore.store import LocalStore

                if not make and not folder.is_dir():
                    raise StoreError(f"{self.where}: there is no such folder")
                self._store = LocalStore(folder, mkdir=True)
        self._local = folder

    def entries(self, under: str = "") -> Iterator[Entry]:
        """The objects under a name, in no order."""
        with self._faults():
            for page in self._store.list(under or None):
                yield from map(_entry, page)

    def entry(self, name: str) -> Entry | None:
        """One object; None where it is not there."""
        with self._faults():
            try:
                return _entry(self._store.head(name))
            except FileNotFoundError:
                return None

    def read(self, name: str) -> bytes | None:
        """What an object holds; None where it is not there."""
        with self._faults():
            try:
                return bytes(self._store.get(name).bytes())
            except FileNotFoundError as error:
                if is_of_bucket(error):
                    raise
                return None

    def read_to(self, path: Path, name: str, tag: str | None = None) -> None:
        """Writes an object to a file.

        tag  that the object must still have
        """
        from obstore.exceptions import PreconditionError

        with self._faults():
            try:
                found = self._store.get(name, options={"if_match": tag} if tag else {})
                with path.open("wb") as file:
                    for piece in found.stream(min_chunk_size=PIECE):
                        file.write(piece)
            except PreconditionError:
                raise StoreError(f"{self.where}/{name} has changed since it was listed") from None
            except FileNotFoundError as error:
                if is_of_bucket(error):
                    raise
                raise StoreError(f"{self.where}/{name} has been deleted since it was listed") from None

    def put_once(self, name: str, data: bytes) -> bool:
        """Writes an object, whole or not at all; False where another has been there before, which stays."""
        from obstore.exceptions import AlreadyExistsError

        with self._faults():
            try:
                self._store.put(name, data, mode="create")
            except AlreadyExistsError:
                if self._store.head(name)["size"]:
                    return False
                self._store.put(name, data)  # a power failure left a file without content
        self._sync(name)
        return True

    def put(self, name: str, data: bytes | Path) -> None:
        """Writes an object, whole or not at all, in place of what is there. A file is read piece by piece."""
        with self._faults():
            self._store.put(name, data)
        self._sync(name)

    def delete(self, names: Iterable[str]) -> None:
        """Deletes objects; one that is not there is none the less gone."""
        for name in names:
            with self._faults():
                try:
                    self._store.delete(name)
                except FileNotFoundError:
                    continue

    def _folder(self) -> Path | None:
        if not is_url(self.where):
            return Path(self.where)
        parts = urlsplit(self.where)
        if parts.scheme not in SCHEMES:
            named = ", ".join(f"{scheme}://" for scheme in SCHEMES)
            raise StoreError(f"{self.where}: must be a folder, or a URL that begins with one of {named}")
        if parts.scheme != "file":
            if (reason := refusal(self.where, os.environ)) is not None:
                raise StoreError(reason)
            return None
        if parts.netloc not in ("", "localhost"):
            raise StoreError(f"{self.where}: must be file:///FOLDER, with three slashes")
        return Path(unquote(parts.path))

    def _sync(self, name: str) -> None:
        """Has what was written survive a power failure, where that is up to this machine."""
        if self._local is None:
            return
        with self._faults():
            path = self._local / name
            for each in (path, path.parent):
                opened = os.open(each, os.O_RDONLY)
                try:
                    os.fsync(opened)
                finally:
                    os.close(opened)

    @contextmanager
    def _faults(self) -> Iterator[None]:
        from obstore.exceptions import BaseError

        try:
            yield
        except (BaseError, OSError) as error:
            raise StoreError(said(self.where, error)) from error
        except BaseException as error:
            if type(error).__name__ != "PanicException":  # of the library, which is no Exception
                raise
            raise StoreError(said(self.where, error)) from None


def _remote(url: str) -> Any:
    from obstore.store import from_url

    wait = {"timeout": timedelta(seconds=ANSWER_WAIT), "connect_timeout": timedelta(seconds=CONNECT_WAIT)}
    # an endpoint of http:// is one that its owner named in the environment
    retry = {"max_retries": RETRIES, "retry_timeout": timedelta(seconds=RETRY_WAIT)}
    return from_url(url, client_options={**wait, "allow_http": True}, retry_config=retry)  # type: ignore[call-overload]


def _without_slash(url: str) -> str:
    """A URL whose path does not end with a slash."""
    scheme, _, rest = url.partition("://")
    return f"{scheme}://{rest.rstrip('/')}"


def _entry(about: Any) -> Entry:
    written = about["last_modified"].timestamp()
    return Entry(name=about["path"], size=about["size"], tag=about["e_tag"] or str(written), written=written)
