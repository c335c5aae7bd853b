"""Which campaigns count as above a machine's printed detection limit."""

import json

import pytest

from benchmarks.printed_limits import above_limit, read_limits


def limits_file(folder, **values):
    stated = [
        {"name": name, "value": value, "largest_tried": None if value is not None else 1.0}
        for name, value in values.items()
    ]
    stated.append({"name": "bearing_defect", "value": None, "largest_tried": None})
    path = folder / "unsw.json"
    path.write_text(json.dumps({"rig": "unsw", "detection_limits": stated}), encoding="utf-8")
    return path


def truth(name, **parameters):
    return {"effects": [{"name": name, "parameters": parameters}]}


@pytest.mark.parametrize(
    ("effect", "above"),
    [
        (truth("misalignment", lead_um=-25.0), True),
        (truth("misalignment", lead_um=19.0), False),
        (truth("tooth_crack", remaining_stiffness=0.5, tooth=3), True),
        (truth("tooth_crack", remaining_stiffness=0.7, tooth=3), False),
        (truth("sensor_gain", gain=0.6), True),  # 1/0.6 is more than 1.4
        (truth("sensor_gain", gain=0.8), False),
        (truth("sensor_resonance", frequency_hz=1500.0, damping_ratio=0.03), True),
        (truth("sensor_resonance", frequency_hz=2500.0, damping_ratio=0.03), False),
        (truth("mesh_damping", factor=9.0), False),  # found at no size
        (truth("bearing_defect", force_n=9.0), None),  # not simulated
        (truth("profile_error", tip_relief_um=None, slope_um=4.0), None),  # the limit is of the relief
    ],
)
def test_size_is_compared_with_the_limit_by_its_distance_from_doing_nothing(tmp_path, effect, above):
    limits = read_limits(
        [
            limits_file(
                tmp_path,
                misalignment=20e-6,
                tooth_crack=0.4,
                sensor_gain=1.4,
                sensor_resonance=2000.0,
                mesh_damping=None,
                profile_error=2e-6,
            )
        ]
    )
    assert above_limit(effect, "unsw", limits) is above
    assert above_limit(effect, "another", limits) is None
    assert above_limit({"effects": effect["effects"] * 2}, "unsw", limits) is None
