"""The dashboard in a real browser: charts with the data in them, live and offline."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import service_fakes as fakes

from service.contract.encoder_pair import EncoderPair
from tests.claims.test_encoder_pair import counted
from twin.encoder_pair.assessing import assess_pair
from twin.rig import Rig
from twin.windows import Window

CHROMIUM = Path(os.environ.get("GEAR_TWIN_CHROMIUM", "/usr/bin/chromium"))
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
CHARTS = ("rms", "depth", "profile", "rul")


@pytest.fixture(scope="module")
def browser():
    if not CHROMIUM.exists():
        reason = f"{CHROMIUM} is not installed (Debian's package chromium; GEAR_TWIN_CHROMIUM names another)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser, address):
    """Opens the page at a path; every message of an error and every request elsewhere fails the test."""
    opened, wrong = [], []

    def open_at(path="/", width=1440, height=900, **given):
        page = browser.new_page(viewport={"width": width, "height": height}, **given)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
        page.on("request", lambda r: None if _own(r.url, address) else wrong.append(f"left for {r.url}"))
        page.goto(address + path)
        opened.append(page)
        return page

    yield open_at
    for page in opened:
        page.close()
    assert wrong == []


def _own(url, address):
    return url.startswith((address, "data:", "blob:"))


def points(page, chart):
    """How many points the chart holds, and how many its drawing shows."""
    drawn = page.locator(f"#{chart} .scatterlayer .trace path").count()
    return int(page.get_attribute(f"#{chart}", "data-points")), drawn


def wait_for_windows(page, count):
    page.wait_for_selector(f"body[data-windows='{count}']", timeout=15_000)


def test_charts_show_the_campaign(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page()
    wait_for_windows(page, 14)
    for chart in CHARTS:
        held, drawn = points(page, chart)
        assert held >= 12 and drawn >= 2, chart
    titles = page.locator(".xtitle, .ytitle").all_text_contents()
    assert {"RMS [m/s²]", "maximum depth [µm]", "roll angle [°]", "remaining life [h]"} <= set(titles)
    assert "1 update;" in page.inner_text("#rms figcaption")
    assert page.inner_text("#cards .card >> nth=0").split("\n")[1] == "433 µm"
    assert "gap" in page.inner_text("#tables")


def test_new_window_appears_without_a_reload(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page()
    wait_for_windows(page, 14)
    page.wait_for_selector("#link.live")
    before = points(page, "rms")[0]
    fakes.take(store, board, "unsw", 90, 19500.0, updated=True)
    wait_for_windows(page, 15)
    assert points(page, "rms")[0] > before
    assert "2 updates" in page.inner_text("#rms figcaption")


def test_a_reason_that_several_parts_share_is_given_once(open_page, store, board):
    fakes.take(store, board, "spectraquest", 0, 10.0, report=fakes.little_known_report())
    page = open_page()
    wait_for_windows(page, 1)
    notice = page.inner_text("#missing")
    assert notice.startswith("Not available for this machine: wear depth and profile, remaining life")
    assert page.inner_text("main").count("gears.module") == notice.count("gears.module") == 1
    for chart in ("depth", "profile", "rul"):
        assert page.locator(f"#{chart}").is_hidden()
    assert points(page, "rms")[0] == 1


def test_the_address_names_the_asset_and_back_returns_to_it(open_page, store, board):
    fakes.campaign(store, board)
    fakes.take(store, board, "another", 0, 10.0)
    page = open_page("/#unsw")
    wait_for_windows(page, 14)
    page.select_option("#asset", "another")
    wait_for_windows(page, 1)
    page.go_back()
    wait_for_windows(page, 14)
    assert page.input_value("#asset") == "unsw"


def test_no_button_of_a_chart_sends_it_elsewhere(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page()
    wait_for_windows(page, 14)
    titles = page.locator(".modebar-btn").evaluate_all("buttons => buttons.map(b => b.dataset.title)")
    assert len(titles) == 24 and not [t for t in titles if "hare" in t or "loud" in t or "tudio" in t], titles


def test_pair_of_encoders_and_lines_of_no_shaft_have_their_panels(open_page, store, board):
    pinion, gear = counted(1)
    window = Window(start_time_ns=1, encoders={"pinion": pinion, "gear": gear})
    strange = {
        "frequency_hz": 39.597, "frequency_std_hz": 0.001, "order": 1.188, "part": 3, "geared": None,
        "sidebands": [{"channel": "ch11", "harmonic": 1, "multiple": 2, "amplitude": 1.1, "depth": 0.083}],
        "causes": [{"name": "mains of 50 Hz", "possible": False, "detail": "13.199 Hz"}],
    }  # fmt: skip
    pair = EncoderPair.of(assess_pair(Rig.from_mapping({}), window, 0)).as_json()
    told = {"pair": pair, "unattributed_lines": [strange]}
    fakes.take(store, board, "pair", 0, 10.0, report=fakes.little_known_report() | told)
    page = open_page()
    wait_for_windows(page, 1)
    shown = page.inner_text("#tables")
    assert "31/16" in shown and "1× a turn of the gear" in shown and "its encoder's disc" in shown
    assert "Lines spaced by 39.597 ± 0.001 Hz" in shown and "weaker lines are at 13.199 Hz" in shown
    assert "mesh 1 ± 2×" in shown and "8.30" in shown and "mains of 50 Hz" in shown


def test_assets_are_chosen_by_the_selector_and_new_ones_join(open_page, store, board):
    page = open_page()
    page.wait_for_selector("#empty:not([hidden])")
    fakes.campaign(store, board)
    fakes.take(store, board, "another", 0, 10.0)
    wait_for_windows(page, 1)
    page.select_option("#asset", "unsw")
    wait_for_windows(page, 14)
    status = page.request.get(f"{page.url.partition('#')[0]}v1/assets/unsw").json()["status"]
    assert page.inner_text("#status") == status["level"].replace("_", " ")
    assert page.inner_text("#reason") == " ".join(status["reasons"])


def test_inspections_are_drawn_beside_the_twin(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page()
    wait_for_windows(page, 14)
    before = points(page, "depth")[0]
    page.request.post(
        f"{page.url}v1/assets/unsw/inspections",
        data={"revolutions": 12500, "max_depth_um": 265, "flank": "pinion", "std_um": 12},
    )
    page.reload()
    wait_for_windows(page, 14)
    assert points(page, "depth")[0] == before + 1
    assert "265 ± 12" in page.inner_text("#lists")


def test_effects_are_shown_with_what_they_change_and_can_be_decided_on(open_page, store, board):
    fakes.campaign(store, board)
    fakes.take(store, board, "unsw", 90, 19500.0, report=fakes.traced_report(19500.0, 12))
    page = open_page()
    wait_for_windows(page, 15)
    panel = page.inner_text("#tables .panel >> nth=0")
    for part in ("misalignment", "40.1 ± 4.3 µm", "24 → 9 %", "180 → 152 µm", "mesh stiffness loss, 134 lower"):
        assert part in panel
    assert "tooth friction: rejected" in panel
    assert "with the effects, history re-evaluated" in page.inner_text("#depth")
    with page.expect_response("**/effects/misalignment") as answered:
        page.get_by_role("button", name="accept misalignment").click()
    assert answered.value.status == 202  # nobody carries it out here: it is kept
    assert [d.verb for d in store.decisions("unsw")] == ["accept"]
    page.wait_for_function("document.querySelector('.decision').textContent.includes('after the current window')")


def test_effect_is_decided_on_by_the_keyboard_alone_and_the_focus_stays_with_it(open_page, store, board):
    fakes.campaign(store, board)
    fakes.take(store, board, "unsw", 90, 19500.0, report=fakes.traced_report(19500.0, 12))
    page = open_page()
    wait_for_windows(page, 15)
    page.wait_for_selector("#link.live")
    page.get_by_role("button", name="pin gear eccentricity").focus()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "reject gear eccentricity"
    asked = []
    page.once("dialog", lambda dialog: (asked.append(dialog.message), dialog.dismiss()))
    page.keyboard.press("Enter")
    assert "re-evaluated without it" in asked[0] and store.decisions("unsw") == ()  # thought better of it
    page.keyboard.press("Shift+Tab")
    with page.expect_response("**/effects/gear_eccentricity"):
        page.keyboard.press("Enter")
    report = fakes.traced_report(19500.0, 12)
    report["effects"][0]["status"] = "pinned"
    (waiting,) = store.pending_decisions()
    assert store.carry_out(waiting, state={}, report=report, events=[("effect", {"action": "pin"})])
    board.update("unsw", report=report, last_event_id=store.last_event_id("unsw"))
    page.get_by_role("button", name="release gear eccentricity").wait_for()  # the event has brought it
    assert page.evaluate("document.activeElement.dataset.effect") == "gear_eccentricity"


def test_service_that_is_gone_is_told_where_the_decision_was_made(open_page, store, board):
    fakes.campaign(store, board)
    fakes.take(store, board, "unsw", 90, 19500.0, report=fakes.traced_report(19500.0, 12))
    page = open_page()
    wait_for_windows(page, 15)
    refusal = {"status": 202, "content_type": "application/json", "body": "no JSON"}
    page.route("**/effects/misalignment", lambda route: route.fulfill(**refusal))
    page.get_by_role("button", name="accept misalignment").click()
    page.wait_for_function("document.querySelector('.decision').textContent.includes('does not answer')")


@pytest.mark.parametrize("width", [1440, 800])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_fits_its_width_and_follows_the_theme(open_page, store, board, width, scheme):
    fakes.campaign(store, board)
    fakes.take(store, board, "unsw", 90, 19500.0, report=fakes.traced_report(19500.0, 12))
    page = open_page(width=width, color_scheme=scheme)
    wait_for_windows(page, 15)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    light = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)")
    assert (sum(light) > 600) == (scheme == "light")


def test_openapi_page_is_drawn_offline(open_page):
    page = open_page("/docs")
    page.wait_for_selector(".opblock")
    assert page.locator(".opblock").count() >= 15
