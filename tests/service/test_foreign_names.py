"""Names that others wrote are shown as text: they steer no terminal, close no element, end no line and no label."""

import asyncio
import io
import json
import logging
from types import SimpleNamespace

import numpy as np
import pytest
import service_fakes as fakes
from mqtt_broker import broker_at_work, reading, wait_until
from prometheus_client import generate_latest
from prometheus_client.parser import text_string_to_metric_families
from test_alarms import WORN
from test_health import report_of
from test_mqtt import bridged, settings_for
from test_opcua import asked
from test_opcua import serving as opcua_serving
from test_page_alarms import OK

from service.alarms.keeper import AlarmKeeper
from service.api.collector import family_of
from service.cli import run
from service.cli.show import say
from service.files.import_mapping import load_import_mapping
from service.files.readers import read_table
from service.logs import LimitedLines, formatter
from service.operation.metric_catalogue import METRICS
from service.printable import all_printable, printable
from service.results.alarm_store import AlarmStore
from service.stream.wire.topics import NAME

RATE, N = 12800.0, 12800
X = np.sin(2 * np.pi * 560 * np.arange(N) / RATE) + 0.1 * np.random.default_rng(1).normal(size=N)
NAMES = (
    "acc\x1b[2J\x1b[31mred", "acc\x9b2J", "acc\x1b]0;title\x07", "acc<script>alert(1)</script>", "acc[bold]",
    "acc\u202egnp", "acc\nnew = 1", "acc\r\ngear-twin: all is well", "acc{0.__class__}%s%n", "acc$x^2$ \\in{a} & #1~_",
    "acc`a` | *b* [c](d)", 'acc"}\\ 1\n', "acc+#", "=cmd|' /C calc'!A0", "acc 100 %", "Schwingung µ °C 加速度",
)  # fmt: skip
STEERING = [
    chr(n) for n in (*range(9), *range(11, 32), *range(127, 160), *range(0x202A, 0x202F), *range(0x2066, 0x206A))
]


def steers(text):
    return [c for c in STEERING if c in text]


def as_hdf5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file.attrs["fs"] = RATE
        for name in NAMES:
            data = file.create_dataset(name.replace("/", "÷"), data=X)
            data.attrs["unit"], data.attrs["gain\x1b[2J"] = "g\x1b[2J", 3
            file.create_dataset("odd " + name.replace("/", "÷"), data="text\x1b[2J")


def as_csv(path):
    names = [" ".join(name.split("\n")).replace(",", ";").replace("\r", "") for name in NAMES]
    head = ",".join(["time (s)", *(f"{name} (g)" for name in names), "odd\x1b[2J"])
    rows = "\n".join(f"{i / RATE:.9f}," + f"{x:.6f}," * len(names) + "\x1b[2J" for i, x in enumerate(X.tolist()))
    path.write_bytes(f"{head}\n{rows}\n".encode())


@pytest.mark.parametrize("write", [as_hdf5, as_csv])
def test_a_file_of_any_names_is_proposed_imported_and_shown_without_steering_the_terminal(
    tmp_path, monkeypatch, capsys, write
):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "run.dat")
    assert run(["import", "run.dat", "--guess", "--yes", "--teeth", "23/57"]) == 0
    said = capsys.readouterr()
    assert not steers(said.out + said.err) and "acc[bold]" in said.out
    assert all(line.startswith("gear-twin: ") for line in said.err.splitlines())
    assert not steers((tmp_path / "run.toml").read_text(encoding="utf-8"))
    table, mapping = read_table(tmp_path / "run.dat"), load_import_mapping("run.toml")
    assert {c.columns[0] for c in mapping.channels} <= set(table.names)
    assert len(mapping.channels) == len(NAMES)


def test_a_mapping_finds_a_column_by_the_name_that_the_file_has(tmp_path):
    pytest.importorskip("h5py")
    as_hdf5(tmp_path / "run.h5")
    assert read_table(tmp_path / "run.h5").column("acc\x1b[2J\x1b[31mred").name == "acc?[2J?[31mred"


