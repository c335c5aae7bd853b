"""Attacks over HTTP, each against a real server: it answers, forgets, or closes, and others are served meanwhile."""

from __future__ import annotations

import asyncio
import itertools
import json
import os
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import httpx
import pytest
import service_fakes as fakes
from http_front import WRITE, front
from service_streams import ROOT, wait_until

from service.access.access import Access
from service.access.roles import Role
from service.api import create_app
from service.api.limits import Limits
from service.runtime.http_gate import Gate
from service.runtime.http_protocol import Times


def said(port, text, wait=5.0):
    """What is answered to raw bytes, until the server closes or falls silent."""
    with socket.create_connection(("127.0.0.1", port), wait) as caller:
        caller.sendall(text if isinstance(text, bytes) else text.encode())
        return received(caller)


def received(caller):
    found = b""
    try:
        while part := caller.recv(65536):
            found += part
            if b"\r\n\r\n" in found and b"content-length: 0" in found.lower():
                break
    except (TimeoutError, ConnectionResetError):
        pass
    return found.decode(errors="replace")


def healthy(port):
    return httpx.get(f"http://127.0.0.1:{port}/healthz", timeout=5).status_code == 200


# -- names ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "status"),
    [("127.0.0.1", 200), ("localhost:8080", 200), ("[::1]:8080", 200), ("192.0.2.7:80", 200),
     ("twin.plant.example", 200), ("TWIN.plant.example:8443", 200), ("evil.example", 421),
     ("twin.plant.example.evil.example", 421), ("127.0.0.1.evil.example", 421), ("", 421)],
)  # fmt: skip
def test_rebound_name_is_refused(app, host, status):
    """A page of another site whose name was made to lead here (DNS rebinding) sends that name as Host."""
    with front(app) as (port, _):
        answer = said(port, f"GET /v1/assets HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")
    assert answer.startswith(f"HTTP/1.1 {status} "), answer[:200]


def test_foreign_page_writes_nothing(app):
    body = json.dumps({"revolutions": 1, "max_depth_um": 1, "flank": "combined", "std_um": 1})
    with front(app) as (port, _):
        for origin in ("http://evil.example", f"http://127.0.0.1:{port + 1}", "null"):
            answer = httpx.post(f"http://127.0.0.1:{port}{WRITE}", content=body, headers={"Origin": origin})
            assert answer.status_code == 403
        preflight = httpx.options(f"http://127.0.0.1:{port}{WRITE}", headers={"Origin": "http://evil.example"})
        assert "access-control-allow-origin" not in preflight.headers
    assert app.state.queue.jobs.of("unsw", "inspection") == ()


