"""What a failure of the database's driver means: storage that may work again later, or a database that is damaged.

The drivers are not imported: SQLite's errors carry `sqlite_errorcode`, those of PostgreSQL `sqlstate`.
"""

from __future__ import annotations

import errno

from service.errors import StorageFault, StorageUnavailable, StoreError

SQLITE_FAULTS: dict[int, StorageFault] = {
    5: "locked",  # SQLITE_BUSY
    6: "locked",  # SQLITE_LOCKED
    8: "read-only",  # SQLITE_READONLY
    10: "input or output",  # SQLITE_IOERR
    13: "no space",  # SQLITE_FULL
    14: "input or output",  # SQLITE_CANTOPEN: a folder or file that is gone, or may not be opened
    15: "locked",  # SQLITE_PROTOCOL
}
"""Primary result codes of SQLite after which a later try may succeed."""

SQLITE_DAMAGED = (1, 11, 26)  # SQLITE_ERROR (tables that are missing), SQLITE_CORRUPT, SQLITE_NOTADB

POSTGRESQL_FAULTS: dict[str, StorageFault] = {
    "53100": "no space",
    "25006": "read-only",
    "55P03": "locked",
    "57014": "locked",  # a statement that took longer than it may
    "40P01": "locked",
    "40001": "locked",
    "58030": "input or output",
    "53": "connection lost",  # too many connections, out of memory
    "57P": "connection lost",  # the server stops, or starts
    "08": "connection lost",
}
"""Beginnings of SQLSTATE after which a later try may succeed."""

POSTGRESQL_DAMAGED = ("XX001", "XX002", "42P01", "42703")  # data or index damaged; a table or a column missing

OS_FAULTS: dict[int, StorageFault] = {
    errno.ENOSPC: "no space",
    errno.EDQUOT: "no space",
    errno.EFBIG: "no space",
    errno.EROFS: "read-only",
    errno.EACCES: "read-only",
    errno.EPERM: "read-only",
}
"""Failures of the operating system after which a later try may succeed; every other one is `input or output`."""


def storage_error(error: BaseException, where: str, *, lost: bool = False) -> StoreError | None:
    """What an error of a database's driver, or of the operating system, means; None where the program is at fault.

    where  the database, as a person knows it
    lost   whether the connection is of no more use
    """
    reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    fault, damaged = _meaning(error)
    if lost and fault is None and not damaged:
        fault = "connection lost"
    if fault is not None:
        return StorageUnavailable(f"{where} cannot be used now ({fault}): {reason}", reason=fault)
    if damaged:
        return StoreError(f"{where} is damaged: {reason}")
    return None


def _meaning(error: BaseException) -> tuple[StorageFault | None, bool]:
    """Why a later try may succeed, if so; and whether the database is damaged."""
    if isinstance(error, OSError):
        return OS_FAULTS.get(error.errno or 0, "input or output"), False
    code = getattr(error, "sqlite_errorcode", None)
    if code is not None:
        return SQLITE_FAULTS.get(code & 0xFF), code & 0xFF in SQLITE_DAMAGED
    if type(error).__module__ == "sqlite3":  # a value that is not what its column holds
        return None, "decode" in str(error)
    if not hasattr(error, "sqlstate"):
        return None, False
    state = error.sqlstate
    if state is None:  # of the connection itself, before the server could say anything
        lost = any(kind.__name__ == "OperationalError" for kind in type(error).__mro__)
        return ("connection lost" if lost else None), False
    fault = next((POSTGRESQL_FAULTS[state[:n]] for n in (5, 3, 2) if state[:n] in POSTGRESQL_FAULTS), None)
    return fault, state in POSTGRESQL_DAMAGED


def is_away(error: BaseException) -> bool:
    """Whether the database's server does not answer now."""
    return isinstance(error, StorageUnavailable) and error.reason == "connection lost"
