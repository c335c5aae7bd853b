"""The page's view of signals in a real browser: every view, cursors, markers, waterfall, trends, keyboard."""

from __future__ import annotations

import re

import pytest
import service_fakes as fakes
from gear_signals import MESH, RIG, Z1, meshing_window
from segments import in_folder, keep
from test_page import painted, points

KEPT = range(6)
SIGNALS = "/#/asset/unsw/signals"


@pytest.fixture
def signals(store, board, tmp_path):
    return in_folder(store, tmp_path / "segments")


@pytest.fixture
def opened(open_page, store, board, signals):
    """Opens the view at a part of its address."""
    fakes.campaign(store, board, windows=6)
    store.keep_rig("unsw", RIG)
    board.update("unsw", rig=RIG)
    for index in KEPT:
        keep(signals, "unsw", index, meshing_window(index), revolutions=100.0 * index, found=index == 3)

    def open_at(path="", **given):
        page = open_page(f"{SIGNALS}{path}", **given)
        page.wait_for_selector("main[data-view=signals]")
        return page

    return open_at


PATIENCE = 90_000  # of a busy machine [ms]


def settled(page):
    page.wait_for_selector("#signal[data-points]:not([data-points='0'])", timeout=PATIENCE)
    page.wait_for_function("!document.querySelector('[aria-busy=true]')")


def numbers(rows):
    """The places in the cursor's list."""
    texts = [row.locator("td").nth(1).inner_text() for row in rows.all()]
    return [float(text.replace(",", "").replace("−", "-")) for text in texts]


def choose(page, name, value):
    page.select_option(f"[data-key=choice-{name}]", value)


@pytest.mark.slow
def test_every_view_of_a_window_is_drawn_and_has_its_own_address(opened):
    page = opened(allowed="409")  # the flank needs a model
    settled(page)
    assert page.url.endswith("/signals/window/latest/spectrum/accel%2Fy6")
    for view in (
        "waveform",
        "order-spectrum",
        "envelope-spectrum",
        "synchronous-average",
        "transmission-error",
        "spectrum",
    ):
        choose(page, "view", view)
        page.wait_for_function(f"location.hash.includes('/{view}')")
        settled(page)
        assert points(page, "signal") > 100 and painted(page, "signal") > 3, view
    choose(page, "view", "flank")
    page.get_by_role("heading", name="Worn flank is not available").wait_for()
    assert "the rig file does not give" in page.inner_text("main")


@pytest.mark.slow
def test_the_chart_says_its_strongest_lines_to_those_who_do_not_see_it(opened):
    page = opened("/window/2/order-spectrum/accel%2Fy6")
    settled(page)
    said = page.get_attribute("#signal .u-wrap", "aria-label")
    found = re.search(r"Strongest lines: ([\d.]+) m/s² at ([\d.]+)", said)
    assert found, said
    assert float(found[2]) == pytest.approx(Z1, abs=0.1) and 0.8 * MESH < float(found[1]) <= 1.01 * MESH


@pytest.mark.slow
def test_windows_are_chosen_by_buttons_and_by_the_keyboard(opened):
    page = opened("/window/2/spectrum/accel%2Fy6")
    settled(page)
    assert "window 2 " in page.inner_text(".which")
    page.click("[data-key=next-window]")
    page.wait_for_function("location.hash.includes('/window/3/')")
    assert "effects changed here" in page.inner_text(".which")
    page.focus("[data-key=window]")
    page.keyboard.press("End")
    page.wait_for_function("location.hash.includes('/window/latest/')")
    assert page.is_disabled("[data-key=next-window]") and not page.is_disabled("[data-key=previous-window]")
    page.reload()
    settled(page)
    assert "newest" in page.inner_text(".which")


