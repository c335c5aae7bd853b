"""The table of channel kinds is the only place that names them."""

from __future__ import annotations

import ast
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from service.errors import FrameError
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import SampleFrame
from service.stream.wire import gearbox_pb2 as pb
from service.stream.wire.topics import Channel
from twin.windows import Window

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("kind", CHANNEL_KINDS.values(), ids=lambda kind: kind.segment)
def test_a_kind_has_its_message_in_the_wire_format_and_its_place_in_a_window(kind):
    assert kind.schema.removeprefix("gearbox.v1.") in pb.DESCRIPTOR.message_types_by_name
    assert ("slow" if kind.slow else kind.window_field) in {field.name for field in fields(Window)}
    assert bool(kind.record_key) == kind.slow  # a slow channel is shown by its kind's key
    assert kind.rate[0] < kind.rate[1] and kind.values[0] < kind.values[1]
    assert kind.import_units


def test_no_module_of_the_stream_compares_with_the_name_of_a_kind():
    for folder in ("stream", "runtime", "contract"):
        for file in (ROOT / "service" / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Compare):
                    literals = {c.value for c in ast.walk(node) if isinstance(c, ast.Constant)}
                    if file.name not in ("channels.py", "assess.py"):
                        assert not literals & set(CHANNEL_KINDS), f"{file}:{node.lineno}"


def test_a_rate_beyond_the_kind_is_refused_with_the_limit():
    with pytest.raises(FrameError, match=r"sample_rate_hz = 1e\+08 is outside \(0, 1e\+06\] Hz"):
        SampleFrame(
            channel=Channel("a", "accel", "y6"),
            start_time_ns=10**18,
            sequence=1,
            sample_rate=1e8,
            values=np.zeros(1_000_000, np.float32),
        )
