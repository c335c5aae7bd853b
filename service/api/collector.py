"""What Prometheus reads: the figures of all assets and of the process, as metrics of the catalogue and of no others.

The cost of a scrape does not depend on how long the service has run: it reads the latest state of each asset, one
query for all decisions, and counters. So many assets have metrics of their own; those beyond are one asset together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import product

from prometheus_client import CollectorRegistry, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from service.contract.alarms import LEVELS, STATES
from service.contract.finding import SEVERITY
from service.contract.status import DATA_LEVELS
from service.errors import StoreError
from service.operation.metric_catalogue import METRICS, OF_ASSETS, OTHERS, MetricEntry
from service.results.asset_table import AssetTable
from service.results.jobs import Jobs
from service.results.snapshot import Snapshot

Figure = float | Histogram | Metric | Mapping[str, float] | Mapping[tuple[str, ...], float]
"""A metric's value; by its label, or by all its labels in their order, where it has any."""

Figures = Mapping[str, Figure]
"""Values by the name of their metric in the catalogue."""

MISSING, IN_PLACE = "lost", "disorder"  # kinds of frames that are counted on their own as well


def registry(table: AssetTable, jobs: Jobs, figures: Callable[[], Figures], most: int | None) -> CollectorRegistry:
    """A registry of this app alone, that reads table and jobs when it is scraped.

    figures  of the process and of its assets, by the names of the catalogue
    most     assets that have metrics of their own; None where there are no metrics of assets
    """
    own = CollectorRegistry()
    own.register(AssetCollector(table, jobs, figures, most))
    return own


class AssetCollector(Collector):
    """The assets and the figures of the process as Prometheus metrics."""

    def __init__(self, table: AssetTable, jobs: Jobs, figures: Callable[[], Figures], most: int | None) -> None:
        self._table, self._jobs, self._figures, self._most = table, jobs, figures, most
        self._labelled: set[str] = set()  # assets with metrics of their own
        self._decisions: Mapping[str, Mapping[str, int]] = {}

    def describe(self) -> list[Metric]:
        """Nothing is collected when the registry is made."""
        return []

    def collect(self) -> Iterator[Metric]:
        """One scrape; KeyError where something is to be exported that the catalogue does not have."""
        figures = dict(self._figures())
        if self._most is not None:
            yield from self._of_assets(figures, self._most)
        for key, figure in figures.items():
            yield family_of(METRICS[key], figure)

    def _of_assets(self, figures: dict[str, Figure], most: int) -> Iterator[Metric]:
        """The metrics of the assets; what `figures` has of them is taken out there."""
        snapshots = self._table.every()
        self._choose({snapshot.asset for snapshot in snapshots}, most)
        gathered = _Gathered(self._labelled, {s.asset: s.name for s in snapshots})
        for snapshot in snapshots:
            _add_asset(gathered, snapshot)
        for name, verbs in self._decision_counts(bool(figures.get("storage_unavailable"))).items():
            for verb, count in verbs.items():
                gathered.add("decisions", (name, verb), count)
        for entry in OF_ASSETS:
            for labels, value in _by_labels(figures.pop(entry.name, {})):
                gathered.add(entry.name, labels, value)
        yield from gathered.families()
        figures["assets"] = len(snapshots)

    def _choose(self, known: set[str], most: int) -> None:
        """An asset that has metrics of its own keeps them: counters of a series never fall."""
        self._labelled &= known
        self._labelled |= set(sorted(known - self._labelled)[: max(most - len(self._labelled), 0)])

    def _decision_counts(self, unavailable: bool) -> Mapping[str, Mapping[str, int]]:
        """Of all assets; as they were last read where the storage cannot be used."""
        if not unavailable:
            with suppress(StoreError):
                self._decisions = self._jobs.decision_counts()
        return self._decisions


class _Gathered:
    """Values of assets by metric and labels, with those of assets beyond the bound added up."""

    def __init__(self, labelled: set[str], names: Mapping[str, str]) -> None:
        """names  what assets are called now"""
        self._labelled, self._names = labelled, names
        self._values: dict[str, dict[tuple[str, ...], float]] = {entry.name: {} for entry in OF_ASSETS}

    def add(self, name: str, labels: tuple[str, ...], value: float) -> None:
        """One value; the asset is the first label."""
        values = self._values[name]
        if labels[0] in self._labelled:
            values[self._names[labels[0]], *labels[1:]] = value
            return
        how, key = METRICS[name].others, (OTHERS, *labels[1:])
        if how != "none":
            before = values.get(key, 0.0)
            values[key] = max(before, value) if how == "max" else before + value

    def families(self) -> Iterator[Metric]:
        for name, values in self._values.items():
            yield family_of(METRICS[name], values)


