"""Worker processes under a supervisor, without a service: run as a program, with what it is given in a file."""

from __future__ import annotations

import logging
import os
import pickle
import sys
from functools import partial
from pathlib import Path

from forked_processes import ForkedProcess

from service.results.roles import INGEST
from service.runtime import supervisor, work_role
from service.runtime.ingested import Ingested
from service.runtime.role_process import Others
from service.runtime.supervisor import Role, Supervisor
from service.runtime.work_processes import WORK, WorkProcesses
from service.termination import until_told

HERE = Path(__file__).parent


class Processes:
    """The role `work` in processes of their own, as a service sees it.

    failures  how often a process of it cannot be started
    """

    def __init__(self, folder, given, failures=0):
        self._known, self._said, file = folder / "known", folder / "complained.txt", folder / "given"
        file.write_bytes(pickle.dumps(given))
        environment = os.environ | {"POOL": str(file), "KNOWN": str(self._known), "FAILURES": str(failures)}
        with self._said.open("w") as said:
            self._process = ForkedProcess(HERE / "worker_pool.py", environment, said, said)
        self._others = Others()
        self._seen = WorkProcesses(given.count, self._others)

    @property
    def said(self):
        """What has been logged."""
        return self._said.read_text()

    @property
    def role(self):
        """The process that makes the workers."""
        return self._now().process

    @property
    def replaced(self):
        return self._now().replaced

    def _now(self):
        if self._known.exists():
            self._others.take(WORK, *pickle.loads(self._known.read_bytes()))
        return self._others.state(WORK)

    def at_work(self):
        self._now()
        return self._seen.at_work()

    def unusable(self):
        self._now()
        return self._seen.unusable()

    def figures(self):
        self._now()
        return self._seen.figures()

    def end(self):
        self._process.send_signal(15)
        self._process.wait(20)


def begun(context):
    """Says that the results are open."""
    while not context.stop.wait(0.1):
        context.beat()
        context.say(Ingested(begun=True, not_ready=None))


def note(context, known):
    """Notes how the workers are, whenever that changes."""
    while not context.stop.is_set():
        context.others.wait(0.2)
        context.beat()
        new = known.with_suffix(".new")
        new.write_bytes(pickle.dumps((context.others.state(WORK), context.others.said(WORK))))
        new.replace(known)


def main():
    given, failures = (
        pickle.loads(Path(os.environ["POOL"]).read_bytes()),
        [OSError(12, "no memory")] * int(os.environ["FAILURES"]),
    )
    fork = os.fork

    def failing():
        if failures and sys._getframe(1).f_locals["role"].name == WORK:
            raise failures.pop()
        return fork()

    supervisor.os.fork = failing
    logging.basicConfig(stream=sys.stderr)
    logging.getLogger("service").setLevel(logging.INFO)
    roles = [
        Role(name=INGEST, work=begun),
        Role(name="note", work=partial(note, known=Path(os.environ["KNOWN"])), hears=(WORK,)),
        Role(name=WORK, work=partial(work_role.work, given=given), threads=False, hears=(INGEST,)),
    ]
    with until_told() as stop:
        Supervisor(roles).run(stop)
    os._exit(0)


if __name__ == "__main__":
    main()
