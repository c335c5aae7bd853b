"""Roles for tests of the supervisor, which runs in a process of its own: it must have no threads."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

from service.errors import SteppedBack, StorageUnavailable
from service.runtime.supervisor import Role, Supervisor
from service.termination import until_told

HERE = Path(__file__).parent


def beating(context, folder):
    """Beats until it is told to end."""
    context.beat()
    context.say({"pid": os.getpid()})
    (folder / str(os.getpid())).touch()
    while not context.stop.wait(0.05):
        context.beat()
        context.say({"pid": os.getpid()})
    (folder / "ended").touch()


def knowing(context, folder):
    """Notes what it knows of the role `beat`, and beats."""
    (folder / "own" / str(os.getpid())).touch()
    while not context.stop.wait(0.05):
        context.beat()
        (folder / "new").write_bytes(pickle.dumps((context.others.state("beat"), context.others.said("beat"))))
        (folder / "new").rename(folder / "known")


def quiet(context):
    """Says something once, and beats."""
    context.say("here")
    while not context.stop.wait(0.05):
        context.beat()


def parent(context, folder):
    """Has a child, and ends without it."""
    if (child := os.fork()) == 0:
        time.sleep(0.5)
        os._exit(0)
    (folder / "child").write_text(str(child))
    os._exit(0)


def failing(context):
    """Ends at once."""
    raise ValueError("a fault")


def away(context):
    """Ends as its database goes away."""
    raise StorageUnavailable("the server does not answer", reason="connection lost")


def renewing(context, folder):
    """Notes each SIGHUP."""
    signal.signal(signal.SIGHUP, lambda *_: (folder / "renewed").touch())
    (folder / "asks").touch()
    while not context.stop.wait(0.05):
        context.beat()


def back(context):
    """Ends as its database has stepped back."""
    raise SteppedBack("it does not have what it had confirmed", reason="connection lost")


def wanting(context, folder):
    """Says which other roles are wanted, by the file `wanted`."""
    while not context.stop.wait(0.05):
        context.beat()
        context.say((folder / "wanted").read_text().split())


def roles_of(folder, names):
    """The roles of these names; `essential` is one whose error ends the service."""
    (folder / "own").mkdir(exist_ok=True)
    known = {
        "beat": Role(name="beat", work=partial(beating, folder=folder)),
        "short": Role(name="beat", work=partial(beating, folder=folder), silent=1.0),
        "wants": Role(name="wants", work=partial(wanting, folder=folder)),
        "know": Role(name="know", work=partial(knowing, folder=folder), hears=("beat",)),
        "parent": Role(name="parent", work=partial(parent, folder=folder), threads=False),
        "quiet": Role(name="quiet", work=quiet),
        "fail": Role(name="fail", work=failing),
        "away": Role(name="away", work=away, essential=True),
        "back": Role(name="back", work=back),
        "renew": Role(name="renew", work=partial(renewing, folder=folder)),
        "essential": Role(name="fail", work=failing, essential=True),
    }
    return [known[name] for name in names]


def started(folder, *names, before=()):
    """A supervisor of these roles in a process of its own; what it logs is in `log` of the folder.

    before  a command that starts it
    """
    path = os.pathsep.join((str(HERE), str(HERE.parents[1])))
    with (folder / "log").open("w") as log:
        command = [*before, sys.executable, __file__, str(folder), *names]
        return subprocess.Popen(command, env=os.environ | {"PYTHONPATH": path}, stderr=log)


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    folder = Path(sys.argv[1])

    def heard(role, said):
        """Notes what is called with."""
        with (folder / "heard").open("a") as file:
            print(role, said, file=file)

        if role == "wants":
            supervisor.want(roles_of(folder, said))

    supervisor = Supervisor(roles_of(folder, sys.argv[2:]), heard)
    with until_told() as stop:
        supervisor.run(stop)
