"""Unknown assets: where people are to be asked, nothing of them is used or kept until somebody adopts them."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import threading
import time
import tracemalloc
from pathlib import Path

import fake_twin
import httpx
import pytest
from memory_transport import MemoryNetwork
from service_streams import Service, SqliteFile, wait_until, write_recording
from test_asset_life import revolutions
from test_decisions import post
from test_other_parts import serving

from service.access.access import Access
from service.access.keys import KeyStore
from service.access.roles import Role
from service.api import create_app
from service.cli import run
from service.errors import DeliveryError
from service.results.offers import Offers
from service.results.sql_store import SqlStore
from service.results.unknown_assets import ASKED_WITHIN, NEXT_QUESTION, ON_THE_WAY, Unknown, UnknownAssets
from service.runtime.replay import replay
from service.settings import Settings
from service.stream.inbox import Inbox
from service.stream.sources.mcap import Recording

WINDOWS = 3
FIRST = [10, 610, 1210]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "unsw.mcap", WINDOWS)


class Clock:
    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


def asking(known=(), clock=None, **given):
    clock = clock or Clock()
    found = UnknownAssets(asks=True, clock=clock, now_ns=lambda: round(clock.now * 1e9), **given)
    found.begin(lambda stream: stream in known, ())
    return found


def listed(unknown):
    return {name: each for name, each in unknown.entries().items() if each.dismissed_ns is None}


# -- the list --------------------------------------------------------------------------------------------


def test_an_unknown_asset_is_listed_with_what_is_known_of_it_and_has_no_queue():
    unknown = asking({"press"})
    inbox = Inbox(admits=unknown.admits)
    assert inbox.offer("gearbox/press/accel/y6", b"..")
    for name in ("y6", "y6", "x6"):
        assert not inbox.offer(f"gearbox/new/accel/{name}", b"..")
    (entry,) = listed(unknown).values()
    assert (entry.asset, entry.frames, entry.channels) == ("new", 3, {"accel/y6", "accel/x6"})
    assert not inbox.waits("new") and inbox.waits("press") and inbox.refused["unknown_asset"] == 3


@pytest.mark.slow
def test_twenty_thousand_names_leave_a_short_list_and_nothing_else(caplog):
    unknown = asking(most=100)
    inbox = Inbox(admits=unknown.admits)
    for _ in range(3):
        inbox.offer("gearbox/press-1/accel/y6", b"..")  # a machine that does send

    def flood(numbers):
        for number in numbers:
            inbox.offer(f"gearbox/asset-{number:05d}/accel/y6", b"..")

    with caplog.at_level(logging.INFO):
        tracemalloc.start()
        flood(range(10_000))
        gc.collect()
        before = tracemalloc.take_snapshot()
        flood(range(10_000, 20_000))
        gc.collect()
        grown = tracemalloc.take_snapshot().compare_to(before, "filename")
        tracemalloc.stop()
    kept = sum(s.size_diff for s in grown if "/service/" in str(s.traceback))
    assert kept < 800_000, grown[:5]  # a name that is kept takes over 80 bytes; the table of the bounded cache 590 kB
    assert len(listed(unknown)) == 100 and listed(unknown)["press-1"].frames == 3  # the quietest go first
    assert (unknown.frames, unknown.forgotten) == (20_003, 19_901)
    assert inbox.depth == inbox.bytes == 0 and inbox.empty
    assert len([record for record in caplog.records if record.name.startswith("service.")]) == 1


def test_one_that_is_silent_for_long_leaves_the_list_and_a_dismissed_one_does_not_come_back_before():
    clock = Clock()
    unknown = asking(clock=clock, expire=60.0)
    unknown.admits("a", "accel/y6")
    unknown.admits("b", "accel/y6")
    unknown.dismiss("b", round(clock.now * 1e9))
    clock.now += 50
    unknown.admits("a", "accel/y6")
    unknown.admits("b", "accel/y6")
    assert set(listed(unknown)) == {"a"} and unknown.frames == 4
    clock.now += 59
    assert set(listed(unknown)) == {"a"}
    clock.now += 2
    unknown.admits("b", "accel/y6")
    assert set(listed(unknown)) == {"b"}


def test_rig_files_for_unknown_assets_are_bounded_in_all():
    unknown = asking(most=1000)
    for number in range(300):
        unknown.offered(f"a{number}", {"n": number}, 60_000)
    kept = [u for u in listed(unknown).values() if u.rig is not None]
    assert sum(u.rig_bytes for u in kept) <= 2**21 and "a299" in {u.asset for u in kept}


@pytest.mark.parametrize("dismissed", [False, True])
def test_a_publisher_that_keeps_its_frames_is_let_in_by_a_question_after_a_pause_and_sends_all_of_them(dismissed):
    """Frames from the middle of a burst would be acknowledged with all before them, and those on their way when it asks
    would have closed windows before these come again.
    """
    clock, known = Clock(), set()
    unknown = asking(known, clock)
    assert not unknown.asked("new") and not unknown.admits("new", "accel/y6")
    if dismissed:
        unknown.dismiss("new", round(clock.now * 1e9))
        assert not unknown.admits("new", "accel/y6")
    known.add("new")
    assert not unknown.admits("new", "accel/y6") and not unknown.renewed("new")
    assert not unknown.asked("new")
    clock.now += 0.9 * ON_THE_WAY
    assert not unknown.admits("new", "accel/y6") and not unknown.asked("new")  # sent before the question
    clock.now += 1.1 * ON_THE_WAY
    assert unknown.asked("new") and unknown.renewed("new") and unknown.admits("new", "accel/y6")
    assert listed(unknown) == {}


def test_an_asset_of_which_nothing_was_left_out_is_let_in_by_the_first_question():
    known = set()
    unknown = asking(known, Clock())
    known.add("new")
    assert unknown.asked("new") and unknown.admits("new", "accel/y6")


def test_a_publisher_that_never_pauses_is_waited_for_no_longer_than_one_that_asks_no_more():
    clock, known = Clock(), set()
    unknown = asking(known, clock)
    assert not unknown.asked("new")
    known.add("new")
    answers = []
    end = clock.now + NEXT_QUESTION + 1.0
    while clock.now < end:
        answers.append(unknown.admits("new") and unknown.asked("new"))
        clock.now += 0.1
    assert answers[0] is False and answers[-1] is True


def test_a_plain_publisher_is_let_in_at_once_and_one_that_asks_no_more_is_waited_for_a_while():
    clock, known = Clock(), set()
    unknown = asking(known, clock)
    for name in ("plain", "gone", "left"):
        assert not unknown.admits(name)
    unknown.asked("left")
    clock.now += ASKED_WITHIN
    unknown.asked("gone")
    known |= {"plain", "gone", "left"}
    assert unknown.admits("plain") and unknown.admits("left") and not unknown.admits("gone")
    clock.now += NEXT_QUESTION + 0.1
    assert unknown.admits("gone")


# -- settings --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "rule", "reason"),
    [({}, "adopt", "only this computer"), ({"http": "0.0.0.0:8080"}, "ask", "http = 0.0.0.0"),
     ({"listen": ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7447"]}, "ask", "listen = tls/0.0.0.0:7447"),
     ({"listen": ["unixsock-stream/gear-twin.sock", "tcp/[::1]:7447"]}, "adopt", "only"),
     ({"listen": ["tcp/0.0.0.0:7447"], "connect": ["tcp/127.0.0.1:1"]}, "adopt", "only"),
     ({"connect": ["tcp/router:7447"]}, "ask", "connect = tcp/router:7447"),
     ({"new_assets": "ask"}, "ask", None), ({"http": "0.0.0.0:8080", "new_assets": "adopt"}, "adopt", None)],
)  # fmt: skip
def test_assets_are_adopted_only_where_nobody_else_can_reach_the_service(given, rule, reason):
    found, why = Settings(**given).rule_of_new_assets
    assert found == rule and (why is None) is (reason is None) and (reason is None or reason in why)


def test_config_prints_the_rule_that_holds_and_why(tmp_path, capsys):
    file = tmp_path / "plant.toml"
    file.write_text('[http]\naddress = "0.0.0.0:8080"\n[assets]\ndeclared = ["press-1"]\nrigs = {press-2 = "p.toml"}\n')
    assert run(["config", "--config", str(file)]) == 0
    said = capsys.readouterr().out
    assert 'new = "ask"' in said and "other computers can reach http = 0.0.0.0" in said
    assert f'rigs = {{press-2 = "{tmp_path / "p.toml"}"}}' in said  # beside the file


# -- the service -----------------------------------------------------------------------------------------


@pytest.fixture
def network():
    return MemoryNetwork()


@pytest.fixture
def running(tmp_path, network):
    with serving(tmp_path / "data", network, SqliteFile(tmp_path / "data"), new_assets="ask") as running:
        yield running


def unknown_of(running):
    return {each["asset"]: each for each in running.get("/v1/unknown-assets")["assets"]}


class Replaying:
    """A replay in a thread."""

    def __init__(self, network, recording, **given):
        self.lines, self.failed = [], None
        self.thread = threading.Thread(target=self._run, args=(network, recording), kwargs=given)
        self.thread.start()

    def _run(self, network, recording, **given):
        try:
            replay(recording, (), 0, publish_to=network.open_publisher, on_fault=self.lines.append, **given)
        except DeliveryError as error:
            self.failed = error

    def end(self):
        self.thread.join(60)
        assert not self.thread.is_alive()
        return self.failed


def position(running, network, stream="unsw"):
    """What is said of a stream: by REST, or where that does not know it, to a publisher."""
    if Service.fleets is None:
        return running.get(f"/v1/assets/{stream}/position")
    answers = []
    network.on_position(stream, answers.append)
    wait_until(lambda: answers)
    return json.loads(answers[0])


def tables(folder):
    with Service(folder).store() as store:
        return SqlStore(store.database).assets()


@pytest.mark.slow
def test_a_replay_into_a_service_that_asks_says_why_it_fails_and_leaves_nothing(running, network, recording, tmp_path):
    sent = Replaying(network, recording, wait=2.0)
    error = sent.end()
    assert (
        "asset unsw is unknown to the service: adopt it on the page, or by gear-twin remote assets adopt unsw"
        in str(error)
    )
    assert any("is unknown to the service" in line for line in sent.lines)
    wait_until(lambda: "unsw" in unknown_of(running))
    entry = unknown_of(running)["unsw"]
    assert entry["frames"] > 0 and "accel/y6" in entry["channels"]
    assert running.get("/v1/assets") == [] and tables(tmp_path / "data") == ()
    said = position(running, network)
    assert said["accepting"] is False and "unknown to the service" in said["reason"]


@pytest.mark.slow
def test_adopted_while_its_frames_come_nothing_is_lost(running, network, recording, tmp_path):
    sent = Replaying(network, recording, wait=30.0)
    wait_until(lambda: unknown_of(running).get("unsw", {}).get("frames", 0) > 8)
    status, answer = post(running, "/v1/unknown-assets/unsw/adopt", {"by": "Ann", "note": "new press"})
    assert (status, answer["asset"]) == (201, "unsw")
    assert sent.end() is None
    windows = running.wait_for_windows(WINDOWS)
    assert revolutions(windows) == FIRST and all(w["quality"] == "good" for w in windows)
    assert unknown_of(running) == {} and position(running, network)["accepting"] is True
    with running.store() as store:
        adopted = store.events("unsw", 0)[0].data
    assert (adopted["kind"], adopted["by"], adopted["note"]) == ("adopted", "Ann", "new press")
    assert [e["action"] for e in running.get("/v1/audit")] == ["asset adopted"]


@pytest.mark.slow
def test_a_declared_asset_needs_nobody_and_one_with_a_rig_file_of_its_own_has_that(tmp_path, network, recording):
    rig = tmp_path / "own.toml"
    rig.write_text('name = "own"\n[gears.pinion]\nteeth = 19\n[gears.gear]\nteeth = 52\n')
    given = {"new_assets": "ask", "assets": ["other"], "asset_rigs": {"unsw": rig}}
    with serving(tmp_path / "data", network, SqliteFile(tmp_path / "data"), **given) as running:
        assert [a["asset"] for a in running.get("/v1/assets")] == ["other", "unsw"]
        replay(recording, (), 0, publish_to=network.open_publisher)
        assert revolutions(running.wait_for_windows(WINDOWS)) == FIRST
        assert running.get("/v1/assets/unsw/rig")["name"] == "own"


@pytest.mark.slow
def test_renamed_assets_are_known_under_their_earlier_name(tmp_path, network, recording):
    data = tmp_path / "data"
    given = {"new_assets": "ask", "assets": ["unsw"]}
    with serving(data, network, SqliteFile(data), **given) as running:
        assert post(running, "/v1/assets/unsw/changes", {"kind": "renamed", "name": "press-7"})[0] == 201
        replay(recording, (), 0, publish_to=network.open_publisher)
        assert revolutions(running.wait_for_windows(WINDOWS, "press-7")) == FIRST
    with serving(data, network, SqliteFile(data), **given) as running:
        assert [a["asset"] for a in running.get("/v1/assets")] == ["press-7"]
        wait_until(lambda: position(running, network)["accepting"] is True)


@pytest.mark.slow
def test_in_a_service_that_adopts_the_first_frame_makes_an_asset(tmp_path, network, recording):
    with serving(tmp_path / "data", network, SqliteFile(tmp_path / "data")) as running:
        replay(recording, (), 0, publish_to=network.open_publisher)
        running.wait_for_windows(WINDOWS)
        assert running.get("/v1/unknown-assets")["asks"] is False and unknown_of(running) == {}


@pytest.mark.slow
def test_dismissed_on_the_command_line(running, network, recording, capsys):
    Replaying(network, recording, wait=1.0).end()
    wait_until(lambda: unknown_of(running))
    url = f"http://{running.http}"
    assert run(["remote", "assets", "unknown", "--url", url]) == 0
    said = capsys.readouterr().out
    assert "unsw" in said and "accel/y6" in said and "gear-twin remote assets adopt NAME" in said
    assert run(["remote", "assets", "dismiss", "unsw", "--by", "me", "--url", url]) == 0
    capsys.readouterr()
    assert run(["remote", "assets", "unknown", "--url", url, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["assets"] == []
    assert run(["remote", "assets", "adopt", "unsw", "--url", url]) == 2
    assert "no frame of 'unsw' has come" in capsys.readouterr().err
    assert [e["action"] for e in running.get("/v1/audit")] == ["unknown asset dismissed"]


class AdoptedAfter(MemoryNetwork):
    """A network in which the asset is adopted between two frames."""

    def __init__(self, frames):
        super().__init__()
        self.frames, self.count, self.adopt = frames, 0, None

    def publish(self, frame):
        super().publish(frame)
        self.count += 1
        if self.count == self.frames:
            assert self.adopt()[0] == 201


def adopted_between_frames(running):
    """The asset is adopted as soon as it is listed, which is within a second."""
    wait_until(lambda: unknown_of(running))
    return post(running, "/v1/unknown-assets/unsw/adopt", {})


@pytest.mark.parametrize(
    "frames", [9, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2, 31, 32, 33, 50, 64, 95, 96))]
)
def test_wherever_in_a_burst_an_asset_is_adopted_all_that_its_publisher_has_sent_is_stored(tmp_path, recording, frames):
    """Frames of the same burst that had been left out before would have been forgotten with those that were stored."""
    network, data = AdoptedAfter(frames), tmp_path / "data"
    with serving(data, network, SqliteFile(data), new_assets="ask") as running:
        network.adopt = lambda: adopted_between_frames(running)
        replay(recording, (), 0, publish_to=network.open_publisher, wait=20.0)
        windows = running.wait_for_windows(WINDOWS)
        assert revolutions(windows) == FIRST and all(w["quality"] == "good" and not w["faults"] for w in windows)


@pytest.mark.slow
@pytest.mark.parametrize("frames", [9, 50])
def test_frames_from_the_middle_of_a_burst_make_no_window_of_their_own(tmp_path, recording, frames, monkeypatch):
    """They were a torn window, which was stored, and the frames before them were forgotten with them."""
    monkeypatch.setattr(fake_twin, "JOINED", 3.0)  # as in the service: the publisher asks before it sends on
    network, data = MemoryNetwork(), tmp_path / "data"
    with Recording(recording) as opened:
        burst = list(opened.messages())[: frames + 8]
    with serving(data, network, SqliteFile(data), new_assets="ask") as running:
        wait_until(lambda: network.inbox is not None)
        network.ask("unsw", 10.0)  # a publisher that asks only now and then has its answer before the adoption
        for number, frame in enumerate(burst):
            if number == frames:
                assert adopted_between_frames(running)[0] == 201
            network.publish(frame)
        time.sleep(6.0)  # silence that would end a window
        assert not running.get("/v1/assets/unsw")["windows"]
        replay(recording, (), 0, publish_to=network.open_publisher, wait=20.0)
        windows = running.wait_for_windows(WINDOWS)
        assert revolutions(windows) == FIRST and all(w["quality"] == "good" and not w["faults"] for w in windows)


@pytest.mark.slow
def test_a_flood_of_names_leaves_no_assets_files_queues_or_log_lines(running, network, recording, tmp_path, caplog):
    wait_until(lambda: network.inbox is not None)
    before = {path for path in (tmp_path / "data").rglob("*") if not path.name.endswith(("-wal", "-shm"))}
    answers, text = [], b'name = "forged"'
    for number in range(20_000):
        network.inbox.offer(f"gearbox/flood-{number}/accel/y6", b"..")
        network.inbox.announce(f"gearbox/flood-{number}/accel/y6", there=True)
        if number % 20 == 0:
            network.on_position(f"flood-{number}", answers.append)
            network.on_rig(f"flood-{number}", text)
    assert len(answers) == 1000 and not any(json.loads(a)["accepting"] for a in answers)
    wait_until(lambda: len(unknown_of(running)) == 100)
    assert network.inbox.empty and running.get("/v1/assets") == []
    assert {path for path in (tmp_path / "data").rglob("*") if not path.name.endswith(("-wal", "-shm"))} == before
    assert len([r for r in caplog.records if "flood" in r.getMessage()]) == 1
    assert post(running, "/v1/assets", {"asset": "unsw"})[0] == 201  # one that is declared is not disturbed

    def announced():
        network.inbox.announce("gearbox/unsw/accel/y6", there=True)
        return network.inbox.announced("unsw") == ("accel/y6",)

    wait_until(announced)
    replay(recording, (), 0, publish_to=network.open_publisher)
    assert revolutions(running.wait_for_windows(WINDOWS)) == FIRST
    assert tables(tmp_path / "data") == ("unsw",)


# -- who may ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("action", ["adopt", "dismiss"])
@pytest.mark.parametrize(
    ("role", "status"), [(None, 401), (Role.read, 403), (Role.operate, 403), (Role.administer, None)]
)
def test_only_who_administers_adopts_and_dismisses(store, board, tmp_path, action, role, status):
    keys = KeyStore(tmp_path / "keys")
    admin = keys.add("admin", Role.administer)
    key = None if role is None else keys.add("anna", role)
    offers = Offers(store.database)
    offers.write(assets=[Unknown(asset="new", first_ns=1, last_ns=1, frames=1)])
    app = create_app(board, store, access=Access(keys))

    async def ask(method, path, credential, **given):
        transport = httpx.ASGITransport(app=app, client=("192.0.2.9", 4711))
        headers = {"Authorization": f"Bearer {credential}"} if credential else {}
        async with httpx.AsyncClient(transport=transport, base_url="http://twin") as caller:
            return await caller.request(method, path, headers=headers, **given)

    answer = asyncio.run(ask("POST", f"/v1/unknown-assets/new/{action}", key, json={"by": "Bob"}))
    assert answer.status_code == (status or {"adopt": 201, "dismiss": 200}[action])
    assert ("new" in store.assets()) is (status is None and action == "adopt")
    assert (offers.find("new") is None) is (status is None)
    (entry,) = [e for e in asyncio.run(ask("GET", "/v1/audit", admin)).json() if e["action"] != "key"]
    assert (entry["outcome"] == "done") if status is None else (entry["action"] == "refused")


# -- real processes --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_killed_between_the_adoption_and_the_first_window(tmp_path, recording):
    running = Service(tmp_path, NEW_ASSETS="ask").start()
    try:
        with pytest.raises(DeliveryError, match="unknown to the service"):
            replay(recording, [running.endpoint], 0, wait=2.0)
        assert post(running, "/v1/unknown-assets/unsw/adopt", {})[0] == 201
        running.end(9)
        running.start()
        assert [a["asset"] for a in running.get("/v1/assets")] == ["unsw"] and unknown_of(running) == {}
        replay(recording, [running.endpoint], 0)
        assert revolutions(running.wait_for_windows(WINDOWS)) == FIRST
    finally:
        running.end()


@pytest.mark.slow
def test_adopted_while_a_replay_over_zenoh_waits(tmp_path, recording):
    running = Service(tmp_path, NEW_ASSETS="ask").start()
    try:
        failed = []

        def send():
            try:
                replay(recording, [running.endpoint], 0, wait=30.0)
            except DeliveryError as error:
                failed.append(error)

        thread = threading.Thread(target=send)
        thread.start()
        wait_until(lambda: "unsw" in unknown_of(running))
        assert post(running, "/v1/unknown-assets/unsw/adopt", {})[0] == 201
        thread.join(40)
        assert not failed and not thread.is_alive()
        windows = running.wait_for_windows(WINDOWS)
        assert revolutions(windows) == FIRST and all(w["quality"] == "good" for w in windows)
    finally:
        running.end()


@pytest.mark.slow
def test_a_service_that_receives_twenty_thousand_names_grows_no_more(tmp_path):
    import zenoh

    from service.transport.zenoh_session import open_session

    running = Service(tmp_path, NEW_ASSETS="ask").start()

    def size():
        files = [Path("/proc") / str(process) / "status" for process in running.process.all]
        lines = [line for file in files for line in file.read_text().splitlines() if line.startswith("VmRSS")]
        return sum(int(line.split()[1]) for line in lines) / 1024  # [MB]

    def disk():
        paths = [path for path in tmp_path.rglob("*") if path.is_file() and path != running.err]
        return sum(path.stat().st_size for path in paths if not path.name.endswith(("-wal", "-shm")))

    try:
        with open_session(connect=[running.endpoint], wait=20.0) as session:

            def send(numbers):
                for number in numbers:
                    for key, payload in (("accel/y6", bytes(2000)), ("rig", b'name = "forged"')):
                        session.put(
                            f"gearbox/n{number}/{key}", payload, congestion_control=zenoh.CongestionControl.BLOCK
                        )
                wait_until(lambda: running.get("/v1/unknown-assets")["frames"] == numbers[-1] + 1)

            send(range(2000))
            before, files = size(), disk()
            send(range(2000, 22_000))
            assert size() - before < 20 and disk() - files < 200_000  # MB and bytes: rows of those that are listed
        assert len(unknown_of(running)) == 100 and len(running.said()[1].splitlines()) <= 2
    finally:
        running.end()
