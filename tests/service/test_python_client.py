"""gear-twin from Python: results of a recording and of a service, and the notebook of the documentation."""

from __future__ import annotations

import json
import re
import threading
from contextlib import closing
from datetime import date
from pathlib import Path

import nbformat
import pytest
import service_fakes as fakes
from memory_transport import MemoryNetwork
from nbclient import NotebookClient
from service_streams import SqliteFile
from test_alarms import NEAR, WORN
from test_asset_baseline import with_windows
from test_health import report_of
from test_other_parts import serving
from test_what_if_answers import ASSET, assess_into

import gear_twin
from service.alarms.keeper import AlarmKeeper
from service.contract.base import not_available
from service.results.alarm_store import AlarmStore

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "examples" / "first-figure.ipynb"


@pytest.fixture
def service(address, store, board):
    fakes.campaign(store, board)
    with gear_twin.Client(address) as client:
        yield client


def test_assets_and_states_are_typed(service):
    (machine,) = service.assets()
    assert machine.asset == "unsw" and machine.windows == 14
    result = service.asset("unsw")
    assert result.answer.asset == result.asset == "unsw"
    assert result.depth_um.p05 < result.depth_um.median < result.depth_um.p95
    assert result.life_hours.median > 0 and result.status.level == machine.status.level


def test_keys_of_a_newer_service_do_not_disturb_the_client(service):
    newer = {**service.asset("unsw").json, "something_new": 1}
    assert gear_twin.Result(newer).answer.asset == "unsw"


def test_all_windows_are_read_page_by_page(service, monkeypatch):
    monkeypatch.setattr("gear_twin.client.PAGE", 4)
    assert [w.index for w in service.windows("unsw")] == list(range(14))
    assert [w.index for w in service.windows("unsw", after=11)] == [12, 13]


def test_an_inspection_answers_with_the_models_own_depth(service):
    answer = service.inspect("unsw", revolutions=9000, max_depth_um=200.0, std_um=5.0)
    assert answer.inspection.max_depth_um == 200.0 and answer.twin.max_depth_um.median > 0


@pytest.fixture
def worn(store, board, service):
    """The service with an open alarm."""
    keeper = AlarmKeeper(AlarmStore(store.database))
    ok = {"level": "ok", "reason": "the latest window is good"}
    keeper.window("unsw", 1, {"index": 0, "quality": "good"}, report_of(WORN), ok)
    board.update("unsw", alarms=keeper.open("unsw"))
    return service


def test_alarms_are_listed_acknowledged_and_cleared_by_name(worn):
    (alarm,) = worn.alarms()
    assert (alarm.asset, alarm.quantity, alarm.active, alarm.acknowledged) == ("unsw", "depth", True, False)
    signed = worn.acknowledge("unsw", alarm.id, "Anna", "seen")
    assert signed.acknowledged and (signed.acknowledgement.by, signed.acknowledgement.note) == ("Anna", "seen")
    assert worn.clear("unsw", alarm.id, by="Ben").state == "closed"
    assert list(worn.alarms("unsw")) == [] and [a.id for a in worn.alarms("unsw", closed=True)] == [alarm.id]
    with pytest.raises(gear_twin.ServiceError, match="closed already"):
        worn.clear("unsw", alarm.id, by="Ben")


def test_all_alarms_are_read_page_by_page(service, store, board, monkeypatch):
    keeper = AlarmKeeper(AlarmStore(store.database))
    for asset, found in (("mill", NEAR), ("pump", WORN), ("saw", WORN)):
        fakes.campaign(store, board, asset=asset, windows=4)
        keeper.window(asset, 1, {"index": 0, "quality": "good"}, report_of(found), {"level": "ok", "reason": ""})
    monkeypatch.setattr("gear_twin.client.PAGE", 2)
    assert [a.asset for a in service.alarms()] == ["mill", "pump", "saw"]  # the most urgent of a page is not its last


def test_changes_are_entered_and_listed(service):
    made = service.change("unsw", "sensor_moved", sensor="y6", by="Anna", note="other flank")
    assert (made.kind, made.sensor, made.by, made.done) == (
        "sensor_moved",
        "y6",
        "Anna",
        False,
    )  # nobody carries it out
    assert [(c.kind, c.note) for c in service.changes("unsw")] == [("sensor_moved", "other flank")]
    with pytest.raises(gear_twin.ServiceError, match="sensor"):
        service.change("unsw", "sensor_moved")


@pytest.mark.slow
def test_a_baseline_is_learned_given_and_removed(tmp_path):
    data = with_windows(tmp_path / "data")
    with (
        serving(data, MemoryNetwork(), SqliteFile(data)) as running,
        gear_twin.Client(f"http://{running.http}") as service,
    ):
        assert not service.baseline("bench").own
        learned = service.learn_baseline("bench", range(4), by="Anna", note="new gears")
        assert learned.own and learned.by == "Anna" and learned.windows == [0, 1, 2, 3]
        assert learned.baseline.sufficiency.recordings == 4
        assert service.learn_baseline("bench", [4], add=True).baseline.sufficiency.recordings == 5
        assert service.signals("bench").windows[-1].index == 4
        shown = service.signal("bench", 4, "spectrum", "accel/b", points=200)
        assert shown.channel == "accel/b" and shown.x.unit == "Hz" and len(shown.x.values) <= 200
        (file,) = (running.folder / "baselines").iterdir()
        file = file.rename(tmp_path / "copy.baseline")
        assert not service.remove_baseline("bench", by="Ben").own
        assert service.give_baseline("bench", file, by="Ben").by == "Ben"
        with pytest.raises(gear_twin.ServiceError, match="window 17 is none of the present gears"):
            service.learn_baseline("bench", [17])


