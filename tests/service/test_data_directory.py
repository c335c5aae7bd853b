"""One service to a data directory, and a database that stays where it is."""

from __future__ import annotations

import threading
from contextlib import ExitStack

import pytest
import service_fakes as fakes

from service.errors import InputError, StorageUnavailable
from service.results import data_folder
from service.results.data_folder import only_service_of


def test_second_service_is_refused_also_where_the_lock_file_was_deleted(tmp_path):
    with only_service_of(tmp_path):
        with pytest.raises(InputError, match="another service has this data directory"), only_service_of(tmp_path):
            pass
        (tmp_path / "service.lock").unlink()
        with pytest.raises(InputError, match="another service has this data directory"), only_service_of(tmp_path):
            pass
    with only_service_of(tmp_path):
        pass


def test_roles_of_a_killed_service_that_end_within_a_moment_are_waited_for(tmp_path, monkeypatch):
    """An immediate start was refused."""
    roles = ExitStack()
    roles.enter_context(only_service_of(tmp_path))
    monkeypatch.setattr(data_folder, "ROLES_END", 0.0)
    with pytest.raises(InputError, match="another service has this data directory"), only_service_of(tmp_path):
        pass
    monkeypatch.undo()
    ends = threading.Timer(0.3, roles.close)
    ends.start()
    with only_service_of(tmp_path):
        ends.join()


def test_a_reader_whose_connection_is_new_says_of_a_file_that_is_gone_that_it_was_removed(store):
    """It said in the driver's words that no file could be opened."""
    fakes.take(store, None, "unsw", 0, 100.0)
    store.database._reader.dispose()
    store.path.rename(store.path.with_name("aside"))
    with pytest.raises(StorageUnavailable, match="removed or replaced while the service runs"):
        store.windows("unsw")


def test_database_that_is_removed_while_the_service_runs_is_noticed_and_used_again_when_it_is_back(store):
    fakes.take(store, None, "unsw", 0, 100.0)
    aside = store.path.with_name("aside")
    store.path.rename(aside)
    with pytest.raises(StorageUnavailable, match="removed or replaced while the service runs") as caught:
        fakes.take(store, None, "unsw", 1, 200.0)
    assert caught.value.reason == "input or output"
    aside.rename(store.path)
    assert fakes.take(store, None, "unsw", 1, 200.0)
    assert [w.record["index"] for w in store.windows("unsw")] == [0, 1]
