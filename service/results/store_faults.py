"""What a fault of an object store is for people: what, where, and what would be right. It holds no secret.

The library's own words have the request and the store's answer, on several lines; what is of use is taken out of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

_HOST = re.compile(r"Error performing \w+ (https?://[^/\s?]+)")
_STATUS = re.compile(r"status code: (\d{3})")
_CODE = re.compile(r"<Code>(\w{1,64})</Code>")
_CERTIFICATE = re.compile(r"InvalidCertificate\(\s*(\w+)")
_QUERY = re.compile(r"(https?://[^\s?]+)\?\S*")  # may hold a signature
_OF_THE_MACHINE = "169.254.169.254"  # where a machine of a cloud is asked for credentials when none are set
_MISSING = re.compile(r"Missing (AccessKeyId|SecretAccessKey)|Account must be specified")


@dataclass(frozen=True, slots=True, kw_only=True)
class Variables:
    """What the environment calls the access to a kind of store."""

    key: str
    endpoint: str
    bucket: str = "bucket"
    endpoints: tuple[str, ...] = ()  # all names under which an endpoint is read


_S3 = Variables(
    key="AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY",
    endpoint="AWS_ENDPOINT_URL",
    endpoints=("AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT"),
)
_AZURE = Variables(
    key="AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY",
    endpoint="AZURE_STORAGE_ENDPOINT",
    bucket="container",
    endpoints=("AZURE_STORAGE_ENDPOINT", "AZURE_ENDPOINT"),
)
_GOOGLE = Variables(key="GOOGLE_APPLICATION_CREDENTIALS", endpoint="GOOGLE_BASE_URL")
BY_SCHEME: Mapping[str, Variables] = {
    "s3": _S3, "s3a": _S3, "gs": _GOOGLE, "az": _AZURE, "abfs": _AZURE, "abfss": _AZURE,
}  # fmt: skip


def refusal(url: str, environment: Mapping[str, str]) -> str | None:
    """Why a URL, or the endpoint that the environment gives its store, cannot be used; None where it can."""
    parts = urlsplit(url)
    names = BY_SCHEME[parts.scheme]
    if parts.password is not None or (parts.username is not None and names is not _AZURE):
        return f"{parts.scheme}://: the URL must not hold credentials: set {names.key} in the environment"
    if parts.query or parts.fragment:
        return f"{parts.scheme}://{parts.netloc}{parts.path}: the URL must end with the path, without ? and #"
    if not parts.netloc:
        return f"{url}: names no {names.bucket}: it must be like {parts.scheme}://{names.bucket}/path"
    for name in names.endpoints:
        given = environment.get(name)
        if given is None:
            continue
        address = urlsplit(given)
        if address.username is not None or address.password is not None:
            return f"{url}: {name} must not hold credentials: set {names.key} in the environment"
        if address.scheme not in ("http", "https") or not address.hostname:
            return f"{url}: {name} = {given!r} must begin with http:// or https://, and name a host"
    return None


def said(url: str, error: BaseException) -> str:
    """What has happened at the store of a URL, and what would be right."""
    text = str(error).strip()
    names = BY_SCHEME.get(urlsplit(url).scheme)
    first = _QUERY.sub(r"\1", text.partition("\n")[0]) or type(error).__name__
    if names is None:
        return f"{url}: cannot be used: {first}"
    if type(error).__name__ == "PanicException":
        return f"{url}: cannot be used: {names.key} or {names.endpoint} hold what no request can ({first})"
    if _MISSING.search(first) or _OF_THE_MACHINE in first:
        return f"{url}: there are no credentials: set {names.key} in the environment of the program"
    host = found[1] if (found := _HOST.search(first)) else "the store"
    if status := _STATUS.search(first):
        return f"{url}: {_answered(names, url, host, status[1], text)}"
    if certificate := _CERTIFICATE.search(text):
        return (
            f"{url}: the certificate of {host} is not accepted ({certificate[1]}): where its authority is one of your "
            "own, set SSL_CERT_FILE to the certificate (PEM) of that authority"
        )
    if "HTTP error:" in first:
        return f"{url}: no answer from {host}: it must run and be reached from here; its address is {names.endpoint}"
    return f"{url}: cannot be used: {first}"


def _answered(names: Variables, url: str, host: str, status: str, text: str) -> str:
    """What an answer of the store means that is none of success."""
    code = found[1] if (found := _CODE.search(text)) else ""
    answer = f"{status} {code}".strip()
    if status == "301" or code in ("AuthorizationHeaderMalformed", "IllegalLocationConstraintException"):
        return f"{host} has the {names.bucket} in another region ({answer}): set AWS_REGION to its region"
    if code == "RequestTimeTooSkewed":
        return f"{host} has another time ({answer}): set the clock of this machine or of that one"
    if status in ("401", "403"):
        return (
            f"{host} refuses the credentials ({answer}): {names.key} must be of one who may list, read, write and "
            f"delete in this {names.bucket}"
        )
    if status == "404" or code == "InvalidBucketName":
        return (
            f"{host} has no {names.bucket} {urlsplit(url).netloc!r} ({answer}): make it there, or correct the URL "
            f"or {names.endpoint}"
        )
    return f"{host} answers {answer}"


def is_of_bucket(error: BaseException) -> bool:
    """Whether what is not there is not an object, but the bucket."""
    return "<Code>NoSuchBucket</Code>" in str(error)