def test_trends_come_with_their_units(service):
    found = service.indicators("unsw")
    assert len(found.index) == 14 and {q.name for q in found.quantities} >= {"rms_measured"}
    assert [q.unit for q in service.indicators("unsw", "rms_measured").quantities] == ["m/s²"]


def test_what_a_duty_and_a_date_are_sent_as(service, monkeypatch):
    sent = []

    def answer(path, body, **_):
        sent.append((path, {name: value for name, value in body.items() if value is not None}))
        raise gear_twin.ServiceError(409, "no window of unsw has been assessed yet")

    monkeypatch.setattr(service, "post", answer)
    with pytest.raises(gear_twin.ServiceError):
        service.what_if("unsw", [(10.0, 12.0, 0.7), (5.0, 20.0, 0.3)], until=date(2027, 3, 1), hours_per_day=8)
    points = [{"speed_hz": 10.0, "torque_nm": 12.0, "share": 0.7}, {"speed_hz": 5.0, "torque_nm": 20.0, "share": 0.3}]
    assert sent == [("/v1/assets/unsw/what-if", {"duty": points, "until": "2027-03-01", "hours_per_day": 8})]


@pytest.mark.slow
def test_life_under_another_duty_is_typed(address, board, store):
    assess_into(store, board)
    with gear_twin.Client(address) as service:
        found = service.what_if(ASSET, [(5.0, 8.0)], until=date(2026, 3, 1), hours_per_day=2.0)
        assert found.hours.p05 < found.hours.median and found.target.date.startswith("2026-03-01")
        assert service.what_if(ASSET).hours.median == pytest.approx(found.present_hours.median, rel=1e-9)


def test_a_refusal_is_one_error_with_the_words_of_the_service(service):
    with pytest.raises(gear_twin.ServiceError, match="no asset 'other' has been seen; known assets: unsw") as refused:
        service.asset("other")
    assert refused.value.status == 404
    with pytest.raises(gear_twin.ServiceError, match="std_um"):
        service.inspect("unsw", revolutions=1, max_depth_um=1, std_um=-1)
    with pytest.raises(gear_twin.ServiceError):
        next(service.events("other"))


def test_events_come_as_they_happen_and_from_where_they_were_left(service, store, board):
    with closing(service.events("unsw", after=0)) as events:
        seen = next(events)
    assert seen.kind == "window" and seen.data["index"] == 0
    last, found = store.last_event_id("unsw"), []

    def listen():
        with closing(service.events("unsw", after=last)) as events:
            found.append(next(events))

    listening = threading.Thread(target=listen)
    listening.start()
    fakes.take(store, board, "unsw", 14, 20000.0)
    listening.join(10)
    assert found and found[0].id > last and found[0].data["index"] == 14


@pytest.mark.slow
def test_a_result_is_drawn_and_reported(service, tmp_path):
    result = service.asset("unsw")
    assert len(result.plot().axes) == 2
    result.report(tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")
    table = result._repr_html_()
    assert "unsw" in table and "µm" in table
    missing = {**result.json, "wear": not_available("no model"), "rul": not_available("no model"), "windows": []}
    assert "not available" in gear_twin.Result(missing)._repr_html_()
    with pytest.raises(ValueError, match="no trend"):
        gear_twin.Result(missing).plot()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_notebook_of_the_documentation_runs_and_shows_what_is_printed_in_it(monkeypatch):
    shown = nbformat.read(NOTEBOOK, as_version=4)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    run = nbformat.from_dict(json.loads(json.dumps(shown)))
    NotebookClient(run, timeout=240, resources={"metadata": {"path": str(ROOT)}}).execute()
    assert "image/png" in run.cells[1].outputs[-1].data
    for before, after in zip(shown.cells, run.cells, strict=True):
        if before.cell_type == "code":
            assert words_of(printed(before)) == words_of(printed(after))
            assert numbers_of(printed(after)) == pytest.approx(numbers_of(printed(before)), rel=0.01)


NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def words_of(texts: list[str]) -> list[str]:
    """Texts with a mark for every number."""
    return [NUMBER.sub("#", text) for text in texts]


def numbers_of(texts: list[str]) -> list[float]:
    """All numbers in texts: the last digit of one may be rounded the other way on another processor."""
    return [float(number) for text in texts for number in NUMBER.findall(text)]


def printed(cell) -> list[str]:
    """What a cell prints or shows as a table; pictures may differ in their bytes."""
    texts = [out.get("text") or out.get("data", {}).get("text/html", "") for out in cell.outputs]
    return [text for text in texts if text]
