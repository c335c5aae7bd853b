"""One service to a data directory, and a database that stays where it is."""

from __future__ import annotations

import pytest
import service_fakes as fakes

from service.errors import InputError, StorageUnavailable
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
