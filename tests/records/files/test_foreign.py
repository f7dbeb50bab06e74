"""Other programs' tables: a mapping says what the columns are; the cuts come back, or the line is refused."""

from __future__ import annotations

import contextlib
import dataclasses
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded_cut import recorded_cut

from cutenv.records import RecordError
from cutenv.records.foreign.column_map import MAP_FILE, ColumnMap, Expression, parse_expression
from cutenv.records.foreign.cut_detection import CutSearch
from cutenv.records.foreign.named_columns import bare_name
from cutenv.records.importers import Imported, load_foreign
from cutenv.records.scoring import score
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.trace import Trace
from scripts.validation.records.virtual_records import DIALECTS, valid_record


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


REAL = Path(__file__).parents[4] / "shared" / "data" / "scalpel_excision_forces.csv"
MILD = SensorParameters(force_noise=0.02, force_resolution=0.0)
SIMPLE = ColumnMap.parse(["time=t", "force=F"], unit="N")


def read(folder: Path, content: str | bytes, mapping: ColumnMap = SIMPLE, **options: Any) -> Imported:
    path = folder / "record.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return load_foreign(path, mapping, **options)


def refused(folder: Path, content: str | bytes, mapping: ColumnMap = SIMPLE) -> str:
    with pytest.raises(RecordError) as caught:
        read(folder, content, mapping)
    assert str(folder / "record.csv") in str(caught.value)
    return caught.value.reason


def rows(n: int = 60, separator: str = ",") -> str:
    return "".join(f"{0.01 * i:.2f}{separator}{i % 7}.5\n" for i in range(n))


@pytest.mark.parametrize("dialect", DIALECTS.values(), ids=DIALECTS)
@pytest.mark.parametrize("known", [("time", "force"), ("time", "force", "position", "speed", "angle", "depth")])
def test_what_a_program_wrote_is_read_back(dialect: Any, known: tuple[str, ...], tmp_path: Path) -> None:
    cut = recorded_cut("liver", sensor=MILD, turns=(0.03, 0.0)).trace
    trace = Trace(**{name: getattr(cut, name) for name in known})
    (record,) = read(tmp_path, dialect.write(trace), dialect.mapping(trace), search=None).records
    assert record.known == known
    assert record.force_unit == "N"
    for name in known:
        written, back = getattr(trace, name), getattr(record, name)
        if dialect.unit(name) in ("s", "N", "m", "m/s", "rad"):
            assert np.array_equal(back, written)
        else:
            np.testing.assert_allclose(back, written, rtol=1e-14, atol=1e-300)


