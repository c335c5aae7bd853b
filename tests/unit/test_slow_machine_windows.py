"""Windows of a slow machine are as long as a healthy baseline needs; nothing is said without its reason."""

import pytest

from service.contract.status import data_of
from service.files.rig import assembly_for
from service.stream.assembly import DEFAULT
from twin.rig import Rig


def rig(speed, pinion=23, gear=57, **more):
    gears = {"pinion": {"teeth": pinion}, "gear": {"teeth": gear}, **more}
    return Rig.from_mapping({"gears": gears, "operating": {"pinion_speed_hz": speed}})


@pytest.mark.parametrize(
    ("known", "length"),
    [
        (rig(25.0, 19, 38), 10.0),  # 1:2, 4 common periods of 2 turns: 10 s hold them
        (rig(5.0), (4 * 57 + 2) / 5.0),
        (rig(2.0, 20, 40), 10.0),
        (rig(0.5), 120.0),
        (rig(5.0, module=0.004), 10.0),  # of a machine with a model 10 s say enough
        (Rig.from_mapping({}), 10.0),
    ],
)
def test_windows_last_until_the_shafts_have_come_round_often_enough(known, length):
    assert assembly_for(known, DEFAULT).length == pytest.approx(length)


def test_data_that_are_good_but_give_no_speed_say_why():
    record = {"quality": "good", "not_available": {"speed_hz": "the rig file does not give the tooth counts"}}
    found = data_of([record])
    assert found.level == "ok"
    assert found.reason == "the latest window is good, without a speed: the rig file does not give the tooth counts"
    assert data_of([{"quality": "good"}]).reason == "the latest window is good"


def test_data_that_are_good_but_too_short_for_the_gears_say_so():
    short = {"not_available": {"pinion": "the window has 1 whole turns of this gear; an average needs 3"}}
    found = data_of([{"quality": "good", "indicators": {"a": short}}])
    assert found.reason.endswith(
        "good, without indicators of the gears: the window has 1 whole turns of this gear; an average needs 3"
    )
    assert data_of([{"quality": "good", "indicators": {"a": short, "b": {"gears": {"pinion": {}}}}}]).reason.endswith(
        "good"
    )
