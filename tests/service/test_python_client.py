"""gear-twin from Python: results of a recording and of a service, and the notebook of the documentation."""

from __future__ import annotations

import json
import threading
from contextlib import closing
from pathlib import Path

import nbformat
import pytest
import service_fakes as fakes
from nbclient import NotebookClient

import gear_twin
from service.contract.base import not_available

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
            assert printed(before) == printed(after)


def printed(cell) -> list[str]:
    """What a cell prints or shows as a table; pictures may differ in their bytes."""
    texts = [out.get("text") or out.get("data", {}).get("text/html", "") for out in cell.outputs]
    return [text for text in texts if text]
