"""Rig files of `gear-twin init` against simulated machines: the true depth lies in its own band at every window.

Source     the independent simulator: the bundled short campaign; reference campaigns D00 (clean, to 200 µm), D07
           (a misalignment sets in, which is not searched for here), D10 (finite-element machine, casing) and D12 (no
           gear encoder); machines of another size (23/57 teeth, module 2.5 mm, 24.6 Hz) whose structure is drawn from
           what the rig file states
Withheld   the machines' own rig files; known are the data sheet (docs/examples/answers.toml) and the recording
All of it  python -m benchmarks.estimated_rigs
"""

import numpy as np
import pytest

from benchmarks.estimated_rigs import bands_of, estimated_rig
from benchmarks.scoring import ROOT
from tests.estimated_machines import rig_of
from tests.simulated_machines import simulated


def check(bands, width):
    assert bands.rows and all(bands.inside), [(r.true, r.low, r.high) for r in bands.rows]
    assert bands.width < width


@pytest.mark.slow
def test_the_bundled_short_campaign():
    check(bands_of(ROOT / "recordings" / "short-campaign.mcap", estimated_rig()), 0.4)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "width"), [("D00", 0.4), ("D07", 0.9), ("D10", 0.4), ("D12", 0.9)])
def test_reference_campaigns_whose_rig_files_are_withheld(shared, name, width):
    check(bands_of(shared / "campaigns" / f"{name}.mcap", estimated_rig()), width)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [101, 102])
def test_machines_of_another_size_with_drawn_structures(tmp_path, seed):
    recording = simulated("pump", seed, tmp_path, [0, 1000, 2500, 5000, 8000, 12000], 2e-13)
    bands = bands_of(recording, rig_of("pump"))
    assert np.mean(bands.inside) >= 0.8, [(r.true, r.low, r.high) for r in bands.rows]
    assert bands.width < 0.7
