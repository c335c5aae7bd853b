"""Levels at known depths: series file, command, relation file, and the depth of a machine without a model."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from service.cli import run
from service.contract.estimate import step
from service.errors import InputError
from service.files.relation import read_relation
from service.files.series import load_series
from service.report.relation import kept_combination
from tests.claims.test_baseline import SPEED, TEETH, machine
from tests.mesh_pairs import UNSW_RIG
from tests.service.test_baselines import recording
from twin.levels import causes
from twin.levels.curve import LevelCurve
from twin.levels.relation import Origin, Quantity, Relation
from twin.model import Condition
from twin.options import Options
from twin.rig import Rig
from twin.state import State

HEADER = """
schema = "gear-series/1"
asset = "bench"
description = "made up"
[file]
path = "records.csv"
case = "case"
depth = "depth"
depth_unit = "um"
unworn_by_day = "day"
[levels.fast]
column = "fast"
unit = "m/s2"
speed_hz = 14.0
torque_nm = 9.0
[levels.slow]
column = "slow"
unit = "g"
speed_hz = 10.0
torque_nm = 10.0
[estimated]
"masses.m4" = 1.5
"""


def toml(values, path="rig"):
    """A nested mapping as TOML tables."""
    plain = {k: v for k, v in values.items() if not isinstance(v, dict)}
    lines = [f"[{path}]", *(f"{k} = {json.dumps(v)}" for k, v in plain.items())]
    return "\n".join(lines + [toml(v, f"{path}.{k}") for k, v in values.items() if isinstance(v, dict)])


def records():
    """Levels that rise with depth, four records a case, unworn on two days."""
    rng = np.random.default_rng(1)
    lines = ["case,depth,day,fast,slow"]
    for case, depth, day in (
        ("new", 0, "2024-01-01"), ("new", 0, "2024-01-02"),
        *((f"W{i}", 12 * i, f"2024-02-{i:02d}") for i in range(1, 13)),
    ):  # fmt: skip
        a = np.exp(0.05 * rng.standard_normal())
        for _ in range(4):
            fast, slow = a * (5.0 + 0.6 * depth), a * (0.2 + 0.03 * depth)
            lines.append(f"{case},{depth},{day}T10:00,{fast * (1 + 0.01 * rng.standard_normal()):.4f},{slow:.4f}")
    return "\n".join(lines) + "\n"


@pytest.fixture
def series(tmp_path):
    rig = {k: v for k, v in UNSW_RIG.items() if k not in ("reference", "schema", "name", "description", "mesh")}
    wheels = {wheel: {"teeth": z, "bore_radius": 0.007} for wheel, z in (("pinion", 20), ("gear", 40))}
    rig["gears"] = {k: v for k, v in rig["gears"].items() if k != "path_of_contact"} | wheels
    rig["wear"] = {k: v for k, v in rig["wear"].items() if k != "pinion_share"}
    rig["mesh"] = {"stiffness_scale": 1.0, "relative_damping_time": 8e-6}
    (tmp_path / "series.toml").write_text(HEADER + toml(rig), encoding="utf-8")
    (tmp_path / "records.csv").write_text(records(), encoding="utf-8")
    return tmp_path / "series.toml"


@pytest.fixture
def short(monkeypatch):
    """Few depths and short motions: what comes out is looked at for its form."""
    monkeypatch.setattr(causes, "DURATION", 0.1)
    monkeypatch.setattr(causes, "UNEVEN_DURATION", 0.1)
    monkeypatch.setattr(causes, "FIRST", (50e-6,))
    monkeypatch.setattr(causes, "STEP", 100e-6)


def test_unworn_records_of_one_day_are_one_assembly(series):
    found = load_series(series)
    assert found.records == 56 and found.cases.name[:3] == ("new 2024-01-01", "new 2024-01-02", "W1")
    np.testing.assert_allclose(found.cases.depth[2:4], [12e-6, 24e-6])
    assert found.cases.level["slow"][2] == pytest.approx(9.80665 * (0.2 + 0.36), rel=0.2)
    assert found.conditions["fast"].speed_hz == 14.0 and found.estimated == {"masses.m4": 1.5}


WRONG = {
    "schema": (('"gear-series/1"', '"gear-series/2"'), "schema = 'gear-series/2' must be 'gear-series/1'"),
    "key": (("unworn_by_day", "unworn_by_week"), "file.unworn_by_week is not known; known here: path, case"),
    "column": (
        ('column = "fast"', 'column = "quick"'),
        "levels.fast.column = 'quick' is not in records.csv, which has",
    ),
    "unit": (('unit = "g"', 'unit = "mm/s"'), "levels.slow.unit = 'mm/s' must be one of g, m/s2, 1"),
    "speed": (
        ("speed_hz = 14.0", "speed_hz = -14.0"),
        "levels.fast.speed_hz = -14 Hz is outside [0.01, 2000]; rev/min?",
    ),
    "estimated": (('"masses.m4" = 1.5', '"masses.m99" = 1.5'), "estimated.masses.m99 is no number of the rig file"),
    "factor": (('"masses.m4" = 1.5', '"masses.m4" = 0.5'), "estimated.masses.m4 = 0.5 is outside [1.001, 100]"),
    "depth unit": (('"um"', '"m"'), "line 10: depth 12 m is outside [0, 0.01); another file.depth_unit?"),
    "sensor": (("[levels.fast]", "[sensor]\nname = 3\n[levels.fast]"), "sensor.name = 3 must name an accelerometer"),
    "band": (
        ("[levels.fast]", "[sensor]\nband_hz = [2e3, 0]\n[levels.fast]"),
        "sensor.band_hz = [2000.0, 0] must rise",
    ),
    "another band": (
        ("[levels.fast]", "[sensor]\nband_hz = [0, 1234]\n[levels.fast]"),
        "contradicts sensor.band_hz = [0.0, 1234.0]",
    ),
    "rig": (("teeth = 20", "teeth = 3"), "rig: gears.pinion.teeth = 3"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_fault_of_a_series_file_is_one_line_with_its_key(series, fault, capsys):
    (old, new), message = WRONG[fault]
    text = series.read_text()
    assert old in text
    series.write_text(text.replace(old, new))
    assert run(["relate", str(series)]) == 2
    said = capsys.readouterr().err.strip()
    assert message in said and "\n" not in said


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("W1,12,2024-02-01,x,0.5", "line 58: fast = 'x' must be a number"),
        ("W1,12,2024-02-01,0,0.5", "line 58: fast = '0' must be positive and finite"),
        ("W1,13,2024-02-01,9,0.5", "records of 'W1' have several depths"),
    ],
)
def test_fault_of_a_record_is_told_with_its_line(series, line, message):
    table = series.with_name("records.csv")
    table.write_text(table.read_text() + line + "\n")
    with pytest.raises(InputError, match=re.escape(message)):
        load_series(series)


def test_too_few_worn_cases_are_refused(series):
    table = series.with_name("records.csv")
    table.write_text("\n".join(table.read_text().splitlines()[:18]) + "\n")
    with pytest.raises(InputError, match="too few worn cases, at least 12 are needed"):
        load_series(series)


def test_series_says_what_its_levels_are_of(series):
    assert load_series(series).stated == ()
    series.write_text(series.read_text().replace("[levels.fast]", '[sensor]\nname = "a2"\n[levels.fast]'))
    found = load_series(series)
    assert found.sensor == "a2" and found.band is None and found.stated == ("sensor",)


def test_scatter_within_a_case_is_of_a_sample_and_not_known_of_one_record(series):
    table = series.with_name("records.csv")
    lines = table.read_text().splitlines()
    two = [f"W1,12,2024-02-01T10:00,{fast},0.5" for fast in (9, 11)]
    table.write_text("\n".join([*lines[:9], *two, *lines[13:-3]]))
    scatter = load_series(series).cases.scatter["fast"]
    assert scatter[2] == pytest.approx(np.sqrt(2)) and np.isnan(scatter[-1])


@pytest.mark.slow
def test_relate_prints_writes_and_draws(series, short, capsys):
    series.write_text(series.read_text().replace("[levels.fast]", '[sensor]\nname = "a2"\n[levels.fast]'))
    out = {name: series.with_name(name) for name in ("page.html", "relation.json", "answer.json")}
    command = ["relate", str(series), "--draws", "1", "--out", str(out["page.html"])]
    assert run([*command, "--relation", str(out["relation.json"]), "--json", str(out["answer.json"])]) == 0
    said = capsys.readouterr().out
    assert "12 worn and 2 unworn assemblies of 56 records" in said and "straight line" in said
    answer = json.loads(out["answer.json"].read_text())
    assert [t["name"] for t in answer["trials"]][:5] == [
        "straight line", "spline", "monotone cubic", "twin", "background",
    ]  # fmt: skip
    assert len(answer["depths"]) == 12 and answer["draws"] == 1
    names = {t["name"] for t in answer["trials"]}
    assert {"straight line + assembly", "spline + assembly", "monotone cubic + assembly", "assembly"} <= names
    assert "other sensor" not in names  # it is stated
    assert answer["chosen"]["without_a_case"]["cases"] == 12
    assert "does not state the band of its levels" in said
    assert answer["estimated"]["masses.m4"]["factor"] == 1.5
    page = out["page.html"].read_text()
    assert "Level against wear depth of bench" in page and page.count("plotly-graph-div") == 3
    assert page.count('"showSendToCloud": false') == 3  # no figure offers to upload itself
    relation = read_relation(out["relation.json"])
    assert relation.teeth == (20, 40) and set(relation.curves) == {"fast", "slow"}
    basis = answer["basis"]
    by_cases = basis["cubic_over_model_nat"] > 0
    assert basis["curve"] == ("monotone cubic" if by_cases else "model")
    causes = () if by_cases else tuple(answer["chosen"]["causes"][1:])
    assert relation.origin == Origin(asset="bench", curve=basis["curve"], causes=causes, sensor="a2")
    assert relation.quantities["slow"] == Quantity(column="slow", unit="g")
    assert f"The relation is {'a monotone cubic' if by_cases else 'the model'}" in said


@pytest.mark.parametrize(
    ("best", "causes", "said"),
    [
        ([], [], "No combination improves it by 3 nat per cause: the model with its background is kept."),
        (["run-in"], ["run-in"], "The best combination has run-in."),
        (
            ["run-in", "assembly"],
            [],
            "The combination with run-in and assembly fits best but is not kept: chosen anew without each case, "
            "combinations change the evidence of the case left out by -2.4 nat; 3 nat are needed.",
        ),
    ],
)
def test_report_says_which_combination_is_kept_and_why_none(best, causes, said):
    chosen = {"causes": ["background", *causes], "best_combination": ["background", *best], "log_evidence": -2.4}
    assert kept_combination(chosen) == said


def test_file_that_is_no_relation_is_refused_in_one_line(series, tmp_path, capsys):
    for text in ("not json", "[]", '{"schema": "gear-relation/1"}'):
        wrong = tmp_path / "wrong.json"
        wrong.write_text(text)
        recording_file = recording(tmp_path, "any")
        capsys.readouterr()
        assert run(["assess", str(recording_file), "--relation", str(wrong)]) == 2
        assert str(wrong) in capsys.readouterr().err


# depths of a table of levels


@pytest.fixture
def known(tmp_path):
    """A relation file: 100 µm at 10 m/s² in the column "rms", given in g; no longer rising from 400 µm on."""
    found = replace(relation_to(10.0), quantities={"only": Quantity(column="rms", unit="g")})
    path = tmp_path / "bench.relation"
    path.write_text(json.dumps({"schema": "gear-relation/1", "relation": found.to_dict()}), encoding="utf-8")
    return path


def depths(known, table, *more):
    path = known.with_name("levels.csv")
    path.write_text(table, encoding="utf-8")
    return run(["depths", str(known), str(path), *more])


def test_table_of_levels_becomes_depths(known, capsys):
    table = f"day,rms,by\nmonday,{10 / 9.80665},me\ntuesday,{24 / 9.80665},me\nfriday,,you\n"
    assert depths(known, table, "--json", "-") == 0
    monday, tuesday, friday = json.loads(capsys.readouterr().out)
    assert monday["day"] == "monday" and monday["by"] == "me" and "rms" not in monday
    assert monday["median_um"] == pytest.approx(100, abs=2) and monday["p05_um"] < 98 < 102 < monday["p95_um"]
    assert tuesday["median_um"] is None and tuesday["p95_um"] is None and tuesday["p05_um"] > 300
    assert "an upper bound is not known" in tuesday["reason"]
    assert friday["p05_um"] is None and friday["reason"] == "no level is given"
    out = known.with_name("depths.csv")
    assert depths(known, table, "--out", str(out)) == 0
    lines = out.read_text().splitlines()
    assert lines[0] == "day,by,median_um,p05_um,p95_um,reason" and lines[1].startswith("monday,me,")
    assert "3 depths written to" in capsys.readouterr().err
    assert depths(known, table) == 0
    said = capsys.readouterr().out
    assert "monday" in said and "at least" in said and "not available" in said


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("day,level\nmonday,1\n", "none of the relation's columns is there: 'rms'"),
        ("day,rms\nmonday,loud\n", "levels.csv, line 2: rms = 'loud' must be a number"),
        ("day,rms\nmonday,-1\n", "levels.csv, line 2: rms = '-1' must be positive and finite"),
        ("day,rms\nmonday\n", "levels.csv, line 2: 2 cells are needed, as in the header"),
        ("day,rms\n", "levels.csv: has no rows"),
    ],
)
def test_fault_of_a_table_is_one_line(known, table, message, capsys):
    assert depths(known, table) == 2
    said = capsys.readouterr().err.strip()
    assert message in said and "\n" not in said


def test_delimiter_of_several_characters_and_foreign_unit_are_one_line(known, capsys):
    assert depths(known, "day,rms\nmonday,1\n", "--delimiter", ";;") == 2
    assert "delimiter = ';;' must be one character" in capsys.readouterr().err
    known.write_text(known.read_text().replace('"unit": "g"', '"unit": "mm/s"'))
    assert depths(known, "day,rms\nmonday,1\n") == 2
    assert "the relation's unit 'mm/s' must be one of g, m/s2, 1" in capsys.readouterr().err


# a machine of which tooth counts and a relation are known


@pytest.fixture
def window():
    return machine(0.3, 1)


@pytest.fixture
def rig():
    return Rig.from_mapping(
        {"gears": {"pinion": {"teeth": TEETH[0]}, "gear": {"teeth": TEETH[1]}}, "operating": {"pinion_speed_hz": SPEED}}
        | {"sensors": {"accelerometer": "a"}}
    )


def relation_to(level, teeth=TEETH, speed=SPEED, **origin):
    """A relation by which this level [m/s²] is some 100 µm deep, and the level stops rising at 400 µm."""
    depth = np.linspace(0, 800e-6, 41)
    curve = LevelCurve(
        teeth=teeth,
        condition=Condition(speed_hz=speed, torque=1.0),
        depth=depth,
        level=level * (0.5 + np.minimum(depth, 400e-6) / 200e-6),
        scatter=np.zeros_like(depth),
        apart=np.zeros_like(depth),
    )
    return Relation(
        curves={"only": curve}, background={"only": 0.0}, gain={"only": 1.0}, assembly_std=0.05,
        rest_std={"only": 0.02}, deepest=800e-6, origin=Origin(**origin),
    )  # fmt: skip


def told(rig, window, relation, state=None):
    return step(rig, State() if state is None else state, window, Options(relation=relation))


def test_level_tells_the_depth_of_a_machine_without_a_model(rig, window):
    level = told(rig, window, None)[1].record["rms_measured"]
    state, found = told(rig, window, relation_to(level))
    wear = found.report["wear"]
    depth = wear["max_depth_um"]["combined"]
    assert depth["median"] == pytest.approx(100, abs=5) and depth["p05"] < 95 < 105 < depth["p95"]
    assert wear["reason"] is None and wear["method"] == "level"
    assert wear["max_depth_um"]["gear"]["status"] == "not available"
    assert found.report["rul"]["status"] == "not available"
    assert found.record["wear_depth_um"] == depth["median"]
    again = State.from_dict(json.loads(json.dumps(state.to_dict())))
    assert told(rig, window, relation_to(level), again)[1].report["wear"]["levels"]["only"]["window"] == 1


def test_level_beyond_where_it_rises_gives_a_lower_bound_in_words(rig, window):
    level = told(rig, window, None)[1].record["rms_measured"]
    wear = told(rig, window, relation_to(level / 2.5))[1].report["wear"]
    assert wear["max_depth_um"]["combined"]["p95"] is None
    assert wear["reason"].startswith("the level no longer rises with depth: at least 3")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"teeth": (18, 35)}, "the rig file has (20, 30) teeth, the relation's (18, 35): which are right?"),
        ({"speed": 45.0}, "the relation of level and depth holds for 45 Hz, not for"),
        ({"sensor": "b"}, "the relation is of sensor 'b', this level of 'a'"),
        ({"band": (0.0, 500.0)}, "the relation is of the RMS from 0 to 500 Hz, this level from 0 to 2000 Hz"),
    ],
)
def test_relation_of_another_machine_speed_sensor_or_band_says_nothing(rig, window, changed, message):
    wear = told(rig, window, relation_to(1.0, **changed))[1].report["wear"]
    assert wear["status"] == "not available" and message in wear["reason"]


def test_sensor_is_that_of_the_level_where_the_rig_file_names_none(window):
    rig = Rig.from_mapping(
        {"gears": {"pinion": {"teeth": TEETH[0]}, "gear": {"teeth": TEETH[1]}}, "operating": {"pinion_speed_hz": SPEED}}
    )
    wear = told(rig, window, relation_to(1.0, sensor="z"))[1].report["wear"]
    assert wear["reason"] == "the relation is of sensor 'z', this level of 'a'"


@pytest.mark.parametrize(
    ("stated", "note"),
    [
        ({}, "does not state the sensor and band of its levels"),
        ({"sensor": "a"}, "does not state the band of its levels"),
        ({"sensor": "a", "band": (0.0, 2000.0)}, None),
    ],
)
def test_depth_stands_with_what_its_relation_is_of_and_does_not_say(rig, window, stated, note):
    level = told(rig, window, None)[1].record["rms_measured"]
    wear = told(rig, window, relation_to(level, asset="bench", **stated))[1].report["wear"]
    assert wear["max_depth_um"]["combined"]["median"] == pytest.approx(100, abs=5)
    of = wear["relation"]
    assert of["asset"] == "bench" and of["sensor"] == stated.get("sensor")
    assert of["note"] is None if note is None else note in of["note"]


def test_assess_gives_the_depth_by_a_relation_file(tmp_path, rig, window, capsys):
    level = told(rig, window, None)[1].record["rms_measured"]
    file = tmp_path / "relation.json"
    file.write_text(json.dumps({"schema": "gear-relation/1", "relation": relation_to(level).to_dict()}))
    path = recording(tmp_path, "some", load=0.3, seed=1)
    out = tmp_path / "answer.json"
    assert run(["assess", str(path), "--relation", str(file), "--json", str(out)]) == 0
    answer = json.loads(out.read_text())
    assert answer["wear"]["max_depth_um"]["combined"]["median"] == pytest.approx(100, abs=10)
    said = capsys.readouterr().out
    assert "µm" in said and "does not state the sensor and band" in said
    assert run(["report", str(out)]) == 0
    assert "Not available: remaining life" in capsys.readouterr().out