@pytest.mark.parametrize(
    ("content", "mapping"),
    [
        ("t,F\n0,1.5\n1,2.5\n2,4.5\n", ["time=t[ms]", "force=F[N]"]),
        ("time,force\n0,1500\n1,2500\n2,4500\n", ["time=time[ms]", "force=force[mN]"]),
        ("t ; F\n0 ; 1,5\n1 ; 2,5\n2 ; 4,5\n", ["time=t[ms]", "force=F[N]"]),
        ("t [ms]  F [N]\n0  1.5\n1\t2.5\n2     4.5\n", ["time=t", "force=F"]),
        ('"t (ms)","F (N)"\n"0","1,5"\n"1","2,5"\n"2","4,5"\n', ["time=t", "force=F"]),
        ("t in ms;F / N\n\n0;1.5\n\n1;2.5\n# a remark\n2;4.5\n\n", ["time=t", "force=F"]),
        ("Weg;T;Kraft\n;ms;N\n0,1;0;1,5\n0,1;1;2,5\n0,1;2;4,5\n", ["time=t", "force=kraft"]),
        ("note,t_ms,force_mN\na,0,1500\nb,1,2500\nc,2,4500\n", ["time=t", "force=force"]),
        ("0 1.5\n1 2.5\n2 4.5\n", ["time=#1[ms]", "force=#2[N]"]),
        ("run 3\n# t F\n0 -1.5\n1 -2.5\n2 -4.5\n", ["time=t[ms]", "force=-F[N]"]),
        ("F\n1.5\n2.5\n4.5\n", ["rate=1kHz", "force=F[N]"]),
        ("F [N]\n1,5\n2,5\n4,5\n", ["rate=1kHz", "force=F"]),
        ("a,b,t\n0.9,1.2,0\n1.5,2,1\n2.7,3.6,2\n", ["time=t[ms]", "force=norm(a,b)[N]"]),
        ("t,F,\n0,1.5,\n1,2.5,\n2,4.5,\n", ["time=t[ms]", "force=F[N]"]),
        ("t,F,t\n0,1.5,7\n1,2.5,8\n2,4.5,9\n", ["time=#1[ms]", "force=F[N]"]),
    ],
)
@pytest.mark.parametrize("encode", ["utf-8", "utf-8-sig", "utf-16", "cp1252", "mac line ends"])
def test_a_table_is_understood(content: str, mapping: list[str], encode: str, tmp_path: Path) -> None:
    encoded = content.replace("\n", "\r").encode() if encode == "mac line ends" else content.encode(encode)
    (record,) = read(tmp_path, encoded, ColumnMap.parse(mapping)).records
    np.testing.assert_allclose(record.time, [0.0, 0.001, 0.002])
    np.testing.assert_allclose(record.force, [1.5, 2.5, 4.5])


@pytest.mark.parametrize(
    ("content", "mapping", "message"),
    [
        ("", {}, "it is empty. Record or copy it again"),
        ("# only\n\n", {}, "it holds no numbers"),
        ("t,F\n", {}, "no rows of numbers"),
        ("some text\nand more of it\n", {}, "no rows of numbers"),
        ("t,Fx\n" + rows(), {}, "there is no column 'F'; there are t, Fx. Did you mean 'Fx'?"),
        (rows(), {}, "no line above the numbers names them .nothing stands above them.*time=#1 force=#2"),
        ("Run 5\n" + rows(), {}, "above them stands 'Run 5': 1 names for 2 columns"),
        (rows(), {"time": "#1", "force": "#3"}, "there is no column #3: the rows have 2"),
        ("t,F,F\n0,1,2\n1,2,3\n", {}, "columns #2 and #3 are both called 'F'"),
        ("t,F [parsec]\n" + rows(), {"unit": None}, "unit of force must be one of .*'parsec'.*force=F.unit."),
        ("t,F\n" + rows(), {"unit": None}, "the unit of force is not known.*--unit N"),
        ("t,F [mN]\n" + rows(), {}, "force is mapped in N, but the file has mN"),
        ("t,F [N],G [mN]\n0,1,2\n1,2,3\n", {"force": "norm(F,G)", "unit": None}, "of force are in N and mN"),
        ("t [parsec],F\n" + rows(), {}, "unit of time must be one of"),
        ("t,F\n0,1\n", {}, "lines 2 to 2: a trace has 2 instants or more"),
        ("t,F\n0,1\n1000,2\n2000,3\n", {}, "it looks like milliseconds"),
        ("t,F,x\n0,1,2\n0.001,2,3\n", {"position": "x"}, "position = 2 m is outside.*looks like centimetres"),
        (b"PK\x03\x04rest", {}, "it is no text but a zip file or a spreadsheet.* save it as CSV"),
        (b"\x89HDF\r\n\x1a\n", {}, "it is no text but HDF5. Give it the suffix of what it is"),
        (b"t,F\n0,1\x00\n", {}, "it is no text: it holds zero bytes"),
        ("t,F\n1,2\n".encode("utf-16-le"), {}, "it is no text: it holds zero bytes"),
        (b"t,F\n0,1\x81\n", {}, "no text in UTF-8, UTF-16 or Windows' encoding"),
    ],
)
def test_a_bad_file_is_refused_by_line_and_cure(
    content: str | bytes, mapping: dict[str, Any], message: str, tmp_path: Path
) -> None:
    reason = refused(tmp_path, content, dataclasses.replace(SIMPLE, **mapping))
    assert re.search(message, reason), reason


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ("0.05,nan\n", "no finite number .line 7: 'nan' in column 'F'"),
        ("0.05,\n", "no finite number .line 7: '' in column 'F'"),
        ("0.05,1e999\n", "no finite number .line 7: '1e999' in column 'F'"),
        ("0.05,OL\n", "no finite number .line 7: 'OL' in column 'F'"),
        ("0.05,1e30\n", "no finite number .line 7: '1e30' in column 'F'"),
        ("0.05,oops\n", "words in place of numbers .line 7: '0.05,oops'"),
        ("0.05\n", "incomplete lines"),
        ("0.05,1,5\n", "incomplete lines, or of more cells"),
        ("0.04,1\n", "their time repeats"),
        ("Maximum,4.5\n", "words in place of numbers .line 7: 'Maximum,4.5'"),
        ("t,F\n", "the header, repeated"),
    ],
)
def test_sound_rows_around_a_bad_one_are_read_and_it_is_counted(bad: str, said: str, tmp_path: Path) -> None:
    more = "".join(f"{0.05 + 0.01 * i:.2f},{i % 5}.5\n" for i in range(1, 60))
    imported = read(tmp_path, "t,F\n" + rows(5) + bad + more)
    (left_out,) = imported.left_out
    assert left_out.count == 1
    assert re.search(said, left_out.reason), left_out.reason
    assert any(str(left_out) in note for note in imported.notes)
    (record,) = imported.records
    assert len(record) == 64
    np.testing.assert_allclose(record.force, [i + 0.5 for i in range(5)] + [i % 5 + 0.5 for i in range(1, 60)])


