"""What a rig file may hold, and what is said of one that is wrong: name, value, unit, range, likely cause."""

import copy
import math
import re
from dataclasses import fields

import pytest

from service.files.rig import expected_channels
from tests.mesh_pairs import UNSW_RIG
from twin.errors import NotAvailable, ParameterError
from twin.rig import Rig
from twin.rig_estimated import Estimated
from twin.rig_schema import DEGREES_OF_FREEDOM, SCHEMA
from twin.rig_tolerances import Tolerances


def rig_with(path, value):
    """The reference rig with one value replaced."""
    values = copy.deepcopy(UNSW_RIG)
    *tables, key = path.split(".")
    node = values
    for table in tables:
        node = node.setdefault(table, {})
    node[key] = value
    return values


def message_of(mapping):
    with pytest.raises(ParameterError) as caught:
        Rig.from_mapping(mapping)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_reference_rig_is_accepted_as_it_is():
    rig = Rig.from_mapping(UNSW_RIG)
    assert rig.name == "unsw"
    assert rig.teeth == (19, 52)
    assert rig.accelerometer == "y6"
    assert rig.band == (0.0, 2000.0)
    assert rig.get("layout.degrees_of_freedom") == DEGREES_OF_FREEDOM
    pair = rig.gear_pair()
    assert (pair.module, pair.face_width, pair.backlash) == (0.002, 0.02, 1e-4)
    assert pair.pressure_angle == pytest.approx(math.radians(20))
    assert pair.bore_radius == (0.007, 0.01)


NUMBERS = [
    ("gears.module", 2.0, "gears.module = 2 m is outside (1e-05, 0.1] m; a module in mm?"),
    (
        "gears.pressure_angle_deg",
        0.349,
        "gears.pressure_angle_deg = 0.349 ° is outside (5, 45] °; radians?",
    ),
    ("gears.face_width", -0.02, "gears.face_width = -0.02 m is outside (0, 2] m; a length in mm?"),
    (
        "gears.youngs_modulus",
        205.0,
        "gears.youngs_modulus = 205 Pa is outside (1e+07, 2e+12] Pa; GPa?",
    ),
    ("gears.poisson_ratio", 0.7, "gears.poisson_ratio = 0.7 is outside (0, 0.5]"),
    ("gears.density", 7.85, "gears.density = 7.85 kg/m³ is outside (100, 30000] kg/m³; g/cm³?"),
    (
        "gears.pinion.teeth",
        4,
        "gears.pinion.teeth = 4 is outside (5, 1000]; tooth counts below 6 do not mesh",
    ),
    (
        "gears.path_of_contact.contact_ratio",
        0.89,
        "gears.path_of_contact.contact_ratio = 0.89 is outside (1, 5]; an addendum coefficient given in mm?",
    ),
    (
        "mesh.mean_stiffness",
        13.6,
        "mesh.mean_stiffness = 13.6 N/m is outside (100000, 1e+12] N/m; N/(mm·µm)?",
    ),
    (
        "mesh.relative_damping_time",
        8.0,
        "mesh.relative_damping_time = 8 s is outside [0, 0.01] s; microseconds?",
    ),
    (
        "bearings.ky_input",
        14.33,
        "bearings.ky_input = 14.33 N/m is outside (1000, 1e+12] N/m; a stiffness in N/µm or N/mm?",
    ),
    (
        "torsional_stiffness.k_1_2",
        0.0,
        "torsional_stiffness.k_1_2 = 0 N·m/rad is outside (0.01, 1e+09] N·m/rad; a stiffness per degree?",
    ),
    (
        "inertias.J5",
        5.4e5,
        "inertias.J5 = 540000 kg·m² is outside (1e-09, 100000] kg·m²; an inertia in kg·mm² or kg·cm²?",
    ),
    ("masses.m5", 385200.0, "masses.m5 = 385200 kg is outside (0.0001, 100000] kg; a mass in g?"),
    ("damping.modal_ratio", 5.0, "damping.modal_ratio = 5 is outside [0, 0.5]; a ratio in percent?"),
    (
        "operating.pinion_speed_hz",
        math.nan,
        "operating.pinion_speed_hz = nan Hz is outside (0, 2000] Hz; rev/min?",
    ),
    ("wear.K", 2.7, "wear.K = 2.7 1/N is outside (0, 1] 1/N; a dimensional coefficient in m²/N?"),
    ("wear.max_depth_at_6000", 156.0, "wear.max_depth_at_6000 = 156 m is outside (0, 0.1] m; micrometres?"),
    ("wear.pinion_share", 73.0, "wear.pinion_share = 73 is outside (0, 1]; percent?"),
    ("end_of_life.max_depth", 500.0, "end_of_life.max_depth = 500 m is outside (0, 0.1] m; micrometres?"),
]


