"""The page for everybody: axe finds nothing, the keyboard reaches everything, paper shows everything."""

from __future__ import annotations

import io
import unicodedata

import pypdfium2
import pytest
import service_fakes as fakes
from axe_playwright_python.sync_playwright import Axe
from machines import KINDS, show_machine

ADDRESSES = {"fleet": "#/", "overview": "#/asset/{}", "data": "#/asset/{}/data"}


def findings(page):
    """What axe objects to, and which texts' contrast it could not judge."""
    found = Axe().run(page).response
    wrong = [f"{v['id']}: {n['html'][:120]}" for v in found["violations"] for n in v["nodes"]]
    unsure = [
        n["html"][:120]
        for v in found["incomplete"]
        if v["id"] == "color-contrast"
        for n in v["nodes"]
        if n["any"][0]["data"]["messageKey"] != "shortTextContent"  # one digit has the colours of longer numbers
    ]
    return wrong, unsure


SCHEMES = ["light", pytest.param("dark", marks=pytest.mark.slow)]
SOME_KINDS = [k if k == "model" else pytest.param(k, marks=pytest.mark.slow) for k in KINDS]


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kind", SOME_KINDS)
def test_axe_finds_nothing_in_the_views_of_any_kind_of_machine(open_page, store, board, kind, scheme):
    show_machine(store, board, kind)
    page = open_page(color_scheme=scheme)
    for view, address in ADDRESSES.items():
        page.evaluate("hash => { location.hash = hash }", address.format(kind))
        page.wait_for_selector(f"main[data-view={view}]")
        assert findings(page) == ([], []), view
        assert page.evaluate("document.documentElement.scrollWidth") <= 1440


@pytest.mark.slow
@pytest.mark.parametrize("kind", SOME_KINDS)
def test_every_kind_of_machine_fits_a_phone(open_page, store, board, kind):
    show_machine(store, board, kind)
    page = open_page(width=390, height=844)
    for view, address in ADDRESSES.items():
        page.evaluate("hash => { location.hash = hash }", address.format(kind))
        page.wait_for_selector(f"main[data-view={view}]")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, view
        wide = page.evaluate(
            """[...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth + 1)
               .map(s => s.textContent.slice(0, 60))"""
        )
        assert wide == [], view


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_machine_shows_first_what_it_can_tell(open_page, store, board, kind):
    show_machine(store, board, kind)
    page = open_page(f"/#/asset/{kind}")
    assert page.get_attribute(".view", "data-kind") == KINDS[kind].shown_as
    assert KINDS[kind].first in page.inner_text(".cards .card >> nth=0")
    assert page.locator(".missing").count() <= 1
    status = page.request.get(f"{page.url.partition('#')[0]}v1/assets/{kind}").json()["status"]
    assert page.inner_text(".health .level").lower() == status["level"].replace("_", " ")
    assert page.inner_text(".health .action") == status["action"]


@pytest.mark.slow
def test_normal_is_not_said_where_the_limit_is_reached(open_page, store, board):
    show_machine(store, board, "worn-out")
    page = open_page("/")
    assert page.inner_text(".fleet .level") == "End of life"
    page.get_by_role("link", name="worn-out", exact=True).click()
    page.wait_for_selector("main[data-view=overview]")
    shown = page.inner_text("main")
    assert "End of life" in shown and "Normal" not in shown and "The limit is reached." in shown


@pytest.mark.slow
def test_keyboard_reaches_the_machines_the_tabs_and_the_charts(open_page, store, board):
    show_machine(store, board, "model")
    page = open_page("/")

    def press_until(selector, key="Tab", most=40):
        for _ in range(most):
            page.keyboard.press(key)
            if page.evaluate("s => document.activeElement?.matches(s)", selector):
                return
        raise AssertionError(f"{selector} was not reached")

    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"
    press_until(".fleet tbody a")
    page.keyboard.press("Enter")
    page.wait_for_selector("main[data-view=overview]")
    assert page.evaluate("document.activeElement.tagName") == "H1"  # the reader goes on at the view's beginning
    press_until(".tabs a[aria-current]")
    page.keyboard.press("End")
    last = page.evaluate("document.activeElement.getAttribute('href')")
    page.keyboard.press("Enter")
    page.wait_for_selector(f"main[data-view={last.rpartition('/')[2]}]")
    page.go_back()
    page.wait_for_selector("main[data-view=overview]")
    press_until("#rms .u-wrap", most=80)
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"


@pytest.mark.slow
def test_print_is_light_and_cuts_nothing_off(open_page, store, board):
    show_machine(store, board, "model")
    page = open_page("/#/asset/model", color_scheme="dark")
    document = pypdfium2.PdfDocument(io.BytesIO(page.pdf(format="A4")))
    assert len(document) <= 3
    text = unicodedata.normalize(
        "NFKC", "".join(document[i].get_textpage().get_text_bounded() for i in range(len(document)))
    )
    for part in (
        "Largest wear depth",
        "Remaining life",
        "Vibration RMS",
        "material removed",
        "Misalignment",
        "Unexplained",
    ):
        assert part in text
    for i in range(len(document)):
        picture = document[i].render(scale=1).to_pil().convert("L")
        width, height = picture.size
        margins = [picture.crop((0, 0, 30, height)), picture.crop((width - 30, 0, width, height))]
        assert all(margin.getextrema()[0] > 200 for margin in margins), f"page {i} is drawn into its margin"
        assert picture.getpixel((5, 5)) > 250


@pytest.mark.slow
def test_list_of_machines_is_a_table_on_paper_that_begins_on_the_first_sheet(open_page, store, board):
    for kind in KINDS:
        show_machine(store, board, kind)
    document = pypdfium2.PdfDocument(io.BytesIO(open_page("/").pdf(format="A4")))
    sheets = [" ".join(document[i].get_textpage().get_text_bounded().split()) for i in range(len(document))]
    assert len(sheets) <= 2 and "Wear depth Remaining life" in sheets[0] and "worn-out" in sheets[0]


@pytest.mark.slow
def test_no_machine_yet_says_how_to_begin(open_page):
    page = open_page("/")
    said = page.inner_text(".empty")
    assert "gear-twin replay" in said and "gear-twin import" in said
    assert page.inner_text("#link") == "connected"
    assert findings(page) == ([], [])


@pytest.mark.slow
def test_connection_that_is_lost_is_said_and_found_again(open_page, store, board):
    fakes.campaign(store, board)
    page = open_page("/", allowed="")
    page.route("**/v1/assets?*", lambda route: route.abort())
    page.wait_for_selector("#link[data-state=lost]")
    page.unroute("**/v1/assets?*")
    page.wait_for_selector("#link[data-state=live]")
