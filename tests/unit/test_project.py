"""The project keeps its own rules: who imports whom, what is declared, locked, shipped and documented."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from service.cli import run
from service.cli.commands import app
from tests.rules import may_be_skipped

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
OPTIONAL = PROJECT["project"]["optional-dependencies"]
DEVELOP = (ROOT / "docs" / "how-to" / "develop.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
LOCKS = (
    "requirements.lock", "requirements-formats.lock", "requirements-plant.lock", "requirements-fleet.lock",
    "requirements-dev.lock",
)  # fmt: skip
PLANT = ("postgresql", "mqtt", "opcua", "telemetry")  # the extras that make up `plant`
LOADED_WHERE_SET = {
    "service/bridges/mqtt.py": "mqtt",
    "service/operation/traces.py": "telemetry",
    "service/results/parquet_rows.py": "formats",
    "service/bridges/opcua.py": "opcua",
    "service/fleet/actor.py": "fleet",
    "service/fleet/assess_task.py": "fleet",
    "service/fleet/batch.py": "fleet",
    "service/results/object_store.py": "fleet",
    "service/results/raw_segments.py": "fleet",
    "service/fleet/ray_session.py": "fleet",
    "service/fleet/segments.py": "fleet",
    "service/results/stored_recordings.py": "fleet",
}  # files that alone know an extra's packages
READERS = ROOT / "service" / "files" / "readers"
COMMANDS = sorted(c.name or c.callback.__name__ for c in app.registered_commands if c.callback)
OUTWARD = {"asyncio", "io", "logging", "os", "pathlib", "random", "shutil", "socket", "sqlite3", "subprocess", "time"}
MACHINES = re.compile(r"(?<![\w.])/(?:work|root|home|Users|opt/pypi|opt/wheels)/")
REGISTRIES = re.compile(
    r"pyp[i]\.|python[h]osted|npm[j]s|js[d]elivr|un[p]kg|cdn[j]s|index-url\s*[=\s]\s*\w+:", re.IGNORECASE
)
TEXT = {
    "",
    ".py",
    ".c",
    ".h",
    ".md",
    ".toml",
    ".lock",
    ".yml",
    ".json",
    ".js",
    ".css",
    ".html",
    ".svg",
    ".proto",
    ".txt",
}


def dist_name(requirement: str) -> str:
    return re.split(r"[^\w.\-]", requirement, maxsplit=1)[0].lower().replace("_", "-")


def imports(file: Path, anywhere: bool = True) -> set[str]:
    """Dotted names of what a file imports; only at its top level unless `anywhere`."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree) if anywhere else tree.body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module)
    return found


def packages(file: Path, anywhere: bool = True) -> set[str]:
    return {name.partition(".")[0] for name in imports(file, anywhere)}


def sources(folder: str) -> list[Path]:
    found = sorted((ROOT / folder).rglob("*.py"))
    assert found
    return found


