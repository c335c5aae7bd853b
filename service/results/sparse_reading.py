"""Reading a few rows of a long history: the index is entered once for each row of the answer, and never walked along.

The time of an answer grows with what is asked for, not with what there is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sqlalchemy import BindParameter, ColumnElement, ScalarSelect, Select, and_, bindparam, func, literal, select, union

from service.results.schema import NUMBER, WINDOWS


def spread_numbers(which: ColumnElement[bool]) -> Select:
    """Numbers of windows above `after`, evenly spread: of each `every` from `since` on the first kept, and the newest.

    Multiples of `every` where the history has not been thinned; at least the first `most`, where there are as many.

    which  the windows in question, by leading columns of an index that ends in their number
    """
    every, most = bindparam("every", type_=NUMBER), bindparam("most", type_=NUMBER)
    first = _edge(func.min, which, WINDOWS.c.number >= bindparam("since", type_=NUMBER))
    found = select(first.label("number"), literal(1).label("step")).cte("found", recursive=True)
    next_bucket = found.c.number - found.c.number % every + every
    following = _edge(func.min, which, WINDOWS.c.number >= next_bucket, outside=found)
    found = found.union_all(
        select(following, found.c.step + 1).where(found.c.number.is_not(None), found.c.step <= most)
    )
    chosen = union(select(found.c.number), select(_edge(func.max, which))).subquery("chosen")
    return select(chosen.c.number).where(chosen.c.number > bindparam("after", type_=NUMBER))


def epochs_of(asset: BindParameter[str]) -> Select:
    """The epochs of an asset that have windows: `epoch`, `windows`, `first` and `last` number, also of thinned ones."""
    own = WINDOWS.c.asset == asset
    first = select(func.min(WINDOWS.c.epoch)).where(own).scalar_subquery()
    found = select(first.label("epoch")).cte("found_epochs", recursive=True)
    following = select(func.min(WINDOWS.c.epoch)).where(own, WINDOWS.c.epoch > found.c.epoch)
    found = found.union_all(select(following.correlate(found).scalar_subquery()).where(found.c.epoch.is_not(None)))
    of_epoch = and_(own, WINDOWS.c.epoch == found.c.epoch)
    ends = (
        select(
            found.c.epoch,
            _edge(func.min, of_epoch, outside=found).label("first"),
            _edge(func.max, of_epoch, outside=found).label("last"),
        )
        .where(found.c.epoch.is_not(None))
        .subquery("ends")
    )
    count = (ends.c.last - ends.c.first + 1).label("windows")
    return select(ends.c.epoch, count, ends.c.first, ends.c.last).order_by(ends.c.epoch)


def _edge(extreme: Callable[..., Any], *which: ColumnElement[bool], outside: Any = None) -> ScalarSelect[int]:
    """The smallest or greatest number of some windows; one look at the index."""
    query = select(extreme(WINDOWS.c.number)).where(*which)
    return (query if outside is None else query.correlate(outside)).scalar_subquery()
