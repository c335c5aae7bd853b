"""What of a history is kept for how long: whole, then thinned, then not at all.

An asset's windows are aged by the start of its newest one, or by this machine's clock where that is earlier, so that
a machine that stands still loses nothing. They go in the order in which they were received: a window is old where all
before it are and one that is not before it has an old start, so that windows with a wrong time go with their
neighbours. The newest window is never deleted.

Thinned histories keep every window that updated the twin, found an effect, raised or ended an alarm, changed the
status or was refused, those whose signals are kept (which kept_signals.py bounds), and the extremes of each 256 windows
(extremes.py); the first and the last window of each epoch stay for ever. The signals of a window go with it.
Inspections, decisions, changes and open alarms are never deleted.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy import Connection, Delete, and_, bindparam, delete, func, or_, select, update

from service.results.alarm_store import MOST_HISTORY
from service.results.extremes import drop_before, is_extreme
from service.results.schema import ALARM_HISTORY, ALARMS, ASSETS, EVENTS, NUMBER, WINDOWS
from service.results.store import Tables
from service.settings import Settings

DAY_NS = 86_400 * 10**9
BATCH = 200  # rows that one transaction deletes: a window waits for it for some milliseconds
NOTABLE = 1  # a window that stays when a history is thinned ...
END_OF_EPOCH = 2  # ... and one that is never deleted


@dataclass(frozen=True, slots=True, kw_only=True)
class Retention:
    """How long what is kept."""

    whole_days: float  # windows are all kept
    every: int  # of older windows one in so many
    days: float  # and none that are older than this
    events: int  # newest events of an asset
    alarms: int = 10_000  # newest closed alarms of an asset
    history: int = MOST_HISTORY  # newest entries of one alarm

    @classmethod
    def of(cls, settings: Settings) -> Retention:
        """What the settings say."""
        return cls(
            whole_days=settings.keep_whole_days, every=settings.keep_every, days=settings.keep_days,
            events=settings.keep_events, alarms=settings.keep_alarms,
        )  # fmt: skip


STAYS = (  # a window that is committed is notable
    update(WINDOWS)
    .where(WINDOWS.c.asset == bindparam("of"), WINDOWS.c.start_ns == bindparam("at"), WINDOWS.c.notable < NOTABLE)
    .values(notable=NOTABLE)
)
_OWN = WINDOWS.c.asset == bindparam("of")
_NEWEST = select(WINDOWS.c.start_ns).where(_OWN).order_by(WINDOWS.c.number.desc()).limit(1)
_start = WINDOWS.c.start_ns + 0  # by number, not by start: the few windows in question are at one end of that index
_FIRST_YOUNG = (
    select(WINDOWS.c.number)
    .where(_OWN, _start >= bindparam("before", type_=NUMBER), _start <= bindparam("now", type_=NUMBER))
    .order_by(WINDOWS.c.number)
    .limit(1)
    .scalar_subquery()
)
_LAST_OLD = (  # no row where no start lies between the limit and now: no time can be trusted then
    select(WINDOWS.c.number)
    .where(_OWN, WINDOWS.c.number < _FIRST_YOUNG, _start < bindparam("before", type_=NUMBER))
    .order_by(WINDOWS.c.number.desc())
    .limit(1)
)
_FIRST_KEPT = select(func.coalesce(func.min(WINDOWS.c.number), 0)).where(
    WINDOWS.c.asset == bindparam("of"), WINDOWS.c.notable < END_OF_EPOCH
)
_WINDOWS = (
    select(WINDOWS.c.start_ns, WINDOWS.c.number)
    .where(_OWN, WINDOWS.c.number <= bindparam("thinned_until"), WINDOWS.c.notable < END_OF_EPOCH)
    .where(
        or_(
            WINDOWS.c.number <= bindparam("dropped_until"),
            and_(
                WINDOWS.c.notable < NOTABLE,
                WINDOWS.c.segment.is_(None),
                WINDOWS.c.number % bindparam("every", type_=NUMBER) != 0,
                ~is_extreme(),
            ),
        )
    )
    .order_by(WINDOWS.c.number)
    .limit(BATCH)
)
_OLDEST_KEPT_EVENT = (
    select(EVENTS.c.id)
    .where(EVENTS.c.asset == bindparam("of"))
    .order_by(EVENTS.c.id.desc())
    .limit(1)
    .offset(bindparam("kept"))
)
_EVENTS = (
    select(EVENTS.c.id)
    .where(EVENTS.c.asset == bindparam("of"), EVENTS.c.id <= bindparam("until"))
    .order_by(EVENTS.c.id)
    .limit(BATCH)
)
_CLOSED = select(ALARMS.c.id).where(ALARMS.c.asset == bindparam("of"), ALARMS.c.open == 0)
_OLD_ALARMS = (
    _CLOSED.where(
        ALARMS.c.id
        <= _CLOSED.order_by(ALARMS.c.id.desc()).limit(1).offset(bindparam("kept")).correlate(None).scalar_subquery()
    )
    .order_by(ALARMS.c.id)
    .limit(BATCH)
)
_LONG_HISTORIES = (
    select(ALARM_HISTORY.c.alarm)
    .join(ALARMS, ALARMS.c.id == ALARM_HISTORY.c.alarm)
    .where(ALARMS.c.asset == bindparam("of"))
    .group_by(ALARM_HISTORY.c.alarm)
    .having(func.count() > bindparam("kept"))
)
_COUNT = update(ASSETS).where(ASSETS.c.asset == bindparam("of")).values(deleted=ASSETS.c.deleted + bindparam("rows"))
_DELETED = select(func.coalesce(func.sum(ASSETS.c.deleted), 0))


def delete_old(
    database: Tables,
    asset: str,
    retention: Retention,
    clock: Callable[[], int] = time.time_ns,
    unnamed: Callable[[str], object] = lambda file: None,
) -> int:
    """Deletes at most one batch of each kind of what an asset has beyond its retention; how many rows.

    unnamed  called with the name of each file of signals that belongs to no window any more
    """
    return (
        _delete_windows(database, asset, retention, clock(), unnamed)
        + _delete_events(database, asset, retention)
        + _delete_alarms(database, asset, retention)
        + _delete_history(database, asset, retention)
    )


def _delete_windows(
    database: Tables, asset: str, retention: Retention, now: int, unnamed: Callable[[str], object]
) -> int:
    newest = database.rows(_NEWEST, {"of": asset})
    if not newest:
        return 0
    age_from = min(newest[0][0], now)

    def last_old(days: float) -> int:
        found = database.rows(_LAST_OLD, {"of": asset, "before": age_from - int(days * DAY_NS), "now": now})
        return found[0][0] if found else -1

    thinned, dropped = last_old(retention.whole_days), last_old(max(retention.days, retention.whole_days))
    given = {"of": asset, "every": retention.every, "thinned_until": thinned, "dropped_until": dropped}
    old = database.rows(_WINDOWS, given)
    if old:
        own = (WINDOWS.c.asset == asset, WINDOWS.c.start_ns.in_([row.start_ns for row in old]))
        with database.transaction() as db:
            gone = delete(WINDOWS).where(*own, WINDOWS.c.notable < END_OF_EPOCH)  # an epoch may have ended since
            files = db.execute(gone.returning(WINDOWS.c.segment)).scalars().all()
            _count(database, db, asset, len(files))
            if old[0].number <= dropped:
                drop_before(db, asset, db.execute(_FIRST_KEPT, {"of": asset}).scalar_one())
        for file in files:
            if file is not None:
                unnamed(file)
    return len(old)


def _delete_events(database: Tables, asset: str, retention: Retention) -> int:
    until = database.rows(_OLDEST_KEPT_EVENT, {"of": asset, "kept": retention.events})
    if not until:
        return 0
    old = [row[0] for row in database.rows(_EVENTS, {"of": asset, "until": until[0][0]})]
    with database.transaction() as db:
        _delete(database, db, asset, delete(EVENTS).where(EVENTS.c.id.in_(old)))
    return len(old)


def _delete_alarms(database: Tables, asset: str, retention: Retention) -> int:
    old = [row[0] for row in database.rows(_OLD_ALARMS, {"of": asset, "kept": retention.alarms})]
    if old:
        with database.transaction() as db:
            db.execute(delete(ALARM_HISTORY).where(ALARM_HISTORY.c.alarm.in_(old)))
            _delete(database, db, asset, delete(ALARMS).where(ALARMS.c.id.in_(old)))
    return len(old)


def _delete_history(database: Tables, asset: str, retention: Retention) -> int:
    count = 0
    for (alarm,) in database.rows(_LONG_HISTORIES, {"of": asset, "kept": retention.history}):
        own = select(ALARM_HISTORY.c.id).where(ALARM_HISTORY.c.alarm == alarm)
        old = [row[0] for row in database.rows(own.order_by(ALARM_HISTORY.c.id.desc()).offset(retention.history))]
        with database.transaction() as db:
            _delete(database, db, asset, delete(ALARM_HISTORY).where(ALARM_HISTORY.c.id.in_(old[-BATCH:])))
        count += len(old[-BATCH:])
    return count


def deleted_of(database: Tables) -> int:
    """How many rows of all assets have been deleted."""
    return int(database.rows(_DELETED)[0][0])


def _delete(database: Tables, db: Connection, asset: str, rows: Delete) -> None:
    _count(database, db, asset, db.execute(rows).rowcount)


def _count(database: Tables, db: Connection, asset: str, rows: int) -> None:
    database.ensure(db, asset)
    db.execute(_COUNT, {"of": asset, "rows": rows})
