"""What is said of an object store that cannot be used: where, what, and what would be right, without any secret."""

from __future__ import annotations

import os
import re
import ssl

import pytest
import trustme

from service.cli import run
from service.errors import StoreError
from service.results import object_store
from service.results.object_store import ObjectStore

SECRET = "the-secret-of-the-tests"


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    for name in [name for name in os.environ if name.startswith(("AWS_", "AZURE_", "GOOGLE_"))]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "twin")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
    monkeypatch.setattr(object_store, "RETRIES", 0)


def answer(status, code=""):
    body = f'<?xml version="1.0"?>\n<Error><Code>{code}</Code><Message>No.</Message><Key>raw/a</Key></Error>'
    return {"response_data": body if code else "no", "status": status, "content_type": "application/xml"}


@pytest.mark.parametrize(
    ("status", "code", "expected"),
    [
        (403, "SignatureDoesNotMatch", "refuses the credentials (403 SignatureDoesNotMatch): AWS_ACCESS_KEY_ID and "),
        (401, "", "refuses the credentials (401): AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY must be of one who may"),
        (403, "RequestTimeTooSkewed", "has another time (403 RequestTimeTooSkewed): set the clock"),
        (404, "NoSuchBucket", "has no bucket 'plant' (404 NoSuchBucket): make it there, or correct the URL or AWS_"),
        (400, "InvalidBucketName", "has no bucket 'plant' (400 InvalidBucketName): make it there"),
        (400, "AuthorizationHeaderMalformed", "has the bucket in another region (400 Authorization"),
        (500, "InternalError", "answers 500 InternalError"),
    ],
)
def test_an_answer_says_what_would_be_right(httpserver, monkeypatch, status, code, expected):
    httpserver.expect_request(re.compile("/plant.*")).respond_with_data(**answer(status, code))
    where = httpserver.url_for("")
    monkeypatch.setenv("AWS_ENDPOINT_URL", where)
    store = ObjectStore("s3://plant/raw")
    for act in (lambda: list(store.entries()), lambda: store.put("a", b"x"), lambda: store.put_once("a", b"x")):
        with pytest.raises(StoreError) as raised:
            act()
        said = str(raised.value)
        assert said.startswith(f"s3://plant/raw: {where.rstrip('/')} {expected}"), said
        assert SECRET not in said and "\n" not in said


def test_an_object_that_is_not_there_is_told_from_a_bucket_that_is_not(httpserver, monkeypatch, tmp_path):
    monkeypatch.setenv("AWS_ENDPOINT_URL", httpserver.url_for(""))
    store = ObjectStore("s3://plant/raw")
    httpserver.expect_request("/plant/raw/a").respond_with_data(**answer(404, "NoSuchKey"))
    assert store.read("a") is None and store.entry("a") is None
    with pytest.raises(StoreError, match="raw/a has been deleted since it was listed"):
        store.read_to(tmp_path / "copy", "a")
    httpserver.clear()
    httpserver.expect_request("/plant/raw/a").respond_with_data(**answer(404, "NoSuchBucket"))
    for act in (lambda: store.read("a"), lambda: store.read_to(tmp_path / "copy", "a")):
        with pytest.raises(StoreError, match="has no bucket 'plant'"):
            act()


def test_a_certificate_of_an_own_authority_is_accepted_where_it_is_named(make_httpserver_ssl, monkeypatch, tmp_path):
    authority, server = make_httpserver_ssl
    server.expect_request("/plant/raw/a").respond_with_data("content")
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"https://127.0.0.1:{server.port}")
    with pytest.raises(StoreError) as raised:
        ObjectStore("s3://plant/raw").read("a")
    assert f"the certificate of https://127.0.0.1:{server.port} is not accepted" in str(raised.value)
    assert "set SSL_CERT_FILE" in str(raised.value)
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "ca.pem"))
    assert ObjectStore("s3://plant/raw").read("a") == b"content"


@pytest.fixture
def make_httpserver_ssl():
    from pytest_httpserver import HTTPServer

    authority, context = trustme.CA(), ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("127.0.0.1").configure_cert(context)
    with HTTPServer(host="127.0.0.1", port=0, ssl_context=context) as server:
        yield authority, server


def test_a_server_that_is_away_is_said_with_the_variable_of_its_address(monkeypatch):
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    with pytest.raises(StoreError) as raised:
        list(ObjectStore("s3://plant/raw").entries())
    assert str(raised.value) == (
        "s3://plant/raw: no answer from http://127.0.0.1:9: it must run and be reached from here; its address is "
        "AWS_ENDPOINT_URL"
    )


@pytest.mark.parametrize(
    ("url", "given", "expected"),
    [
        ("s3://plant/raw", {"AWS_SECRET_ACCESS_KEY": None}, "there are no credentials: set AWS_ACCESS_KEY_ID and AWS_"),
        ("az://plant/raw", {}, "there are no credentials: set AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE"),
        ("s3://plant/raw", {"AWS_ACCESS_KEY_ID": "twin\n"}, "AWS_ENDPOINT_URL hold what no request can"),
        ("s3://plant/raw", {"AWS_ENDPOINT_URL": "store:9000"}, "AWS_ENDPOINT_URL = 'store:9000' must begin with http"),
        ("s3://plant/raw", {"AWS_ENDPOINT_URL": ""}, "AWS_ENDPOINT_URL = '' must begin with http:// or https://"),
        ("s3://plant/raw", {"AWS_ENDPOINT": f"http://twin:{SECRET}@store"}, "AWS_ENDPOINT must not hold credentials"),
        (f"s3://twin:{SECRET}@plant/raw", {}, "the URL must not hold credentials: set AWS_ACCESS_KEY_ID and"),
        (f"s3://{SECRET}@plant/raw", {}, "the URL must not hold credentials"),
        (f"s3://plant/raw?secret={SECRET}", {}, "s3://plant/raw: the URL must end with the path, without ? and #"),
        ("s3://", {}, "names no bucket: it must be like s3://bucket/path"),
        ("az:///raw", {}, "names no container: it must be like az://container/path"),
    ],
)
def test_what_no_store_can_be_used_by_is_refused_in_one_line(monkeypatch, url, given, expected):
    for name, value in given.items():
        monkeypatch.delenv(name) if value is None else monkeypatch.setenv(name, value)
    with pytest.raises(StoreError) as raised:
        list(ObjectStore(url).entries())
    assert expected in str(raised.value) and SECRET not in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize("url", [f"s3://twin:{SECRET}@plant/raw", f"s3://plant/raw?secret={SECRET}", "s3:///raw"])
def test_a_setting_of_a_url_with_credentials_or_without_a_bucket_is_refused(capsys, monkeypatch, url):
    monkeypatch.setenv("GEAR_TWIN_RAW_URL", url)
    assert run(["config"]) == 2
    said = capsys.readouterr().err
    assert "such as s3://bucket/raw, without credentials" in said and SECRET not in said


@pytest.mark.parametrize("url", ["s3://b/raw", "s3a://b", "gs://b/", "abfss://c@account.host/raw", "file:///srv/a%20b"])
def test_urls_of_all_kinds_are_settings(capsys, monkeypatch, url):
    monkeypatch.setenv("GEAR_TWIN_RAW_URL", url)
    assert run(["config"]) == 0
    assert url in capsys.readouterr().out
