"""Protected links of Zenoh, each way: certificates, users and access control let the right ones in, and no others."""

from __future__ import annotations

import queue
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
import trustme
from service_streams import free_port, service, wait_until, write_recording

from service.cli import run as command
from service.contract.position import ChannelPositionModel, PositionModel, position_text
from service.errors import DeliveryError, InputError, NotReachable
from service.runtime.admission import access_of
from service.runtime.replay import replay
from service.settings import Settings
from service.transport import zenoh as zenoh_transport
from service.transport.zenoh_links import ZenohLinks
from service.transport.zenoh_session import open_session

ROOT = Path(__file__).parents[2]
ACCESS = ROOT / "docs" / "examples" / "zenoh-access.json5"
FRAME = "gearbox/rig-1/accel/y6"
STATE = "gearbox/rig-1/twin/state"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Certificates of two authorities: files NAME.pem and NAME.key."""
    folder = tmp_path_factory.mktemp("links")
    right, wrong = trustme.CA(), trustme.CA()
    right.cert_pem.write_to_path(str(folder / "right.pem"))
    wrong.cert_pem.write_to_path(str(folder / "wrong.pem"))
    for name, authority, subject in (
        ("router", right, "127.0.0.1"), ("logger", right, "logger.example"), ("forged", wrong, "logger.example"),
        ("elsewhere", right, "192.0.2.1"),
    ):  # fmt: skip
        issued = authority.issue_cert(subject, common_name=name if name != "forged" else "logger")
        (folder / f"{name}.pem").write_bytes(b"".join(part.bytes() for part in issued.cert_chain_pems))
        (folder / f"{name}.key").write_bytes(issued.private_key_pem.bytes())
    (folder / "users").write_text("logger:secret\nviewer:other\n")
    return folder


def own(folder, name):
    return {"certificate": folder / f"{name}.pem", "key": folder / f"{name}.key"}


@contextmanager
def router(links, protocol="tcp"):
    endpoint = f"{protocol}/127.0.0.1:{free_port()}"
    with open_session([endpoint], links=links) as session:
        yield endpoint, session


def is_let_in(endpoint, links):
    try:
        with open_session((), [endpoint], 0.5, links):
            return True
    except NotReachable:
        return False


@pytest.mark.slow
def test_tls_clients_connect_to_a_router_of_their_authority_alone(folder):
    with router(ZenohLinks(**own(folder, "router")), "tls") as (endpoint, _):
        assert is_let_in(endpoint, ZenohLinks(authorities=folder / "right.pem"))
        assert not is_let_in(endpoint, ZenohLinks(authorities=folder / "wrong.pem"))
    with router(ZenohLinks(**own(folder, "elsewhere")), "tls") as (endpoint, _):  # a certificate of another address
        assert not is_let_in(endpoint, ZenohLinks(authorities=folder / "right.pem"))
        assert is_let_in(endpoint, ZenohLinks(authorities=folder / "right.pem", verify_name=False))


@pytest.mark.slow
def test_router_that_demands_certificates_lets_in_those_of_its_authority_alone(folder):
    links = ZenohLinks(**own(folder, "router"), authorities=folder / "right.pem", demand=True)
    with router(links, "tls") as (endpoint, _):
        right = folder / "right.pem"
        assert is_let_in(endpoint, ZenohLinks(authorities=right, **own(folder, "logger")))
        assert not is_let_in(endpoint, ZenohLinks(authorities=right))
        assert not is_let_in(endpoint, ZenohLinks(authorities=right, **own(folder, "forged")))


@pytest.mark.slow
def test_router_with_users_lets_in_those_with_their_password_alone(folder):
    with router(ZenohLinks(users=folder / "users")) as (endpoint, _):
        assert is_let_in(endpoint, ZenohLinks(user="logger", password="secret"))
        assert not is_let_in(endpoint, ZenohLinks(user="logger", password="other"))
        assert not is_let_in(endpoint, ZenohLinks(user="nobody", password="secret"))
        assert not is_let_in(endpoint, ZenohLinks())


def arrives(session, endpoint, links, key):
    """Whether what a client puts reaches the router's own session."""
    came = threading.Event()
    subscriber = session.declare_subscriber("gearbox/**", lambda sample: came.set())
    try:
        with open_session((), [endpoint], 2.0, links) as client:
            deadline = time.monotonic() + 1.5
            while not came.is_set() and time.monotonic() < deadline:
                client.put(key, b"x")
                time.sleep(0.05)
    finally:
        subscriber.undeclare()
    return came.is_set()


