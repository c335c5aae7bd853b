"""The bill of materials, the licences and the audit of packages."""

from __future__ import annotations

import json

import pytest

from benchmarks.packages import LOCK, locked, verdict, write_bill

WEAK = {"name": "a", "version": "1.0", "vulns": [{"id": "CVE-1", "fix_versions": ["1.1"]}]}
SOUND = {"name": "b", "version": "2.0", "vulns": []}
UNKNOWN = {"name": "c", "skip_reason": "not found"}


def test_lock_is_read_with_its_versions():
    assert locked("a-b==1.0 \\\n    --hash=sha256:0\nc==2.1 ; python_version < '4'\n") == {"a-b": "1.0", "c": "2.1"}


@pytest.mark.parametrize(
    ("found", "last", "status"),
    [
        ([SOUND, WEAK], "packages: 2 audited, 1 known weaknesses", 1),
        ([SOUND, UNKNOWN], "packages: 1 audited, 0 known weaknesses; 1 are not known to the source of advisories", 0),
        ([UNKNOWN], "packages: not audited: no source of advisories can be reached", 0),
    ],
)
def test_audit_fails_for_a_known_weakness_alone_and_says_what_was_not_audited(found, last, status):
    lines, given = verdict(found)
    assert lines[-1] == last and given == status
    assert status == 0 or lines[0] == "a 1.0: CVE-1, mended in 1.1"


@pytest.mark.slow
def test_bill_of_materials_and_licences_name_every_locked_package(tmp_path):
    write_bill(tmp_path)
    packages = locked(LOCK.read_text(encoding="utf-8"))
    bill = json.loads((tmp_path / "gear-twin.cdx.json").read_text())
    assert {c["name"]: c["version"] for c in bill["components"]}.items() >= packages.items()
    text = (tmp_path / "licences.md").read_text().lower()
    assert "unknown" not in text
    rows = text.count("\n| ") - 1
    assert rows >= 0.9 * len(packages)  # some are for other systems, and not installed here
