"""The page's view of a machine's life: the open question, changes, the healthy baseline, name and use."""

from __future__ import annotations

import pytest
import service_fakes as fakes
from browsers import under_policy
from memory_transport import MemoryNetwork
from service_streams import SqliteFile, wait_until
from test_asset_baseline import with_windows
from test_asset_life import FIRST, WINDOWS, asked, first, revolutions, second, waiting  # noqa: F401
from test_other_parts import serving as served

from service.runtime.questions import count_fell

LIFE = "/#/asset/unsw/life"


@pytest.fixture
def view(browser):
    """Opens the view of an asset of a running service."""
    opened, wrong = [], []

    def open_at(running, asset="unsw", width=1280):
        page = under_policy(browser.new_page(viewport={"width": width, "height": 900}))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda m: wrong.append(m.text) if m.type in ("error", "warning") else None)
        page.goto(f"http://{running.http}/#/asset/{asset}/life")
        page.wait_for_selector("main[data-view]:not([data-view=loading])", timeout=15_000)
        opened.append(page)
        return page

    yield open_at
    for page in opened:
        page.close()
    assert wrong == [], wrong


@pytest.fixture
def network():
    return MemoryNetwork()


@pytest.fixture
def running(tmp_path, network):
    with served(tmp_path, network, SqliteFile(tmp_path)) as running:
        yield running


@pytest.mark.slow
def test_the_question_is_answered_on_the_page(running, network, view, first, second):  # noqa: F811
    asked(running, network, first, second)
    page = view(running)
    question = page.locator("#question")
    assert "Gears replaced, or another machine?" in question.inner_text() and "4 windows wait" in question.inner_text()
    name = question.get_by_label("Name of the other machine")
    assert not name.is_visible()
    question.get_by_role("combobox", name="Answer").select_option("other_machine")
    assert name.is_visible() and "belong to a new asset" in question.inner_text()
    question.get_by_role("combobox", name="Answer").select_option("gears_replaced")
    question.get_by_label("Your name").fill("Anna")
    question.get_by_role("button", name="Answer").click()
    page.wait_for_selector("#question", state="detached")
    wait_until(lambda: running.get("/v1/assets/unsw")["windows_total"] == WINDOWS)
    assert revolutions(running.windows()) == FIRST and waiting(running) is None
    page.wait_for_function("document.querySelector('#changes').textContent.includes('Gears replaced')")
    assert "Anna" in page.inner_text("#changes")


@pytest.mark.slow
def test_a_change_is_entered_and_the_machine_is_renamed_and_retired(running, network, view, first):  # noqa: F811
    from service.runtime.replay import replay

    replay(first, (), 0, publish_to=network.open_publisher)
    running.wait_for_windows(WINDOWS)
    page = view(running)
    entered = page.get_by_role("form", name="Enter the change")
    entered.get_by_label("What was done").select_option("sensor_moved")
    assert entered.get_by_label("Accelerometer").input_value() == "y6"
    entered.get_by_label("Note").fill("other flank")
    entered.get_by_role("button", name="Enter the change").click()
    page.wait_for_function("document.querySelector('#changes').textContent.includes('other flank')")
    assert running.get("/v1/assets/unsw/changes")[0]["sensor"] == "y6"
    page.get_by_role("button", name="Retire this machine").click()
    page.wait_for_function("document.body.textContent.includes('Retired since')")
    assert page.get_by_role("button", name="Reinstate").is_visible() and running.get("/v1/assets/unsw")["retired"]
    renamed = page.get_by_role("form", name="Rename")
    renamed.get_by_label("New name").fill("press-7")
    renamed.get_by_role("button", name="Rename").click()
    page.wait_for_function("location.hash === '#/asset/press-7/life'")
    page.wait_for_function("document.body.textContent.includes('Retired since')")


@pytest.mark.slow
def test_a_baseline_is_learned_and_removed_on_the_page(tmp_path, view):
    data = with_windows(tmp_path / "data")
    with served(data, MemoryNetwork(), SqliteFile(data)) as running:
        page = view(running, "bench")
        baseline = page.locator("#baseline")
        assert "no baseline of its own" in baseline.inner_text()
        baseline.get_by_label("Last window").fill("3")
        baseline.get_by_role("button", name="Learn").click()
        page.wait_for_function("document.querySelector('#baseline').textContent.includes('4 (at least')")
        baseline.get_by_role("button", name="Remove the baseline").click()
        page.wait_for_function("document.querySelector('#baseline').textContent.includes('no baseline of its own')")
        page.close()  # before the service ends


@pytest.mark.slow
def test_what_is_typed_outlives_a_new_window(open_page, store, board):
    fakes.campaign(store, board)
    board.update("unsw", question=count_fell(9000.0, 20.0, 1_700_000_000 * 10**9))
    page = open_page(LIFE)
    page.locator("#question").get_by_label("Note").fill("half a sent")
    page.wait_for_selector("#link[data-state=live]")
    board.update("unsw", question={**count_fell(9000.0, 20.0, 1_700_000_000 * 10**9), "waiting": 3})
    fakes.take(store, board, "unsw", 90, 19500.0)
    page.wait_for_function("document.querySelector('#question').textContent.includes('3 windows wait')")
    assert page.locator("#question").get_by_label("Note").input_value() == "half a sent"


@pytest.mark.slow
def test_a_page_goes_on_under_the_other_name_that_somebody_gives_its_machine(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page(LIFE, allowed="404")  # what it asks for at that very moment has the former name
    page.wait_for_selector("#link[data-state=live]")
    fakes.rename(store, board, "unsw", "press-7")
    page.wait_for_function("location.hash === '#/asset/press-7/life'")
    page.wait_for_selector("main[data-view=life]")
    fakes.take(store, board, "unsw", 90, 19500.0)
    total = board.get("unsw").windows_total
    page.wait_for_function(f"document.querySelector('main').dataset.windows === '{total}'")
    page.wait_for_selector("#link[data-state=live]")
    assert page.inner_text("#trail").endswith("press-7")


HIDE = """hidden => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


@pytest.mark.slow
def test_a_page_that_was_hidden_meanwhile_and_an_address_with_the_former_name_lead_to_the_present_one(
    open_page, store, board
):
    fakes.campaign(store, board)
    page = open_page(LIFE, allowed="404")
    page.wait_for_selector("#link[data-state=live]")
    page.evaluate(HIDE, True)  # it holds no connection then
    fakes.rename(store, board, "unsw", "press-7")
    page.evaluate(HIDE, False)
    page.wait_for_function("location.hash === '#/asset/press-7/life'")
    page.wait_for_selector("main[data-view=life]")
    kept = open_page(LIFE, allowed="404")
    kept.wait_for_function("location.hash === '#/asset/press-7/life'")
    kept.wait_for_selector("main[data-view=life]")
