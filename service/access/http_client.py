"""How clients of a service call it: the credential, what it is verified by, one call, and what it refuses.

A credential is sent to the service's address alone: no proxy of the environment is used, and no redirection followed.
"""

from __future__ import annotations

import json
import os
import ssl
from collections.abc import Mapping
from http.client import HTTPException, HTTPResponse
from math import inf
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.parse import quote, urlencode
from urllib.request import (
    HTTPDefaultErrorHandler,
    HTTPErrorProcessor,
    HTTPHandler,
    HTTPSHandler,
    OpenerDirector,
    Request,
    UnknownHandler,
)

from service.errors import InputError

KEY, CA = "GEAR_TWIN_KEY", "GEAR_TWIN_CA"
CERTIFICATE, PRIVATE_KEY = "GEAR_TWIN_CERTIFICATE", "GEAR_TWIN_PRIVATE_KEY"
HANDLERS = (HTTPHandler, HTTPErrorProcessor, HTTPDefaultErrorHandler, UnknownHandler)


class ServiceError(Exception):
    """The service refused a call, in its own words (RFC 9457).

    status  of HTTP
    detail  what was wrong, and what would be right
    """

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(f"{detail} (status {status})")
        self.status, self.detail = status, detail


class HttpClient:
    """Calls of one service.

    url      address of the service, such as http://127.0.0.1:8080
    timeout  how long an answer is waited for [s]
    key      API key or token; default: GEAR_TWIN_KEY
    ca       file of certificates (PEM) that the service's is verified by; default: GEAR_TWIN_CA, else the system's
    certificate, private_key  files of the certificate (PEM) to show, and of its key; default: GEAR_TWIN_CERTIFICATE and
        GEAR_TWIN_PRIVATE_KEY, else none is shown

    InputError names the file that cannot be used.
    """

    def __init__(
        self,
        url: str,
        timeout: float,
        *,
        key: str | None = None,
        ca: str | Path | None = None,
        certificate: str | Path | None = None,
        private_key: str | Path | None = None,
    ) -> None:
        self._url, self._timeout = url.rstrip("/"), timeout
        key = key or os.environ.get(KEY)
        self._headers = {"Authorization": f"Bearer {key}"} if key else {}
        given = ((CA, ca), (CERTIFICATE, certificate), (PRIVATE_KEY, private_key))
        files = [str(file) if file else os.environ.get(name) or None for name, file in given]
        self._opener = OpenerDirector()
        for handler in HANDLERS:
            self._opener.add_handler(handler())
        if any(files) or url.startswith("https:"):
            self._opener.add_handler(HTTPSHandler(context=client_context(*files)))

    def opened(
        self,
        path: str,
        body: Mapping[str, Any] | bytes | None = None,
        *,
        method: str | None = None,
        query: Mapping[str, Any] | None = None,
        headers: Mapping[str, str] | None = None,
        timeout: float | None = None,
    ) -> HTTPResponse:
        """The answer, to be read and closed; ServiceError where it is a refusal, OSError where none comes.

        body     JSON data, or a file's bytes as they are; what is None of its values, and of the query's, is left out
        timeout  [s]; that of the client where none is given, infinite for as long as the connection lasts
        """
        kind = "application/octet-stream" if isinstance(body, bytes) else "application/json"
        data = body if body is None or isinstance(body, bytes) else json.dumps(_given(body)).encode()
        asked = urlencode(_given(query or {}), doseq=True)
        address = f"{self._url}{path}{'?' if asked else ''}{asked}"
        wait = timeout or self._timeout
        try:
            request = Request(address, data, {"Content-Type": kind, **self._headers, **(headers or {})}, method=method)
            return self._opener.open(request, timeout=None if wait == inf else wait)
        except HTTPError as error:
            with error:
                raise ServiceError(error.code, _detail(error)) from None
        except URLError as error:
            raise ConnectionError(str(error.reason)) from None
        except (HTTPException, ValueError) as error:
            raise ConnectionError(str(error) or type(error).__name__) from None

    def json(self, path: str, body: Mapping[str, Any] | bytes | None = None, **given: Any) -> Any:
        """The JSON that a path answers; the same options and errors as `opened`."""
        with self.opened(path, body, **given) as answer:
            try:
                return json.load(answer)
            except (HTTPException, ValueError) as error:
                raise ConnectionError(f"its answer is not JSON: {error}") from None


def path_of(*parts: object) -> str:
    """A path of REST, each part quoted: `path_of("assets", "a/b")` is /v1/assets/a%2Fb."""
    return "/".join(("/v1", *(quote(str(part), safe="") for part in parts)))


def _given(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _detail(error: HTTPError) -> str:
    """What the service says of its refusal."""
    text = error.read().decode("utf-8", "replace")
    try:
        return str(json.loads(text)["detail"])
    except (ValueError, KeyError, TypeError):
        return text.strip()[:200] or str(error.reason)


def client_context(
    authorities: str | None = None, certificate: str | None = None, private_key: str | None = None
) -> ssl.SSLContext:
    """The context of a client; InputError names the file that cannot be used.

    authorities  file of certificates (PEM) that the service's is verified by; None: the system's
    certificate  file of the client's own certificate (PEM), with those in between; None: it shows none
    private_key  file of its private key (PEM); None: it is in the file of the certificate
    """
    try:
        context = ssl.create_default_context(cafile=authorities)
    except (OSError, ssl.SSLError):
        raise InputError(f"{authorities}: cannot be read as certificates (PEM)") from None
    if certificate is None:
        if private_key is not None:
            raise InputError(f"{private_key}: a private key is of use only with its certificate, which is not given")
        return context
    files = certificate if private_key is None else f"{certificate} and {private_key}"
    try:
        context.load_cert_chain(certificate, private_key, password="")  # nobody is asked for a key's password
    except (OSError, ValueError) as error:
        if "KEY_VALUES_MISMATCH" in str(error):
            raise InputError(f"{files}: the private key is not that of the certificate") from None
        raise InputError(f"{files}: cannot be read as a certificate and its private key (PEM, no password)") from None
    return context
