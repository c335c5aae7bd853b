"""REST: the remaining life of a machine under another duty."""

from __future__ import annotations

import threading
from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse

from service.access.roles import Role
from service.api.guard import Routes
from service.api.problems import problem
from service.api.reading import snapshot_of
from service.contract.what_if import WhatIf, WhatIfIn
from service.errors import InputError
from service.files.rig import checked_rig
from twin.errors import NotAvailable, ParameterError, TwinError

router = Routes("what-if", prefix="/v1/assets")

ONE_AT_A_TIME = threading.Lock()  # a wear curve under a new condition takes seconds of one core
PLACES = threading.BoundedSemaphore(4)  # answers that are computed or waited for: each holds a thread of REST


@router.entry("POST /{asset}/what-if", Role.read, WhatIf, 400, 404, 409, 422, 503)
def what_if(request: Request, asset: str, asked: WhatIfIn) -> Any:
    """The remaining life under another duty, and the probability of reaching a time; changes nothing."""
    from service.contract.what_if_answer import answer  # loads the twin, which a start does without
    from twin.state import State

    snapshot = snapshot_of(request, asset)
    stored = request.app.state.store.asset(snapshot.asset)
    if stored.state is None or snapshot.rig is None:
        return problem(request, 409, f"no window of {asset} has been assessed yet")
    try:
        rig, state = checked_rig(snapshot.rig, f"rig of {asset}"), State.from_dict(stored.state)
    except (InputError, TwinError, ValueError) as reason:
        return problem(request, 409, f"what is stored of {asset} cannot be used for this: {reason}")
    if not PLACES.acquire(blocking=False):
        detail = "several such questions are being answered; ask again in a minute"
        return problem(request, 503, detail, {"Retry-After": "60"})
    try:
        with ONE_AT_A_TIME:
            return JSONResponse(answer(asset, rig, state, asked))
    except NotAvailable as reason:
        return problem(request, 409, str(reason))
    except ParameterError as reason:
        return problem(request, 422, str(reason))
    finally:
        PLACES.release()
