"""Raw signals of windows: what is kept comes back as it was, takes no more room than it may, and survives a crash."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from segments import keep, made, segment_of
from test_segment_file import same

from service.errors import NotKept, StoreError
from service.results.segment_file import write_segment
from service.results.signal_reading import folder_in, found_in
from service.results.signal_store import SignalStore
from service.results.signal_thinning import FIRST, NEWEST, REFUSED, KeptWindow, given_up
from service.runtime.outcomes import Outcome
from service.runtime.signal_writer import SignalWriter
from twin.rig import Rig
from twin.windows import Edges, Fault, Samples, SlowValue, Window

ROOT = Path(__file__).parents[2]
START = 1_700_000_000_000_000_000


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


def outcome(number: int, **changes) -> Outcome:
    given = {
        "asset": "unsw", "index": number, "window": window(number), "record": {"revolutions": 100.0 * number},
        "state": None, "report": None, "events": (),
    }  # fmt: skip
    return Outcome(**given | changes)


def waited(folder: Path, number: int, **changes) -> Outcome:
    """A window that has been committed, with the file in which it waited."""
    file = folder / f"waited-{number}"
    write_segment(file, segment_of(window(number)))
    return outcome(number, file=file, **changes)


def test_a_window_comes_back_exactly_as_it_was_also_after_a_restart(tmp_path):
    lost = window(3)
    lost.accelerations["y6"].values[17:20] = np.nan
    keep(SignalStore(tmp_path, 2**30), "unsw", 3, lost, revolutions=4095.25)
    again = SignalStore(tmp_path, 2**30)
    assert same(made(again.segment("unsw", 3)), made(segment_of(lost)))
    (kept,) = again.kept("unsw")
    assert (kept.number, kept.start_ns, kept.revolutions) == (3, lost.start_time_ns, 4095.25)
    assert kept.bytes == sum(p.stat().st_size for p in tmp_path.rglob("*.mcap"))


def test_a_kept_window_is_made_again_with_what_its_making_took_from_the_window_before(store, tmp_path):
    signals = SignalStore(tmp_path / "signals", 2**30)
    given = window(encoders={"pinion": Edges(per_rev=64, first_index=640, times=np.arange(100) / 64)})
    for asset, counted in (("unsw", 640), ("fallen", 700)):
        keep(signals, asset, 0, given)
        store.commit(
            asset, given.start_time_ns, record={"index": 0}, state={}, report=None, 
            received_ns=1, before={"edges_counted": {"encoder/pinion": counted}},
        )  # fmt: skip
    rig = Rig.from_mapping({})
    assert "counter_reset" not in {f.kind for f in signals.window("unsw", 0, rig, store).faults}
    assert "counter_reset" in {f.kind for f in signals.window("fallen", 0, rig, store).faults}


def test_a_window_that_is_not_kept_says_which_are(tmp_path):
    store = SignalStore(tmp_path, 2**30)
    with pytest.raises(NotKept, match="none of this asset's windows are kept"):
        store.segment("unsw", 0)
    keep(store, "unsw", 4, window())
    with pytest.raises(NotKept, match=r"window 0 are not kept; kept are 4$"):
        store.segment("unsw", 0)
    (path,) = tmp_path.rglob("*.mcap")
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(NotKept, match="is damaged"):
        store.segment("unsw", 4)


def test_a_folder_that_cannot_be_used_is_one_clear_error(tmp_path):
    (tmp_path / "signals").write_text("a file")
    with pytest.raises(StoreError, match="cannot hold raw signals"):
        SignalStore(tmp_path / "signals", 2**30)


@pytest.mark.parametrize("asset", [".", "..", "a.b-c_1"])
def test_no_name_of_an_asset_leaves_the_folder(tmp_path, asset):
    store = SignalStore(tmp_path / "signals", 2**30)
    keep(store, asset, 0, window())
    assert [p.parent.parent for p in tmp_path.rglob("*.mcap")] == [tmp_path / "signals"]
    assert SignalStore(tmp_path / "signals", 2**30).indices(asset) == (0,)


APART = ("press", "Press", "PRESS", "CON", "con.1", "x.", "x", ".", "..")


def test_assets_whose_names_a_file_system_does_not_keep_apart_have_their_own_folders(share):
    store = SignalStore(share, 2**30)
    for number, asset in enumerate((*APART, *APART)):
        keep(store, asset, number, window(number))
    for opened in (store, SignalStore(share, 2**30)):
        for number, asset in enumerate(APART):
            assert opened.indices(asset) == (number, number + len(APART))
            assert found_in(folder_in(share, asset)).keys() == opened.files(asset).keys()
    names = [p.name for p in share.iterdir() if any(p.iterdir())]
    assert len({name.lower().rstrip(".") for name in names}) == len(APART) and {"press", "x"} <= set(names)
    assert found_in(folder_in(share, "pREss")) == {}


def test_where_names_are_kept_apart_each_folder_has_its_assets_name(tmp_path):
    for asset in APART[:-2]:
        assert folder_in(tmp_path, asset, make=True).name == asset == folder_in(tmp_path, asset).name


def test_nothing_is_kept_where_the_limit_is_zero(tmp_path):
    store = SignalStore(tmp_path, 0)
    assert not keep(store, "unsw", 0, window())
    assert store.indices("unsw") == ()


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


def test_the_store_deletes_what_is_given_up(tmp_path):
    store = SignalStore(tmp_path, 10**6)
    keep(store, "unsw", 0, window())
    size = store.kept("unsw")[0].bytes
    store = SignalStore(tmp_path, 30 * size)
    for number in range(1, 60):
        keep(store, "unsw", number, window(number), revolutions=float(number))
    assert sum(p.stat().st_size for p in tmp_path.rglob("*.mcap")) <= 30 * size
    assert len(list(tmp_path.rglob("*.mcap"))) == len(store.indices("unsw"))
    assert SignalStore(tmp_path, 30 * size).indices("unsw") == store.indices("unsw")


def test_a_window_that_is_kept_again_replaces_the_earlier_one(tmp_path):
    store = SignalStore(tmp_path, 2**30)
    keep(store, "unsw", 0, window(0), revolutions=1.0)
    keep(store, "unsw", 0, window(1), revolutions=2.0)
    assert len(list(tmp_path.rglob("*.mcap"))) == 1
    assert store.segment("unsw", 0).start_ns == window(1).start_time_ns


def test_a_window_without_signals_and_one_that_is_left_out_leave_no_file(tmp_path):
    store = SignalStore(tmp_path / "signals", 2**30)
    writer = SignalWriter(store)
    writer.offer(waited(tmp_path, 0, signals=False))
    writer.end()
    assert store.indices("unsw") == () and not list(tmp_path.glob("waited*"))


def test_the_writer_keeps_what_was_committed_and_marks_windows_at_which_an_effect_changed(tmp_path):
    store = SignalStore(tmp_path, 2**30)
    writer = SignalWriter(store)
    for n in range(5):
        writer.offer(waited(tmp_path, n, events=(("effect", {}),) if n == 3 else ()))
    writer.end()
    assert store.indices("unsw") == (0, 1, 2, 3, 4)
    assert [w.number for w in store.kept("unsw") if w.found] == [3]
    assert writer.figures() == {"signal_windows_waiting": 0, "signal_windows_left_out": 0}


class Blocked(SignalStore):
    """A store on a disk that does not answer until let go, or that is full."""

    def __init__(self, folder, error: OSError | None = None):
        super().__init__(folder, 2**30)
        self.go, self.error = threading.Event(), error

    def keep(self, *given, **options):
        if self.error:
            raise self.error
        self.go.wait(30)
        return super().keep(*given, **options)


def test_a_slow_disk_holds_nobody_up_and_what_is_left_out_is_counted(tmp_path):
    store = Blocked(tmp_path)
    writer = SignalWriter(store, waiting_bytes=300_000)
    begun = time.monotonic()
    for n in range(20):
        writer.offer(waited(tmp_path, n))
    assert time.monotonic() - begun < 15
    left_out = writer.figures()["signal_windows_left_out"]
    assert 0 < left_out < 20
    store.go.set()
    writer.end()
    assert len(store.indices("unsw")) == 20 - left_out


def test_a_full_disk_is_counted_and_ends_nothing(tmp_path):
    writer = SignalWriter(Blocked(tmp_path, OSError(28, "No space left on device")))
    for n in range(3):
        writer.offer(waited(tmp_path, n))
    writer.end()
    assert writer.figures() == {"signal_windows_waiting": 0, "signal_windows_left_out": 3}


WRITES = """
import sys, numpy as np
from pathlib import Path
from service.results.signal_store import SignalStore
from test_signal_store import keep, window
store = SignalStore(Path(sys.argv[1]), 2**30)
for n in range(10_000):
    keep(store, "unsw", n, window(n, 40_000))
    print(n, flush=True)
"""


@pytest.mark.slow
def test_a_killed_process_leaves_whole_windows_only(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", WRITES, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), *sys.path))},
    )  # fmt: skip
    assert process.stdout is not None
    for line in process.stdout:
        if int(line) == 5:
            break
    process.send_signal(signal.SIGKILL)
    process.wait(10)
    process.stdout.close()
    store = SignalStore(tmp_path, 2**30)
    assert set(range(6)) <= set(store.indices("unsw"))
    for number in store.indices("unsw"):
        assert same(made(store.segment("unsw", number)), made(segment_of(window(number, 40_000))))
