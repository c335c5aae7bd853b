"""`gear-twin fleet up` as a process of its own, with the fake twin unless `twin` is ""; run as a program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from service_streams import ROOT, wait_until

HERE = Path(__file__).parent
FAKE = "fake_twin"


class FleetProcess:
    """A fleet that runs, and what it has said."""

    def __init__(self, folder: Path, database: str, twin: str = FAKE, **settings: str) -> None:
        self.twin = twin
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.data = folder, folder / "data"
        self.given = {
            "DATA": str(self.data), "DATABASE": database, "IDLE_TIMEOUT": "0.7", "WORKERS": "0", "NEW_ASSETS": "adopt",
        } | settings  # fmt: skip
        self.process: subprocess.Popen | None = None
        self.out, self.err = folder / "said.txt", folder / "complained.txt"

    def start(self, seconds: float = 180.0) -> FleetProcess:
        environment = os.environ | {f"GEAR_TWIN_{k}": v for k, v in self.given.items()}
        environment |= {"PYTHONPATH": f"{ROOT}{os.pathsep}{HERE}"}
        with self.out.open("w") as out, self.err.open("a") as err:
            self.process = subprocess.Popen(
                [sys.executable, str(HERE / "fleet_up.py"), self.twin], stdout=out, stderr=err, env=environment
            )
        wait_until(lambda: self.process.poll() is not None or "fleet of" in self.out.read_text(), seconds)
        assert self.process.poll() is None, self.err.read_text()
        return self

    def end(self, how: int = signal.SIGTERM) -> int:
        assert self.process is not None
        if self.process.poll() is None:
            self.process.send_signal(how)
        return self.process.wait(90)


if __name__ == "__main__":
    from importlib import import_module

    from service.fleet.up import prepared, up
    from service.logs import logging_by
    from service.settings import Settings

    settings = Settings()
    with logging_by(settings):
        up(
            settings,
            prepared(settings),
            twin=import_module(sys.argv[1]).TWIN if sys.argv[1] else None,
            announce=lambda line: print(line, flush=True),
        )
    os._exit(0)