@pytest.mark.parametrize("path", ["gears.module", "gears.pinion.teeth"])
@pytest.mark.parametrize("value", [10**400, -(10**400), math.inf, -math.inf, math.nan])
def test_a_number_that_no_machine_has_is_refused(path, value):
    assert message_of(rig_with(path, value)).startswith(path)


@pytest.mark.parametrize(("path", "value", "message"), NUMBERS, ids=[n[0] for n in NUMBERS])
def test_value_out_of_range_is_named_with_unit_range_and_likely_cause(path, value, message):
    assert message_of(rig_with(path, value)) == message


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("gears.modul", 0.002, "gears.modul is not a key of a rig file; did you mean gears.module?"),
        ("waer", {}, "waer is not a key of a rig file; did you mean wear?"),
        (
            "end_of_life.xyz",
            1,
            "end_of_life.xyz is not a key of a rig file; known here: criterion, max_depth, horizon_days",
        ),
        ("gears", 3, "gears must be a table, not 3"),
        ("gears.module", "2 mm", "gears.module = '2 mm' must be a number [m]"),
        ("gears.module", True, "gears.module = True must be a number [m]"),
        ("gears.pinion.teeth", 19.5, "gears.pinion.teeth = 19.5 must be a whole number"),
        ("schema", "gear-rig/2", "schema = 'gear-rig/2' must be one of gear-rig/1"),
        ("name", 7, "name = 7 must be text"),
        ("end_of_life.criterion", "rms", "end_of_life.criterion = 'rms' must be one of max_depth"),
        ("mesh.pair_s", 0.001, "mesh.pair_s must be a list of numbers"),
        ("mesh.pair_s", [0.0, "a"], "mesh.pair_s[1] = 'a' must be a number in [-1, 1]"),
        ("mesh.pair_s", [0.0, 5.0], "mesh.pair_s[1] = 5.0 must be a number in [-1, 1]"),
        ("layout.degrees_of_freedom", "th1", "layout.degrees_of_freedom must be a list of names"),
    ],
)
def test_typing_error_is_named_with_the_nearest_key_or_what_is_allowed(path, value, message):
    assert message_of(rig_with(path, value)) == message


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            "gears.pinion.pitch_radius",
            0.038,
            "gears.pinion.pitch_radius = 0.038 m contradicts module·teeth/2 = 0.019 m; "
            "a diameter, or another tooth count?",
        ),
        (
            "gears.gear.base_radius",
            0.05,
            "gears.gear.base_radius = 0.05 m contradicts module·teeth/2·cos α = 0.048864 m; another pressure angle?",
        ),
        (
            "gears.pinion.bore_radius",
            0.0175,
            "gears.pinion.bore_radius = 0.0175 m must be below the root radius 0.0165 m; a diameter?",
        ),
        (
            "mesh.pair_stiffness",
            [1.5e8, 1.6e8],
            "mesh.pair_s has 21 values and mesh.pair_stiffness 2: one each",
        ),
        ("sensors.band_hz", [2000.0, 0.0], "sensors.band_hz = [2000, 0] Hz must rise"),
        ("sensors.band_hz", [2000.0], "sensors.band_hz must be the lowest and the highest frequency, [Hz, Hz]"),
        ("sensors.band_hz", [0.0, 1.0, 2.0], "sensors.band_hz must be the lowest and the highest frequency, [Hz, Hz]"),
        ("sensors.band_hz", [[0.0], [1.0]], "sensors.band_hz must be the lowest and the highest frequency, [Hz, Hz]"),
    ],
)
def test_values_that_contradict_each_other_are_refused(path, value, message):
    assert message_of(rig_with(path, value)) == message


