"""Whom the service lets in, by its settings; and that nobody is let in by an oversight."""

from __future__ import annotations

from service.access.access import Access
from service.access.addresses import is_loopback
from service.access.keys import KeyStore
from service.access.roles import Role
from service.access.tokens import Issuer, Tokens
from service.errors import InputError
from service.settings import Settings


def access_of(settings: Settings) -> Access:
    """The rule of access; InputError where others could reach a service that has no credentials."""
    access = Access(
        KeyStore(settings.data),
        None if settings.oidc_issuer is None else Tokens(_issuer_of(settings, settings.oidc_issuer)),
        Role.read if settings.anonymous == "read" else None,
    )
    if not is_loopback(settings.http_host) and not access.configured and access.anonymous is None:
        raise InputError(
            f"http = {settings.http}: other computers can reach this address, and there are no credentials; make a key "
            f"(gear-twin keys add --name NAME --role administer --data {settings.data}), name an issuer of tokens "
            '([oidc] issuer), listen at 127.0.0.1, or permit everybody to read ([access] anonymous = "read")'
        )
    return access


def _issuer_of(settings: Settings, issuer: str) -> Issuer:
    return Issuer(
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
