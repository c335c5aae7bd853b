"""Raw signals of windows: what is kept comes back as it was, takes no more room than it may, and survives a crash."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import service_fakes as fakes
from segments import in_folder, made, segment_of
from sqlalchemy import select
from test_segment_file import same

from service.errors import NotKept, StorageUnavailable, StoreError
from service.results.retention import DAY_NS, Retention, delete_old
from service.results.schema import WINDOWS
from service.results.signal_thinning import FIRST, NEWEST, REFUSED, KeptWindow, given_up
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs
from service.runtime.commits import CLEAR_EVERY, Commits, Marks
from service.runtime.outcomes import Outcome
from service.stream.window import laid_out
from twin.rig import Rig
from twin.windows import Edges, Fault, Samples, SlowValue, Window

ROOT = Path(__file__).parents[2]
START = 1_700_000_000_000_000_000
STATE = SimpleNamespace(to_dict=dict)


def window(number: int = 0, samples: int = 4000, **changes) -> Window:
    rng = np.random.default_rng(number)
    values = rng.standard_normal(samples).astype(np.float32).astype(np.float64)
    given = {
        "start_time_ns": START + number * 10**9,
        "accelerations": {"y6": Samples(rate=2000.0, start=0.0125, values=values)},
        "torques": {"pinion": Samples(rate=2000.0, start=0.0, values=10 + rng.standard_normal(samples) / 3)},
        "encoders": {"pinion": Edges(per_rev=64, first_index=2**53 + 1, times=np.cumsum(rng.random(100)) / 64)},
        "slow": {"temperature/oil": SlowValue(value=341.5, count=3, age=0.2)},
        "faults": (Fault(kind="gap", channel="accel/y6", count=3, action="repaired", detail="3 samples"),),
        "quality": "repaired",
    }
    return Window(**given | changes)


class Loop:
    """What commits windows: over a store, with a folder of segments."""

    def __init__(self, store, folder, limit=2**30, retention=None):
        self.store, self.folder = store, folder
        self.windows = WindowJobs(store.database, folder)
        self.signals = in_folder(store, folder, limit)
        table = fakes.WrittenTable(store)
        self.sink = Commits(store, table, self.windows, signals=self.signals, retention=retention)

    def waits(self, given, asset="unsw"):
        """A window that waits for its turn."""
        return self.windows.add_waiting(asset, self.windows.write(segment_of(given)))

    def outcome(self, number, given=None, asset="unsw", record=None, **changes):
        """What a window that waits leads to."""
        given = window(number) if given is None else given
        waits = self.waits(given, asset)
        about = fakes.record(number, 100.0 * number) | {"quality": given.quality} | (record or {})
        return Outcome(
            asset=asset, index=number, window=given, record=about, waited=waits, state=STATE, **changes,
        )  # fmt: skip

    def commit(self, number, given=None, asset="unsw", **changes):
        before = len(self.store.windows(asset))
        fakes.commit(self.sink, self.outcome(number, given, asset, **changes))
        return len(self.store.windows(asset)) > before

    @property
    def files(self):
        return {path.name for path in self.folder.glob("*.mcap")}

    @property
    def named(self):
        return {row[0] for row in self.store.database.rows(select(WINDOWS.c.segment)) if row[0] is not None}


@pytest.fixture
def loop(each_store, tmp_path):
    return Loop(each_store, tmp_path / "segments")


def test_a_window_comes_back_exactly_as_it_was_also_after_a_restart(loop):
    lost = window(3)
    lost.accelerations["y6"].values[17:20] = np.nan
    loop.commit(3, lost, record={"revolutions": 4095.25})
    again = Loop(loop.store, loop.folder).signals
    assert same(again.window("unsw", 3, None, laid_out), made(segment_of(lost)))
    (kept,) = again.kept("unsw")
    assert (kept.number, kept.start_ns, kept.revolutions) == (3, lost.start_time_ns, 4095.25)
    assert kept.bytes == sum(p.stat().st_size for p in loop.folder.glob("*.mcap"))


def test_the_file_in_which_a_window_waited_is_the_one_that_is_kept_and_is_never_written_again(loop):
    outcome = loop.outcome(0)
    (path,) = loop.folder.glob("*.mcap")
    before = path.stat()
    fakes.commit(loop.sink, outcome)
    assert loop.files == loop.named == {path.name} and loop.windows.waiting("unsw") == ()
    after = path.stat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


def test_a_kept_window_is_made_again_with_what_its_making_took_from_the_window_before(loop):
    given = window(encoders={"pinion": Edges(per_rev=64, first_index=640, times=np.arange(100) / 64)})
    for asset, counted in (("unsw", 640), ("fallen", 700)):
        loop.commit(0, given, asset, before={"edges_counted": {"encoder/pinion": counted}})
    rig = Rig.from_mapping({})
    assert "counter_reset" not in {f.kind for f in loop.signals.window("unsw", 0, rig).faults}
    assert "counter_reset" in {f.kind for f in loop.signals.window("fallen", 0, rig).faults}


def test_a_window_that_is_not_kept_says_which_are(loop):
    with pytest.raises(NotKept, match="none of this asset's windows are kept"):
        loop.signals.window("unsw", 0, None, laid_out)
    loop.commit(4)
    with pytest.raises(NotKept, match=r"window 0 are not kept; kept are 4$"):
        loop.signals.window("unsw", 0, None, laid_out)
    (path,) = loop.folder.glob("*.mcap")
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(NotKept, match="is damaged"):
        loop.signals.window("unsw", 4, None, laid_out)
    path.unlink()
    with pytest.raises(NotKept, match="window 4 have been deleted"):
        loop.signals.window("unsw", 4, None, laid_out)
    assert loop.signals.indices("unsw") == ()


def test_a_folder_that_cannot_be_used_is_one_clear_error(store, tmp_path):
    (tmp_path / "segments").write_text("a file")
    with pytest.raises(StoreError, match="cannot hold the segments of windows"):
        WindowJobs(store.database, tmp_path / "segments")


def test_a_window_without_signals_leaves_no_file_and_none_does_where_the_limit_is_zero(loop):
    loop.commit(0, signals=False)
    none = Loop(loop.store, loop.folder, limit=0)
    none.commit(1)
    assert loop.files == loop.named == set() and loop.signals.indices("unsw") == ()
    assert [w.record["index"] for w in loop.store.windows("unsw")] == [0, 1]


def test_windows_at_which_an_effect_changed_and_refused_ones_are_marked(loop):
    for n in range(5):
        changes = {"events": (("effect", {}),)} if n == 3 else {}
        loop.commit(n, window(n, quality="refused" if n == 4 else "good"), **changes)
    kept = loop.signals.kept("unsw")
    assert [w.number for w in kept] == [0, 1, 2, 3, 4]
    assert [w.number for w in kept if w.found] == [3] and [w.number for w in kept if w.refused] == [4]


def test_a_window_that_was_committed_before_leaves_the_file_of_the_first_attempt_alone(loop):
    loop.commit(0)
    kept = loop.files
    assert not loop.commit(1, window(0)) and loop.files == loop.named == kept
    again = loop.outcome(2)
    marks = Marks(loop.store.mark("unsw"), 7)
    for _ in range(2):  # the first without an answer
        loop.sink.commit(again, None, marks)
    assert loop.files == loop.named > kept


def test_a_transaction_that_fails_deletes_nothing(loop, monkeypatch):
    loop.commit(0)
    small = Loop(loop.store, loop.folder, limit=1)
    outcome = small.outcome(1)

    def fails(*given):
        raise StorageUnavailable("away", reason="connection lost")

    with monkeypatch.context() as patched:
        patched.setattr(small.windows, "drop_waiting", fails)
        with pytest.raises(StorageUnavailable):
            fakes.commit(small.sink, outcome)
    assert len(loop.files) == 2 and small.signals.indices("unsw") == (0,)
    fakes.commit(small.sink, outcome)
    assert loop.files == loop.named and small.signals.indices("unsw") == (1,)


def kept(number: int, **changes) -> KeptWindow:
    return KeptWindow(**{"number": number, "start_ns": number, "revolutions": 10.0 * number, "bytes": 100} | changes)


def thinned(windows, limit: int) -> list[KeptWindow]:
    held: list[KeptWindow] = []
    for w in windows:
        held.append(w)
        gone = given_up(held, limit)
        held = [h for h in held if h not in gone]
        assert sum(h.bytes for h in held) <= limit or len(held) == 1
    return held


def test_a_long_history_keeps_its_beginning_its_end_and_what_was_found_and_thins_the_rest_evenly():
    held = thinned((kept(n, found=n in (333, 777)) for n in range(2000)), 6000)
    numbers = [w.number for w in held]
    assert numbers[:FIRST] == list(range(FIRST))
    assert numbers[-NEWEST:] == list(range(2000 - NEWEST, 2000))
    assert {333, 777} <= set(numbers) and len(numbers) == 60
    steps = np.diff(numbers[FIRST - 1 : -NEWEST + 1])
    assert steps.max() <= 4 * np.median(steps)


def test_thinning_is_even_in_revolutions_not_in_windows():
    turns = [*range(0, 1000, 10), *range(1000, 101_000, 1000)]
    held = thinned((kept(n, revolutions=float(t)) for n, t in enumerate(turns)), 5000)
    middle = [w for w in held[FIRST:-NEWEST]]
    assert sum(w.revolutions > 1000 for w in middle) > 0.9 * len(middle)


def test_of_refused_windows_only_the_newest_few_are_kept():
    held = thinned((kept(n, refused=n % 2 == 0) for n in range(40)), 10**6)
    assert [w.number for w in held if w.refused] == [40 - 2 * (i + 1) for i in range(REFUSED)][::-1]
    assert sum(not w.refused for w in held) == 20


def test_the_newest_window_is_kept_however_large_it_is_and_found_ones_give_way_at_last():
    assert [w.number for w in thinned((kept(n, found=True) for n in range(100)), 1000)] == list(range(90, 100))
    assert thinned([kept(0), kept(1, bytes=10**9)], 1000) == [kept(1, bytes=10**9)]


def test_windows_without_a_revolution_count_are_thinned_by_their_number():
    held = thinned((kept(n, revolutions=None) for n in range(500)), 4000)
    steps = np.diff([w.number for w in held][FIRST - 1 : -NEWEST + 1])
    assert steps.max() <= 4 * np.median(steps)


def test_what_an_asset_takes_is_bounded_and_the_files_that_are_given_up_are_deleted(loop):
    size = loop.waits(window(), "other").bytes
    bounded, expected = Loop(loop.store, loop.folder, limit=30 * size), []
    for number in range(60):
        refused, found = number % 5 == 0, number in (11, 23)
        changes = {"events": (("effect", {}),)} if found else {}
        bounded.commit(number, window(number, quality="refused" if refused else "good"), **changes)
        newest = kept(number, revolutions=100.0 * number, bytes=size, refused=refused, found=found)
        gone = given_up([*expected, newest], 30 * size)
        expected = [w for w in (*expected, newest) if w not in gone]
    assert bounded.signals.indices("unsw") == tuple(w.number for w in expected)
    assert sum(w.bytes for w in bounded.signals.kept("unsw")) <= 30 * size
    assert loop.files == {*loop.named, *(w.file for w in loop.windows.waiting("other"))}


def test_each_asset_has_its_own_bound(loop):
    small = Loop(loop.store, loop.folder, limit=1)
    for number in range(3):
        for asset in ("press", "Press"):
            small.commit(number, asset=asset)
    assert small.signals.indices("press") == small.signals.indices("Press") == (2,)


def test_several_processes_commit_at_the_same_time_with_no_memory_of_what_is_kept(where, tmp_path):
    with SqlStore(where) as one, SqlStore(where) as other, ThreadPoolExecutor(2) as at_once:
        one_window = Loop(one, tmp_path / "segments").windows.write(segment_of(window(), "other"))
        one_window.path.unlink()
        loops = [Loop(store, tmp_path / "segments", 8 * one_window.bytes) for store in (one, other)]
        loops[0].commit(0)

        def commit_some(place):
            for number in range(1 + place, 41, 2):
                loops[place].commit(number)

        assert list(at_once.map(commit_some, (0, 1))) == [None, None]
        for each in loops:
            assert len(each.signals.kept("unsw")) == 8 and each.files == each.named


def test_whoever_does_not_see_the_files_says_that_none_are_kept(loop, tmp_path):
    loop.commit(0)
    elsewhere = in_folder(loop.store, tmp_path / "elsewhere")
    assert elsewhere.kept("unsw") == () and loop.signals.indices("unsw") == (0,)


def test_a_start_deletes_what_no_row_names_and_nothing_else(loop):
    loop.commit(0)
    waits, unnamed = loop.waits(window(1)), loop.windows.write(segment_of(window(2)))
    assert unnamed.path.name in loop.files
    again = Loop(loop.store, loop.folder)
    assert again.files == {*loop.named, waits.file} and again.signals.indices("unsw") == (0,)


def test_a_database_that_steps_back_names_files_that_are_gone_and_the_others_go_at_the_next_start(store, tmp_path):
    loop = Loop(store, tmp_path / "segments")
    loop.commit(0)
    loop.commit(1)
    with store.database.transaction() as db:
        db.execute(WINDOWS.update().where(WINDOWS.c.number == 1).values(segment="given-up.mcap"))
    again = Loop(store, loop.folder)
    assert len(again.files) == 1 and again.signals.indices("unsw") == (0,)
    with pytest.raises(NotKept, match="window 1 have been deleted"):
        again.signals.window("unsw", 1, None, laid_out)


RETENTION = Retention(whole_days=10, every=4, days=100, events=1000)


def test_the_signals_of_a_window_keep_its_row_in_a_thinned_history_and_go_with_it_at_last(each_store):
    def commit(day, segment=None):
        each_store.commit(
            "unsw", START + day * DAY_NS, record={"index": day}, state={}, report=None,
            received_ns=1, segment=segment, segment_bytes=1,
        )  # fmt: skip

    def retained(until):
        gone = []
        while delete_old(each_store.database, "unsw", RETENTION, lambda: START + until * DAY_NS, gone.append):
            pass
        return [w.record["index"] for w in each_store.windows("unsw")], gone

    for day in range(30):
        commit(day, "third.mcap" if day == 3 else None)
    assert retained(29) == ([0, 3, 4, 8, 12, 16, *range(19, 30)], [])
    commit(129)
    assert retained(129) == ([0, 129], ["third.mcap"])


def test_what_the_retention_gives_up_is_deleted(each_store, tmp_path):
    loop = Loop(each_store, tmp_path / "segments", retention=RETENTION)
    for number, day in enumerate((0, 1, 2, 200, 201)):
        loop.commit(number, window(start_time_ns=START + day * DAY_NS))
    assert loop.signals.indices("unsw") == (0, 1, 2, 3, 4)  # looked at once in a while
    again = Loop(each_store, loop.folder, retention=RETENTION)
    again.commit(5, window(start_time_ns=START + 202 * DAY_NS))  # the first after a start
    assert loop.signals.indices("unsw") == (0, 3, 4, 5) and loop.files == loop.named
    for number in range(6, CLEAR_EVERY):
        again.commit(number, window(start_time_ns=START + (397 + number) * DAY_NS))
    assert loop.signals.indices("unsw")[:4] == (0, 3, 4, 5)
    again.commit(CLEAR_EVERY, window(start_time_ns=START + 500 * DAY_NS))
    assert loop.signals.indices("unsw")[:3] == (0, 6, 7) and loop.files == loop.named


WRITES = """
import os, signal, sys
from pathlib import Path
from service.results.sql_store import SqlStore
from service.runtime import commits
from test_kept_signals import Loop, window
data, what = Path(sys.argv[1]), sys.argv[2]
if what == "deletes":
    commits.delete_file = lambda file: os.kill(os.getpid(), signal.SIGKILL)
