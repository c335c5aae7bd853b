"""The folder of segments is the one that the database knows: where another is found in its place, nothing is lost."""

from __future__ import annotations

import threading

import pytest
import service_fakes as fakes

from service.errors import StorageUnavailable, StoreError
from service.results.window_jobs import KNOWN_BY, WindowJobs


@pytest.fixture
def windows(each_store, tmp_path):
    """One window waits."""
    made = WindowJobs(each_store.database, tmp_path / "segments")
    made.add_waiting("unsw", made.write(fakes.SEGMENT), {})
    return made


@pytest.mark.parametrize("other", ["missing", "empty", "of another database"])
def test_another_folder_is_refused_and_the_windows_of_the_right_one_wait_on(windows, tmp_path, other):
    """That of a disk which is not mounted: its windows were once taken for lost, and the rows were deleted."""
    folder = tmp_path / "other"
    if other != "missing":
        folder.mkdir()
    if other == "of another database":
        (folder / KNOWN_BY).write_text("another")
    for _ in range(2):
        with pytest.raises(StorageUnavailable, match="is its disk mounted") as refused:
            WindowJobs(windows.database, folder)
    again = WindowJobs(windows.database, windows.folder)
    again.step_back()
    assert len(again.waiting("unsw")) == 1 and refused.value.reason == "input or output"


def test_a_folder_that_is_lost_for_good_is_made_anew_as_the_message_says(windows, tmp_path):
    folder = tmp_path / "new"
    with pytest.raises(StorageUnavailable) as refused:
        WindowJobs(windows.database, folder)
    folder.mkdir()
    (folder / KNOWN_BY).write_text(str(refused.value).split(" with the text ")[1].split()[0])
    again = WindowJobs(windows.database, folder)
    again.step_back()
    assert again.waiting("unsw") == ()


def test_all_that_begin_at_the_same_time_find_one_folder(each_store, tmp_path):
    failed, together = [], threading.Barrier(4)

    def begin():
        together.wait()
        try:
            WindowJobs(each_store.database, tmp_path / "segments")
        except Exception as error:
            failed.append(error)

    threads = [threading.Thread(target=begin) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []


def test_an_id_that_was_being_written_when_its_process_was_killed_is_written_anew(each_store, tmp_path):
    (tmp_path / "segments").mkdir()
    (tmp_path / "segments" / KNOWN_BY).touch()
    WindowJobs(each_store.database, tmp_path / "segments")
    WindowJobs(each_store.database, tmp_path / "segments")


def test_a_file_in_place_of_the_folder_is_one_clear_line(each_store, tmp_path):
    (tmp_path / "segments").touch()
    with pytest.raises(StoreError, match="cannot hold the segments of windows"):
        WindowJobs(each_store.database, tmp_path / "segments")
