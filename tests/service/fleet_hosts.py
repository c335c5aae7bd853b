"""A host of a fleet as a process of its own, with workers over a stand-in of the twin; run as a program."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from forked_processes import ForkedProcess, role_of
from service_streams import ROOT

HERE = Path(__file__).parent


class HostProcess:
    """A host, and what it has said."""

    def __init__(self, folder: Path, data: Path, database: str, endpoint: str, name: str, partitions: int, **settings):
        folder.mkdir(parents=True, exist_ok=True)
        self.name, self.folder, self.count, self.process = name, folder, 0, None
        given = {
            "CONNECT": f'["{endpoint}"]', "DATA": str(data), "DATABASE": database, "IDLE_TIMEOUT": "5",
            "WORKERS": "2", "NEW_ASSETS": "adopt",
        } | settings  # fmt: skip
        self.environment = os.environ | {f"GEAR_TWIN_{k}": v for k, v in given.items()}
        self.environment |= {"PYTHONPATH": f"{ROOT}{os.pathsep}{HERE}", "HOST": name, "PARTITIONS": str(partitions)}

    def start(self) -> HostProcess:
        self.count += 1
        self.out, self.err = (self.folder / f"{self.name}-{self.count}.{kind}" for kind in ("out", "err"))
        with self.out.open("w") as out, self.err.open("w") as err:
            self.process = ForkedProcess(HERE / "fleet_hosts.py", self.environment, out, err)
        return self

    def role(self, name: str) -> int | None:
        """The process of a role."""
        return role_of(self.process.pid, name)

    def end(self, how: int = signal.SIGKILL) -> int:
        if self.process.poll() is None:
            self.process.send_signal(how)
        return self.process.wait(30)


if __name__ == "__main__":
    import fake_twin
    import worker_twins

    from service.fleet.host import Host
    from service.fleet.layout import Layout
    from service.logs import logging_by
    from service.runtime import pump
    from service.settings import Settings
    from service.termination import until_told

    pump.JOINED = fake_twin.JOINED
    settings, layout = Settings(), Layout(int(os.environ["PARTITIONS"]))
    with logging_by(settings), until_told() as stop:
        Host(settings=settings, layout=layout, name=os.environ["HOST"], twin=worker_twins.TWIN).serve(stop)
    os._exit(0)
