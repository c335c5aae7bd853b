"""Addresses of clients: of this computer, and which belong together."""

from __future__ import annotations

from ipaddress import ip_address


def is_loopback(address: str | None) -> bool:
    """Whether an address is of this computer alone; names are not looked up, but for `localhost`."""
    if address is None:
        return False
    try:
        found = ip_address(address.strip("[]").partition("%")[0])
    except ValueError:
        return address == "localhost"
    mapped = getattr(found, "ipv4_mapped", None)
    return (mapped or found).is_loopback


def is_local_endpoint(endpoint: str) -> bool:
    """Whether an endpoint of Zenoh, such as tcp/127.0.0.1:7447, is of this computer alone."""
    protocol, _, address = endpoint.partition("/")
    host = address.partition("#")[0].partition("?")[0].rpartition(":")[0]
    return protocol == "unixsock-stream" or is_loopback(host)


def network(address: str | None) -> str:
    """An address, or of version 6 the network that one subscriber usually has."""
    try:
        found = ip_address((address or "").partition("%")[0])
    except ValueError:
        return address or ""
    return str(found) if found.version == 4 else ":".join(found.exploded.split(":")[:4])
