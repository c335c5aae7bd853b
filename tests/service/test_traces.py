"""OpenTelemetry: each window's way is a trace at the collector; nothing is loaded, and nobody waits, without one."""

from __future__ import annotations

import gzip
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from service_streams import ROOT, service, wait_until, write_recording

from service.operation.journey import Journey
from service.runtime.replay import replay

pytest.importorskip("opentelemetry.sdk")
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest

from service.operation.traces import STAGES, Traces

NS = 10**9


@pytest.fixture
def collector():
    """A collector on this computer: its address, and the spans that it was sent."""

    class Collector(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            if self.headers.get("Content-Encoding") == "gzip":
                body = gzip.decompress(body)
            request = ExportTraceServiceRequest.FromString(body)
            for each in request.resource_spans:
                named = {a.key: a.value.string_value for a in each.resource.attributes}
                assert named["service.name"] == "gear-twin" and self.path == "/v1/traces"
                spans.extend(span for scope in each.scope_spans for span in scope.spans)
            self.send_response(200)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_):
            pass

    spans = []
    server = ThreadingHTTPServer(("127.0.0.1", 0), Collector)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", spans
    server.shutdown()
    server.server_close()


def journey(**changed):
    times = ("received", "closed", "kept", "started", "made", "stored", "published")
    found = Journey(**{f"{name}_ns": (100 + n) * NS for n, name in enumerate(times)}, parts={"tracing": 0.5})
    for name, value in changed.items():
        setattr(found, name, value)
    return found


def test_window_is_one_trace_whose_parts_follow_one_another(collector):
    address, spans = collector
    traces = Traces(address, "0")
    traces.arrived("unsw", 7, "good", journey())
    traces.end()
    by_name = {span.name: span for span in spans}
    root = by_name.pop("window")
    assert list(by_name) == [name for name, _, _ in STAGES]
    assert {a.key: a.value.string_value or a.value.int_value for a in root.attributes} == {
        "gear_twin.asset": "unsw", "gear_twin.window": 7, "gear_twin.quality": "good",
    }  # fmt: skip
    assert all(span.trace_id == root.trace_id and span.parent_span_id == root.span_id for span in by_name.values())
    assert root.start_time_unix_nano == by_name["receive"].start_time_unix_nano == 100 * NS
    assert root.end_time_unix_nano == by_name["publish"].end_time_unix_nano == 106 * NS
    assert [a.value.double_value for a in by_name["process"].attributes] == [0.5]


def test_window_that_waited_over_a_restart_has_the_parts_that_are_known(collector):
    address, spans = collector
    traces = Traces(address, "0")
    traces.arrived("unsw", 7, "good", journey(received_ns=0, kept_ns=0))
    traces.end()
    assert [span.name for span in spans] == ["process", "store", "publish", "window"]


@pytest.mark.slow
def test_collector_that_does_not_answer_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(
        "service.operation.traces.WAIT", 0.5
    )  # its thread ends soon after, and leaves no lines to others
    traces, began = Traces("http://127.0.0.1:1", "0"), time.monotonic()
    for index in range(1000):
        traces.arrived("unsw", index, "good", journey())
    traces.end()
    assert time.monotonic() - began < 250.0  # half of what 1000 answers would be waited for
    for thread in threading.enumerate():
        if thread.name == "traces":
            thread.join(30.0)


@pytest.mark.slow
def test_service_sends_the_way_of_each_window_and_ends_in_time(tmp_path, collector):
    address, spans = collector
    recording = write_recording(tmp_path / "short.mcap", 3)
    with service(tmp_path / "data", OTLP=address) as running:
        replay(recording, [running.endpoint], 0)
        wait_until(lambda: len(running.windows()) == 3, 20.0)
        status, _, complained = running.end()
        assert status == 0 and not complained
    numbers = [a.value.int_value for s in spans if s.name == "window" for a in s.attributes if "window" in a.key]
    assert sorted(numbers) == [0, 1, 2]
    assert {span.name for span in spans} == {"window", *(name for name, _, _ in STAGES)}


@pytest.mark.slow
def test_lack_of_opentelemetry_is_one_line_where_it_is_set(tmp_path):
    """That nothing of it is loaded where it is not set: test_optional_packages.py."""
    missing = (
        "import sys; sys.modules['opentelemetry.sdk'] = sys.modules['opentelemetry.exporter'] = None; "
        "from service.cli import run; sys.exit(run(sys.argv[1:]))"
    )
    arguments = ["serve", "--data", str(tmp_path), "--http", "127.0.0.1:0", "--listen", "tcp/127.0.0.1:0"]
    environment = {"PYTHONPATH": str(Path(ROOT)), "GEAR_TWIN_OTLP": "http://127.0.0.1:4318", "PATH": "/usr/bin"}
    done = subprocess.run(
        [sys.executable, "-c", missing, *arguments], env=environment, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert "opentelemetry" in done.stderr and "gear-twin[telemetry]" in done.stderr
