"""The page's list of what waits for a person: unknown machines, and rig files that came on the stream."""

from __future__ import annotations

import pytest
from browsers import under_policy
from memory_transport import MemoryNetwork
from service_streams import SqliteFile, wait_until
from test_other_parts import serving
from test_rig_proposals import OTHER_LIFE, proposed, recording, rig  # noqa: F401
from test_unknown_assets import FIRST, WINDOWS, Replaying, revolutions, unknown_of

from service.runtime.replay import replay


@pytest.fixture
def network():
    return MemoryNetwork()


@pytest.fixture
def running(tmp_path, network):
    with serving(tmp_path / "data", network, SqliteFile(tmp_path / "data"), new_assets="ask") as running:
        yield running


@pytest.fixture
def page(browser, running):
    opened, wrong = under_policy(browser.new_page(viewport={"width": 1280, "height": 900})), []
    opened.on("pageerror", lambda error: wrong.append(str(error)))
    opened.on("console", lambda m: wrong.append(m.text) if m.type in ("error", "warning") else None)
    opened.goto(f"http://{running.http}/")
    opened.wait_for_selector("main[data-view=fleet]", timeout=15_000)
    yield opened
    opened.close()
    assert wrong == []


@pytest.mark.slow
def test_an_unknown_machine_is_adopted_and_a_rig_file_accepted_on_the_page(page, running, network, recording, rig):  # noqa: F811
    assert not page.locator("#incoming").is_visible()
    Replaying(network, recording, wait=0.5).end()
    network.on_rig("unsw", rig)
    network.inbox.offer("gearbox/stray/accel/y6", b"..")
    page.get_by_role("button", name="Adopt with its rig file").wait_for(timeout=15_000)
    unknown = page.locator("#unknown-assets")
    assert "accel/y6" in unknown.inner_text() and "stray" in unknown.inner_text()
    assert "No machine has sent data yet" not in page.inner_text("main")
    page.get_by_label("Your name").fill("Anna")
    page.get_by_label("Note").fill("new press")
    unknown.locator("tr[data-asset=stray]").get_by_role("button", name="Dismiss").click()
    page.wait_for_function("!document.querySelector('#unknown-assets').textContent.includes('stray')")
    unknown.get_by_role("button", name="Adopt with its rig file").click()
    page.wait_for_selector("tr[data-asset=unsw] a[href='#/asset/unsw']")
    assert unknown_of(running) == {} and running.get("/v1/assets/unsw/rig")["name"] == "unsw"
    assert "unsw is adopted" in page.inner_text("#incoming")
    replay(recording, (), 0, publish_to=network.open_publisher)
    assert revolutions(running.wait_for_windows(WINDOWS)) == FIRST
    network.on_rig("unsw", rig.replace(*OTHER_LIFE))
    wait_until(lambda: proposed(running))
    accept = page.get_by_role("button", name="Accept")
    accept.wait_for(timeout=15_000)
    shown = page.inner_text("#rig-proposals")
    assert "1 value differs" in shown and "end_of_life.max_depth" in shown and "0.0003" in shown and "0.0005" in shown
    accept.click()
    accept.wait_for(state="detached")
    assert running.get("/v1/assets/unsw/rig")["end_of_life"]["max_depth"] == 3e-4
    assert [(e["action"], e["note"]) for e in running.get("/v1/audit")] == [
        ("unknown asset dismissed", "new press"), ("asset adopted", "new press"), ("rig_accepted", "new press"),
    ]  # fmt: skip