def answered(session, endpoint, links, key):
    queryable = session.declare_queryable(key, lambda query: query.reply(key, b"state"))
    try:
        with open_session((), [endpoint], 2.0, links) as client:
            return any(reply.ok is not None for reply in client.get(key, timeout=1.5))
    finally:
        queryable.undeclare()


@pytest.mark.slow
def test_access_control_of_the_example_file_lets_loggers_publish_and_viewers_see(folder):
    logger, viewer = ZenohLinks(user="logger", password="secret"), ZenohLinks(user="viewer", password="other")
    with router(ZenohLinks(config=ACCESS, users=folder / "users")) as (endpoint, session):
        assert arrives(session, endpoint, logger, FRAME)
        assert not arrives(session, endpoint, viewer, FRAME)
        assert not arrives(session, endpoint, logger, STATE)  # results are the service's alone
        assert not arrives(session, endpoint, viewer, STATE)
        assert answered(session, endpoint, viewer, STATE) and answered(session, endpoint, logger, STATE)


@pytest.mark.slow
def test_access_control_knows_clients_by_their_certificates(folder):
    links = ZenohLinks(config=ACCESS, **own(folder, "router"), authorities=folder / "right.pem", demand=True)
    with router(links, "tls") as (endpoint, session):
        right = folder / "right.pem"
        assert arrives(session, endpoint, ZenohLinks(authorities=right, **own(folder, "logger")), FRAME)
        assert not arrives(session, endpoint, ZenohLinks(authorities=right, **own(folder, "router")), FRAME)


def stored(asset):
    """A stranger's answer that everything is stored."""
    newest = ChannelPositionModel(sequence=0, start_time_ns=2**62)
    channels = dict.fromkeys(("accel/y6", "torque/pinion", "encoder/pinion", "encoder/gear"), newest)
    return position_text(PositionModel(asset=asset, instance="forged", accepting=True, channels=channels))


@pytest.mark.slow
@pytest.mark.serve_only("workers of a fleet answer as clients of its router")
def test_a_stranger_at_a_services_own_router_is_not_believed_that_frames_are_stored(tmp_path):
    """A replay believed a stranger that said `stored` of an asset that nobody had adopted."""
    recording = write_recording(tmp_path / "run.mcap")

    def answer(query):
        query.reply(str(query.key_expr), stored("unsw"))

    with (
        service(tmp_path / "data", NEW_ASSETS="ask") as running,
        open_session((), [running.endpoint], 20.0) as stranger,
    ):
        for keys in ("gearbox/*/twin/position", "gearbox/**"):
            stranger.declare_queryable(keys, answer, complete=True)
        with pytest.raises(DeliveryError, match="frames are not stored: asset unsw is unknown to the service"):
            replay(recording, [running.endpoint], 0, wait=5.0)


def test_a_router_that_answers_alone_lets_its_clients_publish_all_but_results():
    endpoint, heard = f"tcp/127.0.0.1:{free_port()}", queue.Queue()
    with (
        zenoh_transport.open_zenoh([endpoint], answers_alone=True) as own,
        open_session((), [endpoint], 20.0) as stranger,
        open_session((), [endpoint], 20.0) as viewer,
    ):
        viewer.declare_subscriber("gearbox/**", lambda sample: heard.put(sample.payload.to_string()))
        stranger.liveliness().declare_token("gearbox/forged/twin/alive")
        own.announce("rig-1")
        wait_until(lambda: (own.publish_state("rig-1", "own"), not heard.empty())[1])
        stranger.put(STATE, "forged")
        stranger.put(FRAME, "frame")
        said = {heard.get(timeout=30)}
        while "frame" not in said:
            said.add(heard.get(timeout=30))
        assert said == {"own", "frame"}
        alive = [str(reply.ok.key_expr) for reply in viewer.liveliness().get("gearbox/*/twin/alive", timeout=30)]
        assert alive == ["gearbox/rig-1/twin/alive"]


