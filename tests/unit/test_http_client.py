"""The one way in which commands and the Python client call a service."""

from __future__ import annotations

import pytest
from pytest_httpserver import HTTPServer

from service.access.http_client import HttpClient, ServiceError, path_of


def test_a_key_is_not_taken_to_another_address(httpserver: HTTPServer):
    httpserver.expect_request("/v1/assets").respond_with_data(
        "", status=302, headers={"Location": httpserver.url_for("/elsewhere")}
    )
    with pytest.raises(ServiceError) as refused:
        HttpClient(httpserver.url_for(""), 5.0, key="gt_secret").json("/v1/assets")
    assert refused.value.status == 302 and len(httpserver.log) == 1


def test_a_proxy_of_the_environment_is_not_used(httpserver: HTTPServer, monkeypatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    httpserver.expect_request("/v1/a/b", query_string="x=1&x=2").respond_with_json({"done": True})
    client = HttpClient(httpserver.url_for(""), 5.0)
    assert client.json(path_of("a/b"), query={"x": [1, 2], "y": None}) == {"done": True}


@pytest.mark.parametrize("address", ["http://127.0.0.1:9", "localhost:8080", "file:///etc/hostname", ""])
def test_where_no_service_answers_the_error_is_an_os_error(address):
    with pytest.raises(OSError):
        HttpClient(address, 5.0).json("/v1/assets")


def test_an_answer_that_is_not_json_and_a_refusal_without_words_are_said(httpserver: HTTPServer):
    httpserver.expect_request("/page").respond_with_data("<html>")
    httpserver.expect_request("/none").respond_with_data("", status=503)
    client = HttpClient(httpserver.url_for(""), 5.0)
    with pytest.raises(OSError, match="not JSON"):
        client.json("/page")
    with pytest.raises(ServiceError, match=r"(?i)service unavailable"):
        client.json("/none")
