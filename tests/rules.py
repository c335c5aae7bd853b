"""Rules of a test run on the build machine.

Where `CI` is set a skipped test is a failure: nothing is left out unseen. Five things may be missing there: the
reference data beside the project, for tests marked `shared`, a container engine, for those marked `containers`,
Prometheus, for those marked `prometheus`, an S3 server, for those marked `s3`, and cores that nothing else uses, for
those marked `engine`, which start several nodes of Ray. With GEAR_TWIN_TEST_FLEET every service of the tests is a fleet
of one partition; then tests marked `serve_only` are skipped, each with its reason.
Longer proofs (`slow`: over a second or so) come last, and none begins after GEAR_TWIN_TEST_DEADLINE [Unix time, s]: the
summary tells how many were left out, and the run has failed.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path

import pytest

BESIDE = Path(__file__).resolve().parents[1].parent / "shared"
NAMED_BY = {
    "containers": "GEAR_TWIN_TEST_COMPOSE",
    "prometheus": "GEAR_TWIN_TEST_PROMETHEUS",
    "s3": "GEAR_TWIN_TEST_S3",
    "engine": "GEAR_TWIN_TEST_ENGINE",
}
FLEET = "GEAR_TWIN_TEST_FLEET"  # puts fleets of one partition in place of `serve`
SERVE_ONLY = "serve_only"  # mark of what is for `serve` alone
CHOSEN = pytest.StashKey[int]()


def shared_folder() -> Path:
    """Where the reference campaigns and measured sets are, or would be."""
    return Path(os.environ.get("GEAR_TWIN_SHARED", BESIDE))


def shared_is_here() -> bool:
    return (shared_folder() / "campaigns").is_dir()


def may_be_skipped(marks: set[str], environment: Mapping[str, str], shared_here: bool) -> bool:
    """Whether a test with these marks may be skipped."""
    if any(mark in marks and not environment.get(variable) for mark, variable in NAMED_BY.items()):
        return True
    if SERVE_ONLY in marks and environment.get(FLEET):
        return True
    return not environment.get("CI") or ("shared" in marks and not shared_here)


def failed_for_being_skipped(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turns a report of a skipped test into one of a failure that says why."""
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    report.outcome = "failed"
    report.longrepr = f"skipped, which is a failure where CI is set: {reason}"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What uses the fixture `shared` is marked so, what asks a fleet what one service answers is slow, and comes last.

    Of the others those that take the longest come first: at the end a core has nothing to do for a short time only.
    """
    for item in items:
        if getattr(getattr(item, "module", None), "OVER_FLEET", False):
            item.add_marker(pytest.mark.slow)
        if "shared" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.shared)
    items.sort(key=lambda item: (item.get_closest_marker("slow") is not None, item.path.parent.name != "validation"))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skips what needs the reference data where they are not, and what is for `serve` alone where fleets are."""
    if item.get_closest_marker("shared") and not shared_is_here():
        pytest.skip(f"the reference data are not here: no folder {shared_folder() / 'campaigns'} (GEAR_TWIN_SHARED)")
    mark = item.get_closest_marker(SERVE_ONLY)
    if mark is not None and os.environ.get(FLEET):
        pytest.skip(*mark.args)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo):
    report = yield
    if report.skipped and not hasattr(report, "wasxfail"):
        marks = {mark.name for mark in item.iter_markers()}
        if not may_be_skipped(marks, os.environ, shared_is_here()):
            failed_for_being_skipped(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector):
    report = yield
    if report.skipped and not may_be_skipped(set(), os.environ, shared_is_here()):
        failed_for_being_skipped(report)
    return report


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Leaves a longer proof out, unreported, once the time is used up; fixtures end as if it had run."""
    deadline = float(os.environ.get("GEAR_TWIN_TEST_DEADLINE", "inf"))
    if item.get_closest_marker("slow") is None or time.time() <= deadline:
        return None
    item.session._setupstate.teardown_exact(nextitem)
    return True


def pytest_collection_finish(session: pytest.Session) -> None:
    session.config.stash[CHOSEN] = len(session.items)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node, ids: list[str]) -> None:
    node.config.stash[CHOSEN] = len(ids)


def left_out(config: pytest.Config) -> int:
    """Number of longer proofs that were chosen and not begun."""
    if not os.environ.get("GEAR_TWIN_TEST_DEADLINE"):
        return 0
    stats = config.pluginmanager.get_plugin("terminalreporter").stats
    reports = (report for kind in stats.values() for report in kind)
    begun = {r.nodeid for r in reports if isinstance(r, pytest.TestReport)}
    return config.stash.get(CHOSEN, 0) - len(begun)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Makes a run fail that has left a proof out; the process that reports decides, not one of its workers."""
    if (
        not hasattr(session.config, "workerinput")
        and session.exitstatus == pytest.ExitCode.OK
        and left_out(session.config)
    ):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter) -> None:
    """Tells how many longer proofs were chosen and not begun."""
    if number := left_out(terminalreporter.config):
        terminalreporter.write_line(f"not begun, the time of the run being used up: {number} longer proofs")
