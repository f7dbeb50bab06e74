"""A mapping says what the columns of a file are, in a line, and is kept for the next file."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.recording import RecordError
from cutenv.recording.column_map import MAP_FILE, ColumnMap, Expression, parse_expression


def test_the_command_line_is_read() -> None:
    items = ["time=t", "force=norm(Fx, Fy,Fz)", "position=-x[mm]", "angle=90deg", "depth=20 mm", "split_by=trial,cut"]
    mapping = ColumnMap.parse(items, unit="mN")
    assert mapping.fields == ("time", "force", "position", "angle", "depth")
    assert mapping.expression("time") == Expression(columns=("t",))
    assert mapping.expression("force") == Expression(columns=("Fx", "Fy", "Fz"), is_norm=True, unit="mN")
    assert mapping.expression("position") == Expression(columns=("x",), sign=-1.0, unit="mm")
    assert mapping.expression("angle") == Expression(value=90.0, unit="deg")
    assert mapping.expression("depth") == Expression(value=20.0, unit="mm")
    assert mapping.split_by == ("trial", "cut")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Fx", Expression(columns=("Fx",))),
        ("Fx [N]", Expression(columns=("Fx",), unit="N")),
        ("-Fx[mN]", Expression(columns=("Fx",), sign=-1.0, unit="mN")),
        ('"a,b"', Expression(columns=("a,b",))),
        ('"-a"', Expression(columns=("-a",))),
        ("#2", Expression(columns=("#2",))),
        ("Force in N", Expression(columns=("Force in N",))),
        ("F (t)", Expression(columns=("F (t)",))),
        ('-norm("F, x",Fy)[kN]', Expression(columns=("F, x", "Fy"), is_norm=True, sign=-1.0, unit="kN")),
    ],
)
def test_a_force_is_a_column_or_its_opposite_or_a_norm(text: str, expected: Expression) -> None:
    assert parse_expression("force", text) == expected


@pytest.mark.parametrize(
    ("field", "text", "value", "unit"),
    [
        ("angle", "90deg", 90.0, "deg"),
        ("angle", "45 °", 45.0, "deg"),
        ("angle", "1.57 rad", 1.57, "rad"),
        ("depth", "2e1mm", 20.0, "mm"),
        ("depth", "20[mm]", 20.0, "mm"),
        ("speed", "12.7 mm/s", 12.7, "mm/s"),
        ("speed", "-1cm/s", -1.0, "cm/s"),
    ],
)
def test_what_was_set_by_hand_has_its_unit(field: str, text: str, value: float, unit: str) -> None:
    assert parse_expression(field, text) == Expression(value=value, unit=unit)


@pytest.mark.parametrize(
    ("items", "unit", "message"),
    [
        (["force=F"], "N", "give one of time .* and rate"),
        (["time=t", "rate=100Hz", "force=F"], "N", "give one of time .* and rate"),
        (["rate=100", "force=F"], "N", "Write rate=1000Hz"),
        (["rate=0.1Hz", "force=F"], "N", "rate = 0.1 Hz is outside"),
        (["time=t"], "N", "force is not mapped"),
        (["time=t", "froce=F"], "N", "Did you mean 'force'"),
        (["time=t", "force"], "N", "'force' maps nothing"),
        (["time=t", "time=u", "force=F"], "N", "time is mapped twice: 't' and 'u'"),
        (["time=t", "force=F"], "Newtom", "unit of force must be one of 'N', 'mN'.* got 'Newtom'"),
        (["time=t", "force=F[mN]"], "N", "unit of force is said twice"),
        (["time=t", "force=5N"], None, "force is measured at every instant"),
        (["time=t", "force=F", "position=3mm"], "N", "position is measured at every instant"),
        (["time=t", "force=F", "angle=90"], "N", "has no unit. Write one behind it, such as 90deg"),
        (["time=t", "force=F", "angle=90 parsec"], "N", "unit of angle must be one of"),
        (["time=t", "force=F", "depth=20mm[mm]"], "N", "two units"),
        (["time=t", "force=F", "position=norm(x,y)"], "N", "a norm is made of force's components"),
        (["time=t", "force=norm()"], "N", "a norm is made of force's components"),
        (["time=t", 'force="a","b"'], "N", "Quote odd names"),
        (["time=t", "force=-"], "N", "is no column"),
    ],
)
def test_what_is_no_mapping_is_refused_with_the_cure(items: list[str], unit: str | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ColumnMap.parse(items, unit=unit)


NAMES = st.text(st.characters(codec="utf-8"), max_size=20)


@given(text=NAMES, field=st.sampled_from(["time", "force", "angle"]))
def test_any_expression_is_read_or_refused(text: str, field: str) -> None:
    with contextlib.suppress(ValueError):
        expression = parse_expression(field, text)
        assert bool(expression.columns) == (expression.value is None)


MAPPINGS = [
    ColumnMap(time="t", force="F"),
    ColumnMap(rate=1000.0, force="-norm(a,b)", unit="lbf", depth="20mm", split_by=("trial", "cut")),
    ColumnMap(time="Zeit [ms]", force='"µ, x"', position="x", speed="1mm/s", angle="90°"),
]


@pytest.mark.parametrize("mapping", MAPPINGS)
def test_a_mapping_is_kept_for_the_next_file(mapping: ColumnMap, tmp_path: Path) -> None:
    assert ColumnMap.from_json(mapping.to_json()) == mapping
    assert mapping.save(tmp_path) == tmp_path / MAP_FILE
    assert ColumnMap.load(tmp_path) == ColumnMap.load(tmp_path / MAP_FILE) == mapping
    assert [path.name for path in tmp_path.iterdir()] == [MAP_FILE]
    mapping.save(tmp_path / "sensor b.json")
    assert ColumnMap.load(tmp_path / "sensor b.json") == mapping


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-5], "not JSON"),
        (lambda text: text.replace("columns/1", "columns/2"), "expected a JSON object with schema"),
        (lambda text: text.replace('"depth"', '"deepness"'), "field must be one of"),
        (lambda text: text.replace('"t"', "3"), "time = 3 is not what a mapping holds"),
        (lambda text: text.replace('"t"', "true"), "time = True is not what a mapping holds"),
        (lambda text: text.replace('"rate": null', '"rate": true'), "rate = True is not what a mapping holds"),
        (lambda text: text.replace("[]", '"trial"'), "split_by = 'trial' is not what a mapping holds"),
        (lambda text: text.replace("[]", "[3]"), "split_by must be names of columns"),
        (lambda text: text.replace('"F"', "null"), "force = None is not what a mapping holds"),
        (lambda text: "[]", "expected a JSON object with schema"),
    ],
)
def test_a_damaged_mapping_is_refused_by_its_path(change: Any, message: str, tmp_path: Path) -> None:
    (tmp_path / MAP_FILE).write_text(change(MAPPINGS[0].to_json()))
    with pytest.raises(RecordError, match=message) as caught:
        ColumnMap.load(tmp_path)
    assert str(tmp_path / MAP_FILE) in str(caught.value)


def test_a_mapping_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / MAP_FILE).write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordError, match="no mapping of columns"):
        ColumnMap.load(tmp_path)
