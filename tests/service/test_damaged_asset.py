"""What is kept of one asset is damaged: its windows wait, and a running service goes on with the others."""

from __future__ import annotations

import pytest
from service_streams import service, wait_until, write_recording
from test_damage import hurt

from service.cli import run
from service.results.data_folder import DATABASE
from service.results.window_jobs import WindowJobs


@pytest.mark.serve_only("damages the file of SQLite")
@pytest.mark.slow
def test_a_damaged_asset_holds_up_no_other_and_its_windows_stay_within_bounds(tmp_path):
    data = tmp_path / "data"
    names = ("hurt", "sound")
    days = [
        [write_recording(tmp_path / f"{name}{count}.mcap", count, asset=name) for name in names] for count in (3, 7)
    ]
    with service(data) as running:
        send(running, days[0])
        for name in names:
            running.wait_for_windows(3, name)
        running.end()
    hurt(data / DATABASE, "assets", "state", "asset = 'hurt'")
    with service(data, BACKLOG_WINDOWS="2") as running:
        send(running, days[1])
        assert len(running.wait_for_windows(7, "sound")) == 7
        wait_until(lambda: "until a backup has been restored" in running.said()[1])
        with running.store() as store:
            kept = [window for window in WindowJobs(store.database).waiting("hurt") if window.file is not None]
            assert len(running.windows("hurt")) == 3 and len(kept) <= 2
        ready = running.get("/readyz")
        assert ready["status"] == "ready" and [row["asset"] for row in ready["stale"]] == ["hurt"]
        assert "state of hurt cannot be read from the database any more" in ready["stale"][0]["reason"]
        assert "cannot be read from the database any more" in str(running.get("/v1/assets/hurt")["data"])
        assert running.said()[1].count("until a backup has been restored") == 1


def send(running, recordings):
    for recording in recordings:
        assert run(["replay", str(recording), "--connect", running.endpoint, "--speed", "0"]) == 0
