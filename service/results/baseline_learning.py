"""A healthy baseline learned from windows of an asset whose raw signals are kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from service.errors import InputError, NotKept
from service.files.baseline import learned_from, read_baseline, save
from service.files.rig import checked_rig
from service.results.jobs import Jobs
from service.results.kept_signals import KeptSignals
from service.results.present_machine import demand_present
from service.results.sql_store import SqlStore
from twin.baseline.learned import Baseline
from twin.baseline.validity import identity_of
from twin.errors import TwinError

SOUND = ("good", "repaired")


def learn_from_windows(
    asset: str,
    indices: Sequence[int],
    store: SqlStore,
    signals: KeptSignals,
    jobs: Jobs,
    before: Path | None = None,
) -> Baseline:
    """The baseline of the chosen windows; InputError where one is not sound, or not of the machine as it is now.

    before  the file of a baseline whose recordings take part, too
    """
    rig = store.asset(asset).rig
    if rig is None:
        raise InputError(f"no rig file is known for {asset}: a baseline needs the tooth counts of its gears")
    earlier = None if before is None else _still_valid(read_baseline(before), asset, store)
    demand_present(asset, indices, jobs)
    machine, windows = checked_rig(rig, f"rig of {asset}"), []
    for index in sorted(set(indices)):
        (found,) = store.windows(asset, index - 1, 1) or (None,)
        if found is None or found.record["index"] != index:
            raise InputError(f"window {index} is none of the present gears of {asset}")
        if found.record.get("quality") not in SOUND:
            raise InputError(
                f"window {index} is {found.record.get('quality')}: a baseline is learned from sound windows"
            )
        try:
            windows.append((f"{asset}#{index}", signals.window(asset, index, machine)))
        except NotKept as error:
            raise InputError(str(error)) from None
    return learned_from(machine, windows, earlier)


def _still_valid(baseline: Baseline, asset: str, store: SqlStore) -> Baseline:
    """The baseline; InputError where a change of the machine has ended it, or a part of it."""
    state = store.asset(asset).state
    if identity_of(baseline) in ((state or {}).get("outdated") or {}).values():
        raise InputError(
            f"the baseline of {asset} was learned before the machine was changed: learn a new one in place of adding "
            "windows to it"
        )
    return baseline


def demand_same_teeth(baseline: Baseline, asset: str, store: SqlStore) -> None:
    """InputError where a baseline is of other gears than an asset."""
    rig = store.asset(asset).rig
    if rig is None:
        return
    try:
        own, other = tuple(checked_rig(rig, f"rig of {asset}").teeth), tuple(baseline.rig.teeth)
    except TwinError:
        return
    if own != other:
        raise InputError(
            f"the baseline is of gears with {other[0]} and {other[1]} teeth, {asset} has {own[0]} and {own[1]}"
        )


def written(baseline: Baseline, path: Path) -> Path:
    """The baseline as a file."""
    save(baseline, path)
    return path
