"""Roles in processes of their own: watched, started again, known to one another, ended with their supervisor."""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from forked_processes import is_alive, started_by
from service_streams import wait_until
from supervised import started

pytestmark = pytest.mark.slow  # each starts interpreters


@pytest.fixture
def start(tmp_path):
    made = []

    def start(*names, **given):
        made.append(started(tmp_path, *names, **given))
        return made[-1]

    yield start
    for process in made:
        process.kill()
        process.wait()


def begun(folder, besides=()):
    """The process that has begun, besides earlier ones."""
    wait_until(lambda: {p.name for p in folder.iterdir() if p.name.isdigit()} - {str(b) for b in besides}, 20.0)
    (name,) = {p.name for p in folder.iterdir() if p.name.isdigit()} - {str(b) for b in besides}
    return int(name)


def log_of(folder):
    return (folder / "log").read_text()


def known(folder):
    """What the other role knows."""
    return pickle.loads((folder / "known").read_bytes()) if (folder / "known").exists() else (None, None)


def test_a_role_is_done_by_a_process_of_its_own_in_the_same_group_and_ends_in_good_order(tmp_path, start):
    running = start("beat")
    process = begun(tmp_path)
    assert process != running.pid
    assert (os.getpgid(process), os.getsid(process)) == (os.getpgid(0), os.getsid(0))
    assert Path(f"/proc/{process}/comm").read_text() == "beat\n"
    running.terminate()
    assert running.wait(10) == 0 and not is_alive(process) and (tmp_path / "ended").exists()
    assert log_of(tmp_path) == ""


def test_a_killed_process_is_started_again_at_once(tmp_path, start):
    start("beat")
    first = begun(tmp_path)
    os.kill(first, signal.SIGKILL)
    begun(tmp_path, [first])
    assert "ended with status -9: it is started again in 0.1 s" in log_of(tmp_path)
    assert log_of(tmp_path).count("is started\n") == 1


def test_what_a_role_has_said_once_is_passed_on_with_each_beat(tmp_path, start):
    """Whoever looks after a partition from outside sees by this that it lives."""
    start("quiet")
    heard = tmp_path / "heard"
    wait_until(lambda: heard.exists() and heard.read_text().count("quiet here\n") >= 3, 20.0)


def test_the_first_process_of_a_container_leaves_no_ended_processes(tmp_path, start):
    """Workers of a role that was killed became its children, and it waited for none of them."""
    alone = ["unshare", "--pid", "--fork", "--kill-child", "--mount-proc"]
    if shutil.which(alone[0]) is None or subprocess.run([*alone, "true"], check=False, capture_output=True).returncode:
        pytest.skip("no namespace of processes can be made here")
    running = start("parent", before=alone)
    wait_until(lambda: (tmp_path / "child").exists(), 20.0)
    first = started_by(running.pid)[0]
    wait_until(lambda: log_of(tmp_path).count("is started again") >= 4, 20.0)  # longer than the children live
    wait_until(lambda: all(map(is_alive, started_by(first))), 20.0)


def test_roles_know_how_others_are_also_after_a_start_of_either(tmp_path, start):
    start("beat", "know")
    first = begun(tmp_path)
    wait_until(lambda: known(tmp_path)[1] == {"pid": first} and known(tmp_path)[0].process == first)
    os.kill(first, signal.SIGKILL)
    second = begun(tmp_path, [first])
    wait_until(lambda: known(tmp_path)[1] == {"pid": second} and known(tmp_path)[0].lives)
    os.kill(begun(tmp_path / "own"), signal.SIGKILL)
    (tmp_path / "known").unlink()
    wait_until(lambda: known(tmp_path)[1] == {"pid": second})


def test_a_suspended_process_is_silent_is_killed_and_another_takes_its_place(tmp_path, start):
    start("short", "know")
    first = begun(tmp_path)
    os.kill(first, signal.SIGSTOP)
    second = begun(tmp_path, [first])
    assert not is_alive(first) and "is silent for 1 s: it is killed" in log_of(tmp_path)
    wait_until(lambda: known(tmp_path)[0].process == second and known(tmp_path)[0].replaced == 1)


