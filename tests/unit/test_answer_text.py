"""An answer as text says what matters, warns where the model does not hold, and fits the terminal."""

import pytest

from service.report.content import report_of
from service.report.text import answer_text, summary_lines, window_table
from service.report.words import listed, table

BAND = {"median": 520.0, "p05": 480.0, "p95": 560.0}
RECORD = {
    "kind": "measurement",
    "revolutions": 18001.2,
    "speed_hz": 10.03,
    "torque_nm": 9.796,
    "rms_measured": 228.3,
    "rms_predicted": 222.8,
    "error_percent": -2.435,
    "rms_after": 222.8,
    "k_wear_per_n": 3.077e-6,
    "wear_depth_um": 510.7,
    "updated": True,
    "quality": "repaired",
}


def answer(validity=None, notes=(), **more):
    wear = {"max_depth_um": {"combined": BAND, "pinion": BAND, "gear": BAND}, "validity": validity}
    return {
        "asset": "unsw",
        "windows": [RECORD | {"index": i, "notes": list(notes)} for i in range(12)],
        "wear": wear,
        "rul": {"hours": BAND, "revolutions": BAND},
        "effects": [],
        "data_quality": {"windows": {"good": 12}},
        **more,
    }


def lines_of(given):
    return summary_lines(report_of(given), given)


def test_a_depth_beyond_the_last_steady_state_carries_a_warning():
    said = "\n".join(lines_of(answer({"valid": False, "contact_loss_from_um": 336.4})))
    assert "Warning: outside the validity of the model" in said and "336.4 µm" in said
    assert "Warning" not in "\n".join(lines_of(answer({"valid": True, "contact_loss_from_um": 336.4})))
    assert "Warning: outside the validity of the model: because" in "\n".join(
        lines_of(answer({"valid": False, "reason": "because"}))
    )


def test_notes_of_windows_are_printed_once_with_their_windows():
    said = answer_text(answer(notes=["the teeth lose contact for 12 % of the mesh cycle"]))
    assert said.count("the teeth lose contact") == 1
    assert "Note on window 0 to 11 (12 windows)" in said


def test_the_status_is_the_first_line_and_an_unknown_effect_is_named():
    status = {"level": "end_of_life", "reasons": ["511 µm of 500 µm are worn."]}
    lines = lines_of(answer(status=status, unexplained={"verdict": "unknown_effect", "reason": "39.6 Hz"}))
    assert lines[0] == "Status: end of life. 511 µm of 500 µm are worn."
    assert "Unknown effect: 39.6 Hz." in lines


def test_a_reason_is_not_repeated():
    part = {"status": "not available", "reason": "the rig file does not give gears.module"}
    said = "\n".join(lines_of(answer() | {"wear": part, "rul": part}))
    assert said.count("gears.module") == 1


def test_preliminary_figures_say_why_and_what_would_settle_them_once():
    doubt = {"reasons": ["the level alone"], "remedies": ["an encoder", "a measured depth"]}
    young = {"reasons": ["the level alone", "one window"], "remedies": ["a measured depth", "two windows"]}
    given = answer()
    given["wear"]["preliminary"], given["rul"]["preliminary"] = doubt, young
    lines = lines_of(given)
    assert [line for line in lines if line.startswith("Preliminary: ")] == [
        "Preliminary: The level alone.", "Preliminary: One window.",
    ]  # fmt: skip
    assert sum(line == "What would settle it: A measured depth." for line in lines) == 1
    assert any(line.startswith("Wear depth: 520 µm; Preliminary. 5–95 %: 480 to 560 µm") for line in lines)
    assert not any("Preliminary" in line for line in lines_of(answer()))


@pytest.mark.parametrize("width", [80, 100, 170])
def test_the_window_table_fits_the_terminal_and_keeps_depth_and_level(width, monkeypatch):
    monkeypatch.setattr("service.report.text.width", lambda: width)
    lines = window_table(answer()["windows"])
    assert max(map(len, lines)) <= width
    assert "depth µm" in lines[0] and "RMS meas." in lines[0] and "510.7" in lines[1]
    assert ("K 1/N" in lines[0]) is (width == 170)


def test_columns_without_a_value_are_left_out():
    bare = [{"index": 0, "kind": "measurement", "rms_measured": 1.0, "quality": "good", "updated": False}]
    assert window_table(bare)[0].split() == ["#", "kind", "RMS", "meas.", "data"]


def test_a_life_without_an_upper_bound_is_stated_as_a_lower_bound_with_the_reason():
    """It was "not available; not available"."""
    unbounded = {"median": None, "p05": 120.0, "p95": None}
    rul = {"hours": unbounded, "revolutions": unbounded | {"p05": 4.3e6}, "reason": "the wear rate is not known yet"}
    (line,) = [line for line in lines_of(answer(rul=rul)) if line.startswith("Remaining life")]
    assert line == (
        "Remaining life: at least 120 h; 4,300,000 revolutions of the pinion (95 % confidence); the wear rate is not "
        "known yet"
    )


def test_a_list_of_the_json_is_a_table_of_its_keys_without_those_that_hold_nothing():
    found = [
        {"at": "2026-01-01T10:00:00Z", "what": {"effect": "crack", "note": None}, "done": True, "count": 1200.5},
        {"at": "2026-01-02T10:00:00Z", "what": {}, "done": False, "by": None, "count": None},
    ]
    assert listed(found, "at what done by count") == [
        "at                    what          done  count",
        "2026-01-01 10:00 UTC  effect crack  yes   1200.5",
        "2026-01-02 10:00 UTC                no",
    ]
    assert listed([], "at") == []


def test_columns_are_aligned_and_the_last_one_is_wrapped_where_there_is_little_room(monkeypatch):
    monkeypatch.setattr("service.report.words.width", lambda: 40)
    lines = table([("a", 1, "word " * 8), ("long", 10, "short")], ("name", "n", "text"), right=(1,))
    assert (
        lines[0] == "name   n  text"
        and lines[1].startswith("a      1  word")
        and lines[2].startswith(" " * 10 + "word")
    )
    assert lines[-1] == "long  10  short" and max(map(len, lines)) <= 40