def test_a_clock_that_starts_again_parts_the_records(tmp_path: Path) -> None:
    imported = read(tmp_path, "t,F\n" + rows(50) + rows(70))
    assert [len(record) for record in imported.records] == [50, 70]
    assert any("starts again 1 times" in note for note in imported.notes)


@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_a_decimal_comma_in_one_row_of_thousands_is_seen(separator: str, tmp_path: Path) -> None:
    lines = [f"{i}{separator}{i % 7}" for i in range(3000)]
    lines[2900] = f"2900,25{separator}3"
    (record,) = read(
        tmp_path, "\n".join([f"t{separator}F", *lines]), ColumnMap.parse(["time=t[ms]", "force=F[N]"])
    ).records
    assert record.time[2900] == 2.90025


def long_file(offset: tuple[float, float, float] = (0.4, 0.0, 0.0)) -> tuple[str, float]:
    """Rest, a cut, rest, in three components, the force along (0.6, 0, 0.8); and when the cut starts [s]."""
    cut = recorded_cut("2 cm", sensor=MILD, turns=(0.03,)).trace
    rest = 0.02 * np.random.default_rng(3).standard_normal(2000)
    force = np.concatenate([rest, cut.force])
    components = np.outer(force, (0.6, 0.0, 0.8)) + offset
    lines = [f"{i / 1000},{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate(components.tolist())]
    return "t,Fx,Fy,Fz\n" + "\n".join(lines) + "\n", 2.0


def test_a_norm_is_made_of_components_without_their_offsets(tmp_path: Path) -> None:
    content, start = long_file(offset=(0.4, -1.0, 2.0))
    mapping = ColumnMap.parse(["time=t", "force=norm(Fx,Fy,Fz)"], unit="N")
    imported = read(tmp_path, content, mapping)
    (trace,) = imported.traces
    assert trace.time[0] == pytest.approx(start, abs=0.03)
    felt = recorded_cut("2 cm", sensor=MILD, turns=(0.03,)).trace.force
    np.testing.assert_allclose(trace.force[-1000:], felt[-1000:], atol=5e-3)
    assert trace.metadata["tare_N"] == pytest.approx({"Fx": 0.4, "Fy": -1.0, "Fz": 2.0}, abs=2e-3)
    assert np.hypot(np.hypot(0.4, 1.0), 2.0) == pytest.approx(imported.records[0].force[:1000].mean(), rel=0.01)


def test_the_cuts_of_a_record_tell_where_they_are_from(tmp_path: Path) -> None:
    content, start = long_file()
    mapping = ColumnMap.parse(["time=t", "force=Fx[N]", "angle=90deg", "depth=20mm"])
    imported = read(tmp_path, content, mapping)
    (trace,), (whole,) = imported.traces, imported.records
    first, last = trace.metadata["instants"]
    assert trace.metadata["source"] == "record.csv"
    assert trace.metadata["lines"] == [first + 2, last + 2]
    assert trace.metadata["columns"]["force"] == "Fx[N]"
    assert np.array_equal(trace.force, whole.force[first : last + 1] - trace.metadata["tare_N"]["Fx"])
    assert len(whole) == content.count("\n") - 1
    assert np.array_equal(trace.angle, np.full(len(trace), np.pi / 2))
    assert np.array_equal(trace.depth, np.full(len(trace), 0.02))
    told = "\n".join(imported.notes)
    assert "separator comma, decimal point" in told
    assert "time: no unit is given, s is assumed" in told
    assert "0.4 N taken off the force" in told
    assert f"cut 1 from {trace.time[0]:.3f} s to {trace.time[-1]:.3f} s" in told
    assert start == pytest.approx(trace.time[0], abs=0.03)


def test_a_record_without_a_cut_is_kept_whole_and_said_so(tmp_path: Path) -> None:
    noise = 0.02 * np.random.default_rng(3).standard_normal(2000)
    content = "t,F\n" + "\n".join(f"{i / 1000},{F!r}" for i, F in enumerate(noise.tolist()))
    imported = read(tmp_path, content)
    assert len(imported.traces[0]) == 2000
    assert imported.cuts == ((),)
    assert any("no cut found" in note for note in imported.notes)


def test_a_flaw_is_told_by_the_lines_of_the_file(tmp_path: Path) -> None:
    content, _ = long_file()
    lines = content.split("\n")
    for i in range(3000, 3900):
        lines[i] = lines[i].split(",")[0] + "," + lines[3000].partition(",")[2]
    imported = read(tmp_path, "\n".join(lines), ColumnMap.parse(["time=t", "force=Fx[N]"]))
    (flaw,) = imported.flaws[0]
    assert flaw.kind == "stuck"
    assert flaw.message.startswith("lines 3001 to 3900: the sensor shows")
    assert imported.sound == ()
    assert imported.picture(0)["flaws"] == ((flaw,),)


def test_groups_are_records_of_one_cut_each(tmp_path: Path) -> None:
    content = "who,n,t,F\n" + "".join(
        f"{who},{n},{i / 100},{np.sin(i / 9) + 1}\n" for i in range(200) for who in "ab" for n in (1, 2)
    )
    mapping = ColumnMap.parse(["time=t", "force=F", "split_by=who,n"], unit="N")
    imported = read(tmp_path, content, mapping)
    assert [trace.metadata["group"] for trace in imported.records] == [
        {"who": who, "n": n} for who, n in (("a", "1"), ("a", "2"), ("b", "1"), ("b", "2"))
    ]
    assert [len(trace) for trace in imported.records] == [200] * 4
    assert len(imported.traces) == 4
    assert imported.records[1].metadata["lines"] == [3, 799]
    assert "split_by=who,n" in refused(tmp_path, content, ColumnMap.parse(["time=t", "force=F"], unit="N"))


def test_the_next_file_is_read_by_the_mapping_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    path.write_text("t,F\n" + rows())
    with pytest.raises(RecordError, match=r"which of its columns is what\? .*--map time=t force=F --unit N$"):
        load_foreign(path)
    SIMPLE.save(tmp_path)
    assert load_foreign(path).mapping == SIMPLE


def test_search_parameters_are_used(tmp_path: Path) -> None:
    content, _ = long_file()
    mapping = ColumnMap.parse(["time=t", "force=Fx[N]"])
    assert read(tmp_path, content, mapping, search=CutSearch(quiet=5.0)).traces[0].metadata.get("tare_N") is None
    (whole,) = read(tmp_path, content, mapping, search=None).traces
    assert len(whole) == content.count("\n") - 1


@pytest.mark.parametrize("seed", range(12))
def test_valid_records_in_any_dialect_are_accepted(seed: int, tmp_path: Path) -> None:
    record = valid_record(seed)
    dialect = list(DIALECTS.values())[seed % len(DIALECTS)]
    imported = read(tmp_path, dialect.write(record.trace), dialect.mapping(record.trace))
    assert imported.sound == imported.traces
    tare = imported.traces[0].metadata["tare_N"]
    assert next(iter(tare.values())) == pytest.approx(record.offset, abs=0.025)
    if record.trace.position is not None:
        assert [trace.time[0] for trace in imported.traces] == pytest.approx(record.starts, abs=0.2)


@settings(max_examples=200)
@given(content=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: ("t,F\n0,1\n1,2\n" + text).encode()))
def test_anything_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    for mapping in (SIMPLE, ColumnMap(rate=100.0, force="#1", unit="1")):
        with contextlib.suppress(RecordError):
            read(tmp_path_factory.getbasetemp(), content, mapping)


