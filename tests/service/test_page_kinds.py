"""What the page says of machines of every kind: each thing once, with its unit, and nothing that is not known."""

from __future__ import annotations

import time

import pytest
import service_fakes as fakes
from gear_signals import START, meshing_window
from machines import MODULATION, NOT_GIVEN, SUDDEN, show_machine, show_waiting
from segments import in_folder, keep

from service.results.snapshot import Waiting
from twin.windows import Window


@pytest.fixture
def signals(store, tmp_path):
    return in_folder(store, tmp_path / "segments")


def shown(page, kind, view=""):
    page.evaluate("hash => { location.hash = hash }", f"#/asset/{kind}{view and '/'}{view}")
    page.wait_for_selector(f"main[data-view={view.partition('/')[0] or 'overview'}]")
    page.wait_for_function("kind => document.title.includes(kind)", arg=kind)
    return page.inner_text("main")


@pytest.mark.slow
def test_list_of_machines_gives_units_and_says_nothing_of_a_machine_without_windows(open_page, store, board):
    show_machine(store, board, "preliminary")
    show_waiting(store, board)
    page = open_page("/")
    rows = {row.get_attribute("data-asset"): row.inner_text() for row in page.locator(".fleet tbody tr").all()}
    assert "5–95 %: 495 – 550 µm" in rows["preliminary"]
    life = page.locator("[data-asset=preliminary] td").nth(3).inner_text()
    assert "limit reached" in life and "5–95 %: 0 h – 3 min" in life and "preliminary" in life
    assert "wear depth" in page.locator("[data-asset=preliminary] td").nth(4).inner_text()
    assert "vibration level" not in rows["waiting"]  # nothing is known of what it can tell


@pytest.mark.slow
def test_a_life_that_is_not_sure_to_be_over_keeps_its_band_and_its_reason_is_said_once(open_page, store, board):
    show_machine(store, board, "preliminary")
    page = open_page("/#/asset/preliminary")
    assert len(page.inner_text(".health .reason").split()) <= 25 and "What helps" not in page.inner_text("main")
    page.click(".health summary")
    said = page.inner_text("main")
    assert said.lower().count(SUDDEN) == 1
    assert "What helps: record 2 more windows at this speed and load; measure the wear depth." in said
    assert "5–95 %: 0 – 3 min" in page.inner_text(".cards .card >> nth=1")


@pytest.mark.slow
def test_life_of_a_machine_that_must_stop_is_said_to_be_of_wear_alone(open_page, store, board):
    show_machine(store, board, "cracked")
    page = open_page("/#/asset/cracked")
    assert "of wear alone" in page.inner_text(".cards .card >> nth=1").lower()
    effect = page.inner_text("#effects")
    assert "stiffness loss 53.2 ± 4.4 %, tooth 9." in effect
    assert "neither the wear depth nor the life until the wear limit" in effect


@pytest.mark.slow
def test_machine_without_a_model_says_why_once_and_lists_its_sidebands(open_page, store, board):
    show_machine(store, board, "level")
    page = open_page("/#/asset/level")
    assert page.inner_text("main").count(NOT_GIVEN.partition("give ")[2]) == 1
    assert "The machine cannot be judged; see below what it cannot tell yet, and why." in page.inner_text(".health")
    table = page.inner_text("section:has(h2:text('Modulation'))")
    assert "once per turn of the pinion" in table and "18.9 ± 0.11" in table and "Healthy gears have sidebands" in table
    shown(page, "level", "data")
    assert page.locator("h2", has_text="Modulation").count() == 0
    assert "model" not in page.inner_text("#windows")  # a column without values


@pytest.mark.slow
def test_encoders_alone_have_a_signal_to_look_at_first(open_page, store, board, signals):
    show_machine(store, board, "encoders")
    keep(signals, "encoders", 0, Window(start_time_ns=START, encoders=meshing_window().encoders))
    page = open_page("/#/asset/encoders/signals")
    page.wait_for_selector("#signal[data-points]:not([data-points='0'])")
    assert "Waveform of encoder" in page.inner_text("main")
    assert page.is_disabled("[data-key=previous-window]") and page.is_disabled("[data-key=next-window]")


