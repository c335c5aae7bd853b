"""Two advanced publishers on one key of a running service are named by the identities that Zenoh gives."""

from __future__ import annotations

import time

import pytest
import zenoh
import zenoh.ext
from service_streams import service, wait_until
from streams import ACCEL, LENGTH, frame

from service.stream.wire.codec import encode, encoding_of
from service.stream.wire.topics import topic_of
from service.transport.zenoh_session import open_session


@pytest.mark.slow
def test_two_advanced_publishers_on_one_key_are_named_by_a_running_service(tmp_path):
    with (
        service(tmp_path / "data") as running,
        open_session((), [running.endpoint]) as one,
        open_session((), [running.endpoint]) as two,
    ):
        key = topic_of(ACCEL._replace(asset="unsw"))
        made = [
            zenoh.ext.declare_advanced_publisher(
                each, key, sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=0.5)
            )
            for each in (one, two)
        ]
        time.sleep(1.0)
        for number in range(240):
            if "two publishers" in running.said()[1]:
                break
            payload = encode(frame(ACCEL, number, number * LENGTH))
            made[number // 4 % 2].put(payload, encoding=encoding_of(ACCEL))
            time.sleep(LENGTH)
        wait_until(lambda: "two publishers send on the key of accel/y6" in running.said()[1])
        assert str(one.zid()) in running.said()[1] and str(two.zid()) in running.said()[1]