def test_a_configuration_of_zenoh_says_itself_who_answers(tmp_path):
    """A second service may then be a client of the first one's router."""
    (tmp_path / "zenoh.json5").write_text("{}")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    links = ZenohLinks(config=tmp_path / "zenoh.json5")
    with (
        zenoh_transport.open_zenoh([endpoint], links=links, answers_alone=True) as own,
        own.answer_positions(lambda stream, reply, sending: None),
        zenoh_transport.open_zenoh((), [endpoint], wait=20.0, answers_alone=True) as second,
        second.answer_positions(lambda stream, reply, sending: reply("second")),
        zenoh_transport.open_publisher([endpoint]) as publisher,
    ):
        wait_until(lambda: b"second" in list(publisher.ask("rig-1", 1.0)))


@pytest.mark.parametrize(
    ("links", "said"),
    [
        (
            lambda folder: ZenohLinks(certificate=folder / "absent", key=folder / "absent"),
            "zenoh_certificate = .*absent",
        ),
        (lambda folder: ZenohLinks(users=folder / "absent"), "zenoh_users = .*cannot be read: no such file"),
        (lambda folder: ZenohLinks(config=folder / "users"), "zenoh_config = .*is no configuration of Zenoh"),
    ],
)
def test_file_that_cannot_be_used_is_one_line(folder, links, said):
    with pytest.raises(InputError, match=said), router(links(folder), "tls"):
        pass


def test_key_of_another_certificate_is_said(folder):
    links = ZenohLinks(certificate=folder / "router.pem", key=folder / "logger.key")
    with pytest.raises(DeliveryError, match="certificate, key and users right"), router(links, "tls"):
        pass


def test_router_that_others_reach_is_protected_or_meant_to_be_open(tmp_path, folder, capsys):
    def admitted(**given):
        return access_of(Settings(listen=["tcp/0.0.0.0:7447"], data=tmp_path, **given))

    assert command(["serve", "--listen", "tcp/0.0.0.0:7447", "--data", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "everybody could publish" in said and "[zenoh] open = true" in said
    certificates = {"zenoh_certificate": folder / "router.pem", "zenoh_private_key": folder / "router.key"}
    with pytest.raises(InputError, match="everybody could publish"):
        admitted(**certificates)  # TLS alone hides what is sent; it lets everybody in
    admitted(**certificates, zenoh_authorities=folder / "right.pem", zenoh_client_certificates=True)
    admitted(zenoh_users=folder / "users")
    admitted(zenoh_config=ACCESS)
    admitted(zenoh_open=True)
    admitted(connect=["tcp/192.0.2.1:7447"])


def test_settings_of_file_make_the_links(tmp_path, folder):
    path = tmp_path / "gear-twin.toml"
    path.write_text('[zenoh]\nuser = "logger"\npassword = "secret"\nauthorities = "ca.pem"\n')
    found = Settings(config=path)
    assert found.zenoh_links == ZenohLinks(user="logger", password="secret", authorities=tmp_path / "ca.pem")
    assert "secret" not in repr(found)


class Info:
    """What a session says of its routers; not to two threads at once."""

    def __init__(self):
        self.routers, self.asked = ["one"], 0

    def routers_zid(self):
        self.asked += 1
        assert self.asked == 1, "asked by two threads at once"
        time.sleep(0.001)
        self.asked -= 1
        return self.routers


def test_a_link_that_was_lost_is_interrupted_until_publishers_may_be_back(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(zenoh_transport.time, "monotonic", lambda: now[0])
    session = SimpleNamespace(info=Info())
    transport = zenoh_transport.ZenohTransport(session, connect=["tcp/router:7447"])
    assert transport.lost() is None and not transport.interrupted()
    session.info.routers = []
    assert "the link to the router at tcp/router:7447 is lost" in transport.lost() and transport.interrupted()
    now[0] += 60.0
    assert transport.interrupted()
    session.info.routers = ["one"]
    assert transport.lost() is None and transport.interrupted()
    now[0] += zenoh_transport.COME_BACK + 0.1
    assert not transport.interrupted()
    session.info.routers = ["another"]  # it ended and came back between two looks
    assert transport.lost() is None and transport.interrupted()
    assert not zenoh_transport.ZenohTransport(session).interrupted()  # a router itself


def test_the_link_may_be_looked_at_by_several_threads():
    """The thread that says that a partition is at work ended with "Already mutably borrowed"."""
    transport = zenoh_transport.ZenohTransport(SimpleNamespace(info=Info()), connect=["tcp/router:7447"])
    with ThreadPoolExecutor(4) as pool:
        looks = [pool.submit(look) for _ in range(50) for look in (transport.lost, transport.interrupted)]
        assert not any(look.result() for look in looks)
