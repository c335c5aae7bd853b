"""Recordings are kept by the generator's edition: it must be raised when a spec gives another recording."""

import numpy as np
import pytest

from recordings.generator import EDITION, simulate
from tests.generator_instances import SPEC, rig

SMALL = {
    **SPEC,
    "calibration": [],
    "windows": {"seconds": 0.25, "at_revolutions": [0, 400]},
    "wear": {"k_m2_per_n": 6e-12, "dynamic_forces": True},
    "effects": [
        {"name": "gear_eccentricity", "e_um": 40.0, "phase": 1.0},
        {"name": "misalignment", "lead_um": 20.0, "onset_revolutions": 200.0},
        {"name": "bearing_defect", "force_n": 4.0, "order": 3.58},
        {"name": "rub", "amplitude": 2.0},
    ],
}
GIVEN = {  # edition: RMS of the last window [m/s²], its last sample, mean edge interval of the gear [s], depth [µm]
    1: (14.6955786, 20.2941895, 0.000132991847, 10.5446092),
}


@pytest.mark.slow
def test_the_edition_is_the_one_whose_recordings_these_are():
    campaign = simulate(SMALL, rig())
    last = campaign.windows[-1]
    found = (
        float(np.std(last.acceleration)),
        float(last.acceleration[-1]),
        float(np.diff(last.gear_edges[1]).mean()),
        campaign.truth["final"]["combined_um"],
    )
    assert found == pytest.approx(GIVEN[EDITION], rel=1e-6), "raise recordings.generator.EDITION and pin its figures"