with SqlStore(data / "twin.sqlite") as store:
    loop = Loop(store, data / "segments", limit=1 if what == "deletes" else 2**30)
    for number in range(10_000):
        loop.commit(number, window(number, 40_000))
        print(number, flush=True)
"""


def killed(data, what, after):
    """The signals that a process leaves which is killed once it has committed so many windows."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITES, str(data), what], cwd=ROOT, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), *sys.path))},
    )  # fmt: skip
    with process, process.stdout:
        for line in process.stdout:
            if int(line) == after:
                process.kill()
                break
    assert process.returncode == -signal.SIGKILL


@pytest.mark.slow
def test_a_killed_process_leaves_whole_windows_only(tmp_path):
    killed(tmp_path, "commits", after=5)
    with SqlStore(tmp_path / "twin.sqlite") as store:
        loop = Loop(store, tmp_path / "segments")
        assert set(range(6)) <= set(loop.signals.indices("unsw"))
        for number in loop.signals.indices("unsw"):
            assert same(loop.signals.window("unsw", number, None, laid_out), made(segment_of(window(number, 40_000))))


@pytest.mark.slow
def test_what_a_process_was_to_delete_that_is_killed_after_its_commit_goes_at_the_next_start(tmp_path):
    killed(tmp_path, "deletes", after=10_000)
    with SqlStore(tmp_path / "twin.sqlite") as store:
        assert len(list((tmp_path / "segments").glob("*.mcap"))) == 2
        loop = Loop(store, tmp_path / "segments")
        assert loop.signals.indices("unsw") == (1,) and loop.files == loop.named
