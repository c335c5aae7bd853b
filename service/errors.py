"""What can go wrong at the edges.

ServiceError
├── InputError   something handed in that cannot be used: what, where, what would be right (exit status 2)
│   ├── FrameError   one frame that breaks the contract: topic, field, value, allowed range
│   ├── InputErrors  several of them, a line each
│   └── StoreError   a database, or a state in it, that cannot be used: which, and why
│       ├── DamageError          something kept that is not what was written: which row
│       ├── NewerTables          tables that a newer program wrote: this one changes nothing in them
│       └── StorageUnavailable   storage that fails now and may work again later: full, read-only, locked, not connected
│           └── SteppedBack      a database without what it had confirmed: a new start goes on from there (status 1)
├── NotKept      raw signals that are not on disk, or not any more: which window, and which are
└── DeliveryError    a stream that could not be delivered or joined in time
    └── NotReachable     the other side does not answer yet; it may later
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, Literal

StorageFault = Literal["no space", "read-only", "locked", "connection lost", "input or output", "damaged"]
"""What keeps storage from being used: `locked` also where it did not answer in time, `damaged` where one asset's state
has to be brought back from a backup before its windows can be kept."""


class ServiceError(Exception):
    """Base of every error that the service raises on purpose."""


class InputError(ServiceError):
    """Input that cannot be used."""


class NameTaken(InputError):
    """A name that an asset has, or had: no other asset begins under it."""


class FrameError(InputError):
    """A frame outside the contract's limits."""


class InputErrors(InputError):
    """Several mistakes, each one line."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("; ".join(lines))
        self.lines = tuple(lines)


class StoreError(InputError):
    """Stored results that cannot be used."""


class DamageError(StoreError):
    """Something kept is not what was written."""


class NewerTables(StoreError):
    """Tables that a newer program wrote: this one changes nothing in them."""


class StorageUnavailable(StoreError):
    """Storage that cannot be used now, and may be later without anyone touching the service.

    reason   why, in two words: a `StorageFault`
    unknown  whether the transaction may have been committed all the same; otherwise nothing was changed
    """

    def __init__(self, message: str, *, reason: StorageFault, unknown: bool = False) -> None:
        super().__init__(message)
        self.reason, self.unknown = reason, unknown

    def __reduce__(self) -> tuple[Any, ...]:
        """Worker processes send it."""
        return partial(type(self), reason=self.reason, unknown=self.unknown), self.args


class SteppedBack(StorageUnavailable):
    """A database that does not have what it had confirmed to this process, which remembers more than is there."""


class NotKept(ServiceError):
    """Raw signals of a window that is not kept."""


class DeliveryError(ServiceError):
    """Frames that could not be handed over."""


class NotReachable(DeliveryError):
    """No one answers at the other end; trying again later may succeed."""


FAULT = "internal error"
"""How the reason begins where not the input was wrong but the program."""
