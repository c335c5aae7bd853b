"""What the page asks for is small: compressed, not sent again where nothing changed, thin where a part is enough."""

from __future__ import annotations

import gzip

import httpx
import pytest
import service_fakes as fakes

PAGE_LIMIT = 1_500_000  # of the whole page on the wire [bytes]


def raw(address, path, **headers):
    """Status, headers and the bytes that went over the wire."""
    with httpx.stream("GET", address + path, headers={"Accept-Encoding": "gzip", **headers}) as answer:
        return answer.status_code, answer.headers, b"".join(answer.iter_raw())


@pytest.mark.parametrize("path", ["/v1/assets", "/v1/assets/unsw", "/v1/assets/unsw/trend", "/v1/assets/unsw/windows"])
def test_an_answer_that_has_not_changed_is_not_sent_again(address, store, board, path):
    fakes.campaign(store, board)
    _, headers, _ = raw(address, path)
    status, again, body = raw(address, path, **{"If-None-Match": headers["etag"]})
    assert status == 304 and body == b"" and again["etag"] == headers["etag"]
    fakes.take(store, board, "unsw", 90, 19500.0)
    assert raw(address, path, **{"If-None-Match": headers["etag"]})[0] == 200


def test_long_answers_are_compressed_and_event_streams_are_not(address, store, board):
    fakes.campaign(store, board)
    _, headers, body = raw(address, "/v1/assets/unsw")
    assert headers["content-encoding"] == "gzip"
    assert len(gzip.decompress(body)) > 3 * len(body)
    with httpx.stream("GET", f"{address}/v1/assets/unsw/events?after=0", headers={"Accept-Encoding": "gzip"}) as stream:
        assert "content-encoding" not in stream.headers
        assert "window" in next(line for line in stream.iter_lines() if line.startswith("event:"))


def test_state_can_be_had_without_its_windows(address, store, board):
    fakes.campaign(store, board)
    whole = httpx.get(f"{address}/v1/assets/unsw").json()
    thin = httpx.get(f"{address}/v1/assets/unsw?windows=0").json()
    assert thin["windows"] == [] and thin["windows_total"] == 14
    assert {**thin, "windows": whole["windows"]} == whole
    latest = httpx.get(f"{address}/v1/assets/unsw?windows=3").json()["windows"]
    assert [w["index"] for w in latest] == [11, 12, 13]


def test_summary_has_what_a_row_of_the_list_shows_also_after_a_restart(address, store, board):
    fakes.campaign(store, board, windows=100)
    (row,) = httpx.get(f"{address}/v1/assets").json()
    assert row["kind"] == "model" and row["limit_um"] == 500 and row["preliminary"] is False
    assert row["depth_um"]["median"] == pytest.approx(fakes.depth_um(18000.0))
    assert row["life_hours"]["p05"] < row["life_hours"]["median"]
    course = row["sparkline"]
    assert course["unit"] == "µm" and 15 <= len(course["values"]) <= 30
    assert course["values"] == sorted(course["values"]) and course["values"][-1] == pytest.approx(
        row["depth_um"]["median"]
    )
    assert fakes.WrittenTable(store).get("unsw").summary()["sparkline"] == course


def test_summary_of_a_machine_without_a_model_shows_its_level(address, store, board):
    for index in range(4):
        fakes.take(store, board, "fan", index, 10.0 * index, report=fakes.little_known_report())
    (row,) = httpx.get(f"{address}/v1/assets").json()
    assert row["kind"] == "level" and row["depth_um"] is row["limit_um"] is row["life_hours"] is None
    assert row["sparkline"]["quantity"] == "vibration RMS" and len(row["sparkline"]["values"]) == 4


@pytest.mark.slow
def test_whole_page_is_small_on_the_wire(open_page, address, store, board):
    fakes.campaign(store, board)
    page = open_page("/#/asset/unsw")
    page.wait_for_selector("main[data-windows='14']")
    paths = page.evaluate(
        "performance.getEntriesByType('resource').map(e => new URL(e.name)).map(u => u.pathname + u.search)"
    )
    sizes = {path: len(raw(address, path)[2]) for path in {"/", *paths} if not path.endswith("/events")}
    assert len(sizes) > 15 and sum(sizes.values()) < PAGE_LIMIT / 5, sizes
