"""HTTP over TLS: who is served, who is known by a certificate, and which files are refused."""

from __future__ import annotations

import datetime
import socket
import ssl

import httpx
import pytest
import service_fakes as fakes
import trustme
from http_front import WRITE, front

import gear_twin
from service.access.access import Access
from service.access.keys import KeyStore
from service.access.roles import Role
from service.api import create_app
from service.cli import run
from service.errors import InputError
from service.runtime.http_protocol import Times
from service.runtime.http_tls import Tls, context_of


@pytest.fixture(scope="module")
def authority():
    return trustme.CA()


def pair(issued, folder, name="server"):
    certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
    certificate.write_bytes(b"".join(part.bytes() for part in issued.cert_chain_pems))
    key.write_bytes(issued.private_key_pem.bytes())
    return certificate, key


def client_of(authority, shown=None, **given):
    context = ssl.create_default_context()
    authority.configure_trust(context)
    if shown is not None:
        shown.configure_cert(context)
    return httpx.Client(verify=context, timeout=5, **given)


def test_tls_serves_with_the_right_authority_alone_and_never_plainly(app, tmp_path, authority):
    certificate, key = pair(authority.issue_cert("127.0.0.1"), tmp_path)
    with front(app, times=Times(), tls=Tls(certificate=certificate, key=key)) as (port, _):
        url = f"https://127.0.0.1:{port}"
        with client_of(authority) as client:
            answer = client.get(f"{url}/healthz")
            assert answer.status_code == 200 and "max-age" in answer.headers["strict-transport-security"]
        with client_of(trustme.CA()) as stranger, pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
            stranger.get(f"{url}/healthz")
        with pytest.raises(httpx.HTTPError):
            httpx.get(f"http://127.0.0.1:{port}/healthz", timeout=3)
        old = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        authority.configure_trust(old)
        with pytest.warns(DeprecationWarning):
            old.maximum_version = ssl.TLSVersion.TLSv1_1
        with pytest.raises(httpx.ConnectError):
            httpx.get(f"{url}/healthz", verify=old, timeout=3)


def test_clients_are_known_by_their_certificates(store, board, tmp_path, authority):
    fakes.campaign(store, board)
    access = Access(KeyStore(tmp_path / "keys"), certificates={"operator": Role.operate, "logger": Role.read})
    app = create_app(board, store, access=access)
    certificate, key = pair(authority.issue_cert("127.0.0.1"), tmp_path)
    clients = tmp_path / "clients.pem"
    authority.cert_pem.write_to_path(str(clients))
    tls = Tls(certificate=certificate, key=key, clients=clients)
    body = {"revolutions": 6000, "max_depth_um": 150.0, "flank": "combined", "std_um": 4.0}
    with front(app, times=Times(), tls=tls) as (port, _):
        url = f"https://127.0.0.1:{port}"
        for name, read, write in (("operator", 200, 201), ("logger", 200, 403), ("nobody", 401, 401), (None, 401, 401)):
            shown = None if name is None else authority.issue_cert(f"{name}.example", common_name=name)
            with client_of(authority, shown) as client:
                assert client.get(f"{url}/v1/assets").status_code == read, name
                assert client.post(f"{url}{WRITE}", json=body).status_code == write, name
        forged = trustme.CA().issue_cert("x.example", common_name="operator")
        with client_of(authority, forged) as forger, pytest.raises(httpx.HTTPError):
            forger.get(f"{url}/v1/assets")
    required = Tls(certificate=certificate, key=key, clients=clients, required=True)
    with (
        front(app, times=Times(), tls=required) as (port, _),
        client_of(authority) as bare,
        pytest.raises(httpx.HTTPError),
    ):
        bare.get(f"https://127.0.0.1:{port}/healthz")


