"""The assessment of one stored recording: computed once, and written once, whole or not at all.

    {label}-{digest}.json           the answer of `gear-twin assess --json`
    {label}-{digest}.refused.json   why it cannot be assessed, and what is known of it all the same

The digest is of the recording's place and content (size and time, or the object's tag), the options and the version of
the program. What a repetition may change, such as a file that cannot be read now, is not written.
"""

from __future__ import annotations

import json
import logging
import re
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any, Literal

from service import __version__
from service.errors import FAULT, InputError, StoreError
from service.files.rig import choose_asset, rig_of
from service.fleet.segments import Segments
from service.json_text import json_text
from service.results.object_store import ObjectStore
from service.results.scratch import scratch
from service.results.stored_recordings import StoredRecording
from service.runtime.assess import Unassessable, assess, assess_source
from service.runtime.twin_port import Twin, gear_twin
from service.stream.assembly import AssemblySettings

log = logging.getLogger(__name__)

RESULT, REFUSED = ".json", ".refused.json"
_DIGEST_BYTES = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """What is done with each recording.

    results  folder or URL
    options  of the twin
    rig      name and text of the rig file of all recordings; None for those that are attached
    given    all that was said about options, as plain data: another value calls for another result
    twin     in place of the one of `options`
    """

    results: str
    options: Any
    assembly: AssemblySettings
    prefix: str
    given: dict[str, Any]
    rig: tuple[str, bytes] | None = None
    asset: str | None = None
    twin: Twin | None = None

    def name_of(self, recording: StoredRecording) -> str:
        """The name of a recording's result, without its ending."""
        made_of = [__version__, self.given, recording.identity]
        digest = blake2b(json.dumps(made_of, sort_keys=True).encode(), digest_size=_DIGEST_BYTES).hexdigest()
        return f"{re.sub(r'[^A-Za-z0-9._/-]', '_', recording.label)}-{digest}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of one recording.

    result  name of what was written; None where nothing was
    reason  why it was refused
    """

    state: Literal["assessed", "found", "refused"]
    result: str | None
    reason: str | None = None


def found_outcome(results: ObjectStore, name: str, known: set[str] | None = None) -> Outcome | None:
    """What an earlier run has written; None where it has not.

    known  the names of all results that hold something; None where they have not been listed
    """
    result, refused = name + RESULT, name + REFUSED
    if known is None:
        known = {each for each in (result, refused) if (entry := results.entry(each)) is not None and entry.size}
    if result in known:
        return Outcome(state="found", result=result)
    kept = results.read(refused) if refused in known else None
    return None if kept is None else Outcome(state="refused", result=refused, reason=json.loads(kept)["reason"])


def assess_one(work: Work, recording: StoredRecording) -> Outcome:
    """Assesses a recording, unless its result is there, and writes the result."""
    name = work.name_of(recording)
    results = ObjectStore(work.results, make=True)
    found = found_outcome(results, name)
    if found is not None:
        return found
    try:
        answer = _answer(work, recording)
    except StoreError as error:
        return Outcome(state="refused", result=None, reason=str(error))
    except InputError as error:
        known = error.answer if isinstance(error, Unassessable) else None
        refusal = {"recording": recording.where, "reason": str(error), "answer": known}
        results.put_once(name + REFUSED, _text(refusal))
        return Outcome(state="refused", result=name + REFUSED, reason=str(error))
    except OSError as error:
        said = (error.strerror or type(error).__name__).lower()
        return Outcome(state="refused", result=None, reason=f"{recording.where}: cannot be read: {said}")
    except Exception as error:
        log.exception("%s is not assessed because of an internal error", recording.where)
        return Outcome(state="refused", result=None, reason=f"{recording.where}: {FAULT}: {_said(error)}")
    results.put_once(name + RESULT, _text(answer))
    return Outcome(state="assessed", result=name + RESULT)


def _answer(work: Work, recording: StoredRecording) -> dict[str, Any]:
    twin = work.twin or gear_twin(work.options)
    with scratch() as folder:
        rig_path = None
        if work.rig is not None:
            rig_path = folder / work.rig[0]
            rig_path.write_bytes(work.rig[1])
        if len(recording.parts) > 1:
            any_rig = rig_path is not None
            with Segments(recording.where, recording.parts, work.prefix, any_rig=any_rig) as source:
                asset, rig = choose_asset(source, work.asset), rig_of(source, rig_path)
                return assess_source(source, asset, rig, twin, prefix=work.prefix, assembly=work.assembly)[2]
        with recording.parts[0].fetched() as path:
            try:
                return assess(path, rig_path, asset=work.asset, prefix=work.prefix, assembly=work.assembly, twin=twin)
            except InputError as error:
                error.args = (str(error).replace(str(path), recording.where),)
                raise


def _text(value: Any) -> bytes:
    return (json_text(value) + "\n").encode()


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
