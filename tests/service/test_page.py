"""The page in a real browser: addresses, views, live data, decisions, downloads; nothing leaves the service."""

from __future__ import annotations

import csv
import io

import pytest
import service_fakes as fakes

from service.contract.parts import EncoderPair
from tests.claims.test_encoder_pair import counted
from twin.encoder_pair.assessing import assess_pair
from twin.rig import Rig
from twin.windows import Window

CHARTS = ("rms", "depth", "profile", "rul")
UNSW = "/#/asset/unsw"


def points(page, chart):
    return int(page.get_attribute(f"#{chart}", "data-points"))


def wait_for_windows(page, count):
    page.wait_for_selector(f"main[data-windows='{count}']", timeout=15_000)


def painted(page, chart):
    """How many different colours a chart's canvas shows: 1 where nothing is drawn."""
    return page.evaluate(
        """(id) => { const c = document.querySelector(`#${id} canvas`);
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; const seen = new Set();
        for (let i = 0; i < d.length; i += 4) seen.add((d[i] << 16) | (d[i+1] << 8) | d[i+2]); return seen.size; }""",
        chart,
    )


@pytest.mark.slow
def test_charts_show_the_campaign(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page(UNSW)
    wait_for_windows(page, 14)
    for chart in CHARTS:
        assert points(page, chart) >= 12 and painted(page, chart) > 3, chart
        said = page.get_attribute(f"#{chart} .u-wrap", "aria-label")
        assert "points from" in said and "latest" in said, said
    assert "1 update of the model" in page.inner_text("#rms figcaption")
    assert page.inner_text(".cards .value >> nth=0") == "433 µm"
    assert "87 % of the limit of 500 µm" in page.inner_text(".cards")


@pytest.mark.slow
def test_points_that_the_page_leaves_out_are_no_peaks(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page(UNSW)
    levels = [50.0 if i == 17 else None if i in (18, 20) else 0.1 if i == 22 else 5.0 + i % 3 for i in range(41)]
    thinned = """async ([levels, most]) => (await import('/static/machine.js')).thinned(
        levels.map((rms, index) => ({ index, rms_measured: rms })), most).map((p) => p.index)"""
    assert page.evaluate(thinned, [levels, 21]) == list(range(41))
    shown = page.evaluate(thinned, [levels, 20])
    assert {17, 22, 40} <= set(shown) and shown == sorted(set(shown)) and 18 <= len(shown) <= 22
    level = page.evaluate(thinned, [[None] * 41, 20])
    assert level[-1] == 40 and len(level) <= 22


@pytest.mark.slow
def test_new_window_appears_without_a_reload_by_fetching_what_is_new_alone(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page(UNSW)
    wait_for_windows(page, 14)
    page.wait_for_selector("#link[data-state=live]")
    page.wait_for_timeout(2000)  # what the connection itself asks for is over
    asked = []
    page.on("request", lambda r: asked.append(r.url.partition("/v1/")[2]))
    before = points(page, "rms")
    fakes.take(store, board, "unsw", 90, 19500.0, updated=True)
    wait_for_windows(page, 15)
    assert points(page, "rms") > before
    assert "2 updates" in page.inner_text("#rms figcaption")
    assert sorted(asked) == ["assets/unsw/trend?after=13&resolution=600", "assets/unsw?windows=0"]


@pytest.mark.slow
def test_a_reason_that_several_parts_share_is_given_once(open_page, store, board):
    for index in range(2):
        fakes.take(store, board, "spectraquest", index, 10.0 * index, report=fakes.little_known_report())
    page = open_page("/#/asset/spectraquest")
    wait_for_windows(page, 2)
    notice = page.inner_text(".missing")
    assert "Wear depth and profile, remaining life" in notice
    assert page.inner_text("main").count("gears.module") == notice.count("gears.module") == 1
    for chart in ("depth", "profile", "rul"):
        assert page.locator(f"#{chart}").is_hidden()
    assert points(page, "rms") == 2
    assert page.locator("#effects").is_hidden()  # nothing was searched for: nothing is said of it
    assert page.get_attribute(".view", "data-kind") == "level"


@pytest.mark.slow
def test_addresses_name_asset_and_view_and_back_returns(open_page, store, board):
    fakes.campaign(store, board)
    fakes.take(store, board, "another", 0, 10.0)
    page = open_page("/")
    page.get_by_role("link", name="unsw", exact=True).click()
    wait_for_windows(page, 14)
    page.get_by_role("link", name="Windows and data").first.click()
    page.wait_for_selector("main[data-view=data]")
    assert page.url.endswith("#/asset/unsw/data")
    page.go_back()
    page.wait_for_selector("main[data-view=overview]")
    page.go_back()
    page.wait_for_selector("main[data-view=fleet]")
    page.go_forward()
    page.wait_for_selector("main[data-view=overview]")
    page.evaluate("location.hash = '#/asset/another'")
    wait_for_windows(page, 1)
    assert page.inner_text("#trail").endswith("another")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "said"),
    [("/#/asset/nobody", "no asset 'nobody' has been seen"), ("/#/asset/unsw/nothing", "There is no view nothing")],
)
def test_a_wrong_address_says_what_would_be_right(open_page, store, board, path, said):
    fakes.campaign(store, board)
    page = open_page(path, allowed="")
    page.wait_for_selector("main[data-view=problem]")
    assert said in page.inner_text("main")
    page.get_by_role("link", name="All machines").last.click()
    page.wait_for_selector("main[data-view=fleet]")


@pytest.mark.slow
def test_pair_of_encoders_and_lines_of_no_shaft_have_their_panels(open_page, store, board):
    pinion, gear = counted(1)
    window = Window(start_time_ns=1, encoders={"pinion": pinion, "gear": gear})
    unattributed = {
        "frequency_hz": 39.597, "frequency_std_hz": 0.001, "order": 1.188, "part": 3, "geared": None,
        "sidebands": [{"channel": "ch11", "harmonic": 1, "multiple": 2, "amplitude": 1.1, "depth": 0.083}],
        "causes": [{"name": "mains of 50 Hz", "possible": False, "detail": "13.199 Hz"}],
    }  # fmt: skip
    pair = EncoderPair.of(assess_pair(Rig.from_mapping({}), window, 0)).as_json()
    found = {"pair": pair, "unattributed_lines": [unattributed]}
    fakes.take(store, board, "pair", 0, 10.0, report=fakes.little_known_report() | found)
    page = open_page("/#/asset/pair")
    wait_for_windows(page, 1)
    assert page.get_attribute(".view", "data-kind") == "encoders"
    assert page.inner_text(".cards .card >> nth=0").startswith("Gear ratio")
    shown = page.inner_text(".findings")
    assert "31/16" in shown and "1× a turn of the gear" in shown and "its encoder's disc" in shown
    assert "Lines spaced by 39.597 ± 0.001 Hz" in shown and "weaker lines are at 13.199 Hz" in shown
    assert "mesh 1 ± 2×" in shown and "8.30" in shown and "mains of 50 Hz" in shown


@pytest.mark.slow
def test_inspections_are_drawn_with_the_depth(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page(UNSW)
    before = points(page, "depth")
    page.request.post(
        f"{page.url.partition('#')[0]}v1/assets/unsw/inspections",
        data={"revolutions": 12500, "max_depth_um": 265, "flank": "pinion", "std_um": 12},
    )
    page.reload()
    wait_for_windows(page, 14)
    assert points(page, "depth") == before + 1
    assert "inspection, pinion" in page.inner_text("#depth .legend")
    page.goto(f"{page.url}/data")
    page.wait_for_selector("main[data-view=data]")
    assert "265 ± 12" in page.inner_text("#inspections")


# -- effects -----------------------------------------------------------------------------------------------


@pytest.fixture
def traced(open_page, store, board):
    fakes.campaign(store, board)
    fakes.take(store, board, "unsw", 90, 19500.0, report=fakes.traced_report(19500.0, 12))
    page = open_page(UNSW)
    wait_for_windows(page, 15)
    return page


@pytest.mark.slow
def test_effect_that_grows_or_was_taken_back_says_so(open_page, store, board):
    fakes.campaign(store, board)
    report = fakes.traced_report(19500.0, 12)
    eccentric, misaligned = report["effects"][:2]
    now = {"value": 8e-6, "unit": "m", "std": 1e-6}
    rate = {"value": 2e-4, "unit": "m/1e6 rev", "std": 4e-5}
    eccentric["growth"] = {
        "law": "linear", "parameter": "eccentricity", "size_at_latest_window": now,
        "rate_per_million_revolutions": rate,
    }  # fmt: skip
    misaligned["growth"] = {
        "law": "second_change", "parameter": "lead_gap",
        "size_at_latest_window": {"value": 0.0, "unit": "m", "std": 1e-6},
        "second_change_at": {"value": 5656.0, "unit": "rev", "std": 240.0},
    }  # fmt: skip
    misaligned["moved_lines"] = [
        {"channel": "transmission_error", "lines": 9, "before_percent": 48.2, "after_percent": 3.1}
    ]
    fakes.take(store, board, "unsw", 90, 19500.0, report=report)
    page = open_page(UNSW)
    wait_for_windows(page, 15)
    shown = page.inner_text("#effects")
    assert "transmission error 48.2 → 3.1 %" in page.text_content("#effects")
    assert (
        "The eccentricity grows by 200 ± 40 µm per million revolutions; at the latest window it is 8 ± 1 µm." in shown
    )
    assert "The lead gap changed again at about 5,656 revolutions; at the latest window it is 0 ± 1 µm." in shown


@pytest.mark.slow
def test_effects_are_sentences_with_size_consequence_and_onset(traced, store):
    shown = traced.inner_text("#effects")
    for part in (
        "lead gap 40.1 ± 4.3 µm",
        "It began at about 4,095 revolutions (",
        "With it the wear depth is 152 µm; without it, it would be 180 µm.",
        "The remaining life is 11,400 instead of 9,800 revolutions.",
        "It changes neither the wear depth nor the life until the wear limit.",
        "The error of the acceleration falls from 24 to 9 %.",
        "tooth friction: rejected",
    ):
        assert part in shown, part
    assert "history re-evaluated with the effects" in traced.inner_text("#depth .legend")
    traced.get_by_text("Evidence", exact=True).last.click()
    assert "mesh stiffness loss, by 134" in traced.inner_text("#effects")


@pytest.mark.slow
def test_a_decision_is_sent_and_its_progress_said(traced, store):
    with traced.expect_response("**/effects/misalignment") as answered:
        traced.get_by_role("button", name="accept misalignment").click()
    assert answered.value.status == 202  # nobody carries it out here: it is kept
    assert [d.given["verb"] for d in fakes.decisions(store, "unsw")] == ["accept"]
    traced.wait_for_function("document.querySelector('.decision').textContent.includes('after the current window')")


@pytest.mark.slow
def test_a_decision_is_signed_and_shown_where_effects_are_listed(traced, store, board):
    """Anybody could reject an effect on the page, without a name or a reason."""
    page = traced
    page.wait_for_selector("#link[data-state=live]")
    page.get_by_text("Name and note of decisions").click()
    page.get_by_role("textbox", name="Your name").fill("Anna")
    page.get_by_role("textbox", name="Note").fill("seen on the flank")
    page.get_by_role("button", name="accept misalignment").click()
    page.wait_for_function("document.querySelector('.decision').textContent.includes('after the current window')")
    (waiting,) = fakes.jobs_of(store).pending()
    assert (waiting.given["by"], waiting.given["note"]) == ("Anna", "seen on the flank")
    report = fakes.traced_report(19500.0, 12)
    next(e for e in report["effects"] if e["name"] == "misalignment")["status"] = "accepted"
    assert fakes.carry_out(store, waiting, state={}, report=report, events=[("effect", {"action": "accept"})])
    board.update("unsw", report=report, last_event_id=store.last_event_id("unsw"))
    page.wait_for_function("document.querySelector('#effects').textContent.includes('Latest decision: accept by Anna')")
    page.get_by_text("Decisions (1)").click()
    table = page.locator("#effects table").inner_text()
    assert "accept misalignment" in table and "Anna" in table and "seen on the flank" in table
    assert page.get_by_role("textbox", name="Note").input_value() == "", "a note is of one decision"
    assert page.get_by_role("textbox", name="Your name").input_value() == "Anna"


@pytest.mark.slow
def test_effect_is_decided_on_by_the_keyboard_alone_and_the_focus_stays_with_it(traced, store, board):
    page = traced
    page.wait_for_selector("#link[data-state=live]")
    page.get_by_role("button", name="pin gear eccentricity").focus()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "reject gear eccentricity"
    asked = []
    page.once("dialog", lambda dialog: (asked.append(dialog.message), dialog.dismiss()))
    page.keyboard.press("Enter")
    assert "re-evaluated without it" in asked[0] and fakes.decisions(store, "unsw") == ()  # thought better of it
    page.keyboard.press("Shift+Tab")
    with page.expect_response("**/effects/gear_eccentricity"):
        page.keyboard.press("Enter")
    report = fakes.traced_report(19500.0, 12)
    report["effects"][0]["status"] = "pinned"
    (waiting,) = fakes.jobs_of(store).pending()
    assert fakes.carry_out(store, waiting, state={}, report=report, events=[("effect", {"action": "pin"})])
    board.update("unsw", report=report, last_event_id=store.last_event_id("unsw"))
    page.get_by_role("button", name="release gear eccentricity").wait_for()  # the event has brought it
    assert page.evaluate("document.activeElement.dataset.group") == "gear_eccentricity"


@pytest.mark.slow
def test_service_that_is_gone_is_said_where_the_decision_was_made(traced):
    traced.route("**/effects/misalignment", lambda route: route.fulfill(status=202, body="no JSON"))
    traced.get_by_role("button", name="accept misalignment").click()
    traced.wait_for_function("document.querySelector('.decision').textContent.includes('no readable answer')")


# -- charts ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_one_outlier_does_not_rule_the_scale_and_is_said(open_page, store, board):
    for index in range(12):
        fakes.take(store, board, "unsw", index, 500.0 * (index + 1), rms_predicted=9000.0 if index == 4 else None)
    page = open_page(UNSW)
    assert "1 point is outside the scale (model, before the update: up to 9,000 m/s²)" in page.inner_text(
        "#rms .outside"
    )
    page.get_by_label("Menu of the chart Vibration RMS").click()
    page.get_by_role("button", name="Scale to all points").click()
    page.wait_for_function("document.querySelector('#rms .outside').textContent === ''")


@pytest.mark.slow
def test_cursor_and_zoom_are_linked_and_answer_to_the_keyboard(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page(UNSW)
    spoken = page.locator("#depth .u-wrap")
    spoken.focus()
    page.keyboard.press("End")
    assert "window 13" in page.inner_text("#depth .reading")
    assert "window 13" in page.inner_text("#rms .reading")  # the cursor is linked
    page.keyboard.press("ArrowLeft")
    assert "window 12" in page.inner_text("#depth .reading")
    for chart in ("depth", "rms"):
        picture = f"document.querySelector('#{chart} canvas').toDataURL()"
        whole = page.evaluate(picture)
        spoken.focus()
        page.keyboard.press("+")
        page.wait_for_function(f"whole => {picture} !== whole", arg=whole)
        page.keyboard.press("0")


@pytest.mark.slow
def test_menu_of_a_chart_saves_csv_and_png_and_sends_nothing_elsewhere(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page(UNSW)
    menu = page.get_by_label("Menu of the chart Vibration RMS")
    menu.click()
    texts = page.locator("#rms .menu-list button").all_inner_texts()
    assert not [t for t in texts if any(w in t.lower() for w in ("share", "upload", "cloud", "send"))], texts
    with page.expect_download() as saved:
        page.locator("#rms").get_by_role("button", name="Save as CSV").click()
    rows = list(csv.DictReader(io.StringIO(saved.value.path().read_text(encoding="utf-8"))))
    trend = page.request.get(f"{page.url.partition('#')[0]}v1/assets/unsw/trend").json()
    measured = [p["rms_measured"] for p in trend if p["kind"] != "calibration"]
    assert [float(r["measured [m/s²]"]) for r in rows] == pytest.approx(measured)
    menu.click()
    with page.expect_download() as saved:
        page.locator("#rms").get_by_role("button", name="Save as PNG").click()
    assert saved.value.path().read_bytes().startswith(b"\x89PNG")
    menu.click()
    page.locator("#rms").get_by_role("button", name="table").click()
    assert page.locator("#rms .as-table tbody tr").count() == len(measured)


@pytest.mark.slow
def test_trends_run_against_time_as_well(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page(UNSW)
    page.get_by_label("time", exact=True).check()
    page.wait_for_selector("#rms .u-wrap[aria-label*='Nov 2023']")
    page.reload()
    page.wait_for_selector("main[data-view=overview]")
    assert page.get_by_label("time", exact=True).is_checked()  # kept for all views


# -- list of machines --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_machines_are_listed_by_severity_and_new_ones_join(open_page, store, board):
    page = open_page("/")
    assert "No machine has sent data yet" in page.inner_text("main")
    assert page.get_attribute("#link", "data-state") == "live"  # the service is there: nothing red
    fakes.campaign(store, board)
    alarm = fakes.report(10.0, 1) | {"status": fakes.status("alarm", "A cracked tooth was found.")}
    fakes.take(store, board, "zz-last", 0, 10.0, report=alarm)
    page.wait_for_selector("[data-assets='2']")
    assert page.locator(".fleet tbody tr").evaluate_all("rows => rows.map(r => r.dataset.asset)") == ["zz-last", "unsw"]
    first, second = page.locator(".fleet tbody tr").all_inner_texts()
    assert "Alarm" in first and "A cracked tooth was found." in first
    assert "Normal" in second and "433 µm (87 % of limit)" in second and "rig model" in second
    page.get_by_label("Search machines").fill("cracked")
    page.wait_for_selector("[data-assets='1']")
    assert page.locator(".fleet tbody tr").get_attribute("data-asset") == "zz-last"


# -- looks -------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (800, "dark"), (390, "light")])
def test_page_fits_its_width_and_follows_the_theme(open_page, store, board, width, scheme):
    fakes.campaign(store, board)
    fakes.take(store, board, "unsw", 90, 19500.0, report=fakes.traced_report(19500.0, 12))
    page = open_page(width=width, color_scheme=scheme)
    for address, view in (("#/", "fleet"), ("#/asset/unsw", "overview"), ("#/asset/unsw/data", "data")):
        page.evaluate("hash => { location.hash = hash }", address)
        page.wait_for_selector(f"main[data-view={view}]")
        assert page.evaluate("document.documentElement.scrollWidth") <= width, view
    light = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)")
    assert (sum(light) > 600) == (scheme == "light")


@pytest.mark.slow
def test_openapi_page_is_drawn_offline(open_page):
    page = open_page("/docs")
    page.wait_for_selector(".opblock")
    assert page.locator(".opblock").count() >= 15
