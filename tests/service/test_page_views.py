"""Every view of every kind of machine, on a desk and on a phone, light and dark: drawn, whole, and clean for axe.

One service and one page a combination serve all of its views, since a browser takes longer to start than to draw.
"""

from __future__ import annotations

import re
from dataclasses import replace

import playwright.sync_api
import pytest
import service_fakes as fakes
from browsers import under_policy
from conftest import serving
from gear_signals import RIG, meshing_window
from machines import KINDS, WAITING, show_machine, show_waiting
from segments import in_folder, keep
from test_alarms import CRACKED, NEAR, WORN
from test_health import report_of
from test_page_access import findings

from service.alarms.keeper import AlarmKeeper
from service.results.alarm_store import AlarmStore
from service.results.sql_store import SqlStore

pytestmark = pytest.mark.slow

VIEWS = ("", "signals/window", "signals/waterfall", "signals/indicators", "alarms", "what-if", "life", "data")
OF_ALL = ("#/", "#/alarms")
NO_TEXT = re.compile(r"\bundefined\b|\bNaN\b|\[object|\bnull\b|\bInfinity\b")
EMPTY = (
    "[...document.querySelectorAll('figure.panel[data-points=\"0\"]')].filter(f => f.checkVisibility()).map(f => f.id)"
)
REFUSED = "#/asset/encoders/signals/waterfall"  # the view says why there is none
ALARMED = {"worn-out": WORN, "baseline": CRACKED, "model": NEAR}


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    """The address of a service with a machine of each kind, with kept signals and alarms."""
    folder = tmp_path_factory.mktemp("plant")
    with SqlStore(folder / "twin.sqlite") as store:
        board, kept = fakes.WrittenTable(store), in_folder(store, folder / "segments")
        alarms = AlarmKeeper(AlarmStore(store.database))
        for kind in KINDS:
            show_machine(store, board, kind)
            for index in range(3):
                window = meshing_window(index)
                if kind == "encoders":
                    window = replace(window, accelerations={}, torques={})
                elif KINDS[kind].shown_as in ("baseline", "level"):
                    window = replace(window, encoders={}, torques={})
                keep(kept, kind, index, window, revolutions=500.0 * index)
            if KINDS[kind].shown_as in ("baseline", "level"):
                board.update(kind, rig=RIG)
            if kind in ALARMED:
                data = {"level": "ok", "reason": "the latest window is good"}
                record = {"index": 3, "quality": "good"}
                alarms.window(kind, 1_700_000_000 * 10**9, record, report_of(ALARMED[kind]), data)
                board.update(kind, alarms=alarms.open(kind))
        show_waiting(store, board)
        with serving(board, store, kept) as address:
            yield address


def addresses():
    """Every view that the page offers of every machine, and those of all machines."""
    for machine in (*KINDS, WAITING):
        for view in VIEWS:
            if view == "what-if" and (machine == WAITING or KINDS[machine].shown_as != "model"):
                continue
            yield f"#/asset/{machine}{view and '/'}{view}"
    yield from OF_ALL


def go(page, address):
    view = {"#/": "fleet", "#/alarms": "alarms"}.get(address) or (address.split("/")[3:] or ["overview"])[0]
    page.evaluate("() => { document.querySelector('main').dataset.view = 'left' }")
    page.evaluate("hash => { location.hash = hash }", address)
    page.wait_for_selector(f"main[data-view={view}]")
    page.wait_for_function("!document.querySelector('[aria-busy=true]')")


def faults(page, address, width, axe):
    """What is wrong with the view that is shown."""
    found = []
    text = page.inner_text("main")
    if len(text) < 20:
        found.append("it is empty")
    if said := NO_TEXT.search(text):
        found.append(f"it says {text[max(said.start() - 60, 0) : said.end() + 20]!r}")
    if (wide := page.evaluate("document.documentElement.scrollWidth")) > width:
        found.append(f"it is {wide} px wide")
    try:  # charts are drawn one after another
        page.wait_for_function(f"!{EMPTY}.length", timeout=30_000)
    except (AssertionError, playwright.sync_api.TimeoutError):
        found.append(f"empty charts: {page.evaluate(EMPTY)}")
    if width < 900:
        cut = page.evaluate(
            """[...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth + 1)
               .map(s => s.textContent.slice(0, 60))"""
        )
        found += [f"cut off: {one}" for one in cut]
    if axe:
        wrong, unsure = findings(page)
        found += wrong + unsure
    return [f"{address}: {one}" for one in found]


@pytest.mark.parametrize(
    ("width", "scheme", "axe"),
    [(1440, "light", True), (390, "dark", True), (390, "light", False), (1440, "dark", False)],
)
def test_every_view_of_every_kind_of_machine(browser, plant, width, scheme, axe):
    page = under_policy(browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme))
    wrong = []
    page.on("pageerror", lambda error: wrong.append(f"{page.url}: {error}"))
    page.on("console", lambda m: wrong.append(f"{page.url}: {m.text}") if m.type in ("error", "warning") else None)
    page.goto(f"{plant}/")
    try:
        for address in addresses():
            go(page, address)
            wrong += faults(page, address, width, axe)
    finally:
        page.close()
    assert [w for w in wrong if not (REFUSED in w and "409 (Conflict)" in w)] == [], "\n".join(wrong)


def test_tabs_of_every_machine_lead_to_the_views_that_are_tested(browser, plant):
    page = under_policy(browser.new_page())
    page.goto(f"{plant}/")
    try:
        for machine in (*KINDS, WAITING):
            go(page, f"#/asset/{machine}")
            links = page.locator(".tabs a").evaluate_all("all => all.map(a => a.getAttribute('href'))")
            tested = {"/".join(a.split("/")[:4]) for a in addresses() if a.split("/")[2:3] == [machine]}
            assert set(links) == tested, machine
    finally:
        page.close()
