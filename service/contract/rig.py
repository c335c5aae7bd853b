"""What an answer says of its rig file: name, source of the mesh stiffness, and values that disagree with each other."""

from __future__ import annotations

import json
from functools import lru_cache

from pydantic import Field

from service.contract.base import ContractModel
from twin.rig import Rig


class RigSummary(ContractModel):
    """The rig file in use, in short."""

    name: str
    mesh_stiffness: str = Field(description="potential-energy method, or given in the rig file")
    notes: list[str] = Field(description="values that the file states twice and differently, a sentence each")

    @classmethod
    def of(cls, rig: Rig) -> RigSummary:
        return _summary(rig.text)


@lru_cache(maxsize=16)
def _summary(text: str) -> RigSummary:
    """Kept by the file's values: the notes on wear take half a second."""
    from twin.rig_notes import rig_notes

    rig = Rig.from_mapping(json.loads(text))
    return RigSummary(name=rig.name, mesh_stiffness=rig.mesh_stiffness_source, notes=list(rig_notes(rig)))
