"""API keys: made once, shown once, stored as salted hashes in a file of the data directory.

A key reads `gt_ID_SECRET`. The identifier finds the entry; the secret has 256 random bits, so that one round of SHA-256
over salt and secret is enough, and comparing takes the same time whatever is given. The file is read again when it has
changed: keys that are made or revoked by the command line hold at once in a running service.
"""

from __future__ import annotations

import fcntl
import hashlib
import hmac
import json
import logging
import os
import re
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from service.access.roles import Role
from service.errors import InputError

FILE = "access-keys.json"
PREFIX = "gt_"
_KEY = re.compile(r"gt_([0-9a-f]{12})_([A-Za-z0-9_-]{43})")
NAME = re.compile(r"[^\W_][\w .@+-]{0,99}")
MOST_KEYS = 1000
_NOBODY = "0" * 64
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """What is stored of one key; times are Unix times [s]."""

    id: str
    name: str
    role: Role
    salt: str
    hash: str
    created: float
    expires: float | None = None
    revoked: float | None = None

    def holds(self, now: float) -> bool:
        return self.revoked is None and (self.expires is None or now < self.expires)

    def state(self, now: float) -> str:
        if self.revoked is not None:
            return "revoked"
        return "valid" if self.holds(now) else "expired"


class KeyStore:
    """The keys of one data directory; usable from any thread and several processes."""

    def __init__(self, folder: Path, clock: Callable[[], float] = time.time) -> None:
        self._path, self._clock = folder / FILE, clock
        self._lock = threading.Lock()
        self._version: tuple[int, int, int] | None = None
        self._keys: dict[str, Key] = {}
        self._lost = False

    def all(self) -> tuple[Key, ...]:
        """Every key, oldest first, revoked and expired ones included."""
        return tuple(self._read().values())

    @property
    def version(self) -> object:
        """What changes whenever the list does."""
        self._read()
        return self._version

    def changed(self, since: object) -> bool:
        """Whether the list has another version."""
        return self.version != since

    @property
    def configured(self) -> bool:
        """Whether there is any key. Revoking the last one does not open the service again."""
        return bool(self._read()) or self._lost

    def find(self, given: str) -> Key | None:
        """The key that holds now, or None."""
        parts = _KEY.fullmatch(given)
        known = self._read().get(parts[1]) if parts else None
        salt, expected = (known.salt, known.hash) if known else ("", _NOBODY)
        same = hmac.compare_digest(_hash(salt, parts[2] if parts else given), expected)
        return known if known is not None and same and known.holds(self._clock()) else None

    def add(self, name: str, role: Role, expires: float | None = None) -> str:
        """Makes a key; answers it, which nobody can do again."""
        if not NAME.fullmatch(name):
            raise InputError(
                f"name = {name!r} must begin with a letter or digit, and have at most 100 letters, digits, spaces or "
                "any of _ . @ + -"
            )
        with self._changing() as keys:
            if any(key.name == name and key.holds(self._clock()) for key in keys.values()):
                raise InputError(f"there is a valid key named {name!r} already; revoke it first, or take another name")
            if len(keys) >= MOST_KEYS:
                raise InputError(f"{self._path} holds {len(keys)} keys, the most there can be; remove old ones")
            identifier, secret, salt = secrets.token_hex(6), secrets.token_urlsafe(32), secrets.token_hex(16)
            keys[identifier] = Key(
                id=identifier,
                name=name,
                role=role,
                salt=salt,
                hash=_hash(salt, secret),
                created=self._clock(),
                expires=expires,
            )
        return f"{PREFIX}{identifier}_{secret}"

    def revoke(self, which: str) -> Key:
        """Revokes the valid key with this name or identifier; InputError where there is none."""
        with self._changing() as keys:
            found = [k for k in keys.values() if which in (k.id, k.name) and k.revoked is None]
            if not found:
                known = ", ".join(sorted({k.name for k in keys.values() if k.revoked is None})) or "none"
                raise InputError(f"no key {which!r} can be revoked; keys: {known}")
            for key in found:
                keys[key.id] = replace(key, revoked=self._clock())
            return keys[found[-1].id]

    def remove(self, which: str) -> Key:
        """Removes a revoked or expired key from the list."""
        with self._changing() as keys:
            found = [k for k in keys.values() if which in (k.id, k.name) and not k.holds(self._clock())]
            if not found:
                raise InputError(f"no revoked or expired key {which!r} can be removed; see `gear-twin db keys list`")
            if len(keys) == len(found):
                raise InputError("the last key stays in the list: without any, everybody on this computer might write")
            for key in found:
                del keys[key.id]
            return found[-1]

    def _read(self) -> dict[str, Key]:
        """The keys by identifier. A file that is gone or cannot be read any more lets nobody in."""
        with self._lock:
            try:
                found = self._path.stat()
                version = (found.st_mtime_ns, found.st_size, found.st_ino)
                if version != self._version:
                    self._keys = self._parsed(self._path.read_bytes())
                    self._version, self._lost = version, False
            except FileNotFoundError:
                if self._version is not None:
                    self._lose("it has been removed")
            except (InputError, OSError) as error:
                if self._version is None and not self._lost:
                    raise InputError(f"{self._path}: cannot be read: {error}") from None
                self._lose(str(error))
            return dict(self._keys)

    def _lose(self, why: str) -> None:
        if not self._lost:
            log.error("%s: no API key is accepted any more: %s", self._path, why)
        self._keys, self._lost = {}, True

    def _parsed(self, text: bytes) -> dict[str, Key]:
        try:
            entries = json.loads(text)["keys"]
            keys = [Key(**{**entry, "role": Role(entry["role"])}) for entry in entries]
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{self._path}: cannot be read as a list of API keys: {error}") from None
        return {key.id: key for key in keys}

    @contextmanager
    def _changing(self) -> Iterator[dict[str, Key]]:
        """The keys to change; written as a whole at the end, by one process at a time."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self._path.with_suffix(".lock"), os.O_CREAT | os.O_RDWR, 0o600)
        except OSError as error:
            raise InputError(f"{self._path.parent}: keys cannot be kept here: {error.strerror}") from None
        with open(descriptor, "rb+") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            keys = self._read()
            yield keys
            text = json.dumps({"keys": [asdict(key) for key in keys.values()]}, indent=1)
            fresh = self._path.with_suffix(".new")
            fresh.unlink(missing_ok=True)
            with open(os.open(fresh, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "w") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
                if os.geteuid() == 0:  # made by the administrator for a service that runs as the folder's owner
                    owner = self._path.parent.stat()
                    os.fchown(file.fileno(), owner.st_uid, owner.st_gid)
            fresh.replace(self._path)


def _hash(salt: str, secret: str) -> str:
    return hashlib.sha256(f"{salt}:{secret}".encode()).hexdigest()