# -- paths and headers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    ["/static/../api/__init__.py", "/static/..%2fapi%2f__init__.py", "/static/%2e%2e/%2e%2e/pyproject.toml",
     "/static//etc/passwd", "/assets/..%2f..%2fsettings.py", "/static/....//api/__init__.py", "//etc/passwd",
     "/v1/assets/..%2f..%2fetc%2fpasswd", "/static/%00", "/static/vendor"],
)  # fmt: skip
def test_no_path_leads_out_of_what_is_served(app, path):
    with front(app) as (port, _):
        answer = said(port, f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
    status = int(answer.split()[1])
    assert status in (404, 405, 400, 422), answer[:200]
    assert "import" not in answer and "root:" not in answer


@pytest.mark.parametrize(
    "request_text",
    [
        "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        "GET / HTTP/1.1\r\n\r\n",
        "GET / HTTP/x\r\nHost: 127.0.0.1\r\n\r\n",
        "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",
        f"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: {'a' * 70_000}\r\n\r\n",
        f"GET /{'a' * 70_000} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        "POST /v1/session HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        "POST /v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -1\r\n\r\n",
        "GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX: a\x00b\r\n\r\n",
    ],
    ids=range(9),
)
def test_request_that_is_none_is_refused_and_hurts_nobody(app, request_text):
    with front(app) as (port, _):
        answer = said(port, request_text.encode("latin-1"))
        assert answer == "" or answer.split()[1] in ("400", "408", "414", "415", "421", "422", "431"), answer[:200]
        assert healthy(port)


def test_every_answer_says_what_browsers_may_do_with_it(app):
    with front(app) as (port, _):
        for path in (
            "/",
            "/docs",
            "/v1/assets",
            "/v1/assets/unsw/report",
            "/v1/nothing",
            "/metrics",
            "/static/page.js",
        ):
            headers = httpx.get(f"http://127.0.0.1:{port}{path}").headers
            assert headers["x-content-type-options"] == "nosniff" and headers["x-frame-options"] == "DENY", path
            assert headers["referrer-policy"] == "same-origin" and "server" not in headers
            policy = headers["content-security-policy"]
            assert "frame-ancestors 'none'" in policy and "unsafe-eval" not in policy
            scripts = next((part for part in policy.split(";") if "script-src" in part), policy.split(";")[0])
            assert "unsafe-inline" not in scripts, path
            if path in ("/v1/assets", "/metrics"):
                assert headers["cache-control"].startswith("private") and "Authorization" in headers["vary"]
            assert "strict-transport-security" not in headers


# -- bodies --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("announced", [True, False])
def test_large_body_is_refused_without_being_read(app, announced):
    sent = 0

    def endless():
        nonlocal sent
        for _ in range(9600):
            sent += 65536
            yield b"x" * 65536

    with front(app, times=Times()) as (port, _):
        headers = {"Content-Type": "application/json"} | ({"Content-Length": str(600 * 2**20)} if announced else {})
        try:
            answer = httpx.post(f"http://127.0.0.1:{port}{WRITE}", content=endless(), headers=headers, timeout=20)
            assert answer.status_code == 413 and answer.headers["content-type"] == "application/problem+json"
        except (httpx.WriteError, httpx.RemoteProtocolError, httpx.ReadError):
            pass  # the server has closed while more was being sent
        assert sent < 64 * 2**20
        assert healthy(port)


def test_rig_and_rules_may_be_larger_than_other_bodies(app):
    with front(app, times=Times()) as (port, _):
        url = f"http://127.0.0.1:{port}"
        rig = {"schema": "gear-rig/1", "description": "x" * 200_000}
        assert httpx.post(f"{url}/v1/assets", json={"asset": "a", "rig": rig}).status_code == 201
        assert httpx.post(f"{url}{WRITE}", json={"x": "x" * 200_000}).status_code == 413


def test_compressed_body_is_refused(app):
    with front(app) as (port, _):
        answer = httpx.post(
            f"http://127.0.0.1:{port}{WRITE}", content=b"\x1f\x8b", headers={"Content-Encoding": "gzip"}
        )
    assert answer.status_code == 415


class Failing:
    """A store whose every call is a fault of the program."""

    def __getattr__(self, name):
        raise ZeroDivisionError("the inside of the program")


def test_fault_of_the_program_is_an_answer_like_the_others_and_one_entry_of_the_log(store, board, caplog):
    fakes.campaign(store, board)
    app = create_app(board, store)
    app.state.store = Failing()
    with front(app) as (port, _):
        for method, path in (("GET", "/v1/assets/unsw/epochs"), ("POST", WRITE)):
            caplog.clear()
            body = {"revolutions": 1, "max_depth_um": 1, "flank": "combined", "std_um": 1}
            answer = httpx.request(method, f"http://127.0.0.1:{port}{path}", json=body if method == "POST" else None)
            assert answer.status_code == 500 and answer.headers["content-type"] == "application/problem+json"
            assert "inside" not in answer.text and "Traceback" not in answer.text and "store" not in answer.text
            assert answer.headers["x-frame-options"] == "DENY" and answer.headers["x-content-type-options"] == "nosniff"
            assert "content-security-policy" in answer.headers and answer.headers["cache-control"].startswith("private")
            (entry,) = caplog.records
            assert entry.exc_info is not None and entry.getMessage() == f"{method} {path} failed"
        assert healthy(port)


MALFORMED = (
    "[" * 30_000, '{"a":' * 10_000, "[" * 30_000 + "]" * 30_000, '"' + "\\u0000" * 9000 + '"', "9" * 60_000,
    '{"revolutions": ' + "9" * 5000 + "}", '{"revolutions": 1e999}', '{"revolutions": NaN}', "nul",
    '{"revolutions": "\\ud800"}', '{"\\ud800": 1}',
)  # fmt: skip


def test_body_that_is_deep_long_or_none_is_refused_as_a_problem(app):
    paths = (WRITE, "/v1/assets/unsw/what-if", "/v1/assets", "/v1/session", "/v1/assets/unsw/changes")
    with front(app, times=Times()) as (port, _), httpx.Client(base_url=f"http://127.0.0.1:{port}") as client:
        for path, body in itertools.product(paths, MALFORMED):
            answer = client.post(path, content=body.encode(), headers={"Content-Type": "application/json"})
            assert answer.status_code in (400, 422), (path, body[:30], answer.text[:300])
            assert answer.headers["content-type"] == "application/problem+json" and len(answer.content) < 10_000
        assert healthy(port)


EXCESSIVE = (
    "windows?limit=10001", "windows?limit=99999999999999999999", "windows?after=99999999999999999999999",
    "windows?after=-99999999999999999999999", "trend?resolution=1000000000", "windows?limit=1e400",
    "events?after=99999999999999999999999", "signals?limit=1000000000", "waterfall?points=1000000000",
    "windows/99999999999999999999999/signals/spectrum", "windows/0/signals/spectrum?points=999999999999",
    "alarms?limit=1000000000", "indicators?limit=1000000000",
)  # fmt: skip


def test_query_for_more_than_may_be_asked_is_bounded(app):
    with front(app, times=Times()) as (port, _), httpx.Client(base_url=f"http://127.0.0.1:{port}") as client:
        for query in EXCESSIVE:
            answer = client.get(f"/v1/assets/unsw/{query}")
            assert answer.status_code in (200, 404, 422) and len(answer.content) < 2**20, (query, answer.text[:300])
        assert healthy(port)


# -- slow clients --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "part",
    [b"", b"GET /healthz HT", b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n",
     b"POST /v1/assets/unsw/inspections HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100\r\n"
     b"Content-Type: application/json\r\n\r\n{"],
    ids=["nothing", "half a line", "half the headers", "half the body"],
)  # fmt: skip
def test_slow_request_is_ended_in_time_and_others_are_served(app, part):
    with front(app) as (port, before), socket.create_connection(("127.0.0.1", port), 5) as slow:
        slow.sendall(part)
        for byte in (b"X", b"-"):
            time.sleep(0.1)
            if part:
                slow.sendall(byte)  # a byte now and then prolongs nothing
            assert healthy(port)
        ended = received(slow)
        assert ended == "" or ended.startswith("HTTP/1.1 408")
        assert before.protocol.slow == 1