def tracked() -> list[Path]:
    """The files of the project, as git knows them; all but what is ignored."""
    if not (ROOT / ".git").exists():
        pytest.skip("no git repository: the project's own files are not known")
    command = ["git", "-c", "safe.directory=*", "ls-files", "-z"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    return [ROOT / name for name in listed.split("\0") if name and (ROOT / name).is_file()]


@pytest.mark.slow
def test_the_core_knows_arrays_and_numbers_alone():
    for file in sources("twin"):
        beyond = packages(file) - sys.stdlib_module_names - {"twin", "numpy", "scipy", "__future__"}
        assert not beyond, file
        assert not packages(file) & OUTWARD, file
        assert "open" not in {n.id for n in ast.walk(ast.parse(file.read_text("utf-8"))) if isinstance(n, ast.Name)}


@pytest.mark.slow
def test_the_service_asks_for_the_generator_in_the_command_line_alone_and_only_when_it_runs():
    for file in sources("service"):
        if (ROOT / "service" / "cli") in file.parents:
            assert "recordings" not in packages(file, anywhere=False), file
        else:
            assert "recordings" not in packages(file), file


def test_rooms_below_the_loops_know_neither_loops_nor_rest_nor_commands():
    """`service/files` imported the loop of `gear-twin assess`."""
    above = {f"service.{room}" for room in ("runtime", "api", "cli", "fleet", "report", "bridges")}
    for room in ("files", "stream", "contract", "results"):
        for file in sources(f"service/{room}"):
            assert not {".".join(name.split(".")[:2]) for name in imports(file)} & above, file


def test_answers_know_no_loops_loops_no_fleets_and_the_python_client_nothing_of_the_service_but_its_contract():
    """The recorder of raw frames imported the fleet, routes the loops, and the client the routes."""
    above = {"service/api": ("runtime", "cli", "fleet"), "service/runtime": ("cli", "fleet")}
    for folder, rooms in above.items():
        for file in sources(folder):
            assert not {name.split(".")[1] for name in imports(file) if name.startswith("service.")} & set(rooms), file
    known = {name.split(".")[1] for name in imports(ROOT / "gear_twin" / "client.py") if name.startswith("service.")}
    assert known == {"access", "contract"}


def test_files_of_the_page_are_loaded_in_no_circle():
    """A part of a view asked the table of views for a path, and the table loads the views."""
    page = ROOT / "service" / "page"
    loads = {
        file: {
            (file.parent / found).resolve()
            for found in re.findall(r"""(?:from|import)\s*\(?\s*"(\.[^"]+)\"""", file.read_text("utf-8"))
        }
        for file in page.rglob("*.js")
        if "vendor" not in file.parts
    }
    assert sum(map(len, loads.values())) > 100
    while loads:
        ends = [file for file, needed in loads.items() if not needed & loads.keys()]
        assert ends, sorted(str(file.relative_to(page)) for file in loads)
        for file in ends:
            del loads[file]


@pytest.mark.slow
def test_files_that_need_an_extra_are_imported_by_none_as_a_whole():
    within = {"service/fleet/ray_session.py"}  # imports its package in a function itself
    names = {path.removesuffix(".py").replace("/", ".") for path in LOADED_WHERE_SET.keys() - within}
    assert not {"ray"} & {name.partition(".")[0] for path in within for name in imports(ROOT / path, anywhere=False)}
    for file in sources("service"):
        if str(file.relative_to(ROOT)) not in LOADED_WHERE_SET:
            assert not names & imports(file, anywhere=False), file


@pytest.mark.slow
def test_what_the_program_imports_is_declared():
    extras = PROJECT["project"]["optional-dependencies"]
    optional = [d for name in ("analysis", *PLANT) for d in extras[name]]  # tests/unit/test_optional_packages.py
    declared = {dist_name(d) for d in PROJECT["project"]["dependencies"] + optional}
    extra = {dist_name(d) for d in PROJECT["project"]["optional-dependencies"]["formats"]}
    dists = packages_distributions()
    for folder in ("gear_twin", "twin", "service", "studies", "recordings"):
        for file in sources(folder):
            for name in imports(file):
                top = name.partition(".")[0]
                if top in sys.stdlib_module_names or top in ("gear_twin", "twin", "service", "studies", "recordings"):
                    continue
                of = {dist_name(d) for d in dists.get(top, ())}
                if READERS in file.parents and of & extra:
                    assert name not in imports(file, anywhere=False), f"{file.name}: {name} is imported by all"
                    continue
                extra_of_file = LOADED_WHERE_SET.get(str(file.relative_to(ROOT)))
                if extra_of_file and of & {dist_name(d) for d in OPTIONAL[extra_of_file]}:
                    continue
                assert of & declared, f"{file.relative_to(ROOT)}: {name} is not in pyproject.toml"


@pytest.mark.parametrize("lock", LOCKS)
def test_the_lock_names_a_hash_for_every_package_and_no_host(lock):
    text = (ROOT / lock).read_text(encoding="utf-8")
    assert "://" not in text and "index-url" not in text and "find-links" not in text
    entries = re.split(r"\n(?=[a-z0-9])", text.strip())
    assert len(entries) >= len(PROJECT["project"]["dependencies"])
    for entry in entries:
        assert re.match(r"[\w.\-]+==\S+", entry), entry
        assert "--hash=sha256:" in entry, entry.partition("\n")[0]


def test_the_locks_hold_what_the_project_depends_on_and_agree():
    pinned = {
        lock: dict(re.findall(r"^([\w.\-]+)==(\S+)", (ROOT / lock).read_text(encoding="utf-8"), re.MULTILINE))
        for lock in LOCKS
    }
    runtime, formats, plant, fleet, development = (pinned[lock] for lock in LOCKS)
    extras = PROJECT["project"]["optional-dependencies"]
    assert {dist_name(d) for d in PROJECT["project"]["dependencies"] + extras["analysis"]} <= set(runtime)
    assert {dist_name(d) for d in PROJECT["project"]["optional-dependencies"]["dev"]} <= set(development)
    assert {dist_name(d) for d in PROJECT["project"]["optional-dependencies"]["formats"]} <= set(formats)
    assert {"ray", "obstore", "psycopg"} <= set(fleet)
    assert {dist_name(d) for extra in PLANT for d in PROJECT["project"]["optional-dependencies"][extra]} <= set(plant)
    assert runtime.items() <= formats.items() <= development.items()
    assert plant.items() <= development.items() and not {"numba", "plotly"} & set(plant)
    assert {dist_name(d) for d in PROJECT["project"]["dependencies"]} <= set(plant)


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_explains_itself(command, capsys):
    assert run([command, "--help"]) == 0
    assert f"gear-twin {command}" in capsys.readouterr().out


@pytest.mark.parametrize("target", sorted(set(re.findall(r"make ([a-z][a-z-]+)[`\n ]", README + DEVELOP))))
def test_each_make_target_of_the_documentation_exists(target):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:", makefile, re.MULTILINE)


@pytest.mark.slow
def test_no_file_names_a_machine_or_a_package_registry():
    for file in tracked():
        if file.suffix not in TEXT:
            continue
        text = file.read_text(encoding="utf-8")
        for pattern in (MACHINES, REGISTRIES):
            found = pattern.search(text)
            assert not found, f"{file.relative_to(ROOT)}: {found[0] if found else ''}"


def test_what_the_service_reads_of_its_own_is_shipped_with_it():
    shipped = {pattern.lstrip("*") for pattern in PROJECT["tool"]["setuptools"]["package-data"]["*"]}
    needed = {f.suffix for f in tracked() if f.relative_to(ROOT).parts[0] in ("service", "twin")} - {".py"}
    assert needed <= shipped


def test_the_truth_of_the_recordings_is_not_shipped():
    assert ".json" not in {p.lstrip("*") for p in PROJECT["tool"]["setuptools"]["package-data"]["*"]}
    for file in tracked():
        if file.relative_to(ROOT).parts[:2] == ("recordings", "truth"):
            assert file.suffix == ".json"


def test_the_version_has_its_entry_in_the_changelog():
    assert f"## {PROJECT['project']['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_linear_algebra_runs_on_one_thread_unless_the_environment_says_otherwise():
    code = "import service, os; print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])"
    for given, expected in (({}, "1 1"), ({"OMP_NUM_THREADS": "3"}, "1 3")):
        said = subprocess.run(
            [sys.executable, "-c", code], cwd=ROOT, env=given, capture_output=True, text=True, check=True
        ).stdout
        assert said.strip() == expected


@pytest.mark.parametrize(
    ("marks", "environment", "shared_here", "allowed"),
    [
        (set(), {}, False, True),
        (set(), {"CI": "true"}, False, False),
        ({"shared"}, {"CI": "true"}, False, True),
        ({"shared"}, {"CI": "true"}, True, False),
        ({"containers"}, {"CI": "true"}, True, True),
        ({"prometheus"}, {"CI": "true"}, True, True),
        ({"s3"}, {"CI": "true"}, True, True),
        ({"s3"}, {"CI": "true", "GEAR_TWIN_TEST_S3": "/opt/weed"}, True, False),
        ({"prometheus"}, {"CI": "true", "GEAR_TWIN_TEST_PROMETHEUS": "/opt/prometheus"}, True, False),
        ({"containers"}, {"CI": "true", "GEAR_TWIN_TEST_COMPOSE": "docker compose"}, True, False),
    ],
)
def test_a_skipped_test_is_a_failure_on_the_build_machine_unless_its_data_are_absent(
    marks, environment, shared_here, allowed
):
    assert may_be_skipped(marks, environment, shared_here) is allowed


RULES_ALONE = "[pytest]\nmarkers =\n    slow\n    shared\n    containers\n"


def run_by_the_rules(folder: Path, tests: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs tests under the rules of the build machine, with a deadline that has passed."""
    (folder / "rules.py").write_text((ROOT / "tests" / "rules.py").read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "conftest.py").write_text("from rules import *\n")
    (folder / "pytest.ini").write_text(RULES_ALONE)
    (folder / "test_some.py").write_text(f"import pytest\n{tests}")
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments],
        cwd=folder, env={"CI": "true", "GEAR_TWIN_TEST_DEADLINE": "1", **environment}, capture_output=True, text=True,
    )  # fmt: skip


@pytest.mark.slow
def test_skips_fail_and_longer_proofs_stop_at_the_deadline_on_the_build_machine(tmp_path):
    tests = (
        "@pytest.mark.slow\ndef test_long(): pass\n"
        "def test_skips(): pytest.skip('because')\n"
        "@pytest.mark.shared\ndef test_without_data(): pytest.skip('no data')\n"
        "@pytest.mark.xfail\ndef test_known(): assert False\n"
        "def test_good(): pass\n"
    )
    said = run_by_the_rules(tmp_path, tests, "-p", "no:xdist", GEAR_TWIN_SHARED=str(tmp_path / "nothing"))
    assert said.returncode == 1
    assert "1 failed, 1 passed, 1 skipped, 1 xfailed" in said.stdout.splitlines()[-1]
    assert "skipped, which is a failure where CI is set: Skipped: because" in said.stdout
    assert "not begun, the time of the run being used up: 1 longer proofs" in said.stdout


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("-p", "no:xdist"), ("-n", "2", "--dist", "worksteal")])
def test_a_run_that_leaves_a_proof_out_has_failed_though_every_test_that_ran_has_passed(tmp_path, arguments):
    tests = "@pytest.mark.slow\ndef test_long(): pass\ndef test_good(): pass\n"
    said = run_by_the_rules(tmp_path, tests, *arguments)
    assert (said.returncode, said.stdout.splitlines()[-1].split(" in ")[0].strip("= ")) == (1, "1 passed")
    assert "not begun, the time of the run being used up: 1 longer proofs" in said.stdout
    assert run_by_the_rules(tmp_path, tests, *arguments, GEAR_TWIN_TEST_DEADLINE="inf").returncode == 0
