"""Which part of a healthy baseline still holds after changes of the machine.

A baseline of earlier gears, or of gears put together otherwise, says nothing of the present ones; one learned with an
accelerometer at another place says nothing of that accelerometer.
"""

from __future__ import annotations

from collections.abc import Mapping

from twin.baseline.learned import Baseline, without_channels
from twin.errors import NotAvailable

WHOLE = "all"  # in place of a channel: the whole baseline


def identity_of(baseline: Baseline) -> str:
    """What a baseline is recognised by: the recordings that it was learned from."""
    starts = [r.start_time_ns for r in baseline.readings]
    return f"{len(starts)} recordings, {min(starts)} to {max(starts)}"


def valid_part(baseline: Baseline, outdated: Mapping[str, str]) -> Baseline:
    """The baseline without channels that were moved since it was learned; NotAvailable where nothing is left of it.

    outdated  channel, or WHOLE, to the identity of the baseline that no longer holds for it
    """
    own = identity_of(baseline)
    gone = [name for name, identity in outdated.items() if identity == own]
    if WHOLE in gone:
        raise NotAvailable(
            "the gears were replaced or reassembled after this healthy baseline was learned: learn it again from "
            "recordings of the machine as it is now"
        )
    left = without_channels(baseline, gone)
    if left is None:
        raise NotAvailable(
            f"{', '.join(sorted(gone))} was moved after this healthy baseline was learned: learn it again from "
            "recordings of the machine as it is now"
        )
    return left