@pytest.mark.slow
def test_client_that_does_not_read_is_ended(app):
    with front(app) as (port, before), socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.connect(("127.0.0.1", port))
        ask = b"GET /static/vendor/uPlot.iife.min.js HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
        deadline = time.monotonic() + 10
        deaf.settimeout(0.2)
        while before.protocol.slow == 0 and time.monotonic() < deadline:
            try:
                deaf.sendall(ask)
            except (TimeoutError, OSError):
                time.sleep(0.1)
        assert before.protocol.slow >= 1
        assert healthy(port)


def test_connections_are_bounded_and_come_free_again(app):
    gate = Gate(20, 5)
    with front(app, gate, Times()) as (port, _):
        held = [socket.create_connection(("127.0.0.1", port), 5) for _ in range(60)]
        wait = time.monotonic() + 5
        while gate.refused < 40 and time.monotonic() < wait:
            time.sleep(0.01)
        assert gate.open == 20 and gate.refused == 40
        for each in held:
            each.close()
        while gate.open and time.monotonic() < wait:
            time.sleep(0.01)
        assert gate.open == 0
        assert healthy(port)


def test_connections_of_one_client_are_bounded():
    gate = Gate(100, 3)
    leaves = [gate.enter("192.0.2.1") for _ in range(5)]
    assert [leave is not None for leave in leaves] == [True, True, True, False, False]
    assert gate.enter("192.0.2.2") is not None
    assert all(gate.enter("127.0.0.1") is not None for _ in range(10))  # a proxy may be there
    leaves[0]()
    assert gate.enter("192.0.2.1") is not None
    assert gate.enter("2001:db8::1") and gate.enter("2001:db8::2") and gate.enter("2001:db8::3")
    assert gate.enter("2001:db8:0:0:1::4") is None  # one network of one subscriber


