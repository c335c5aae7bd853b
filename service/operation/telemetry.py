"""Traces of windows where the setting `otlp` is made; nothing of OpenTelemetry's SDK is loaded where it is not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from service import __version__
from service.operation.journey import Arrived, Journey, nobody


@contextmanager
def sending_traces(endpoint: str | None) -> Iterator[Arrived]:
    """What takes the processing stages of windows to a collector at an address; to nobody where there is none.

    ModuleNotFoundError where the packages of the extra `telemetry` are not installed.
    """
    if endpoint is None:
        yield nobody
        return
    from service.operation.traces import Traces

    traces = Traces(endpoint, __version__)
    try:
        yield traces.arrived
    finally:
        traces.end()


def all_of(*arrived: Arrived) -> Arrived:
    """Several who want to know the processing stages of windows, as one."""

    def each(asset: str, index: int, grade: str, journey: Journey) -> None:
        for one in arrived:
            one(asset, index, grade, journey)

    return each