def test_columns_whose_names_are_then_alike_are_both_there(tmp_path):
    np.savez(tmp_path / "run.npz", **{"acc\x01": X, "acc\x02": 2 * X})
    assert read_table(tmp_path / "run.npz").names == ("acc?", "acc? #2")


@pytest.mark.parametrize("name", NAMES)
def test_what_is_said_and_logged_is_one_line_that_steers_nothing(capsys, name):
    say(f"the name {name}")
    stream = io.StringIO()
    lines = LimitedLines(formatter("text"), 0, stream=stream)
    lines.emit(logging.LogRecord("service.a", logging.WARNING, "", 0, "the name %s", (name,), None))
    for said in (capsys.readouterr().err, stream.getvalue()):
        assert said.count("\n") == 1 and not steers(said.rstrip("\n")) and "the name" in said


def test_words_of_any_script_stay_as_they_are():
    for text in ("Prüfstand 3, µm/s²", "加速度", "می\u200cخواهم", "½ 😀", 'a "b" \\ c'):
        assert printable(text) == text
    assert all_printable({"a\x1b": ["b\x1b", 1.5, None, True]}) == {"a?": ["b?", 1.5, None, True]}


@pytest.mark.parametrize("name", NAMES)
def test_a_label_of_any_text_is_read_back_by_the_parser_of_prometheus(name):
    entry = METRICS["frames"]

    class One:
        def collect(self):
            yield family_of(entry, {(name, name): 3.0})

    (family,) = text_string_to_metric_families(generate_latest(One()).decode())
    ((sample),) = family.samples
    assert set(sample.labels.values()) == {name} and sample.value == 3.0


# -- the page, MQTT, OPC UA and webhooks --------------------------------------------------------------------

WRITTEN = (*NAMES, "<img src=x onerror=alert(1)>", "../../etc/passwd", "+/#", "a/../b", "x" * 5000, "%0a$SYS", "]]>'--")
ODD_ASSETS = (".", "..", "-", "CON", "x.", "gear-twin", "service", "twin", "range", "A", "a", "9" * 64)


def written_everywhere(store, board, asset="unsw"):
    """An asset whose texts others wrote: names, reasons, signatures and notes; its alarm."""
    fakes.campaign(store, board, asset=asset, windows=3)
    keeper = AlarmKeeper(AlarmStore(store.database), webhooks=["http://127.0.0.1:9/hook"])
    of_status = fakes.status("watch", *(f"reason {name}" for name in WRITTEN), action=WRITTEN[0])
    report = {**fakes.traced_report(6000.0, 3), "status": {**of_status, "summary": WRITTEN[5]}}
    report["wear"] = {**report["wear"], "preliminary": {"reasons": list(WRITTEN)}}
    keeper.window(asset, 1_700_000_000 * 10**9, {"index": 3, "quality": "good"}, report_of(WORN), OK)
    (raised,) = keeper.open(asset)
    signed, _ = keeper.sign(asset, raised["id"], "acknowledged", WRITTEN[5], " ".join(WRITTEN))
    found = {**signed, "reason": " ".join(WRITTEN), "place": WRITTEN[0], "rule": WRITTEN[5]}
    store.note(asset, [("alarm", {"verb": "raised", "alarm": found})])
    board.update(asset, report=report, alarms=(found,), rig={"schema": "gear-rig/1", "name": WRITTEN[5]})
    return keeper, found


def texts_of(value):
    """Every text of a document, keys among them."""
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, list):
        return [text for item in value for text in texts_of(item)]
    return [value] if isinstance(value, str) else []


def is_shown(texts):
    """Each name is there, and none steers."""
    whole = " ".join(texts)
    assert not steers(whole) and "\n" not in whole and "\r" not in whole
    assert all(printable(name) in whole for name in WRITTEN)


