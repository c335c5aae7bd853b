"""The page over ten thousand machines: areas, search, states, and pages by cursor."""

from __future__ import annotations

import pytest
import test_fleet_lists

pytestmark = pytest.mark.slow

board = test_fleet_lists.board


@pytest.fixture
def store(fleet_store):
    return fleet_store


def machines(page):
    return page.locator(".fleet tbody tr").evaluate_all("rows => rows.map(r => r.dataset.asset)")


def test_ten_thousand_machines_are_found_by_page_area_state_and_name(open_page, tmp_path):
    page = open_page("/")
    page.wait_for_selector("[data-assets='50']")
    said = page.inner_text(".counts")
    assert "100 end of life, 200 alarm, 300 watch, 400 no verdict, 9000 normal" in said
    first = machines(page)
    assert page.locator(".areas li").count() == 100 and page.locator(".level-end_of_life").count() == 50
    page.get_by_role("button", name="Next machines").click()
    page.wait_for_function("first => document.querySelector('.fleet tbody tr').dataset.asset !== first", arg=first[0])
    assert "machines 51 to 100" in page.inner_text(".pager") and not set(machines(page)) & set(first)
    page.get_by_role("button", name="Previous machines").click()
    page.wait_for_function("first => document.querySelector('.fleet tbody tr').dataset.asset === first", arg=first[0])
    page.screenshot(path=tmp_path / "all.png")
    page.get_by_role("button", name="plant-3.line-4").click()
    page.wait_for_function("document.querySelector('.fleet tbody tr').dataset.asset.startsWith('plant-3.line-4.')")
    assert page.locator(".area[aria-pressed=true]").inner_text().startswith("plant-3.line-4")
    page.get_by_label("Which states").select_option("attention")
    page.wait_for_selector("[data-assets='6']")
    page.screenshot(path=tmp_path / "area.png")
    page.get_by_label("Which states").select_option("")
    page.get_by_label("Search machines").fill("gb-00043")
    page.wait_for_selector("[data-assets='1']")
    assert machines(page) == ["plant-3.line-4.gb-00043"]
    page.screenshot(path=tmp_path / "one.png")
    page.get_by_label("Search machines").fill("no such machine")
    page.wait_for_selector(".none:not([hidden])")
