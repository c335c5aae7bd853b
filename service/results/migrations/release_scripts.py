"""SQLite's schema from an empty file to the last release without Alembic, whose `PRAGMA user_version` is 8.

These scripts are history: a later change of the schema is a revision in `versions`.
"""

from __future__ import annotations

SCRIPTS = (
    """
    CREATE TABLE assets (
        asset TEXT PRIMARY KEY,
        rig TEXT,
        state TEXT,
        report TEXT,
        assembly TEXT,
        quality TEXT
    );
    CREATE TABLE windows (
        asset TEXT NOT NULL REFERENCES assets(asset),
        start_ns INTEGER NOT NULL,
        record TEXT NOT NULL,
        figures TEXT NOT NULL,
        PRIMARY KEY (asset, start_ns)
    ) WITHOUT ROWID;
    CREATE TABLE events (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        kind TEXT NOT NULL,
        data TEXT NOT NULL
    );
    CREATE INDEX events_of_asset ON events (asset, id);
    CREATE TABLE inspections (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        received_ns INTEGER NOT NULL,
        inspection TEXT NOT NULL,
        answer TEXT NOT NULL
    );
    """,
    """
    CREATE TABLE decisions (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        received_ns INTEGER NOT NULL,
        name TEXT NOT NULL,
        verb TEXT NOT NULL,
        done INTEGER NOT NULL DEFAULT 0,
        refused TEXT
    );
    CREATE INDEX decisions_waiting ON decisions (done, id);
    """,
    """
    ALTER TABLE windows ADD COLUMN number INTEGER NOT NULL DEFAULT 0;
    UPDATE windows SET number = json_extract(record, '$.index');
    CREATE INDEX windows_by_number ON windows (asset, number);
    ALTER TABLE assets ADD COLUMN windows INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE assets ADD COLUMN updates INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE assets ADD COLUMN received_ns INTEGER;
    UPDATE assets SET
        windows = (SELECT COUNT(*) FROM windows AS w WHERE w.asset = assets.asset),
        updates = (
            SELECT COUNT(*) FROM windows AS w WHERE w.asset = assets.asset AND json_extract(w.record, '$.updated')
        );
    CREATE TABLE fault_totals (
        asset TEXT NOT NULL REFERENCES assets(asset),
        kind TEXT NOT NULL,
        channel TEXT NOT NULL,
        action TEXT NOT NULL,
        count INTEGER NOT NULL,
        windows INTEGER NOT NULL,
        PRIMARY KEY (asset, kind, channel, action)
    ) WITHOUT ROWID;
    INSERT INTO fault_totals
        SELECT w.asset, json_extract(f.value, '$.kind'), json_extract(f.value, '$.channel'),
            json_extract(f.value, '$.action'), SUM(json_extract(f.value, '$.count')), COUNT(DISTINCT w.start_ns)
        FROM windows AS w, json_each(w.record, '$.faults') AS f
        GROUP BY 1, 2, 3, 4;
    """,
    """
    CREATE TABLE alarm_rules (
        asset TEXT PRIMARY KEY REFERENCES assets(asset),
        rules TEXT NOT NULL,
        changed TEXT NOT NULL
    );
    CREATE TABLE alarm_memory (
        asset TEXT PRIMARY KEY REFERENCES assets(asset),
        memory TEXT NOT NULL
    );
    CREATE TABLE alarms (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        name TEXT NOT NULL,
        open INTEGER NOT NULL,
        record TEXT NOT NULL
    );
    CREATE UNIQUE INDEX alarms_open ON alarms (asset, name) WHERE open = 1;
    CREATE TABLE alarm_history (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        alarm INTEGER NOT NULL REFERENCES alarms(id),
        entry TEXT NOT NULL
    );
    CREATE INDEX history_of_alarm ON alarm_history (alarm, id);
    CREATE TABLE webhook_outbox (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        name TEXT NOT NULL,
        url TEXT NOT NULL,
        body TEXT NOT NULL,
        created_ns INTEGER NOT NULL,
        next_ns INTEGER NOT NULL,
        attempts INTEGER NOT NULL DEFAULT 0
    );
    """,
    """
    ALTER TABLE inspections ADD COLUMN done INTEGER NOT NULL DEFAULT 1;
    CREATE INDEX inspections_waiting ON inspections (done, id);
    """,
    """
    ALTER TABLE assets ADD COLUMN epoch INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE assets ADD COLUMN question TEXT;
    ALTER TABLE assets ADD COLUMN retired TEXT;
    ALTER TABLE windows ADD COLUMN epoch INTEGER NOT NULL DEFAULT 0;
    CREATE INDEX windows_by_epoch ON windows (asset, epoch, number);
    CREATE TABLE changes (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        received_ns INTEGER NOT NULL,
        kind TEXT NOT NULL,
        given TEXT NOT NULL,
        done INTEGER NOT NULL DEFAULT 0,
        refused TEXT,
        effect TEXT
    );
    CREATE INDEX changes_waiting ON changes (done, id);
    CREATE TABLE waiting (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        start_ns INTEGER NOT NULL,
        bytes INTEGER NOT NULL
    );
    CREATE INDEX waiting_of_asset ON waiting (asset, id);
    CREATE TABLE routes (
        stream TEXT PRIMARY KEY,
        asset TEXT NOT NULL REFERENCES assets(asset)
    );
    """,
    """
    CREATE TABLE baselines (
        asset TEXT PRIMARY KEY REFERENCES assets(asset),
        file TEXT NOT NULL,
        about TEXT NOT NULL
    );
    CREATE TABLE baseline_numbers (id INTEGER PRIMARY KEY AUTOINCREMENT);
    """,
    """
    ALTER TABLE decisions ADD COLUMN signed_by TEXT;
    ALTER TABLE decisions ADD COLUMN note TEXT;
    """,
)
"""Entry i takes `PRAGMA user_version` from i to i + 1."""


def statements_from(version: int) -> list[str]:
    """The single statements that bring a file of this `user_version` to the newest."""
    return [statement for script in SCRIPTS[version:] for statement in script.split(";") if statement.strip()]