def test_coordinates_in_another_order_are_refused():
    message = message_of(rig_with("layout.degrees_of_freedom", list(DEGREES_OF_FREEDOM[::-1])))
    assert message.startswith("layout.degrees_of_freedom must be the 21 coordinates of the paper's eq. 2")
    assert message.endswith(", ".join(DEGREES_OF_FREEDOM))


def test_addendum_coefficient_in_millimetres_is_found_by_the_contact_ratio():
    message = message_of(rig_with("gears.addendum", 0.001))
    assert re.search(r"contact ratio = 0\.89\d must be above 1 .*coefficient given in mm", message)


def test_missing_tables_make_unavailable_what_needs_them_and_nothing_else():
    rig = Rig.from_mapping({"name": "bare", "gears": {"pinion": {"teeth": 18}, "gear": {"teeth": 35}}})
    assert rig.teeth == (18, 35)
    assert rig.accelerometer is None
    assert rig.band == (0.0, 2000.0)
    assert rig.get("wear.K") is None
    assert not rig.has("gears.pinion.teeth", "wear.K")
    with pytest.raises(NotAvailable) as caught:
        rig.gear_pair()
    assert str(caught.value).startswith(
        "the geometry of the gear pair is not available: the rig file does not give gears.module, "
        "gears.pressure_angle_deg, 7 more of gears"
    )


def test_an_empty_rig_is_unnamed_and_has_no_tooth_ratio():
    rig = Rig.from_mapping({})
    assert rig.name == "unnamed"
    with pytest.raises(NotAvailable, match=r"tooth ratio is not available.*gears\.pinion\.teeth, gears\.gear\.teeth"):
        _ = rig.teeth


def test_backlash_that_is_not_given_is_none():
    values = copy.deepcopy(UNSW_RIG)
    del values["gears"]["backlash"]
    assert Rig.from_mapping(values).gear_pair().backlash == 0


def test_tolerances_that_the_file_does_not_state_have_their_defaults():
    tolerances = Rig.from_mapping(rig_with("tolerances.stiffness", 0.06)).tolerances
    assert tolerances.stiffness == 0.06
    assert (tolerances.mass, tolerances.damping) == (0.01, 0.2)
    assert (tolerances.pinion_graduation, tolerances.gear_graduation) == (0.6e-6, 1.6e-6)
    assert Rig.from_mapping({}).tolerances == Tolerances()


def test_every_tolerance_can_be_stated_in_the_rig_file():
    assert set(SCHEMA["tolerances"]) == {f.name for f in fields(Tolerances)}


def test_torque_floor_is_a_share_of_the_rated_torque_unless_the_file_states_it():
    assert Rig.from_mapping(UNSW_RIG).tolerances.torque_floor == pytest.approx(0.005)
    large = rig_with("operating.input_torque", 400.0)
    assert Rig.from_mapping(large).tolerances.torque_floor == pytest.approx(0.2)
    large["tolerances"] = {"torque_floor": 0.03}
    assert Rig.from_mapping(large).tolerances.torque_floor == 0.03


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("tolerances.stiffness", 3.0, "tolerances.stiffness = 3 is outside [0, 0.9]; percent?"),
        (
            "tolerances.gear_graduation",
            1.6,
            "tolerances.gear_graduation = 1.6 m is outside (0, 0.001] m; micrometres?",
        ),
        ("tolerances.masses", 0.1, "tolerances.masses is not a key of a rig file; did you mean tolerances.mass?"),
        ("sensors.ranges.accel", -5.0, "sensors.ranges.accel = -5 m/s² is outside (0, 1e+07] m/s²; a range in g?"),
        (
            "sensors.ranges.accel",
            {"y6": 0.0},
            "sensors.ranges.accel.y6 = 0 m/s² is outside (0, 1e+07] m/s²; a range in g?",
        ),
    ],
)
def test_tolerances_and_ranges_out_of_range_are_refused(path, value, message):
    assert message_of(rig_with(path, value)) == message


