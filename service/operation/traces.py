"""The processing stages of each window as an OpenTelemetry trace, sent by OTLP over HTTP.

Loaded only where the setting `otlp` is made. Nothing waits for the collector: what it does not take in time is left
out. The SDK's own variables (OTEL_EXPORTER_OTLP_HEADERS, OTEL_EXPORTER_OTLP_CERTIFICATE, OTEL_RESOURCE_ATTRIBUTES, …)
hold as well.
"""

from __future__ import annotations

import threading

from opentelemetry import trace
from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import Resource
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor

from service.operation.journey import Journey
from twin.observed import TRACING

PATH = "/v1/traces"  # below the collector's address
WAIT = 5.0  # for one answer of the collector [s]
END_WAIT = 2.0  # for what has not been sent at the end [s]
MOST_SPANS = 2048  # that wait to be sent

STAGES = (
    ("receive", "received_ns", "closed_ns"),  # from the newest frame until no other is waited for
    ("spool", "closed_ns", "kept_ns"),  # until the window is durable
    ("wait", "kept_ns", "started_ns"),  # for its turn and a worker
    ("process", "started_ns", "made_ns"),  # in the twin
    ("store", "made_ns", "stored_ns"),  # until its results are durable
    ("publish", "stored_ns", "published_ns"),
)
"""Name of a span, and the times of a `Journey` between which it lies."""


class Traces:
    """Sends the traces of windows to a collector.

    endpoint  its address, such as http://127.0.0.1:4318
    version   of this program
    """

    def __init__(self, endpoint: str, version: str) -> None:
        address = endpoint.rstrip("/")
        exporter = OTLPSpanExporter(
            endpoint=address if address.endswith(PATH) else address + PATH,
            timeout=WAIT,  # type: ignore[arg-type]
        )
        resource = Resource.create({"service.name": "gear-twin", "service.version": version})
        self._provider = TracerProvider(resource=resource, shutdown_on_exit=False)
        self._provider.add_span_processor(BatchSpanProcessor(exporter, max_queue_size=MOST_SPANS))
        self._tracer = self._provider.get_tracer("gear-twin")

    def arrived(self, asset: str, index: int, grade: str, journey: Journey) -> None:
        """The results of a window are stored and shown: its trace is complete."""
        known = [(name, getattr(journey, a), getattr(journey, b)) for name, a, b in STAGES]
        whole = [(name, begin, max(begin, end)) for name, begin, end in known if begin and end]
        if not whole:
            return
        root = self._tracer.start_span(
            "window",
            context=trace.Context(),
            start_time=min(begin for _, begin, _ in whole),
            attributes={"gear_twin.asset": asset, "gear_twin.window": index, "gear_twin.quality": grade},
        )
        context = trace.set_span_in_context(root)
        for name, begin, end in whole:
            span = self._tracer.start_span(name, context=context, start_time=begin)
            if name == "process" and TRACING in journey.parts:
                span.set_attribute("gear_twin.tracing_seconds", journey.parts[TRACING])
            span.end(end_time=end)
        root.end(end_time=max(end for _, _, end in whole))

    def end(self) -> None:
        """Sends what waits, as far as that takes no more than a few seconds."""
        ending = threading.Thread(target=self._provider.shutdown, name="traces", daemon=True)
        ending.start()
        ending.join(END_WAIT)
