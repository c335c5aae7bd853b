"""Health and metrics: what a machine watches the service by."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from service.access.roles import Role
from service.api import models
from service.api.guard import Guarded, may_read, needs, public
from service.api.problems import problem, responses
from service.contract.alarms import LEVELS, STATES
from service.contract.base import iso_time
from service.contract.findings import SEVERITY
from service.contract.status import DATA_LEVELS
from service.results.board import Board, Snapshot
from service.results.store import ResultStore

router = APIRouter(tags=["operation"], route_class=Guarded)

TEXT: dict[int | str, dict[str, Any]] = {
    200: {"description": "Prometheus text", "content": {"text/plain": {"schema": {"type": "string"}}}}
}


@router.get("/healthz", response_model=models.Health)
@public
async def healthz() -> Any:
    """The process answers."""
    return JSONResponse({"status": "ok"})


@router.get("/readyz", response_model=models.Readiness, responses=responses(503))
@public
async def readyz(request: Request) -> Any:
    """The service is subscribed and accepts frames; assets that send none, or none of use, do not make it unready."""
    reason = request.app.state.not_ready()
    if reason:
        return problem(request, 503, reason)
    if not await may_read(request):
        return JSONResponse({"status": "ready"})
    board = request.app.state.board
    snapshots = [s for name in board.assets() if (s := board.get(name))]
    stale = [
        {"asset": s.asset, "since": iso_time(s.stale.since_ns), "reason": s.stale.reason} for s in snapshots if s.stale
    ]
    return JSONResponse({"status": "ready", "stale": stale})


@router.get("/metrics", response_class=Response, responses=TEXT)
@needs(Role.read)
def metrics(request: Request) -> Response:
    """Counters and gauges as Prometheus text. Reads the store, so it runs in a thread of its own."""
    return Response(generate_latest(request.app.state.registry), media_type=CONTENT_TYPE_LATEST)


def registry(board: Board, store: ResultStore, gauges: Callable[[], Mapping[str, float]]) -> CollectorRegistry:
    """A registry of this app alone, that reads board and store when it is scraped."""
    own = CollectorRegistry()
    own.register(BoardCollector(board, store, gauges))
    return own


class BoardCollector(Collector):
    """The board as Prometheus metrics."""

    def __init__(self, board: Board, store: ResultStore, gauges: Callable[[], Mapping[str, float]]) -> None:
        self._board, self._store, self._gauges = board, store, gauges

    def collect(self) -> Iterator[Metric]:
        snapshots = [s for name in self._board.assets() if (s := self._board.get(name))]
        yield from _health(snapshots)
        frames = CounterMetricFamily("gear_twin_frames", "Frames received", labels=("asset", "channel"))
        stream = CounterMetricFamily(
            "gear_twin_frame_faults",
            "Frames that were lost, late, double, out of order or refused",
            labels=("asset", "channel", "kind"),
        )
        windows = CounterMetricFamily("gear_twin_windows", "Windows by quality", labels=("asset", "quality"))
        faults = CounterMetricFamily(
            "gear_twin_data_faults",
            "Frames, samples or edges with a fault",
            labels=("asset", "kind", "channel"),
        )
        updates = CounterMetricFamily("gear_twin_updates", "Windows that updated the twin", labels=("asset",))
        depth = GaugeMetricFamily(
            "gear_twin_wear_depth_micrometres", "Largest depth", labels=("asset", "flank", "quantile")
        )
        limit = GaugeMetricFamily(
            "gear_twin_wear_depth_limit_micrometres", "Wear depth at the end of life", labels=("asset",)
        )
        life = GaugeMetricFamily(
            "gear_twin_remaining_life_hours", "Remaining useful life", labels=("asset", "quantile")
        )
        received = GaugeMetricFamily(
            "gear_twin_last_window_seconds", "Unix time at which the latest window was committed", labels=("asset",)
        )
        stale = GaugeMetricFamily("gear_twin_stale", "1 where no whole window has come for long", labels=("asset",))
        effects = GaugeMetricFamily("gear_twin_effects", "Effects in the model besides wear", labels=("asset",))
        decisions = CounterMetricFamily(
            "gear_twin_decisions", "Decisions on effects that were carried out", labels=("asset", "decision")
        )
        for snapshot in snapshots:
            name = snapshot.asset
            effects.add_metric((name,), len(snapshot.whole["effects"]))
            for verb, count in self._store.decision_counts(name).items():
                decisions.add_metric((name, verb), count)
            _add_frames(snapshot, frames, stream)
            for grade, count in snapshot.quality.get("windows", {}).items():
                windows.add_metric((name, grade), count)
            for (kind, channel), count in _fault_counts(snapshot).items():
                faults.add_metric((name, kind, channel), count)
            updates.add_metric((name,), snapshot.updates)
            stale.add_metric((name,), float(snapshot.stale is not None))
            if snapshot.received_ns is not None:
                received.add_metric((name,), snapshot.received_ns / 1e9)
            end = snapshot.whole["rul"].get("max_depth_um")
            if end is not None:
                limit.add_metric((name,), end)
            latest = snapshot.latest
            for flank, band in (latest.get("depth_um") or {}).items():
                for quantile, value in _quantiles(band):
                    depth.add_metric((name, flank, quantile), value)
            for quantile, value in _quantiles(latest.get("rul_hours") or {}):
                life.add_metric((name, quantile), value)
        yield from (frames, stream, windows, faults, updates, received, stale, effects, decisions, depth, limit, life)
        for key, value in self._gauges().items():
            yield GaugeMetricFamily(f"gear_twin_{key}", key.replace("_", " "), value=value)


def _health(snapshots: Sequence[Snapshot]) -> Iterator[Metric]:
    """Status and data quality, each as one gauge a level: 1 at the level that holds; and open alarms."""
    status = GaugeMetricFamily("gear_twin_status", "1 at the machine's status, 0 elsewhere", labels=("asset", "level"))
    data = GaugeMetricFamily("gear_twin_data", "1 at the quality of the data, 0 elsewhere", labels=("asset", "level"))
    for snapshot in snapshots:
        for family, key, levels in ((status, "status", SEVERITY), (data, "data", DATA_LEVELS)):
            holds = snapshot.whole[key]["level"]
            for level in levels:
                family.add_metric((snapshot.asset, level), float(level == holds))
    alarms = GaugeMetricFamily("gear_twin_alarms", "Open alarms", labels=("asset", "level", "state"))
    for snapshot in snapshots:
        for severity, state in product(LEVELS, STATES[:-1]):
            found = sum(a["level"] == severity and a["state"] == state for a in snapshot.alarms)
            alarms.add_metric((snapshot.asset, severity, state), found)
    yield from (status, data, alarms)


def _add_frames(snapshot: Snapshot, frames: CounterMetricFamily, faults: CounterMetricFamily) -> None:
    """The counters of every channel: frames taken in, and those with a fault by its kind."""
    for channel, kinds in snapshot.quality.get("channels", {}).items():
        for kind, count in kinds.items():
            if kind == "frames":
                frames.add_metric((snapshot.asset, channel), count)
            else:
                faults.add_metric((snapshot.asset, channel, kind), count)


def _fault_counts(snapshot: Snapshot) -> dict[tuple[str, str], int]:
    counts: dict[tuple[str, str], int] = {}
    for (kind, channel, _), (count, _) in snapshot.fault_totals.items():
        counts[kind, channel] = counts.get((kind, channel), 0) + count
    return counts


def _quantiles(band: Mapping[str, float | None]) -> Iterator[tuple[str, float]]:
    for quantile, key in (("0.05", "p05"), ("0.5", "median"), ("0.95", "p95")):
        value = band.get(key)
        if value is not None:
            yield quantile, value
