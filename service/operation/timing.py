"""Distributions of durations, as histograms of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping

from prometheus_client import Histogram

from service.operation.journey import TOTAL, Journey
from service.operation.metric_catalogue import METRICS, TIMES
from twin.observed import TRACING


def histogram(name: str) -> Histogram:
    """An empty histogram of a metric of the catalogue, in no registry."""
    entry = METRICS[name]
    return Histogram(entry.shown, entry.meaning, labelnames=entry.labels, registry=None, buckets=TIMES)


class Timing:
    """How long the storage takes, and the stages of windows in the service."""

    def __init__(self) -> None:
        self.commit, self.read = histogram("store_commit_seconds"), histogram("store_read_seconds")
        self.processing, self.tracing = histogram("processing_seconds"), histogram("trace_seconds")
        self.delay = histogram("window_delay_seconds")

    def stored(self, what: str, seconds: float) -> None:
        """A transaction (`commit`) or a query (`read`) of the database has ended."""
        (self.commit if what == "commit" else self.read).observe(seconds)

    def computed(self, verb: str, parts: Mapping[str, float]) -> None:
        """A twin has answered; `parts` of the computation [s]."""
        for name, seconds in parts.items():
            if name == TOTAL:
                self.processing.labels(verb).observe(seconds)
            elif name == TRACING:
                self.tracing.observe(seconds)

    def arrived(self, asset: str, index: int, grade: str, journey: Journey) -> None:
        """The results of a window are stored and shown."""
        self.delay.observe(journey.delay)

    def figures(self) -> dict[str, Histogram]:
        """Figures for /metrics."""
        return {
            "store_commit_seconds": self.commit,
            "store_read_seconds": self.read,
            "processing_seconds": self.processing,
            "trace_seconds": self.tracing,
            "window_delay_seconds": self.delay,
        }
