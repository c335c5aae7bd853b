"""What has come from the network and waits for people is written for them, and what they have said of it is read.

Nobody who receives waits for it: the list of unknown assets is in memory, and so are rig files that are offered, until
the storage takes them.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from typing import Any

from service.files.rig_difference import digest_of
from service.results.jobs import Jobs
from service.results.offers import ASSET, RIG, Offers, Proposal
from service.results.unknown_assets import Unknown, UnknownAssets
from service.runtime.rigs import Rigs
from service.steady_clock import later_time_ns

log = logging.getLogger(__name__)

EVERY = 1.0  # [s]


class OfferWriter:
    """Called between frames: keeps the table `offers` of what is received here, where something has changed.

    It begins with what the last run has written.
    """

    def __init__(
        self,
        offers: Offers,
        jobs: Jobs,
        unknown: UnknownAssets,
        rigs: Rigs,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._offers, self._jobs, self._unknown, self._rigs, self._clock = offers, jobs, unknown, rigs, clock
        self._due = float("-inf")
        self._written: dict[str, Unknown] = offers.own()
        self._left_out = offers.left_out(own=True)  # as it was written
        unknown.restore(self._written.values())
        for proposal in offers.proposals(own=True):
            rigs.propose(proposal.asset, proposal.rig)  # where it is one still

    def __call__(self) -> None:
        """Writes what has changed, once a second at most."""
        if self._clock() < self._due:
            return
        self._due = self._clock() + EVERY
        unknown, before = self._unknown, self._written
        for name, at_ns in self._offers.dismissed().items() if before else ():
            unknown.dismiss(name, at_ns)
        present, left_out = unknown.entries(), (unknown.frames, unknown.forgotten)
        assets = [each for each in present.values() if each.dismissed_ns is None and each != before.get(each.asset)]
        gone: list[tuple[str, str]] = []
        rigs: list[Proposal] = []
        for now in assets:
            known = before.get(now.asset)
            if now.rig is not None and (known is None or known.digest != now.digest):
                rigs.append(_offer(now.asset, now.rig, now.last_ns))
        for name, known in before.items():
            left = present.get(name)
            if left is None or (known.dismissed_ns is not None and left.dismissed_ns is None):  # listed anew
                gone.append((ASSET, name))
            if known.rig is not None and (left is None or left.rig is None):
                self._rigs.proposed.setdefault(name, known.rig)  # which it is where the asset was adopted
        proposals, ended = self._judged()
        gone += [(RIG, asset) for asset in ended]
        rigs += proposals
        if assets or gone or rigs or left_out != self._left_out:
            self._offers.write(gone=gone, assets=assets, rigs=rigs, left_out=left_out)
        self._written, self._left_out = present, left_out
        self._rigs.proposed.clear()
        for proposal in proposals:
            log.warning(
                "%s: a rig file that is not the one in use is kept as a proposal (gear-twin remote assets rig)",
                proposal.asset, extra={"asset": proposal.asset},
            )  # fmt: skip

    def _judged(self) -> tuple[list[Proposal], list[str]]:
        """Of the rig files that have come for assets: those that become proposals, and of whom one is none any more."""
        proposals, ended, waiting = [], [], self._offers.digests(self._rigs.proposed)
        for asset, rig in self._rigs.proposed.items():
            offer = _offer(asset, rig, later_time_ns())
            waits = waiting.get(asset) == offer.digest
            wanted = self._rigs.wants(asset, rig) and offer.digest not in self._jobs.rejected_rigs(asset)
            if wanted and not waits:
                proposals.append(offer)
            elif waits and not wanted:
                ended.append(asset)
        return proposals, ended


def _offer(asset: str, rig: Mapping[str, Any], received_ns: int) -> Proposal:
    return Proposal(asset=asset, rig=rig, digest=digest_of(rig), received_ns=received_ns)