@pytest.mark.slow
def test_commands_and_the_python_client_show_their_certificate(store, board, tmp_path, authority, capsys, monkeypatch):
    fakes.campaign(store, board)
    app = create_app(board, store, access=Access(KeyStore(tmp_path / "keys"), certificates={"historian": Role.read}))
    certificate, key = pair(authority.issue_cert("127.0.0.1"), tmp_path)
    right, wrong = tmp_path / "right.pem", tmp_path / "wrong.pem"
    authority.cert_pem.write_to_path(str(right))
    stranger = trustme.CA()
    stranger.cert_pem.write_to_path(str(wrong))
    own = pair(authority.issue_cert("h.example", common_name="historian"), tmp_path, "own")
    forged = pair(stranger.issue_cert("h.example", common_name="historian"), tmp_path, "forged")
    tls = Tls(certificate=certificate, key=key, clients=right, required=True)
    with front(app, times=Times(), tls=tls) as (port, _):
        url = f"https://127.0.0.1:{port}"
        for authorities, shown, status in ((right, own, 0), (wrong, own, 2), (right, forged, 2), (right, None, 2)):
            options = [] if shown is None else ["--certificate", str(shown[0]), "--private-key", str(shown[1])]
            assert run(["remote", "assets", "list", "--url", url, "--ca", str(authorities), *options]) == status, (
                shown,
                status,
            )
            said = capsys.readouterr()
            assert "unsw" in said.out if status == 0 else said.err.count("\n") == 1
        for files, what in (
            ((own[0], forged[1]), "the private key is not that of the certificate"),
            ((own[0], own[0]), "cannot be read as a certificate and its private key"),
            ((tmp_path / "absent", own[1]), "cannot be read as a certificate and its private key"),
        ):
            options = ["--certificate", str(files[0]), "--private-key", str(files[1])]
            assert run(["remote", "assets", "list", "--url", url, "--ca", str(right), *options]) == 2
            assert what in capsys.readouterr().err
        with gear_twin.Client(url, ca=right, certificate=own[0], private_key=own[1]) as client:
            assert [machine.asset for machine in client.assets()] == ["unsw"]
        with gear_twin.Client(url, ca=right) as client, pytest.raises(OSError):
            client.assets()
        for name, file in (("CA", right), ("CERTIFICATE", own[0]), ("PRIVATE_KEY", own[1])):
            monkeypatch.setenv(f"GEAR_TWIN_{name}", str(file))
        assert run(["remote", "assets", "list", "--url", url]) == 0
        with gear_twin.Client(url) as client:
            assert len(client.assets()) == 1
            with pytest.raises(gear_twin.ServiceError, match="historian has read"):
                client.inspect("unsw", revolutions=1.0, max_depth_um=1.0, std_um=1.0)
    with pytest.raises(InputError, match="of use only with its certificate"):
        monkeypatch.delenv("GEAR_TWIN_CERTIFICATE")
        gear_twin.Client(url)


def test_certificate_is_read_again_on_demand_and_stays_where_the_new_one_is_wrong(app, tmp_path, authority):
    certificate, key = pair(authority.issue_cert("127.0.0.1"), tmp_path)

    def serial(port):
        context = ssl.create_default_context()
        authority.configure_trust(context)
        plain = socket.create_connection(("127.0.0.1", port), 5)
        with context.wrap_socket(plain, server_hostname="127.0.0.1") as wrapped:
            return wrapped.getpeercert()["serialNumber"]

    with front(app, times=Times(), tls=Tls(certificate=certificate, key=key)) as (port, before):
        first = serial(port)
        pair(authority.issue_cert("127.0.0.1"), tmp_path)
        before.renew()
        second = serial(port)
        certificate.write_text("nothing")
        before.renew()
        assert first != second and serial(port) == second


def test_wrong_certificates_and_keys_are_one_clear_line(tmp_path, authority):
    certificate, key = pair(authority.issue_cert("127.0.0.1"), tmp_path)
    _, other = pair(authority.issue_cert("127.0.0.1"), tmp_path, "other")
    now = datetime.datetime.now(datetime.UTC)
    old, old_key = pair(authority.issue_cert("a", not_after=now - datetime.timedelta(days=1)), tmp_path, "old")
    text = tmp_path / "text.pem"
    text.write_text("nothing")
    for tls, what in (
        (Tls(certificate=tmp_path / "absent", key=key), "absent: cannot be read: no such file"),
        (Tls(certificate=text, key=key), "text.pem: is not a certificate"),
        (Tls(certificate=certificate, key=other), "other.key: it is not the key of"),
        (Tls(certificate=certificate, key=text), "text.pem: is not a private key"),
        (Tls(certificate=old, key=old_key), "old.pem: it expired at"),
        (Tls(certificate=certificate, key=key, clients=text), "text.pem: is not certificates"),
    ):
        with pytest.raises(InputError, match=what):
            context_of(tls)
