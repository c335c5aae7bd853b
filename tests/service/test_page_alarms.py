"""The page's alarms: listed by urgency, acknowledged and cleared by name, of one machine and of all; their rules."""

from __future__ import annotations

import pytest
import service_fakes as fakes
from test_alarms import CRACKED, NEAR, WORN
from test_health import report_of

from service.alarms.keeper import AlarmKeeper
from service.results.alarm_store import AlarmStore

OK = {"level": "ok", "reason": "the latest window is good"}
ALARMS = "/#/asset/unsw/alarms"


@pytest.fixture
def keeper(store, board):
    """Two machines with alarms: one worn, one with a cracked tooth and a near limit."""
    made = AlarmKeeper(AlarmStore(store.database))
    for asset, found in (("unsw", WORN), ("mill", CRACKED), ("pump", NEAR)):
        fakes.campaign(store, board, asset=asset, windows=4)
        made.window(asset, 1_700_000_000 * 10**9, {"index": 3, "quality": "good"}, report_of(found), OK)
        board.update(asset, alarms=made.open(asset), report=report_of(found))
    return made


@pytest.mark.slow
def test_alarm_is_acknowledged_by_name_with_a_note(open_page, keeper):
    page = open_page(ALARMS)
    alarm = page.locator("[data-alarm='1']")
    assert "Wear depth" in alarm.inner_text() and "active, not acknowledged" in alarm.inner_text()
    assert "Stop the machine and replace the gear pair: 511 µm of 500 µm." in alarm.inner_text()
    assert page.inner_text(".counts") == "1 active, 1 not acknowledged"
    alarm.get_by_text("Acknowledge or clear").click()
    alarm.get_by_role("button", name="Acknowledge", exact=True).click()
    assert page.inner_text(".counts") == "1 active, 1 not acknowledged", "a name is required"
    alarm.get_by_label("Your name").fill("Anna")
    alarm.get_by_label("Note").fill("oil sample taken")
    alarm.get_by_role("button", name="Acknowledge", exact=True).click()
    page.wait_for_function("document.querySelector('.counts').textContent === '1 active, 0 not acknowledged'")
    assert "Acknowledged by Anna" in alarm.inner_text() and "oil sample taken" in alarm.inner_text()
    alarm.locator("summary", has_text="Clear").click()
    assert alarm.get_by_label("Your name").input_value() == "Anna", "the name is remembered"
    alarm.get_by_role("button", name="Clear after a repair").click()
    page.wait_for_function("document.querySelector('.counts').textContent === 'No open alarm.'")
    page.get_by_label("closed alarms too").check()
    page.wait_for_selector("[data-alarm='1']")
    page.locator("[data-alarm='1']").get_by_text("History").click()
    said = page.locator("[data-alarm='1']").inner_text()
    assert "raised" in said and "cleared" in said and "closed" in said


@pytest.mark.slow
def test_an_answer_that_a_later_one_has_overtaken_is_not_drawn(open_page, keeper, store, board):
    """The list of open alarms, asked for first, arrives after the list of all."""
    page = open_page(ALARMS)
    keeper.window("unsw", 1_800_000_000 * 10**9, {"index": 4, "quality": "good"}, report_of(CRACKED), OK)
    held = []
    page.route("**/alarms?state=open", lambda route: held.append(route))
    with page.expect_request("**/alarms?state=open"):
        fakes.take(store, board, "unsw", 90, 19500.0)
    with page.expect_response("**/alarms?state=all"):
        page.get_by_label("closed alarms too").check()
    page.wait_for_selector("[data-alarm='4']")
    before = page.locator("[data-alarm]").count()
    with page.expect_response("**/alarms?state=open"):
        held[0].fulfill(json=[])
    page.wait_for_timeout(300)
    assert page.locator("[data-alarm]").count() == before


@pytest.mark.slow
def test_what_is_typed_outlives_a_new_alarm(open_page, keeper, store, board):
    page = open_page(ALARMS)
    alarm = page.locator("[data-alarm='1']")
    alarm.get_by_text("Acknowledge or clear").click()
    alarm.get_by_label("Note").fill("half a sent")
    page.wait_for_selector("#link[data-state=live]")
    keeper.window("unsw", 1_800_000_000 * 10**9, {"index": 4, "quality": "good"}, report_of(CRACKED), OK)
    fakes.take(store, board, "unsw", 90, 19500.0)
    page.wait_for_selector("[data-alarm='4']", timeout=10_000)
    assert page.locator("[data-alarm='1']").get_by_label("Note").input_value() == "half a sent"