def family_of(entry: MetricEntry, figure: Figure) -> Metric:
    """One metric as it is exported."""
    if isinstance(figure, Histogram | Metric):
        found = figure if isinstance(figure, Metric) else next(iter(figure.collect()))
        found.samples = [sample for sample in found.samples if not sample.name.endswith("_created")]
        return found
    kind = CounterMetricFamily if entry.type == "counter" else GaugeMetricFamily
    family = kind(entry.shown, entry.meaning, labels=entry.labels)
    for labels, value in _by_labels(figure):
        family.add_metric(labels, value)
    return family


def _by_labels(figure: Figure) -> Iterator[tuple[tuple[str, ...], float]]:
    if isinstance(figure, Mapping):
        for labels, value in figure.items():
            yield (labels,) if isinstance(labels, str) else labels, value
    elif not isinstance(figure, Histogram | Metric):
        yield (), figure


def _add_asset(gathered: _Gathered, snapshot: Snapshot) -> None:
    """What is shown of one asset."""
    name, whole = snapshot.asset, snapshot.whole
    for metric, levels in (("status", SEVERITY), ("data", DATA_LEVELS)):
        holds = whole[metric]["level"]
        for level in levels:
            gathered.add(metric, (name, level), float(level == holds))
    for severity, state in product(LEVELS, STATES[:-1]):
        found = sum(a["level"] == severity and a["state"] == state for a in snapshot.alarms)
        gathered.add("alarms", (name, severity, state), found)
    gathered.add("effects", (name,), len(whole["effects"]))
    gathered.add("updates", (name,), snapshot.updates)
    gathered.add("stale", (name,), float(snapshot.stale is not None))
    if snapshot.received_ns is not None:
        gathered.add("last_window_seconds", (name,), snapshot.received_ns / 1e9)
    for grade, count in whole.get("data_quality", {}).get("windows", {}).items():
        gathered.add("windows", (name, grade), count)
    _add_frames(gathered, snapshot)
    _add_figures(gathered, snapshot)


def _add_frames(gathered: _Gathered, snapshot: Snapshot) -> None:
    """The counters of every channel, and the faults of all windows."""
    name, missing, in_place = snapshot.asset, 0, 0
    for channel, kinds in snapshot.whole.get("data_quality", {}).get("channels", {}).items():
        missing += kinds.get(MISSING, 0)
        in_place += kinds.get(IN_PLACE, 0)
        for kind, count in kinds.items():
            if kind == "frames":
                gathered.add("frames", (name, channel), count)
            else:
                gathered.add("frame_faults", (name, channel, kind), count)
    gathered.add("missing_frames", (name,), missing)
    gathered.add("recovered_frames", (name,), in_place)
    faults: dict[tuple[str, str], int] = {}
    for (kind, channel, _), (count, _) in snapshot.fault_totals.items():
        faults[kind, channel] = faults.get((kind, channel), 0) + count
    for (kind, channel), count in faults.items():
        gathered.add("data_faults", (name, kind, channel), count)


def _add_figures(gathered: _Gathered, snapshot: Snapshot) -> None:
    """Wear and life, where there are any."""
    name, latest = snapshot.asset, snapshot.latest
    end = snapshot.whole["rul"].get("max_depth_um")
    if end is not None:
        gathered.add("wear_depth_limit_micrometres", (name,), end)
    for flank, band in (latest.get("depth_um") or {}).items():
        for quantile, value in _quantiles(band):
            gathered.add("wear_depth_micrometres", (name, flank, quantile), value)
    for quantile, value in _quantiles(latest.get("rul_hours") or {}):
        gathered.add("remaining_life_hours", (name, quantile), value)


def _quantiles(band: Mapping[str, float | None]) -> Iterator[tuple[str, float]]:
    for quantile, key in (("0.05", "p05"), ("0.5", "median"), ("0.95", "p95")):
        value = band.get(key)
        if value is not None:
            yield quantile, value