@pytest.mark.slow
def test_a_counter_that_begins_again_is_no_axis(open_page, store, board):
    for index, turns in enumerate((122.0, 122.5, 122.0, 367.0)):
        fakes.take(store, board, "fan", index, turns, report=fakes.little_known_report())
    page = open_page("/#/asset/fan")
    assert page.get_by_label("time", exact=True).is_checked()


@pytest.mark.slow
def test_what_every_window_says_is_said_once(open_page, store, board):
    for index in range(3):
        fakes.take(store, board, "fan", index, 4.0e4, report=fakes.little_known_report())
    page = open_page("/#/asset/fan/data")
    assert page.inner_text("#windows").count("beyond the steady states of the model") == 0
    assert page.inner_text("#windows").count("Beyond the steady states of the model") == 1


@pytest.mark.slow
def test_a_retired_machine_is_not_shown_as_one_that_runs(open_page, store, board):
    show_machine(store, board, "retired")
    page = open_page("/#/asset/retired")
    assert "Out of use since 16 Nov 2023" in page.inner_text(".health") and "A. Fitter: sold" in page.inner_text(
        ".health"
    )
    page.goto(f"{page.url.partition('#')[0]}#/")
    page.get_by_label("retired machines too").check()
    page.wait_for_selector("[data-asset=retired] .badge:text-is('retired')")


@pytest.mark.slow
def test_machine_whose_windows_wait_says_how_many_and_behind_which_machine(open_page, store, board):
    show_waiting(store, board)
    board.update("waiting", waiting=Waiting(windows=6, since_ns=time.time_ns() - 85 * 10**9, behind=("pump-3",)))
    page = open_page("/#/asset/waiting")
    assert "6 windows wait to be assessed" in page.inner_text(".health .reason")
    assert "behind pump-3" in page.inner_text(".health .reason") and "behind pump-3" in page.inner_text(".seen")
    assert "no whole measurement window" not in page.inner_text("main")


@pytest.mark.slow
def test_every_view_of_a_machine_says_when_it_was_last_seen(open_page, store, board):
    show_machine(store, board, "model")
    board.update("model", last_frame_ns=time.time_ns() - 180 * 10**9)
    page = open_page("/#/asset/model")
    for view in ("", "alarms", "what-if", "life", "data"):
        shown(page, "model", view)
        assert page.inner_text(".seen").startswith("Last seen 3 minutes ago"), view


@pytest.mark.slow
def test_new_modulation_is_a_change_since_the_healthy_baseline(open_page, store, board):
    """The card said `none found` above a modulation nine times as deep as in the healthy recordings."""
    show_machine(store, board, "baseline")
    report = {**board.get("baseline").report, "effects": []}
    report["modulation"] = [{**MODULATION, "healthy_percent": [2.8, 3.1], "new": True}]
    board.update("baseline", report=report)
    card = open_page("/#/asset/baseline").inner_text(".cards .card >> nth=0")
    assert "none found" not in card and "modulation 1 × per turn of the pinion" in card


@pytest.mark.slow
def test_what_could_have_been_found_is_on_the_page_in_the_words_of_the_answer(open_page, store, board):
    show_machine(store, board, "baseline")
    said = ["What 6 windows would have shown, where nothing was found:", "tooth crack: stiffness loss from 0.3 (basis)"]
    board.update("baseline", report={**board.get("baseline").report, "effects": [], "detectable": {"said": said}})
    page = open_page("/#/asset/baseline")
    page.click(".cards .card details summary")
    assert all(line in page.inner_text(".cards .card >> nth=0") for line in said)


@pytest.mark.slow
def test_baseline_is_counted_by_windows_days_and_loads(open_page, store, board):
    """Twelve windows of one file of two minutes were "12 recordings (at least 5 to judge teeth)"."""
    show_machine(store, board, "baseline")
    report = board.get("baseline").report
    baseline = {**report["baseline"], "recordings": [f"healthy#{i}" for i in range(12)], "days": 1, "loads": 1}
    board.update("baseline", report={**report, "baseline": baseline})
    said = open_page("/#/asset/baseline").inner_text(".cards")
    assert (
        "12 windows" in said and "recorded on 1 day, at 1 operating condition" in said and "12 recordings" not in said
    )
