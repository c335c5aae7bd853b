"""Healthy baselines of single assets: a file each, and what is said of it in the results' database.

A baseline is named by a number of its own, so that an asset can be renamed, and that a kill leaves the asset with the
earlier baseline or with the new one.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, delete, select

from service.errors import StoreError
from service.results.jobs import Jobs
from service.results.json_columns import dump, salvage
from service.results.schema import BASELINE_NUMBERS, BASELINES
from service.results.store import Tables

SUFFIX = ".baseline"


class BaselineStore:
    """The baselines of all assets."""

    def __init__(self, database: Tables, folder: Path, *, clears: bool = True) -> None:
        """clears  whether files that are no asset's baseline are deleted now"""
        self._database, self._folder = database, Path(folder)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if clears:
                self._clear()
        except OSError as error:
            raise StoreError(f"{self._folder} cannot hold baselines: {error.strerror or error}") from error

    def _clear(self) -> None:
        """Deletes the files of baselines that were replaced, or never came into use."""
        known = {name for (name,) in self._database.rows(select(BASELINES.c.file))}
        known |= {job.given.get("file") for job in Jobs(self._database).pending()}  # submitted, and not done yet
        for path in self._folder.iterdir():
            if path.name not in known:
                path.unlink(missing_ok=True)

    def transaction(self) -> AbstractContextManager[Connection]:
        """A transaction that other stores of the same database take part in."""
        return self._database.transaction()

    def new_path(self) -> Path:
        """Where a baseline is to be written before it comes into use."""
        with self._database.transaction() as db:
            number = self._database.add(db, BASELINE_NUMBERS, {})
        return self._folder / f"{number:08d}{SUFFIX}"

    def path(self, asset: str) -> Path | None:
        """The file of the asset's own baseline; None where it has none."""
        rows = self._database.rows(select(BASELINES.c.file).where(BASELINES.c.asset == asset))
        return self._folder / rows[0][0] if rows else None

    def about(self, asset: str) -> Mapping[str, Any] | None:
        """Who gave the asset its own baseline, when and from which windows; None where it has none."""
        rows = self._database.rows(select(BASELINES.c.about).where(BASELINES.c.asset == asset))
        return salvage(rows[0][0], f"what is known of the baseline of {asset}") if rows else None

    def use(self, asset: str, file: str, about: Mapping[str, Any]) -> None:
        """Gives an asset the baseline of a file that `new_path` named, in place of an earlier one."""
        with self._database.transaction() as db:
            self._database.ensure(db, asset)
            row = {"file": file, "about": dump(about)}
            db.execute(
                self._database.insert(BASELINES).on_conflict_do_update(index_elements=["asset"], set_=row),
                {"asset": asset, **row},
            )

    def remove(self, asset: str) -> None:
        """Leaves the asset without a baseline of its own."""
        with self._database.transaction() as db:
            db.execute(delete(BASELINES).where(BASELINES.c.asset == asset))

    def exists(self, file: str) -> bool:
        """Whether a file that `new_path` named has been written."""
        return (self._folder / file).exists()

    def delete(self, path: Path | None) -> None:
        """Deletes a file that is no asset's baseline any more."""
        if path is not None:
            path.unlink(missing_ok=True)
