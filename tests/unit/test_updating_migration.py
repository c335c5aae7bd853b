"""Serialised memory of an earlier schema version opens again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from twin.updating.memory import Memory
from twin.updating.migration import migrate_memory_v1
from twin.updating.rms_update import RmsTrack


def test_a_memory_of_version_1_opens_after_migration():
    memory = replace(Memory(), rms_track=RmsTrack(revolutions=10.0, work=2.0, rate=3.0, updates=1))
    data = memory.to_dict()
    old = {"paper" if key == "rms_track" else key: value for key, value in data.items()}
    assert Memory.from_dict(migrate_memory_v1(old)) == memory
    assert migrate_memory_v1({}) == {}


def test_a_memory_of_version_1_is_not_opened_unmigrated():
    old = {"paper" if key == "rms_track" else key: value for key, value in Memory().to_dict().items()}
    with pytest.raises(KeyError):
        Memory.from_dict(old)
