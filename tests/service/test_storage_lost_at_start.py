"""The database's server goes away while a start reads from it: the start goes on once it is back."""

from __future__ import annotations

from unittest.mock import patch

import fake_twin
import pytest
from memory_transport import MemoryNetwork
from service_streams import wait_until, write_recording
from test_other_parts import serving

from service.errors import StorageUnavailable
from service.json_text import plain
from service.results.sql_store import SqlStore
from service.runtime import storage_watch
from service.runtime.assess import assess
from service.runtime.replay import replay

WINDOWS = 2


@pytest.fixture
def quick():
    """No long pauses between attempts."""
    with patch.multiple(storage_watch, FIRST_PAUSE=0.001, LONGEST_PAUSE=0.01):
        yield


class Store:
    """A store in a file."""

    def __init__(self, path):
        self.path = path

    def open(self):
        return SqlStore(self.path)


class LosingStore(Store):
    """One whose connection is lost at each statement that reads, when it is read from for the first time."""

    def __init__(self, path):
        super().__init__(path)
        self.lost = set()

    def open(self):
        store = super().open()
        rows = store.database.rows

        def losing(query, values=None):
            if str(query) not in self.lost:
                self.lost.add(str(query))
                raise StorageUnavailable("the database cannot be used now (connection lost)", reason="connection lost")
            return rows(query, values)

        store.database.rows = store._rows = losing
        return store


@pytest.mark.slow
def test_a_connection_that_is_lost_at_any_read_of_the_start_is_waited_for(tmp_path, quick):
    """The service ended where its restart met an outage of the database's server after it had connected."""
    recording, network, path = write_recording(tmp_path / "short.mcap", WINDOWS), MemoryNetwork(), tmp_path / "sqlite"
    with serving(tmp_path, network, Store(path)) as running:
        replay(recording, (), 0, publish_to=network.open_publisher)
        before = running.wait_for_windows(WINDOWS)
    losing = LosingStore(path)
    with serving(tmp_path, network, losing) as again:
        wait_until(lambda: again.get("/readyz") is not None)
        assert len(losing.lost) > 8, losing.lost
        assert again.wait_for_windows(WINDOWS) == before == plain(assess(recording, twin=fake_twin.TWIN))["windows"]
        replay(recording, (), 0, publish_to=network.open_publisher)
        wait_until(lambda: network.inbox.depth == 0)
        assert again.wait_for_windows(WINDOWS) == before