@pytest.mark.slow
def test_alarms_of_all_machines_are_one_list_that_leads_to_each(open_page, keeper):
    page = open_page("/")
    page.get_by_role("link", name="Alarms: 3 active").click()
    page.wait_for_selector("main[data-view=alarms]")
    assert page.url.endswith("#/alarms") and page.inner_text("#trail").endswith("Alarms")
    names = page.locator(".alarm h3 a").all_inner_texts()
    assert names == ["mill", "unsw", "pump"] or names == ["unsw", "mill", "pump"], "alarms before watches"
    page.get_by_role("link", name="pump").click()
    page.wait_for_selector("main[data-view=alarms]")
    page.wait_for_selector("#alarm-rules")
    assert page.url.endswith("#/asset/pump/alarms")


@pytest.mark.slow
def test_row_of_a_machine_leads_to_its_alarms(open_page, keeper):
    page = open_page("/")
    page.locator("tr[data-asset=mill]").get_by_role("link", name="1 alarm not acknowledged").click()
    page.wait_for_selector("[data-alarm='2']")


@pytest.mark.slow
def test_rules_are_edited_and_saved_by_name(open_page, keeper):
    page = open_page(ALARMS, allowed="409")
    rules = page.locator("#alarm-rules")
    count = int(rules.get_attribute("data-rules"))
    rules.get_by_role("button", name="Add a rule").click()
    rules.get_by_label("Name", exact=True).fill("oil")
    rules.get_by_label("What is watched").select_option("temperature")
    rules.get_by_label("Limit of watch").fill("85")
    rules.get_by_label("Limit of alarm").fill("70")
    rules.get_by_role("button", name="Use this rule").click()
    rules.get_by_label("Your name").fill("Anna")
    rules.get_by_role("button", name="Save the rules").click()
    page.wait_for_selector("#alarm-rules .said.error")
    assert "must lie beyond watch = 85" in page.inner_text("#alarm-rules .said.error")
    rules.get_by_role("button", name="Edit rule oil").click()
    rules.get_by_label("Limit of watch").fill("60")
    rules.get_by_role("button", name="Use this rule").click()
    rules.get_by_label("Your name").fill("Anna")
    rules.get_by_role("button", name="Save the rules").click()
    page.get_by_text("The rules are saved.").wait_for()
    kept = keeper.store.rules("unsw")
    assert kept["by"] == "Anna" and len(kept["rules"]) == count + 1
    assert kept["rules"][-1]["alarm"] == 70 and kept["rules"][-1]["name"] == "oil"
    rules.get_by_role("button", name="Remove rule oil").click()
    rules.get_by_role("button", name="Discard the changes").click()
    assert int(rules.get_attribute("data-rules")) == count + 1


@pytest.mark.slow
@pytest.mark.parametrize("width", [1440, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_alarms_are_accessible_and_fit_the_screen(open_page, keeper, width, scheme):
    from axe_playwright_python.sync_playwright import Axe

    for path in (ALARMS, "/#/alarms"):
        page = open_page(path, width=width, height=844, color_scheme=scheme)
        page.wait_for_selector("[data-alarm]")
        page.locator("summary", has_text="Acknowledge or clear").first.click()
        found = Axe().run(page).response["violations"]
        assert found == [], [(v["id"], [n["html"] for n in v["nodes"]][:3]) for v in found]
        assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_leaving_the_view_while_it_asks_again_is_no_error(open_page, keeper, store, board):
    page = open_page(ALARMS)
    page.wait_for_selector("#link[data-state=live]")
    page.wait_for_timeout(2000)  # what the connection itself asks for is over
    page.route("**/v1/assets/unsw/alarms?*", lambda route: None)  # no answer: it is under way when the view is left
    with page.expect_request("**/v1/assets/unsw/alarms?*"):
        fakes.take(store, board, "unsw", 90, 19500.0)
    page.evaluate("location.hash = '#/asset/unsw/data'")
    page.wait_for_selector("main[data-view=data]")
    page.wait_for_timeout(200)
