"""Whom the service lets in, by its settings; and that nobody is let in by an oversight."""

from __future__ import annotations

from typing import TYPE_CHECKING

from service.access.access import Access
from service.access.addresses import is_local_endpoint, is_loopback
from service.access.keys import KeyStore
from service.access.roles import Role
from service.api.limits import Limits
from service.errors import InputError
from service.runtime.http_gate import Gate, connections_within, raise_descriptor_limit
from service.runtime.http_protocol import Times
from service.runtime.http_server import Front
from service.runtime.http_tls import Tls
from service.settings import Settings

if TYPE_CHECKING:
    from service.access.tokens import Tokens


def access_of(settings: Settings) -> Access:
    """The rule of access; InputError where others could reach a service that has no credentials."""
    access = Access(
        KeyStore(settings.data),
        None if settings.oidc_issuer is None else _tokens_of(settings, settings.oidc_issuer),
        Role.read if settings.anonymous == "read" else None,
        settings.http_certificate_roles,
    )
    if not is_loopback(settings.http_host) and not access.configured and access.anonymous is None:
        raise InputError(
            f"http = {settings.http}: other computers can reach this address, and there are no credentials; make a key "
            f"(gear-twin db keys add --name NAME --role administer --data {settings.data}), name an issuer of tokens "
            '([oidc] issuer), listen at 127.0.0.1, or permit everybody to read ([access] anonymous = "read")'
        )
    demand_protected_links(settings)
    return access


def demand_protected_links(settings: Settings) -> None:
    """InputError where everybody could publish to the embedded router without that being meant."""
    if settings.connect or settings.zenoh_open or settings.zenoh_links.admits_known_clients_only:
        return
    for endpoint in settings.listen:
        if not is_local_endpoint(endpoint):
            raise InputError(
                f"listen = {endpoint}: other computers can reach this address, and everybody could publish frames; "
                "demand certificates ([zenoh] client_certificates) or users ([zenoh] users), give access control "
                "([zenoh] config), listen at 127.0.0.1, or permit everybody ([zenoh] open = true)"
            )


def limits_of(settings: Settings) -> Limits:
    """What one client may ask of the service."""
    return Limits(
        hosts=(settings.http_host, *settings.http_hosts),
        per_minute=settings.http_rate,
        streams=settings.http_streams,
        streams_per_client=settings.http_streams_per_client,
    )


def front_of(settings: Settings) -> Front:
    """How HTTP is served; InputError where certificate or key cannot be used."""
    tls = None
    if settings.http_certificate is not None and settings.http_private_key is not None:
        tls = Tls(
            certificate=settings.http_certificate,
            key=settings.http_private_key,
            minimum=settings.http_tls_minimum,
            clients=settings.http_client_authorities,
            required=settings.http_client_certificates == "required",
        )
    gate = Gate(
        connections_within(settings.http_connections, raise_descriptor_limit()), settings.http_connections_per_client
    )
    return Front(gate, Times(headers=settings.http_header_time, body=settings.http_body_time), tls)


def _tokens_of(settings: Settings, issuer: str) -> Tokens:
    from service.access.tokens import Issuer, Tokens  # whose packages are not loaded where no issuer is set

    return Tokens(
        Issuer(
            issuer=issuer,
            audience=settings.oidc_audience,
            algorithms=tuple(settings.oidc_algorithms),
            leeway=settings.oidc_leeway,
            role_claim=settings.oidc_role_claim,
            roles=settings.oidc_roles,
            name_claim=settings.oidc_name_claim,
            keys_url=settings.oidc_keys_url,
            ca=settings.oidc_ca,
        )
    )
