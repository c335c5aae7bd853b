"""Answers with an ETag: who has the newest already is answered with 304 and no body."""

from __future__ import annotations

import json
from collections.abc import Mapping
from hashlib import blake2b
from typing import Any

from fastapi import Request, Response

from service.json_text import JsonText


def answer(request: Request, content: Any) -> Response:
    """The content as JSON, or 304 where the request's `If-None-Match` names this very content.

    What the store keeps as text (`JsonText`) is passed on as it is, as the content itself, in a list, or in a list of
    a mapping.
    """
    made = Response(encoded(content), media_type="application/json")
    tag = f'W/"{blake2b(made.body, digest_size=12).hexdigest()}"'
    headers = {"ETag": tag, "Cache-Control": "private, no-cache"}
    known = [one.strip() for one in request.headers.get("if-none-match", "").split(",")]
    if tag in known or tag.removeprefix("W/") in known:
        return Response(status_code=304, headers=headers)
    made.headers.update(headers)
    return made


def encoded(content: Any) -> str:
    """Strict JSON without blanks; ValueError for a number that is not finite."""
    if isinstance(content, JsonText):
        return content.text
    if _has_texts(content):
        return f"[{','.join(encoded(one) for one in content)}]"
    if isinstance(content, Mapping):
        texts = {key: value for key, value in content.items() if isinstance(value, JsonText) or _has_texts(value)}
        rest = _plain({key: value for key, value in content.items() if key not in texts})
        own = [f"{_plain(key)}:{encoded(value)}" for key, value in texts.items()]
        return f"{{{','.join(own + ([rest[1:-1]] if rest != '{}' else []))}}}"
    return _plain(content)


def _has_texts(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and any(
        isinstance(one, Mapping) and not isinstance(one, dict) for one in value
    )


def _plain(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
