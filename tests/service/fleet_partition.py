"""One partition of a fleet as a process of its own, with the fake twin; run as a program, set by the environment."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import fake_twin
from forked_processes import ForkedProcess
from service_streams import ROOT, wait_until

from service.fleet.layout import Layout

HERE = Path(__file__).parent


class PartitionProcess:
    """A worker of a partition, and what it has said."""

    def __init__(self, folder: Path, database: str, endpoint: str, *, partition=0, partitions=1, **settings):
        folder.mkdir(parents=True, exist_ok=True)
        self.given = {
            "CONNECT": f'["{endpoint}"]', "DATA": str(folder / "data"), "DATABASE": database, "IDLE_TIMEOUT": "0.7",
            "WORKERS": "0", "NEW_ASSETS": "adopt",
        } | settings  # fmt: skip
        self.partition, self.partitions, self.folder = partition, partitions, folder
        self.prefix = Layout(partitions).prefix_of(partition)
        self.process, self.count = None, 0

    def start(self) -> PartitionProcess:
        environment = os.environ | {f"GEAR_TWIN_{k}": v for k, v in self.given.items()}
        environment |= {"PYTHONPATH": str(ROOT), "PARTITION": str(self.partition), "PARTITIONS": str(self.partitions)}
        self.count += 1
        self.out, self.err = (self.folder / f"{name}-{self.count}.txt" for name in ("said", "complained"))
        with self.out.open("w") as out, self.err.open("w") as err:
            self.process = ForkedProcess(HERE / "fleet_partition.py", environment, out, err)
        wait_until(lambda: self.process.poll() is not None or "at work" in self.out.read_text())
        assert self.process.poll() is None, self.err.read_text()
        return self

    def end(self, how: int = signal.SIGKILL) -> int:
        if self.process.poll() is None:
            self.process.send_signal(how)
        return self.process.wait(20)


if __name__ == "__main__":
    from service.fleet.partition import PartitionRoles
    from service.results.roles import INGEST
    from service.runtime import pump
    from service.runtime.role_process import Context, Others
    from service.settings import Settings

    pump.JOINED = fake_twin.JOINED
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())

    class AtWork(Context):
        begun = False

        def say(self, what):
            if what.begun and not self.begun:
                self.begun = True
                print("at work", flush=True)

    layout = Layout(int(os.environ["PARTITIONS"]))
    roles = PartitionRoles(
        settings=Settings(), partition=int(os.environ["PARTITION"]), layout=layout, twin=fake_twin.TWIN
    )
    roles.ingest(AtWork(INGEST, stop, Others()))
    os._exit(0)
