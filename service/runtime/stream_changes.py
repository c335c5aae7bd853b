"""What a change of an asset means for who receives its frames: carried out once the change has been committed.

All of it follows from the rows: a start that comes in between finds streams, rig file and place as they are.
"""

from __future__ import annotations

from collections.abc import Callable

from service.results.asset_table import AssetTable
from service.results.jobs import RIG_ACCEPTED, Job
from service.results.sql_store import SqlStore
from service.runtime.intake import Intake
from service.runtime.questions import GEARS_DIFFER, REPEATED
from service.runtime.reception import Reception
from service.runtime.routes import Routes
from service.runtime.spool import Spool


class StreamChanges:
    """Called with each job that has been carried out, with its outcome."""

    def __init__(
        self,
        reception: Reception,
        store: SqlStore,
        table: AssetTable,
        *,
        routes: Routes,
        intake: Intake,
        spool: Spool,
        retire: Callable[[str, bool], None],
    ) -> None:
        """retire  called with an asset that is retired now, or is no longer"""
        self._reception, self._store, self._table = reception, store, table
        self._routes, self._intake, self._spool, self._retire = routes, intake, spool, retire

    def __call__(self, job: Job) -> None:
        """Follows a job."""
        outcome = job.outcome or {}
        if job.kind == "other_machine":
            self._give(job.asset, outcome["asset"])
        elif job.kind == "renamed":
            self._routes.reload()
        elif job.kind in ("retired", "reinstated"):
            self._retire(job.asset, job.kind == "retired")
        elif job.kind == "ignore" and outcome["question"] == REPEATED:
            self._reception.ignore_repeats(job.asset)
        elif job.kind in ("gears_replaced", RIG_ACCEPTED) and outcome.get("question") != GEARS_DIFFER:
            self._reception.reopen(job.asset)

    def _give(self, asset: str, name: str) -> None:
        """The stream is another machine's from now on; one that repeats times that have passed begins anew."""
        fresh = self._store.shown_asset(name).assembly is None
        self._routes.reload()
        if fresh:
            self._reception.flush(asset)
        else:
            self._spool.give(asset, name)
        self._reception.split(asset, name, fresh=fresh)
        self._intake.know(name)
        self._table.renewed(name)