@pytest.mark.slow
def test_a_harmonic_cursor_lists_what_its_places_read(opened):
    page = opened("/window/2/order-spectrum/accel%2Fy6")
    settled(page)
    choose(page, "cursor", "harmonic")
    page.focus("#signal .u-wrap")
    page.keyboard.press("Home")
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    rows = page.locator(".cursor-readings tbody tr")
    assert rows.count() == 10
    first, second = numbers(rows)[:2]
    assert second == pytest.approx(2 * first, rel=1e-3)
    choose(page, "cursor", "sideband")
    assert rows.count() == 9
    places = numbers(rows)
    assert places[5] - places[4] == pytest.approx(1.0, abs=1e-3)  # the pinion's rotation
    choose(page, "spacing", "gear")
    page.wait_for_timeout(100)
    places = numbers(rows)
    assert places[5] - places[4] == pytest.approx(19 / 52, abs=1e-3)


@pytest.mark.slow
def test_markers_and_scale_are_switched_without_asking_again(opened):
    page = opened("/window/2/spectrum/accel%2Fy6")
    settled(page)
    page.wait_for_timeout(300)
    asked = []
    page.on("request", lambda r: asked.append(r.url))
    before = painted(page, "signal")
    page.check("[data-key=marker-shaft]")
    page.check("[data-key=marker-sideband]")
    page.uncheck("[data-key=option-log]")
    assert before and painted(page, "signal") > 3
    assert not [url for url in asked if "/signals/" in url]


@pytest.mark.slow
def test_zooming_fetches_the_excerpt_in_full(opened):
    page = opened("/window/2/waveform/accel%2Fy6")
    settled(page)
    with page.expect_request(lambda r: "x_from" in r.url):
        page.focus("#signal .u-wrap")
        for _ in range(3):
            page.keyboard.press("+")
    settled(page)
    with page.expect_request(lambda r: "/signals/waveform" in r.url and "x_from" not in r.url):
        page.focus("#signal .u-wrap")
        page.keyboard.press("0")


@pytest.mark.slow
def test_the_waterfall_reads_its_values_and_leads_to_a_window(opened):
    page = opened("/waterfall")
    page.wait_for_selector("canvas.waterfall[aria-label^='Waterfall of']")
    assert "6 windows from 0 rev to 500 rev" in page.get_attribute("canvas.waterfall", "aria-label")
    page.focus("canvas.waterfall")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector(".reading:has-text('window 4')")
    page.keyboard.press("Enter")
    page.wait_for_url("**/signals/window/4/**", timeout=PATIENCE)
    settled(page)


@pytest.mark.slow
def test_trends_of_indicators_are_drawn_by_group(opened):
    page = opened("/indicators")
    page.wait_for_selector("#trend-rms-measured .u-wrap")
    assert points(page, "trend-rms-measured") == 6
    page.get_by_label("Axis of the trends").select_option("time")
    page.wait_for_function("document.querySelector('.downloads a').href.includes('axis=time')")


@pytest.mark.slow
def test_a_new_window_is_followed_where_the_newest_is_shown(opened, store, board, signals):
    page = opened()
    settled(page)
    page.wait_for_selector("#link[data-state=live]")
    with store.database.transaction():
        fakes.take(store, board, "unsw", 6, 600.0)
        keep(signals, "unsw", 6, meshing_window(6))
    page.wait_for_function("document.querySelector('.which').textContent.includes('window 6 ')")


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [390, 1440])
def test_the_view_fits_and_has_no_fault_of_access(opened, width, dark):
    from axe_playwright_python.sync_playwright import Axe

    page = opened("/window/2/spectrum/accel%2Fy6", width=width, color_scheme="dark" if dark else "light")
    settled(page)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for section in ("window", "waterfall", "indicators"):
        page.check(f"input[name=section][value={section}]")
        page.wait_for_timeout(400)
        found = Axe().run(page)
        assert found.violations_count == 0, found.generate_report()


@pytest.mark.slow
def test_a_machine_without_kept_signals_says_why(open_page, store, board, signals):
    fakes.take(store, board, "other", 0, 10.0)
    page = open_page("/#/asset/other/signals")
    page.get_by_text("No signals to look at yet").wait_for()
    assert "no window's raw signals are kept yet" in page.inner_text("main").lower()