def test_a_supervisor_that_was_suspended_with_its_roles_kills_none_of_them(tmp_path, start):
    running = start("short")
    first = begun(tmp_path)
    for process in (running.pid, first):
        os.kill(process, signal.SIGSTOP)
    time.sleep(6.0)  # longer than any turn of a supervisor
    for process in (running.pid, first):
        os.kill(process, signal.SIGCONT)
    time.sleep(2.0)
    assert is_alive(first) and "silent" not in log_of(tmp_path)


def test_a_role_that_ends_at_once_is_tried_again_after_growing_pauses(tmp_path, start):
    start("fail")
    wait_until(lambda: log_of(tmp_path).count("ended with status 1") >= 3, 30.0)
    assert [f"again in {pause:g} s" in log_of(tmp_path) for pause in (0.1, 0.2, 0.4)] == [True] * 3
    assert "ValueError: a fault" in log_of(tmp_path) and "in failing" in log_of(tmp_path)


def test_a_role_that_ends_because_the_database_is_away_is_started_again_and_nothing_else_ends(tmp_path, start):
    running = start("beat", "away")
    wait_until(lambda: log_of(tmp_path).count("away: the server does not answer") >= 2, 20.0)
    assert running.poll() is None and is_alive(begun(tmp_path))


@pytest.mark.parametrize(
    ("role", "said"), [("essential", "ValueError: a fault"), ("back", "SteppedBack: it does not have what it had")]
)
def test_what_ends_a_role_without_which_there_is_no_service_or_finds_nothing_as_it_was_ends_all(
    tmp_path, start, role, said
):
    running = start("beat", role)
    assert running.wait(10) == 1
    assert said in log_of(tmp_path) and "started again" not in log_of(tmp_path)


def test_roles_are_told_of_a_hangup_and_those_that_do_nothing_about_it_go_on(tmp_path, start):
    running = start("beat", "renew")
    process = begun(tmp_path)
    wait_until(lambda: (tmp_path / "asks").exists(), 20.0)
    running.send_signal(signal.SIGHUP)
    wait_until(lambda: (tmp_path / "renewed").exists(), 10.0)
    assert is_alive(process) and running.poll() is None


def test_a_role_is_done_as_long_as_it_is_wanted(tmp_path, start):
    wanted = tmp_path / "wanted"

    def want(*names):
        (tmp_path / "new").write_text(" ".join(names))
        (tmp_path / "new").rename(wanted)

    want()
    running = start("wants", "quiet")
    wait_until(lambda: len(started_by(running.pid)) == 2, 20.0)
    want("beat")
    first = begun(tmp_path)
    os.kill(first, signal.SIGKILL)
    second = begun(tmp_path, (first,))
    assert not (tmp_path / "ended").exists()
    want()
    wait_until(lambda: not is_alive(second) and (tmp_path / "ended").exists(), 10.0)  # in good order
    want("beat", "know")
    third = begun(tmp_path, (first, second))
    wait_until(lambda: (known(tmp_path)[1] or {}).get("pid") == third, 20.0)
    os.kill(third, signal.SIGSTOP)
    want("know")
    wait_until(lambda: not is_alive(third), 20.0)  # also one that does not end by itself
    assert log_of(tmp_path).count("started again") == 1
    running.terminate()
    assert running.wait(10) == 0


@pytest.mark.parametrize("suspended", [False, True])
def test_whatever_ends_the_parent_ends_the_process_also_a_suspended_one(tmp_path, start, suspended):
    running = start("beat")
    process = begun(tmp_path)
    if suspended:
        os.kill(process, signal.SIGSTOP)
    running.kill()
    running.wait()
    wait_until(lambda: not is_alive(process), 5.0)
