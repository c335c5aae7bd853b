"""The table of assets: what is committed is shown, whoever reads or writes meanwhile."""

from __future__ import annotations

import pytest
import service_fakes as fakes

from service.errors import StorageUnavailable
from service.results.asset_rows import put
from service.results.asset_table import AssetTable


class Overtaken:
    """A lock before which something happens, at the n-th time."""

    def __init__(self, lock, number, happens):
        self.lock, self.number, self.happens = lock, number, happens

    def __enter__(self):
        self.number -= 1
        if self.number == 0:
            self.happens()
        return self.lock.__enter__()

    def __exit__(self, *given):
        return self.lock.__exit__(*given)


@pytest.mark.parametrize("number", [1, 2])
def test_what_is_committed_while_somebody_reads_is_not_shown_as_it_was_before(store, number):
    """Whoever read meanwhile put the snapshot of before in its place, and the next window was added to that."""
    table = fakes.WrittenTable(store)
    fakes.take(store, table, "unsw", 0, 10.0)
    lock = table._lock
    table._lock = Overtaken(lock, number, lambda: fakes.take(store, table, "unsw", 1, 20.0))
    table.get("unsw")
    table._lock = lock
    assert table.latest("unsw").windows_total == len(store.windows("unsw"))


def test_what_is_committed_while_a_start_reads_is_found(store, monkeypatch):
    """The window's version was taken for that of the snapshot without it, and the list showed that for good."""
    written, read = fakes.WrittenTable(store), store.all_assets
    fakes.take(store, written, "unsw", 0, 10.0)

    def overtaken():
        found = read()
        fakes.take(store, written, "unsw", 1, 20.0)
        return found

    table = AssetTable(store)
    with monkeypatch.context() as patched:
        patched.setattr(store, "all_assets", overtaken)
        table.load()
    assert table.look() and table.latest("unsw").windows_total == 2
    table.write_noted()
    assert table.summaries()[0]["windows"] == 2


@pytest.mark.parametrize("reads", ["get", "write_noted"])
def test_who_has_read_what_another_committed_still_follows_it(store, reads):
    """A rename that the thread which receives frames had read by then was not followed: its windows waited on."""
    other, table = fakes.WrittenTable(store), fakes.WrittenTable(store)
    fakes.take(store, other, "unsw", 0, 10.0)
    table.look()
    with table.follow() as changes:
        changes.take(0)
        fakes.take(store, other, "unsw", 1, 20.0)
        if reads == "get":
            assert table.get("unsw").windows_total == 2
        else:
            table.note("unsw", quality={"level": "good"})
            changes.take(0)
            table.write_noted()
        table.look()
        assert changes.take(0) == ("unsw",)
        table.look()
        assert changes.take(0) == ()


def test_assets_are_shown_as_they_were_last_known_while_the_storage_is_away(store, monkeypatch):
    table = fakes.WrittenTable(store)
    fakes.take(store, table, "unsw", 0, 10.0)

    def away(query, values=None):
        raise StorageUnavailable("away", reason="away")

    table.changed("unsw")
    with monkeypatch.context() as patched:
        patched.setattr(store.database, "rows", away)
        assert [snapshot.windows_total for snapshot in table.every()] == [1] == [table.latest("unsw").windows_total]
        with pytest.raises(StorageUnavailable):
            table.get("unsw")
    assert fakes.take(store, None, "unsw", 1, 20.0) and table.latest("unsw").windows_total == 2


def test_a_row_that_somebody_wrote_of_an_older_snapshot_is_written_again(store):
    """A person's signature wrote the list's entry as it was before the window that had come meanwhile."""
    table = fakes.WrittenTable(store)
    fakes.take(store, table, "unsw", 0, 10.0)
    before = table.get("unsw")
    fakes.take(store, table, "unsw", 1, 20.0)
    table.write(before)
    table.renewed("unsw")
    table.write_noted()
    assert AssetTable(store).summaries()[0]["windows"] == 2


def test_a_snapshot_that_goes_on_from_an_earlier_one_is_that_which_is_read_anew(store):
    """Of windows that others have committed: a few, so many that all are read, and those of new gears."""
    fakes.campaign(store, None, windows=3)
    table = fakes.WrittenTable(store)
    assert table.get("unsw").windows_total == 3
    for index, more in ((3, 1), (4, 8), (12, 20)):
        for number in range(index, index + more):
            fakes.take(store, None, "unsw", number, 100.0 * number, updated=number == 4)
        put(store.database, [fakes.WrittenTable(store).get("unsw")])
        table.changed("unsw")
        assert table.get("unsw") == fakes.WrittenTable(store).get("unsw")
    store.keep("unsw", epoch=1)
    fakes.take(store, None, "unsw", 32, 10.0)
    put(store.database, [fakes.WrittenTable(store).get("unsw")])
    assert table.get("unsw") == fakes.WrittenTable(store).get("unsw") and table.get("unsw").windows_total == 1
