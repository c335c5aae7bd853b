"""REST: the list of assets, whole or by pages, and the areas that it can be narrowed to."""

from __future__ import annotations

from typing import Annotated, Any, get_args
from urllib.parse import urlencode

from fastapi import Query, Request
from fastapi.responses import Response
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from service.access.roles import Role
from service.api.conditional import answer
from service.api.guard import Responses, Routes
from service.contract import rest as models
from service.contract.base import AnswerModel
from service.contract.finding import Level
from service.results.asset_list import CURSOR, MOST, PAGE, Choice, Place

router = Routes("assets", prefix="/v1")

LONGEST = 200  # characters of a search

NEXT: Responses = {
    200: {
        "headers": {
            "Link": {
                "description": 'where there is a next page: its address, with `rel="next"`',
                "schema": {"type": "string"},
            }
        }
    }
}


class ListQuery(BaseModel):
    """Which assets are asked for; all of them, by name, where nothing is given."""

    limit: int | None = Field(
        None,
        ge=1,
        le=MOST,
        description=f"at most this many, the most severe first, then by name; {PAGE} where only others are given",
    )
    cursor: str | None = Field(
        None, pattern=f"^{CURSOR}$", description='of the next page, as `Link: <…>; rel="next"` has it'
    )
    search: str | None = Field(
        None,
        max_length=LONGEST,
        pattern=r"^[^\x00]*$",
        description="words that are all found in the asset's name, rig file, kind, level, reasons or action",
    )
    area: str | None = Field(
        None, max_length=64, pattern=r"^[A-Za-z0-9_.-]*$", description="only assets of this area (`/v1/areas`)"
    )
    level: list[Level] = Field([], max_length=len(get_args(Level)), description="only these levels of the status")
    retired: bool | None = Field(None, description="false: without assets that are out of use")

    def choice(self) -> Choice | None:
        """What is asked for; None for all assets by name."""
        if not self.model_fields_set:
            return None
        return Choice(
            after=None if self.cursor is None else Place.of(self.cursor),
            limit=self.limit or PAGE,
            words=tuple((self.search or "").lower().split()),
            area=self.area,
            levels=tuple(self.level),
            retired=self.retired is not False,
        )

    def address(self, path: str, cursor: str) -> str:
        """The address of the page behind a cursor."""
        given = {**self.model_dump(mode="json", exclude_unset=True), "cursor": cursor}
        return f"{path}?{urlencode(given, doseq=True)}"


class Area(AnswerModel):
    """A part of the plant, as the names of its assets state it: all before the last `.`, or the last `-` or `_`."""

    area: str = Field(description="empty for assets whose names state none")
    assets: int = Field(description="in use")
    levels: dict[str, int] = Field(description="of them, by the level of their status, the worst first")
    alarms: int = Field(description="active alarms of these assets")
    retired: int = Field(description="assets out of use")


@router.entry("GET /assets", Role.read, list[models.AssetSummary], 422, responses=NEXT)
async def assets(request: Request, query: Annotated[ListQuery, Query()]) -> Any:
    """The assets seen, each with its status: all by name, or by pages, the most severe first."""
    table, choice = request.app.state.table, query.choice()

    def found() -> Response:
        if choice is None:
            return answer(request, table.summaries())
        page = table.page(choice)
        made = answer(request, list(page.summaries))
        if page.next is not None:
            made.headers["Link"] = f'<{query.address(request.url.path, page.next.cursor)}>; rel="next"'
        return made

    return await run_in_threadpool(found)


@router.entry("GET /areas", Role.read, list[Area])
async def areas(request: Request) -> Any:
    """The parts of the plant by name: how many assets each has, by level."""
    table = request.app.state.table
    return await run_in_threadpool(lambda: answer(request, table.areas()))
