"""The `mcap` reader with protobuf and numpy: every message of a recording as an array.

Messages are taken in the order of the file, which is the faster of the reader's two orders, once without and once with
the check of each chunk's CRC. Their classes are made from the descriptors that the recording carries.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from exchange import Found, serve, shortest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader


def classes_of(summary: Any) -> dict[int, Any]:
    """The message class of every schema, by its id."""
    pool, found = descriptor_pool.DescriptorPool(), {}
    added: set[str] = set()
    for ident, schema in summary.schemas.items():
        if schema.encoding != "protobuf":
            continue
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            if file.name not in added:
                pool.Add(file)
                added.add(file.name)
        found[ident] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return found


def arrays(path: str, crcs: bool) -> list[np.ndarray]:
    """Samples and edge times of every frame, as gear-twin decodes them."""
    out = []
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=crcs)
        classes = classes_of(reader.get_summary())
        for schema, _, message in reader.iter_messages(log_time_order=False):
            if schema is None or schema.id not in classes:
                continue
            frame = classes[schema.id]()
            frame.ParseFromString(message.data)
            if schema.name.endswith("EncoderFrame"):
                out.append(np.array(frame.edge_offset_ns, dtype=np.float64))
            else:
                out.append(np.array(frame.values, dtype=np.float32))
    return out


def read(problem: dict[str, Any]) -> Found:
    path = problem["recording"]
    times = {
        "plain": shortest(lambda: arrays(path, False)),
        "checked": shortest(lambda: arrays(path, True)),
    }
    found = arrays(path, True)
    total = sum(float(np.sum(a, dtype=float)) for a in found)
    return times, {"frames": len(found), "values": sum(a.size for a in found), "sum": total}


if __name__ == "__main__":
    serve("mcap", {"read": read})
