"""An app behind the service's own HTTP server, for attacks on it."""

from __future__ import annotations

import threading
from contextlib import contextmanager

from service.runtime.http_protocol import Times
from service.runtime.http_server import Front, HttpServer, listening_at

WRITE = "/v1/assets/unsw/inspections"
QUICK = Times(headers=0.5, body=0.5, answer=0.5, linger=0.3)


@contextmanager
def front(app, gate=None, times=QUICK, tls=None):
    """The app behind the service's own server; yields its port and the front."""
    stop, started = threading.Event(), threading.Event()
    before = Front(gate, times, tls)
    with listening_at("127.0.0.1", 0, gate) as listening:
        server = HttpServer(app, started=started.set, ending=lambda: None, stop=stop, front=before)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            assert started.wait(10)
            yield listening.getsockname()[1], before
        finally:
            stop.set()
            thread.join(10)
            assert not thread.is_alive()
