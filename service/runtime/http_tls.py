"""TLS of HTTP: the certificate, the least version, and certificates of clients."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from service.errors import InputError

VERSIONS = {"1.2": ssl.TLSVersion.TLSv1_2, "1.3": ssl.TLSVersion.TLSv1_3}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tls:
    """What a service shows, and what it asks of its clients.

    certificate  its certificate, with those in between (PEM)
    key          the private key
    minimum      least version of TLS
    clients      authorities that certificates of clients are verified by; None: clients show none
    required     whether a client must show one
    """

    certificate: Path
    key: Path
    minimum: Literal["1.2", "1.3"] = "1.2"
    clients: Path | None = None
    required: bool = False


def context_of(tls: Tls) -> ssl.SSLContext:
    """A server's context; InputError names the file that cannot be used."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = VERSIONS[tls.minimum]
    load_certificate(context, tls)
    if tls.clients is not None:
        try:
            context.load_verify_locations(cafile=tls.clients)
        except (OSError, ssl.SSLError) as error:
            raise InputError(f"http_client_authorities = {tls.clients}: {_why(error, 'certificates (PEM)')}") from None
        context.verify_mode = ssl.CERT_REQUIRED if tls.required else ssl.CERT_OPTIONAL
    return context


def load_certificate(context: ssl.SSLContext, tls: Tls) -> None:
    """Loads certificate and key, also again: new connections use them."""
    from cryptography import x509  # few services on one machine have TLS

    try:
        first = x509.load_pem_x509_certificates(tls.certificate.read_bytes())[0]
    except (OSError, ValueError) as error:
        raise InputError(f"http_certificate = {tls.certificate}: {_why(error, 'a certificate (PEM)')}") from None
    now, begin, end = datetime.now(UTC), first.not_valid_before_utc, first.not_valid_after_utc
    if now > end:
        raise InputError(f"http_certificate = {tls.certificate}: it expired at {end:%Y-%m-%d %H:%M} UTC")
    if now < begin:
        raise InputError(f"http_certificate = {tls.certificate}: it is not valid before {begin:%Y-%m-%d %H:%M} UTC")
    try:
        context.load_cert_chain(tls.certificate, tls.key)
    except ssl.SSLError as error:
        mismatch = "KEY_VALUES_MISMATCH" in str(error)
        why = f"it is not the key of {tls.certificate}" if mismatch else _why(error, "a private key (PEM)")
        raise InputError(f"http_private_key = {tls.key}: {why}") from None
    except OSError as error:
        raise InputError(f"http_private_key = {tls.key}: {_why(error, 'a private key (PEM)')}") from None


def subject_of(certificate: Mapping[str, Any] | None) -> str | None:
    """The common name of a verified client's certificate, else its first alternative name; None without one."""
    if not certificate:
        return None
    named = {key: value for part in certificate.get("subject", ()) for key, value in part}
    others = [value for _, value in certificate.get("subjectAltName", ())]
    return named.get("commonName") or next(iter(others), None)


def _why(error: Exception, what: str) -> str:
    if isinstance(error, OSError) and not isinstance(error, ssl.SSLError):
        return f"cannot be read: {(error.strerror or 'fault').lower()}"
    return f"is not {what}"
