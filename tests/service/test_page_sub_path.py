"""The page behind a proxy of a plant that serves it under a sub-path."""

from __future__ import annotations

import threading
import urllib.error
import urllib.request
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import pytest
import service_fakes as fakes


@contextmanager
def proxied(address, under):
    """The service at a sub-path; what is asked for elsewhere is not there, and noted."""
    elsewhere, asked = [], []

    class Proxy(BaseHTTPRequestHandler):
        def do_GET(self):
            if not self.path.startswith(under):
                elsewhere.append(self.path)
                self.send_error(404)
                return
            asked.append(self.path.removeprefix(under))
            request = urllib.request.Request(f"{address}/{asked[-1]}", headers=kept(self.headers))
            try:
                answer = urllib.request.urlopen(request, timeout=20)
            except urllib.error.HTTPError as error:
                answer = error
            with answer:
                self.send_response(answer.status)
                for name, value in answer.headers.items():
                    if name.lower() not in ("transfer-encoding", "connection"):
                        self.send_header(name, value)
                self.end_headers()
                try:
                    while part := answer.read1(65536):  # events go on as they come
                        self.wfile.write(part)
                        self.wfile.flush()
                except OSError:
                    pass  # the page has gone, or the service

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Proxy) as server:
        server.daemon_threads = True
        server.block_on_close = False
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield SimpleNamespace(
                url=f"http://127.0.0.1:{server.server_port}{under}", elsewhere=elsewhere, asked=asked
            )  # fmt: skip
        finally:
            server.shutdown()


def kept(headers):
    return {name: value for name, value in headers.items() if name.lower() in ("accept", "if-none-match")}


@pytest.mark.slow
@pytest.mark.parametrize("under", ["/twin/", "/plant/hall%202/gear-twin/"])
def test_page_works_under_a_sub_path_of_a_proxy(browser, address, store, board, under):
    fakes.campaign(store, board)
    page = browser.new_page()
    wrong = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    try:
        with proxied(address, under) as proxy:
            page.goto(proxy.url)
            page.wait_for_selector("tr[data-asset=unsw]")
            page.click("tr[data-asset=unsw] a")
            page.wait_for_selector("main[data-view=overview]")
            page.wait_for_selector("#link[data-state=live], #link[data-state=open], #link:not([data-state=waiting])")
            report = page.locator("a", has_text="PDF").first.get_attribute("href")
            assert page.evaluate("async path => (await fetch(path)).status", report) == 200
            page.goto(f"{proxy.url}#/asset/unsw/data")
            page.wait_for_selector("main[data-view=data]")
            page.goto(f"{proxy.url}docs")
            page.wait_for_selector(".opblock")
            assert proxy.elsewhere == [] and wrong == []
            assert any(path.endswith("/events") for path in proxy.asked)
    finally:
        page.close()
