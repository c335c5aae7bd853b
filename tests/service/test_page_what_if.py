"""The page's what-if and its inspections; the machine is the bundled short campaign."""

from __future__ import annotations

import json

import pytest
import service_fakes as fakes

from benchmarks.scoring import run as run_windows
from benchmarks.scoring import windows_of
from service.contract.base import iso_time
from service.contract.estimate import step
from tests.documentation import ROOT
from twin.options import Options

ASSET = "unsw-short"
VIEW = f"/#/asset/{ASSET}/what-if"


@pytest.fixture(scope="module")
def machine():
    """Rig, last window, state and estimate of the short campaign without attribution."""
    rig, windows = windows_of(ROOT / "recordings" / "short-campaign.mcap")
    state, _ = run_windows(rig, windows[:-1], Options(trace=False))
    return rig, windows[-1], *step(rig, state, windows[-1], Options(trace=False))


@pytest.fixture
def kept(machine, store, board):
    """The machine in the store and on the board."""
    rig, window, state, estimate = machine
    record = {**estimate.record, "index": 0, "start_time": iso_time(window.start_time_ns), "quality": "good"}
    stored = store.commit(
        ASSET, window.start_time_ns, record=record, state=state.to_dict(), report=estimate.report, received_ns=1,
    )  # fmt: skip
    board.update(ASSET, rig=dict(rig.values))
    board.add_window(ASSET, stored, report=estimate.report, quality={}, last_event_id=0, received_ns=1)
    return estimate


@pytest.mark.slow
def test_present_duty_and_date_are_answered_with_a_chart(open_page, kept):
    page = open_page(VIEW)
    assert page.get_by_label("Pinion speed [Hz]").input_value() == "9.936"
    page.get_by_label("Running time per day [h]").fill("0.01")
    page.get_by_label("Date to reach").fill("2026-02-20")
    page.get_by_role("button", name="Compute").click()
    page.wait_for_selector("#survival canvas", timeout=60_000)
    said = page.inner_text("section[aria-label=Answer]")
    assert "The limit of 500 µm is reached after" in said and "Probability of reaching" in said
    assert int(page.get_attribute("#survival", "data-points")) > 50
    hours = kept.report["rul"]["hours"]["median"]
    assert f"{60 * hours:.0f} min" in said or f"{hours:.2g}" in said
    page.get_by_text("Quantiles").click()
    assert page.locator("section[aria-label=Answer] tbody tr").count() == 13


@pytest.mark.slow
def test_duty_that_cannot_be_is_refused_where_it_was_asked(open_page, kept):
    page = open_page(VIEW, allowed="409")
    page.get_by_label("Torque on the pinion [N·m]").fill("900")
    page.get_by_role("button", name="Compute").click()
    page.wait_for_selector(".said.error")
    assert "times the largest that the rig file states" in page.inner_text(".said.error")
    assert page.locator("section[aria-label=Answer]").is_hidden()


@pytest.mark.slow
def test_conditions_are_added_and_their_shares_sent(open_page, kept):
    page = open_page(VIEW)
    page.get_by_role("button", name="Add a condition").click()
    assert page.locator("fieldset.condition").count() == 2
    page.locator("[data-key='share-1']").fill("60")
    for name, value in (("speed-2", "10"), ("torque-2", "10"), ("share-2", "40")):
        page.locator(f"[data-key='{name}']").fill(value)
    sent = []
    page.on("request", lambda r: sent.append(r.post_data_json) if r.method == "POST" else None)
    page.get_by_role("button", name="Compute").click()
    page.wait_for_selector("#survival canvas", timeout=60_000)
    assert [p["share"] for p in sent[0]["duty"]] == [0.6, 0.4]


def answer_of(applied, contradiction=None):
    """What the service answers to an inspection."""
    band = {"median": 40.0, "p05": 38.0, "p95": 42.0}
    narrow = {"median": 39.0, "p05": 38.5, "p95": 39.5}
    given = {"id": 1, "received_ns": 1, "revolutions": 2400.0, "max_depth_um": 39.0, "flank": "combined", "std_um": 0.5}
    both = {"before": band, "after": narrow}
    return {
        "inspection": given, "twin": {"max_depth_um": band, "extrapolated": False}, "difference_um": 1.0,
        "difference_in_std": 0.8, "within_band": True, "applied": applied, "contradiction": contradiction,
        "reason": None if applied else "kept",
        "changed": {
            "depth_um": both, "k_wear_per_n": {"before": 2e-6, "after": 1.9e-6},
            "rul_hours": {"before": fakes.band(1.0, 0.2), "after": fakes.band(1.1, 0.1)}, "rul_revolutions": both,
        } if applied else None,
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("contradiction", [None, "The inspection at 2,400 revolutions contradicts the windows."])
def test_inspection_shows_what_it_changed(open_page, kept, contradiction):
    page = open_page(VIEW)
    said = answer_of(True, contradiction)
    body = json.dumps(said)
    page.route("**/inspections", lambda route: route.fulfill(
        status=201 if route.request.method == "POST" else 200, content_type="application/json",
        body=body if route.request.method == "POST" else f"[{body}]",
    ))  # fmt: skip
    page.get_by_label("Largest depth [µm]").fill("39")
    page.get_by_label("Its standard deviation [µm]").fill("0.5")
    page.get_by_role("button", name="Use in the estimate").click()
    page.wait_for_selector("#inspections tbody tr")
    changed = page.inner_text(".changed")
    assert "40 µm (38 µm – 42 µm) → 39 µm (38.5 µm – 39.5 µm)" in changed
    assert (contradiction or "What it changed") in changed
    assert page.locator("#inspections tbody tr").count() == 1


@pytest.mark.slow
def test_inspection_that_waits_says_so(open_page, kept):
    page = open_page(VIEW)
    page.get_by_label("Largest depth [µm]").fill("39")
    page.get_by_label("Its standard deviation [µm]").fill("0.5")
    page.get_by_role("button", name="Use in the estimate").click()
    page.wait_for_selector("#inspections tbody tr")
    assert "becomes part of the estimate after the window" in page.inner_text(".changed")
    assert page.locator("#inspections tbody tr").count() == 1


@pytest.mark.slow
def test_machine_without_a_life_says_why_and_still_takes_inspections(open_page, store, board):
    fakes.take(store, board, "bench", 0, 10.0, report=fakes.little_known_report())
    page = open_page("/#/asset/bench/what-if")
    assert "A life under another duty is not available: The rig file does not give" in page.inner_text("main")
    assert page.get_by_role("button", name="Use in the estimate").is_visible()
    assert page.get_by_role("link", name="What if").count() == 1  # of the address alone


@pytest.mark.slow
@pytest.mark.parametrize("width", [1440, 390])
def test_view_fits_its_screen_and_is_accessible(open_page, kept, width):
    from axe_playwright_python.sync_playwright import Axe

    page = open_page(VIEW, width=width)
    page.get_by_role("button", name="Compute").click()
    page.wait_for_selector("#survival canvas", timeout=60_000)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    found = Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
