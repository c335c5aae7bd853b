"""Rig files that came on the stream and are not the one in use: each is a proposal until a person decides on it.

An asset has one proposal, the newest. They are kept in memory: after a restart they come again with whoever offers
them. A decision names the proposal by its digest, so that nobody accepts another one than that which was seen; what has
been rejected is not proposed again.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from service.files.rig_difference import digest_of

log = logging.getLogger(__name__)

ACCEPTED, REJECTED = "rig_accepted", "rig_rejected"  # kinds of change that decide on a proposal


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A rig file that waits for a person."""

    asset: str
    rig: Mapping[str, Any]
    digest: str
    received_ns: int  # Unix time [ns]


class ProposalList(Protocol):
    """The proposals as people see them."""

    def find(self, asset: str) -> Proposal | None: ...

    def all(self) -> list[Proposal]: ...


class RigProposals:
    """The proposals of all assets. Safe to use from several threads.

    rejected  digests of the rig files that were rejected for an asset, read when they are first needed
    """

    def __init__(
        self,
        rejected: Callable[[str], Iterable[str]] = lambda asset: (),
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._read_rejected, self._now_ns = rejected, now_ns
        self._lock = threading.Lock()
        self._proposals: dict[str, Proposal] = {}
        self._rejected: dict[str, set[str]] = {}

    def offer(self, asset: str, rig: Mapping[str, Any]) -> None:
        """A rig file has come that is not the one in use; it replaces an earlier proposal."""
        digest = digest_of(rig)
        with self._lock:
            known = self._proposals.get(asset)
            if known is not None and known.digest == digest:
                return
            if asset not in self._rejected:
                self._rejected[asset] = set(self._read_rejected(asset))
            if digest in self._rejected[asset]:
                return
            self._proposals[asset] = Proposal(asset=asset, rig=rig, digest=digest, received_ns=self._now_ns())
        log.warning(
            "%s: a rig file has come that is not the one in use: it is kept as a proposal (gear-twin assets rig)",
            asset, extra={"asset": asset},
        )  # fmt: skip

    def find(self, asset: str) -> Proposal | None:
        """The proposal of an asset."""
        return self._proposals.get(asset)

    def all(self) -> list[Proposal]:
        """The proposals of all assets."""
        with self._lock:
            return [self._proposals[asset] for asset in sorted(self._proposals)]

    def drop(self, asset: str, digest: str) -> None:
        """Ends a proposal, if it is still this one."""
        with self._lock:
            known = self._proposals.get(asset)
            if known is not None and known.digest == digest:
                del self._proposals[asset]

    def reject(self, asset: str, digest: str) -> None:
        """Ends a proposal and does not take it up again."""
        self.drop(asset, digest)
        with self._lock:
            if asset in self._rejected:
                self._rejected[asset].add(digest)

    def figures(self) -> dict[str, float]:
        """Figures for /metrics."""
        return {"rig_proposals": len(self._proposals)}
