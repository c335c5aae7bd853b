"""gear-twin beside its peers: environments, the exchange with their programs, and the table; no peer is installed."""

from __future__ import annotations

import ast
import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.long_recording import SOURCE
from benchmarks.peers import __main__ as command
from benchmarks.peers import asking, environments, features, life, reading, transient
from benchmarks.peers.asking import Answer, answered, ask_in
from benchmarks.peers.environments import REQUIREMENTS, Unavailable, python_of
from benchmarks.peers.programs import exchange
from benchmarks.peers.programs.exchange import read_problem, shortest_after, write_problem
from benchmarks.peers.rows import Row, duration, quickest, row, table
from service.stream.sources.mcap import read_windows
from twin.features.extract import extract
from twin.rig import Rig

PROGRAMS = Path(asking.PROGRAMS)
OF_PEER = {
    "exudyn": {"exudyn", "numba"},
    "mcap": {"google", "mcap"},
    "progpy": {"progpy"},
    "ross": {"ross"},
    "scipy": {"scipy"},
}
PROGRAM = """
import sys
task, problem, answer = sys.argv[1:]
if task == "fails":
    raise ValueError("no such model")
with open(answer, "w") as file:
    file.write('{"version": "1.2", "times": {"a": 0.5}, "values": {"x": [1.0, 2.0]}}')
print("a greeting of the library")
"""


class Installer:
    """Notes the commands and makes the interpreter, as venv does; fails from a given command on."""

    def __init__(self, fails_at: int | None = None):
        self.commands: list[tuple[str, ...]] = []
        self.fails_at = fails_at

    def __call__(self, command):
        self.commands.append(tuple(command))
        if len(self.commands) == self.fails_at:
            raise Unavailable("No matching distribution found for exudyn==1.13.6")
        if "venv" in command:
            python = Path(command[-1]) / "bin" / "python"
            python.parent.mkdir(parents=True)
            python.touch()


def test_an_environment_is_made_once(tmp_path):
    installer = Installer()
    python = python_of("scipy", tmp_path, installer)
    assert python == tmp_path / "scipy" / "bin" / "python"
    venv, install = installer.commands
    assert venv == (sys.executable, "-m", "venv", str(tmp_path / "scipy"))
    assert install[0] == str(python) and install[-2:] == REQUIREMENTS["scipy"]
    assert python_of("scipy", tmp_path, installer) == python and len(installer.commands) == 2


def test_an_environment_is_made_again_when_its_requirements_change(tmp_path, monkeypatch):
    python_of("scipy", tmp_path, Installer())
    monkeypatch.setattr(environments, "REQUIREMENTS", {"scipy": ("scipy==9.9",)})
    installer = Installer()
    python_of("scipy", tmp_path, installer)
    assert len(installer.commands) == 2 and installer.commands[1][-1] == "scipy==9.9"


@pytest.mark.parametrize("fails_at", [1, 2])
def test_an_environment_that_cannot_be_filled_is_not_kept(tmp_path, fails_at):
    with pytest.raises(Unavailable, match="No matching distribution"):
        python_of("exudyn", tmp_path, Installer(fails_at))
    assert not (tmp_path / "exudyn").exists()
    installer = Installer()
    python_of("exudyn", tmp_path, installer)
    assert len(installer.commands) == 2


def test_a_failed_command_says_its_own_error():
    said = "import sys; sys.exit('a line\\nERROR: no index\\nanother line')"
    with pytest.raises(Unavailable, match=r"^no index$"):
        environments.run_quietly((sys.executable, "-c", said))
    with pytest.raises(Unavailable, match="-c ended with 3"):
        environments.run_quietly((sys.executable, "-c", "raise SystemExit(3)"))


def test_environments_lie_in_the_users_cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert environments.default_folder() == tmp_path / "gear-twin" / "peers"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert environments.default_folder() == Path.home() / ".cache" / "gear-twin" / "peers"


