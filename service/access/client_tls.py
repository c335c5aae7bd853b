"""How a client of the service's HTTP verifies it, and what certificate it shows."""

from __future__ import annotations

import ssl

from service.errors import InputError


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