@pytest.mark.needs("records")
class TestRealRecords:
    """207 hand-held cuts (Straizys et al. 2023): other people's file, read by its columns."""

    MAPPING = ColumnMap.parse(["time=time_s", "force=force_normalised", "split_by=trial,cut"], unit="1")

    def test_each_cut_is_a_record(self) -> None:
        imported = load_foreign(REAL, self.MAPPING)
        assert len(imported.records) == len(imported.traces) == 207
        assert {len(trace) for trace in imported.records} == {180}
        assert {trace.force_unit for trace in imported.traces} == {"1"}
        assert len({tuple(trace.metadata["group"].values()) for trace in imported.traces}) == 207
        assert max(trace.force.max() for trace in imported.records) == 1.0

    def test_real_records_raise_no_false_alarm(self) -> None:
        assert load_foreign(REAL, self.MAPPING).flaws == ((),) * 207


def test_the_rest_in_the_file_shows_that_a_cut_that_stops_at_once_is_complete(tmp_path: Path) -> None:
    cut = recorded_cut("liver", sensor=MILD, turns=(0.03,)).trace
    stop = int(np.argmax(cut.require("position", by="this test")[0] > 0.02))
    force = np.concatenate([np.zeros(1000), cut.force[:stop], np.zeros(3000)])
    way = np.concatenate([np.zeros(1000), 1e3 * cut.require("position", by="this test")[0][:stop], np.full(3000, 20.0)])
    lines = "".join(f"{i / 1000};{f:.4f};{x:.4f}\n" for i, (f, x) in enumerate(zip(force, way, strict=True)))
    mapping = ColumnMap.parse(["time=t", "force=F", "position=x"])
    (trace,) = read(tmp_path, "t [s];F [N];x [mm]\n" + lines, mapping).traces
    assert "ends while" not in score(trace, target_length=0.02).no_score
    truncated = "".join(lines.splitlines(keepends=True)[: 1000 + stop])
    (trace,) = read(tmp_path, "t [s];F [N];x [mm]\n" + truncated, mapping).traces
    assert "the record ends while the blade moves" in score(trace, target_length=0.02).no_score


def test_a_header_of_many_blanks_in_brackets_keeps_nobody_waiting() -> None:
    began = time.process_time()
    assert bare_name("force [N]") == "force"
    assert bare_name("x [" + " " * 20_000 + "y [") == "x [" + " " * 20_000 + "y ["
    assert time.process_time() - began < 1.0