def test_requests_and_streams_of_one_client_are_bounded(store, board):
    fakes.campaign(store, board)
    app = create_app(
        board, store, access=Access(anonymous=Role.read),
        limits=Limits(per_minute=12, streams=5, streams_per_client=3),
    )  # fmt: skip

    async def asked(client, paths):
        transport = httpx.ASGITransport(app=app, client=(client, 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://twin") as caller:
            return [(await caller.get(path)).status_code for path in paths]

    assert asyncio.run(asked("192.0.2.1", ["/v1/assets"] * 15)) == [200] * 12 + [429] * 3
    assert asyncio.run(asked("192.0.2.2", ["/v1/assets"])) == [200]
    assert asyncio.run(asked("127.0.0.1", ["/v1/assets"] * 15)) == [200] * 15

    async def streams():
        """Streams that are begun and left open: the app is called as a server calls it."""
        statuses, tasks = [], []
        for client in ["192.0.2.3"] * 4 + ["192.0.2.4"] * 3:
            begun = asyncio.Event()

            async def send(message, begun=begun):
                if message["type"] == "http.response.start":
                    statuses.append(message["status"])
                    begun.set()

            async def receive():
                await asyncio.sleep(60)

            scope = {
                "type": "http", "method": "GET", "path": "/v1/assets/unsw/events", "raw_path": b"", "headers": [],
                "query_string": b"", "client": (client, 1), "server": ("127.0.0.1", 80), "scheme": "http",
                "http_version": "1.1", "root_path": "", "asgi": {"version": "3.0"},
            }  # fmt: skip
            tasks.append(asyncio.ensure_future(app(scope, receive, send)))
            await asyncio.wait_for(begun.wait(), 5)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return statuses

    assert asyncio.run(streams()) == [200, 200, 200, 429, 200, 200, 503]


EXHAUSTED = """
import resource, socket, sys, threading, time
resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40))
from service.runtime.http_server import Front, HttpServer, listening_at
async def app(scope, receive, send):
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"ok"})
stop = threading.Event()
with listening_at("127.0.0.1", 0, None) as listening:
    started = lambda: print(listening.getsockname()[1], flush=True)
    server = HttpServer(app, started=started, ending=lambda: None, stop=stop, front=Front(None))
    threading.Timer(float(sys.argv[1]), stop.set).start()
    server.run(sockets=[listening])
"""


@pytest.mark.slow
def test_descriptors_that_run_out_cost_neither_log_nor_processor():
    """Without a gate, so that they do run out: 32 MB of log in 99 s was written before."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", EXHAUSTED, "4"]
    with subprocess.Popen(command, env=environment, text=True, stdout=-1, stderr=-1) as process:
        port = int(process.stdout.readline())
        held = [socket.create_connection(("127.0.0.1", port), 5) for _ in range(60)]
        time.sleep(2.5)
        used = sum(map(int, Path(f"/proc/{process.pid}/stat").read_text().split()[13:15])) / os.sysconf("SC_CLK_TCK")
        for each in held:
            each.close()
        log = process.communicate(timeout=20)[1]
    assert "no connection can be accepted" in log and len(log) < 5000
    assert used < 2.5


@pytest.mark.slow
def test_1100_half_requests_leave_descriptors_to_others(app):
    """Half requests up to the usual bounds: health is answered, and the process keeps descriptors for Zenoh."""
    gate = Gate(512, 64)
    with front(app, gate, Times(headers=3.0)) as (port, before):
        held = []
        for _ in range(1100):
            caller = socket.create_connection(("127.0.0.1", port), 5)
            with suppress(OSError):
                caller.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n")
            held.append(caller)
        assert gate.open <= 512
        wait_until(lambda: gate.open == 0)
        assert before.protocol.slow >= 400
        assert healthy(port)
        for each in held:
            each.close()
