"""Distributions of durations, as histograms of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from prometheus_client import Histogram

from service.operation.journey import TOTAL, Journey
from service.operation.metric_catalogue import METRICS, TIMES
from twin.observed import TRACING

NAMES = ("store_commit_seconds", "store_read_seconds", "processing_seconds", "trace_seconds", "window_delay_seconds")


def histogram(name: str) -> Histogram:
    """An empty histogram of a metric of the catalogue, in no registry."""
    entry = METRICS[name]
    return Histogram(entry.shown, entry.meaning, labelnames=entry.labels, registry=None, buckets=TIMES)


def said_figures(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures as another process can have them: a histogram as what it has collected."""
    return {name: next(iter(f.collect())) if isinstance(f, Histogram) else f for name, f in figures.items()}


class Timing:
    """How long the storage takes, and the stages of windows in the service."""

    def __init__(self) -> None:
        self._histograms = {name: histogram(name) for name in NAMES}

    def stored(self, what: str, seconds: float) -> None:
        """A transaction (`commit`) or a query (`read`) of the database has ended."""
        self._histograms[f"store_{what}_seconds"].observe(seconds)

    def computed(self, verb: str, parts: Mapping[str, float]) -> None:
        """A twin has answered; `parts` of the computation [s]."""
        for name, seconds in parts.items():
            if name == TOTAL:
                self._histograms["processing_seconds"].labels(verb).observe(seconds)
            elif name == TRACING:
                self._histograms["trace_seconds"].observe(seconds)

    def arrived(self, asset: str, index: int, grade: str, journey: Journey) -> None:
        """The results of a window are stored and shown."""
        self._histograms["window_delay_seconds"].observe(journey.delay)

    def figures(self) -> dict[str, Histogram]:
        """Figures for /metrics."""
        return dict(self._histograms)
