"""The list of assets by pages, and the areas that it is narrowed to."""

from __future__ import annotations

from itertools import chain
from urllib.parse import quote

import pytest
import service_fakes as fakes
from test_api import Client

from service.api import create_app
from service.results.asset_list import Place, area_of

LEVELS = ("end_of_life", "alarm", "watch", "no_verdict", "normal")


def at(level, reason="The twin explains the vibration."):
    return fakes.report(10.0, 1) | {"status": fakes.status(level, reason)}


@pytest.fixture
def client(store, board):
    for number, level in enumerate(LEVELS):
        for line in ("a", "b"):
            fakes.take(store, board, f"plant.{line}.gb-{number}", 0, 10.0, report=at(level))
    fakes.take(store, board, "press-1", 0, 10.0, report=at("alarm", "A cracked tooth was found."))
    board.update("press-2", retired={"since": "2026-01-01T00:00:00+00:00", "by": None, "note": None})
    return Client(create_app(board, store))


def names(answer):
    assert answer.status_code == 200, answer.text
    return [asset["asset"] for asset in answer.json()]


def pages(client, **given):
    """All pages of a choice, by their links."""
    text = "&".join(f"{name}={quote(str(value))}" for name, value in given.items())
    url, found = f"/v1/assets?{text}", []
    while url:
        answer = client.get(url)
        found.append(names(answer))
        link = answer.headers.get("link")
        assert link is None or link.endswith('>; rel="next"')
        url = link and link[1:].partition(">")[0]
    return found


def test_without_a_choice_all_assets_are_listed_by_name(client, board):
    answer = client.get("/v1/assets")
    assert names(answer) == sorted(board.assets()) and "link" not in answer.headers


def test_pages_go_from_the_worst_to_the_best_and_have_every_asset_once(client, board):
    whole = names(client.get("/v1/assets?limit=1000"))
    assert whole[:4] == ["plant.a.gb-0", "plant.b.gb-0", "plant.a.gb-1", "plant.b.gb-1"]
    assert sorted(whole) == sorted(board.assets())
    for limit in (1, 5, 12):
        found = pages(client, limit=limit)
        assert [*chain(*found)] == whole and {len(page) for page in found[:-1]} <= {limit}


def test_a_list_is_narrowed_by_area_level_words_and_use(client):
    assert names(client.get("/v1/assets?area=plant.a")) == [f"plant.a.gb-{n}" for n in range(5)]
    assert names(client.get("/v1/assets?level=watch&level=end_of_life&area=plant.b")) == [
        "plant.b.gb-0",
        "plant.b.gb-2",
    ]
    assert names(client.get("/v1/assets?search=CRACKED%20press")) == ["press-1"]
    assert names(client.get("/v1/assets?search=rig%20model&limit=1")) == ["plant.a.gb-0"]
    assert "press-2" in names(client.get("/v1/assets?area=press"))
    assert names(client.get("/v1/assets?area=press&retired=false")) == ["press-1"]
    assert pages(client, level="alarm", limit=2) == [["plant.a.gb-1", "plant.b.gb-1"], ["press-1"]]


def test_areas_count_their_assets_by_level(client):
    areas = {area["area"]: area for area in client.get("/v1/areas").json()}
    assert list(areas) == ["plant.a", "plant.b", "press"]
    assert areas["plant.a"]["levels"] == dict.fromkeys(LEVELS, 1) and areas["plant.a"]["assets"] == 5
    assert areas["press"] == {"area": "press", "assets": 1, "levels": {"alarm": 1}, "alarms": 0, "retired": 1}


@pytest.mark.parametrize("given", ["cursor=x", "cursor=7.press-1", "limit=0", "level=bad", "search=%00", "area=%2F"])
def test_what_cannot_be_is_refused(client, given):
    assert client.get(f"/v1/assets?{given}").status_code == 422


def test_a_cursor_says_a_place():
    place = Place(severity=3, asset="press-1")
    assert Place.of(place.cursor) == place
    assert area_of("press-1") == "press"