@pytest.mark.parametrize("name", sorted(REQUIREMENTS))
def test_every_peer_is_pinned_and_has_a_program_that_imports_it_alone(name):
    assert all("://" not in requirement and not requirement.startswith("-") for requirement in REQUIREMENTS[name])
    assert any(requirement.startswith(name) and "==" in requirement for requirement in REQUIREMENTS[name])
    found = set()
    for node in ast.walk(ast.parse((PROGRAMS / f"{name}_peer.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    assert found - sys.stdlib_module_names == {"exchange", "numpy"} | OF_PEER[name]


def test_a_problem_comes_back_as_it_was_kept(tmp_path):
    path = write_problem(
        tmp_path / "p.npz", table=np.arange(6.0).reshape(2, 3), rate=2.5, count=3, recording="a b.mcap"
    )
    kept = read_problem(path)
    assert np.array_equal(kept["table"], [[0, 1, 2], [3, 4, 5]])
    assert (kept["rate"], kept["count"], kept["recording"]) == (2.5, 3, "a b.mcap")
    assert isinstance(kept["count"], int) and isinstance(kept["recording"], str)


def test_what_is_prepared_for_a_timed_call_is_prepared_anew(monkeypatch):
    monkeypatch.setattr(exchange, "LEAST", 0.0)
    given = []
    assert shortest_after(object, given.append, times=3) >= 0.0
    assert len(set(map(id, given))) == len(given) == 4


def test_an_answer_is_what_a_program_writes_whatever_its_library_prints(tmp_path, monkeypatch):
    monkeypatch.setattr(asking, "PROGRAMS", tmp_path)
    (tmp_path / "some_peer.py").write_text(PROGRAM, encoding="utf-8")
    answer = answered("some", Path(sys.executable), "works", tmp_path / "p.npz")
    assert (answer.peer, answer.times, answer.values) == ("some 1.2", {"a": 0.5}, {"x": [1.0, 2.0]})
    with pytest.raises(Unavailable, match="its program failed: ValueError: no such model"):
        answered("some", Path(sys.executable), "fails", tmp_path / "p.npz")


def test_rows_have_times_a_ratio_and_the_check():
    answer = Answer(peer="some 1.2", times={"a": 0.5}, values={"x": 1.0})
    done = row("a step", 2e-6, answer, "a", lambda values: f"within {values['x']:.0e}")
    missing = row("a step", 2e-6, Answer(peer="some", missing="no index"), "a", lambda values: values["x"])
    assert done.ratio == pytest.approx(2.5e5) and missing.ratio is None
    head, first, second = table([done, missing]).splitlines()
    assert head.split() == ["work", "peer", "gear-twin", "peer", "ratio", "results"]
    assert first.split("  ")[0] == "a step" and first.endswith("2 µs   500 ms  2.5e+05  within 1e+00")
    assert second.endswith("2 µs        –        –  not available: no index")
    assert done.plain()["peer_s"] == 0.5 and missing.plain()["ratio"] is None


def test_the_shortest_times_of_all_rounds_count_for_both_sides():
    def one(own, theirs):
        return [Row(what="a step", peer="some 1.2", own=own, theirs=theirs, check="the same")]

    (found,) = quickest([one(3.0, 5.0), one(2.0, 6.0), one(4.0, None)])
    assert (found.own, found.theirs, found.ratio) == (2.0, 5.0, 2.5)
    assert quickest([one(3.0, None), one(2.0, None)])[0].theirs is None


@pytest.mark.parametrize(
    ("seconds", "text"), [(12.3456, "12.3 s"), (0.05, "50 ms"), (3.456e-6, "3.46 µs"), (5e-9, "5 ns"), (0.0, "0 ns")]
)
def test_durations_have_three_digits(seconds, text):
    assert duration(seconds) == text


def test_a_peer_that_cannot_be_had_is_a_row_that_says_so(tmp_path, monkeypatch):
    installer = Installer(fails_at=2)
    monkeypatch.setattr(asking, "python_of", lambda name, folder: python_of(name, folder, installer))
    monkeypatch.setattr(exchange, "LEAST", 0.0)
    rows = command.compared(["stiffness"], ask_in(tmp_path), rounds=2)
    assert len(rows) == 2 and len(installer.commands) == 2  # tried once
    for found in rows:
        assert isinstance(found, Row) and found.own > 0 and found.theirs is None
        assert found.check == "not available: No matching distribution found for exudyn==1.13.6"


def test_the_command_prints_the_table_and_writes_json(tmp_path, monkeypatch, capsys):
    found = Row(what="a step", peer="some 1.2", own=1e-6, theirs=2e-6, check="the same")
    monkeypatch.setattr(command, "COMPARISONS", {"one": lambda ask, folder: [found]})
    monkeypatch.setattr(sys, "argv", ["peers", "--only", "one", "--json", str(tmp_path / "out.json")])
    assert command.main() == 0
    assert capsys.readouterr().out.splitlines()[1].endswith("2  the same")
    assert '"ratio": 2.0' in (tmp_path / "out.json").read_text(encoding="utf-8")


def integrated(problem, steps):
    """The deflection by Runge–Kutta steps in the coordinates of the problem, from what its file holds alone."""
    g, τ, n, h = problem["mesh"], problem["damping_time"], problem["samples"], problem["step"]
    inverse = 1 / np.diag(problem["mass"])

    def rate(i, state):
        q, v = state
        x = g @ q + τ * (g @ v)
        closed = np.maximum(problem["side"] * x + problem["open_by"][:, i % n], 0.0)
        force = problem["load"] - g * (problem["side"] * problem["stiffness"][:, i % n] @ closed)
        return np.array([v, inverse * (force - problem["damping"] @ v - problem["stiffness_matrix"] @ q)])

    state = np.array([problem["start"], np.zeros(g.size)])
    for i in range(0, 2 * steps, 2):
        k1 = rate(i, state)
        k2 = rate(i + 1, state + h / 2 * k1)
        k3 = rate(i + 1, state + h / 2 * k2)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(i + 2, state + h * k3))
    return float(g @ state[0])


def test_the_problem_of_the_transient_holds_the_whole_model(tmp_path, monkeypatch):
    def ask(peer, task, path):
        problem = read_problem(path)
        if peer != "exudyn":
            return Answer(peer=peer, missing="not asked")
        found = dict.fromkeys(("python", "numba", "symbolic"), integrated(problem, problem["checked"]))
        problem["stiffness"] *= 0.0
        found["linear"] = integrated(problem, problem["checked"])
        return Answer(peer="numpy", times=dict.fromkeys(found, 1e-3), values=found)

    monkeypatch.setattr(exchange, "LEAST", 0.0)
    *asked, other = transient.rows(ask, tmp_path)
    assert len(asked) == 4 and other.check == "not available: not asked"
    for found in asked:
        assert float(found.check.rpartition(" ")[2]) < 1e-9, found.check


def test_the_noise_of_the_filters_makes_any_kalman_filter_that_of_the_twin(tmp_path):
    windows = life.measured(rate=1.7e-8)
    kept = read_problem(life.filter_problem(tmp_path, windows))
    x, P, at = kept["mean"], kept["covariance"], kept["start_revolutions"]
    for n, z, Q in zip(kept["revolutions"], kept["measured"], kept["noises"], strict=True):
        F = np.array([[1.0, n - at], [0.0, 1.0]])
        x, P, at = F @ x, F @ P @ F.T + Q, n
        gain = P[:, 0] / (P[0, 0] + kept["std"] ** 2)
        x, P = x + gain * (z - x[0]), P - np.outer(gain, P[0])
    track = windows.track(life.WINDOWS)
    assert x == pytest.approx([track.work, track.rate], rel=1e-9)
    assert track.steady == track.windows == life.WINDOWS  # no window was a surprise


@pytest.fixture
def program(monkeypatch):
    """A peer's program as a module, timed as briefly as can be."""
    monkeypatch.syspath_prepend(str(PROGRAMS))
    monkeypatch.setattr(importlib.import_module("exchange"), "LEAST", 0.0)
    return lambda name: importlib.import_module(f"{name}_peer")


def test_the_readers_program_gives_the_frames_that_gear_twin_reads(program):
    times, values = program("mcap").read({"recording": str(SOURCE)})
    assert set(times) == {"plain", "checked"}
    assert reading.agreement(reading.frames(SOURCE), values).endswith("values, the same")


def test_the_script_by_hand_finds_the_mesh_lines_but_for_what_it_loses(program, tmp_path):
    rig, _, windows = read_windows(SOURCE)
    rig, window = Rig.from_mapping(rig), windows[-1]
    _, values = program("scipy").both(read_problem(features.problem(tmp_path, rig, window)))
    own = extract(rig, window)
    lines = np.array([abs(own.acceleration.at(k)) for k in range(1, features.LINES + 1)])
    assert values["cubic"]["rms"] == pytest.approx(own.rms, rel=0.02)
    assert values["cubic"]["acceleration"] == pytest.approx(lines, rel=0.02)
    assert np.abs(values["cubic_all"]["acceleration"] / lines - 1).max() > 0.3  # the encoder's own angle bends the grid
    assert values["cubic"]["transmission_error"][0] == pytest.approx(abs(own.transmission_error.at(1)), rel=0.01)
    assert features.agreement(own, "cubic")(values).startswith("RMS ")
    features.same_alone(rig, window)
