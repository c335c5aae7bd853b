"""How fast the page is with 20 machines of 10,000 windows each: first view, first chart, long tasks, bytes on the wire;
and its view of signals, with the raw signals of 40 windows.

    python -m benchmarks.page [--assets N] [--windows N]

The histories are made up: their size is what matters here, not their figures. The service and the browser
(Chromium, GEAR_TWIN_CHROMIUM names it) run on this computer. The first view and chart are timed by the clock on the
wall; a task of the browser by the processor time of its thread: what it takes where nothing else runs.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import uvicorn

from benchmarks.bench_pipeline import Figure
from service.alarms.keeper import AlarmKeeper
from service.api import create_app
from service.contract.base import iso_time
from service.results.alarm_store import AlarmStore
from service.results.asset_table import AssetTable
from service.results.kept_signals import KeptSignals
from service.results.schema import WINDOWS
from service.results.segment_file import write_segment
from service.results.sql_store import SqlStore
from service.stream.frames import SampleFrame
from service.stream.pieces import Piece
from service.stream.samples import Span
from service.stream.segment import Segment
from service.stream.wire.topics import Channel

CHROMIUM = os.environ.get("GEAR_TWIN_CHROMIUM", "/usr/bin/chromium")
START_NS = 1_700_000_000_000_000_000
STEP_NS = 600_000_000_000
LIMIT_UM = 500.0
RATE, SECONDS, KEPT = 12_800.0, 10.0, 40  # of the raw signals: samples a second, length of a window, windows
LIVE = 20  # windows that come while the page is watched, ten a second
SIGNAL_VIEWS = (  # address, what is there once it is drawn, name, aim [s]
    ("window/latest/spectrum", "#signal canvas", "spectrum of a window", 2.0),
    ("window/latest/waveform", "#signal canvas", "waveform of a window", 2.0),
    ("waterfall", "canvas.waterfall[aria-label*=windows]", f"waterfall of {KEPT} windows", 5.0),  # computed first
    ("indicators", "figure.panel canvas", "trends of indicators", 2.0),
)
TASKS = ("ThreadControllerImpl::RunTask", "RunTask")


def band(value: float) -> dict[str, float]:
    return {"median": value, "p05": 0.9 * value, "p95": 1.1 * value}


def record_of(index: int, count: int) -> dict[str, Any]:
    """A window of a machine that wears to its limit in `count` windows."""
    share = index / count
    level = 5 + 40 * share + math.sin(0.7 * index)
    gears = {gear: {"fm0": 1.4, "fm4": 3.1, "na4": 0.8, "m6a": 20.0, "m8a": 190.0} for gear in ("pinion", "gear")}
    return {
        "index": index, "kind": "measurement", "start_time": iso_time(START_NS + index * STEP_NS),
        "start_time_ns": START_NS + index * STEP_NS, "revolutions": 600.0 * index, "speed_hz": 15.0, "torque_nm": 12.0,
        "rms_measured": level, "rms_predicted": 1.02 * level, "error_percent": 2.0, "updated": index % 50 == 0,
        "rms_after": level, "k_wear_per_n": 1.8e-7, "wear_depth_um": 450 * share, "quality": "good", "faults": [],
        "indicators": {"y6": {"rms": level, "kurtosis": 3.2, "crest_factor": 3.4, "gears": gears}}, "notes": [],
    }  # fmt: skip


def report_of(index: int, count: int) -> dict[str, Any]:
    """Depth, life and profile as of a window."""
    depth, hours = 450 * index / count, 100 * (1.1 - index / count)
    flank = {"radius_mm": [30 + 0.1 * i for i in range(65)], "roll_angle_deg": [5 + 0.4 * i for i in range(65)],
             "depth_um": [depth * abs(math.sin(0.1 * i)) for i in range(65)]}  # fmt: skip
    return {
        "wear": {"k_wear_per_n": 1.8e-7, "specific_wear_rate_m2_per_n": 2e-13, "method": "transmission error",
                 "max_depth_um": {"combined": band(depth), "pinion": band(0.7 * depth), "gear": band(0.3 * depth)},
                 "profile": {"path_position_mm": [0.1 * i for i in range(65)], "pinion": flank, "gear": flank}},
        "rul": {"criterion": "max_depth", "max_depth_um": LIMIT_UM, "reached": False, "hours": band(hours),
                "revolutions": band(54_000 * hours), "speed_hz": 15.0, "torque_nm": 12.0},
        "effects": [],
    }  # fmt: skip


def add(store: SqlStore, asset: str, index: int, count: int) -> tuple[Any, dict[str, Any]]:
    record, report = record_of(index, count), report_of(index, count)
    window = store.commit(
        asset, record["start_time_ns"], record=record, state={}, report=report,
        received_ns=record["start_time_ns"], events=[("window", record)],
    )  # fmt: skip
    return window, report


def fill(store: SqlStore, assets: int, windows: int) -> None:
    """The histories of all machines."""
    for number in range(assets):
        name = f"gearbox-{number:02d}"
        store.keep_rig(name, {"name": "unsw", "gears": {}, "end_of_life": {"max_depth": LIMIT_UM * 1e-6}})
        with store.database.transaction():
            for index in range(windows):
                add(store, name, index, windows)


def keep_signals(store: SqlStore, folder: Path, asset: str, windows: int) -> None:
    """The raw signals of the last windows of a machine: mesh lines and noise."""
    t, random = np.arange(int(RATE * SECONDS)) / RATE, np.random.default_rng(1)
    mesh = sum(np.cos(2 * np.pi * 285 * k * t + k) / k for k in range(1, 12))
    for index in range(windows - KEPT, windows):
        frame = SampleFrame(
            channel=Channel(asset, "accel", "y6"),
            start_time_ns=START_NS + index * STEP_NS,
            sequence=index,
            sample_rate=RATE,
            values=(mesh + 0.1 * random.standard_normal(t.size)).astype(np.float32),
        )
        span, file = Span(frame.start_time_ns, frame.end_time_ns), folder / f"{index}.mcap"
        size = write_segment(file, Segment(span=span, pieces={"accel/y6": [Piece(frame, 0, t.size)]}))
        row = WINDOWS.update().where(WINDOWS.c.asset == asset, WINDOWS.c.number == index)
        with store.database.transaction() as db:
            db.execute(row.values(segment=file.name, segment_bytes=size))


@contextmanager
def serving(board: AssetTable, store: SqlStore, signals: KeptSignals) -> Iterator[str]:
    """The service's HTTP side; yields its address."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        server = uvicorn.Server(
            uvicorn.Config(create_app(board, store, signals=signals), log_level="error", timeout_graceful_shutdown=1)
        )
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        while not server.started:
            time.sleep(0.01)
        try:
            yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        finally:
            board.close()
            server.should_exit = True
            thread.join()