def test_sensor_range_holds_for_all_channels_of_a_kind_or_for_the_named_one():
    rig = Rig.from_mapping(rig_with("sensors.ranges", {"accel": {"y6": 500.0}, "torque": 50.0}))
    assert rig.sensor_range("accel", "y6") == 500.0
    assert rig.sensor_range("accel", "y4") is None
    assert rig.sensor_range("torque", "pinion") == 50.0
    assert Rig.from_mapping(UNSW_RIG).sensor_range("torque", "pinion") is None


def test_temperature_places_are_expected_channels():
    rig = Rig.from_mapping(rig_with("sensors.temperature", ["oil", "bearing"]))
    assert expected_channels(rig)[-2:] == ("temperature/oil", "temperature/bearing")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            "gears.path_of_contact.contact_ratio",
            1.5,
            "gears.path_of_contact.contact_ratio = 1.5 contradicts 1.65258, which follows from teeth, module, "
            "pressure angle and addendum; leave it out, or correct those",
        ),
        (
            "wear.pinion_share",
            0.5,
            "wear.pinion_share = 0.5 contradicts z2/(z1 + z2) = 0.732394: in one passage both flanks lose the same "
            "depth, so the tooth counts alone set the share",
        ),
        (
            "layout.torsion_chain_output",
            [8, 10, 13],
            "layout.torsion_chain_output = [8, 10, 13] must be [8, 10, 12, 13]: the model has no other chain",
        ),
        ("sensors.encoder_input", "y5", "sensors.encoder_input = 'y5' must be one of th1, th2, th3, th5, th7"),
        (
            "operating.measurement_interval_revs",
            20000,
            "operating.measurement_interval_revs = 20000 must not exceed operating.end_revs = 18000",
        ),
        (
            "shafts.torsion_segments",
            [[0.1, 0.0]],
            "shafts.torsion_segments must be pairs of length and diameter above 0, [[m, m], …]",
        ),
    ],
)
def test_repeated_values_and_names_that_the_model_cannot_hold_are_refused(path, value, message):
    assert message_of(rig_with(path, value)) == message


def test_torque_meter_that_is_no_torsional_spring_is_refused_with_those_that_are():
    message = message_of(rig_with("sensors.torque", "k_2_3*(th3-th2)"))
    assert message.startswith(
        "sensors.torque = 'k_2_3*(th3-th2)' must be 'measured' or the twist of a torsional spring: one of k_1_2"
    )


def test_torque_meter_without_a_place_is_between_motor_and_pinion():
    assert Rig.from_mapping(rig_with("sensors.torque", "measured")).torque_meter == (2, 3)
    assert Rig.from_mapping(rig_with("sensors.torque", "k_10_12*(th10-th12)")).torque_meter == (10, 12)


ESTIMATED = {
    "by": "gear-twin init",
    "parts": ["structure", "wear"],
    "spread": {"structure": 0.7, "wear": 1.0},
    "derived": ["gears.addendum"],
    "assumed": ["bearings.kx_input", "wear.K"],
}


def test_estimated_values_are_listed_with_their_spread():
    estimated = Rig.from_mapping({**UNSW_RIG, "estimated": ESTIMATED}).estimated
    assert estimated.parts == ("structure", "wear")
    assert estimated.spread == {"structure": 0.7, "wear": 1.0}
    assert (estimated.by, estimated.derived) == ("gear-twin init", ("gears.addendum",))
    assert estimated.assumed == ("bearings.kx_input", "wear.K")


def test_a_rig_file_without_the_table_is_not_estimated():
    assert Rig.from_mapping(UNSW_RIG).estimated == Estimated()
    assert Rig.from_mapping(UNSW_RIG).estimated.parts == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parts": ["structure", "wear", "bearing"]}, "estimated.parts names 'bearing'; known: structure, inertias"),
        ({"spread": {"structure": 0.7}}, "estimated.spread.wear is missing"),
        ({"parts": ["wear"]}, "estimated.spread.structure is stated, but estimated.parts does not name structure"),
        ({"assumed": ["bearings.kz_input"]}, "estimated.assumed names 'bearings.kz_input', which has no value"),
        ({"spread": {"structure": 70, "wear": 1.0}}, "estimated.spread.structure = 70 is outside (0, 3]; percent?"),
    ],
)
def test_an_estimated_table_that_cannot_be_is_refused(change, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        Rig.from_mapping({**UNSW_RIG, "estimated": ESTIMATED | change})