@pytest.mark.slow
def test_mqtt_has_the_topics_of_each_asset_and_texts_that_steer_nothing(tmp_path, store, board):
    for asset in ODD_ASSETS:
        assert NAME.fullmatch(asset)
        board.update(asset)
    with broker_at_work() as broker, reading(broker.port) as reader:
        settings = settings_for(broker.url, tmp_path, mqtt_full_state=True)
        with bridged(settings, board, store):
            wait_until(lambda: reader.latest(f"gear-twin/{ODD_ASSETS[0]}/result"))
            written_everywhere(store, board)
            board.update("unsw", last_event_id=store.last_event_id("unsw"))
            wait_until(lambda: reader.latest("gear-twin/unsw/alarm"))
            wait_until(lambda: (reader.latest("gear-twin/unsw/alarms") or {}).get("alarms"))
            wait_until(lambda: all(reader.latest(f"gear-twin/{asset}/result") for asset in ODD_ASSETS))
    of_asset = ("result", "alarms", "state")
    expected = {f"gear-twin/{asset}/{what}" for asset in (*ODD_ASSETS, "unsw") for what in of_asset}
    assert {m.topic for m in reader.messages} == expected | {"gear-twin/service", "gear-twin/unsw/alarm"}
    for what in ("result", "alarms", "alarm", "state"):
        is_shown(texts_of(reader.latest(f"gear-twin/unsw/{what}")))
    for asset in ODD_ASSETS:
        assert reader.latest(f"gear-twin/{asset}/result")["asset"] == asset


@pytest.mark.slow
def test_opc_ua_has_an_object_of_each_asset_and_texts_that_steer_nothing(tmp_path, store, board):
    _, alarm = written_everywhere(store, board)
    for asset in ODD_ASSETS:
        board.update(asset)

    async def question(reader):
        await reader.until(f"{ODD_ASSETS[-1]}/window", (None, "BadWaitingForInitialData"))
        for asset in ODD_ASSETS:
            assert (await reader.read(f"{asset}/level")) == ("no_verdict", "Good"), asset
        for name in ("reasons", "depth_note", "alarms"):
            is_shown((await reader.read(f"unsw/{name}"))[0])
        assert (await reader.read("unsw/action"))[0] == printable(WRITTEN[0])
        heard = asyncio.Queue()
        handler = SimpleNamespace(event_notification=lambda event: heard.put_nowait(event))
        subscription = await reader.client.create_subscription(20, handler)
        await subscription.subscribe_events()
        board.update("unsw", alarms=({**alarm, "level": "watch"},))
        event = await heard.get()
        assert event.SourceName == "unsw"
        is_shown([event.Message.Text])

    with opcua_serving(board, tmp_path) as (url, _):
        asked(url, question)


def test_a_webhook_has_valid_json_whose_texts_steer_nothing(store, board):
    keeper, _ = written_everywhere(store, board)
    (raising,) = keeper.store.due(2**62)
    keeper.store.sent(raising[0])
    ((_, _, _, body, _, _),) = keeper.store.due(2**62)
    told = json.loads(body)
    assert told["verb"] == "acknowledged" and told["alarm"]["acknowledgement"]["by"] == printable(WRITTEN[5])
    is_shown(texts_of(told))


@pytest.mark.slow
@pytest.mark.parametrize("path", ["/", "/#/alarms", "/#/asset/unsw", "/#/asset/unsw/alarms", "/#/asset/unsw/data"])
def test_the_page_shows_what_others_wrote_as_text_and_nothing_else(open_page, store, board, path):
    written_everywhere(store, board)
    page = open_page(path)
    page.wait_for_function("document.querySelector('main').textContent.includes('acc')")
    shown = page.evaluate(
        "document.title + [...document.querySelectorAll('*')].map((e) => [e.title ?? '', "
        "e.value ?? '', e.ariaLabel ?? '', ...Object.values(e.dataset)]).flat().join(' ')"
        " + document.querySelector('main').textContent"
    )
    assert not steers(shown)
    assert page.locator("main img, main script, main i, main b").count() == 0