def milliseconds(page: Any) -> float:
    return float(page.evaluate("performance.now()"))


def longest_task(browser: Any) -> float:
    """The longest task of a page's main thread since the tracing began [ms], in processor time; ends the tracing."""
    events = json.loads(browser.stop_tracing())["traceEvents"]
    main = {
        (e["pid"], e["tid"]) for e in events if e["name"] == "thread_name" and e["args"]["name"] == "CrRendererMain"
    }
    tasks = [e["tdur"] for e in events if e["name"] in TASKS and "tdur" in e and (e["pid"], e["tid"]) in main]
    return max(tasks) / 1e3


def on_the_wire(page: Any) -> float:
    """What the page has fetched so far [MB]."""
    sizes = "performance.getEntries().reduce((sum, e) => sum + (e.transferSize ?? 0), 0)"
    return float(page.evaluate(sizes)) / 1e6


def measure(address: str, table: AssetTable, store: SqlStore, windows: int) -> list[Figure]:
    from playwright.sync_api import sync_playwright

    figures = []

    def note(what: str, value: float, unit: str, aim: float) -> None:
        figures.append(Figure(what=what, value=value, unit=unit, aim=aim, by_the_clock=unit != "MB"))

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        browser.start_tracing(page=page, categories=["toplevel"])
        page.goto(f"{address}/")
        page.wait_for_selector(".fleet tbody tr")
        note("list of machines shown after", milliseconds(page) / 1e3, "s", 1.0)
        page.wait_for_timeout(1500)
        note("longest task, list of machines", longest_task(browser), "ms", 100.0)
        page.goto("about:blank")
        browser.start_tracing(page=page, categories=["toplevel"])
        page.goto(f"{address}/#/asset/gearbox-00")
        page.wait_for_selector("#depth canvas")
        note("first chart of a machine drawn after", milliseconds(page) / 1e3, "s", 2.0)
        page.wait_for_selector("#link[data-state=live]")
        page.wait_for_timeout(1500)
        note("longest task, a machine's view", longest_task(browser), "ms", 100.0)
        note("the page with a machine's view, on the wire", on_the_wire(page), "MB", 1.5)
        before = on_the_wire(page)
        browser.start_tracing(page=page, categories=["toplevel"])
        for index in range(windows, windows + LIVE):
            window, report = add(store, "gearbox-00", index, windows)
            last, earlier = store.last_event_id("gearbox-00"), table.latest("gearbox-00")
            assert earlier is not None
            later = replace(earlier.with_window(window), report=report, last_event_id=last).with_whole()
            table.written(later, table.write(later))
            page.wait_for_timeout(100)
        page.wait_for_selector(f"main[data-windows='{windows + LIVE}']")
        note("longest task, ten windows a second", longest_task(browser), "ms", 100.0)
        note("a window that is added, on the wire", (on_the_wire(page) - before) / LIVE, "MB", 0.05)
        for view, drawn, what, aim in SIGNAL_VIEWS:
            page.goto("about:blank")
            browser.start_tracing(page=page, categories=["toplevel"])
            page.goto(f"{address}/#/asset/gearbox-00/signals/{view}")
            page.wait_for_selector(drawn)
            note(f"{what} drawn after", milliseconds(page) / 1e3, "s", aim)
            page.wait_for_timeout(1500)
            note(f"longest task, {what}", longest_task(browser), "ms", 100.0)
        browser.close()
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page", description="Speed of the page.")
    parser.add_argument("--assets", type=int, default=20)
    parser.add_argument("--windows", type=int, default=10_000)
    chosen = parser.parse_args()
    with TemporaryDirectory() as folder, SqlStore(Path(folder) / "page.sqlite") as store:
        fill(store, chosen.assets, chosen.windows)
        segments = Path(folder) / "segments"
        segments.mkdir()
        keep_signals(store, segments, "gearbox-00", chosen.windows)
        table = AssetTable(store, AlarmKeeper(AlarmStore(store.database)), most=None)
        table.load()
        table.write_noted()
        with serving(table, store, KeptSignals(store.database, segments)) as address:
            for figure in measure(address, table, store, chosen.windows):
                print(figure.line)


if __name__ == "__main__":
    main()
