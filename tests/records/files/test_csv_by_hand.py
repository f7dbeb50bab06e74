"""A CSV file that somebody made needs headers with quantity and unit; what is wrong is said with its line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cutenv._base.unit_table import NAMED_UNITS
from cutenv.records import RecordError, load, load_one, save
from cutenv.records.schema import FIELD_UNITS, UNITS, header_of, parse_header
from cutenv.sim.trace import Reading, Trace

GOOD = "time_s,force_N\n0,0.5\n0.001,0.75\n0.002,1.0\n"


@pytest.fixture
def file(tmp_path):
    return tmp_path / "cut.csv"


def test_headers_with_units_are_all_that_is_needed(file):
    file.write_text(
        "time_ms,force_mN,position_cm,speed_cm_s,angle_deg,depth_mm\n0,54,0,2.54,90,20\n10,108,0.0254,2.54,45,20\n"
    )
    cut = load_one(file)
    assert cut == Trace(
        time=[0.0, 0.01],
        force=[0.054, 0.108],
        position=[0.0, 0.000254],
        speed=[0.0254, 0.0254],
        angle=[math.pi / 2, math.pi / 4],
        depth=[0.02, 0.02],
    )


def test_a_normalised_force_stays_one(file):
    file.write_text(GOOD.replace("force_N", "force_1"))
    assert load_one(file).force_unit == "1"


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + GOOD,
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        GOOD.replace(",", " , "),
        GOOD.rstrip("\n"),
        "# measured by hand\n\n" + GOOD + "\n\n",
        GOOD.replace("0.001", "1e-3").replace("0.75", "+.75"),
    ],
    ids=["mark", "windows", "old mac", "blanks", "no end of line", "comments", "exponents"],
)
def test_ways_to_write_the_same(file, text):
    file.write_bytes(text.encode())
    assert load_one(file) == Trace(time=[0.0, 0.001, 0.002], force=[0.5, 0.75, 1.0])


def test_comments_may_hold_metadata(file):
    file.write_text('# metadata: {"rig": "bench 2"}\n' + GOOD)
    assert load_one(file).metadata == {"rig": "bench 2"}


def test_a_column_tells_cuts_apart_and_keeps_their_numbers(file):
    file.write_text(
        '# metadata of cut 7: {"blade": "No. 10"}\ncut,time_s,force_N\n7,0,1\n7,0.1,2\n3,0,3\n3,0.1,4\n3,0.2,5\n'
    )
    first, second = load(file)
    assert (first.metadata, second.metadata) == ({"blade": "No. 10", "cut": 7}, {"cut": 3})
    assert np.array_equal(second.force, [3.0, 4.0, 5.0])


COMPONENTS = "time_s,force_x_N,force_y_N,force_z_N\n0,3,-4,12\n0.1,0,0,-2\n"


@pytest.mark.parametrize(
    ("force", "found"),
    [(None, [13, 2]), ("norm", [13, 2]), ("x", [3, 0]), ("y", [-4, 0]), ("-y", [4, 0]), ("-z", [-12, 2])],
)
def test_a_force_in_three_directions_becomes_one(file, force, found):
    file.write_text(COMPONENTS)
    cut = load_one(file, force=force)
    assert np.array_equal(cut.force, found)
    assert cut.metadata == {"force_along_cut": force or "norm"}


def test_the_file_may_say_which_direction_is_along_the_cut(file):
    file.write_text('# metadata: {"force_along_cut": "-z"}\n' + COMPONENTS)
    assert np.array_equal(load_one(file).force, [-12, 2])
    assert np.array_equal(load_one(file, force="x").force, [3, 0])


def test_two_directions_and_units_of_their_own_make_a_norm(file):
    file.write_text("time_s,force_x_N,force_z_mN\n0,3,4000\n0.1,0.6,800\n")
    assert load_one(file).force == pytest.approx([5.0, 1.0], rel=1e-15)


def test_a_force_beside_its_components_is_taken_unless_one_is_asked_for(file):
    file.write_text("time_s,force_N,force_x_N,force_y_N\n0,1,3,4\n0.1,1,3,4\n")
    assert np.array_equal(load_one(file).force, [1, 1])
    assert np.array_equal(load_one(file, force="norm").force, [5, 5])


def test_an_unknown_direction_is_refused_at_the_door(file):
    with pytest.raises(ValueError, match="force must be one of 'norm', 'x'"):
        load(file, force="w")


REFUSED = {
    "empty": ("", "it is empty"),
    "blank": ("\n\n", "no row of headers, such as time_s,force_N"),
    "no headers": ("0,1\n1,2\n", "line 1: the first row holds numbers. Put names with units above"),
    "no rows": ("time_s,force_N\n", "holds no readings"),
    "no time": ("force_N,position_m\n1,0\n", r"line 1: it has no column time_s \(or time in another unit\)"),
    "no force": ("time_s,position_m\n1,0\n", "no column force_N .*it has time_s, position_m. Add it"),
    "no unit": ("time,force\n0,1\n", "line 1: column 'time' has no unit. Write one of time_s"),
    "unknown unit": ("time_s,force_Nn\n0,1\n", "unit 'Nn', which is not known.*Did you mean force_N"),
    "unknown column": ("time_s,force_N,colour\n0,1,2\n", "'colour' is no quantity of a cut with its unit"),
    "nameless column": (GOOD.replace("\n", ",\n"), "column '' is no quantity"),
    "twice": ("time_s,force_N,time_ms\n0,1,0\n", "columns 'time_s' and 'time_ms' have the same meaning"),
    "cut twice": ("cut,time_s,force_N,cut\n0,1,0,0\n", "columns 'cut' and 'cut' have the same meaning"),
    "two forces": (
        GOOD.replace("force_N", "force_N,force_1")
        .replace(".5", ".5,1")
        .replace("5\n", "5,1\n")
        .replace("1.0", "1.0,1"),
        "force in newtons and one without a unit",
    ),
    "semicolons": (GOOD.replace(",", ";"), "line 1: semicolons part the columns. Part them by commas"),
    "tabs": (GOOD.replace(",", "\t"), "line 1: tabs part the columns"),
    "semicolons in rows": (GOOD.replace("001,", "001;"), "line 3: 1 value for 2 columns .*Part the values by commas"),
    "decimal commas": (
        GOOD.replace(".", ","),
        "line 2: 3 values for 2 columns .*: '0,0,5'. Write decimals with a point",
    ),
    "short row": (GOOD + "0.003", "line 5: 1 value for 2 columns .*cut off"),
    "comment below": (GOOD + "# the end\n", "line 5: .*Put comments above the headers"),
    "missing value": (
        GOOD.replace("0.75", ""),
        "line 3, column force_N: the value is missing. Leave out the whole row",
    ),
    "text": (GOOD.replace("0.75", "much"), "line 3, column force_N: 'much' is not a number. Write it as 0.125"),
    "unit in cell": (GOOD.replace("0.75", "0.75 N"), "line 3, column force_N: '0.75 N' is not a number"),
    "quotes": (GOOD.replace("0.75", '"0.75"'), "line 3, column force_N: .*quotation marks"),
    "underscore": (GOOD.replace("0.75", "0_75"), "line 3, column force_N: '0_75' is not a number"),
    "other digits": (GOOD.replace("0.75", "\u0661"), "line 3, column force_N: .* is not a number"),
    "zero byte": (GOOD.replace("0.75", "\x00"), "line 3, column force_N: .* is not a number"),
    "NaN": (GOOD.replace("0.75", "nan"), "line 3, column force_N: nan is no reading. Leave out the whole row"),
    "infinite": (GOOD.replace("0.75", "-inf"), "line 3, column force_N: -inf is no reading"),
    "too large": (GOOD.replace("0.75", "1e999"), "line 3, column force_N"),
    "NaN after blank lines": (GOOD.replace("\n", "\n\n").replace("1.0", "nan"), "line 7, column force_N: nan"),
    "time stands": (GOOD.replace("0.002", "0.001"), "line 4: time goes from 0.001 s to 0.001 s; it must increase"),
    "time goes back": (GOOD.replace("0.001", "0.003"), "line 4: time goes from 0.003 s to 0.002 s.*Sort the rows"),
    "one row": ("time_s,force_N\n0,1\n", "from line 2 on: a trace has 2 instants or more, got 1"),
    "out of range": (GOOD.replace("0.75", "7500"), "line 3: force = 7500 N is outside .*millinewtons"),
    "centimetres": ("time_s,force_N,position_m\n0,1,0\n0.1,1,5\n", "line 3: position = 5 m .*looks like centimetres"),
    "two out of range": (
        "time_s,position_m,force_N\n0,5,0\n0.1,0,5000\n",
        "line 3: force = 5000 N is outside|line 2: position = 5 m is outside",
    ),
    "milliseconds": ("time_s,force_N\n0,1\n1,1\n2,1\n", "time steps by 1 s.*milliseconds"),
    "broken cut": (
        "cut,time_s,force_N\n0,0,1\n0,1,1\n1,0,1\n1,1,1\n0,2,1\n",
        "line 6: cut 0 goes on here, after another cut",
    ),
    "half a cut": ("cut,time_s,force_N\n0.5,0,1\n0.5,1,1\n", "line 2: the column 'cut' holds 0.5. Number the cuts"),
    "no cut": ("cut,time_s,force_N\n0,0,1\nnan,1,1\n", "line 3: the column 'cut' holds nan"),
    "in cut": ("cut,time_s,force_N\n4,0,1\n4,.1,1\n5,0,1\n5,.1,inf\n", "cut 5, line 5, column force_N: inf"),
    "metadata of none": ('# metadata of cut 2: {"a": 1}\n' + GOOD, "names metadata of cut 2, but holds no such cut"),
    "no JSON": ("# metadata: {rig: 2}\n" + GOOD, r"line 1: metadata is not JSON .*\{rig: 2\}.*Mend it"),
    "no mapping": ("# metadata: [1]\n" + GOOD, 'line 1: metadata is .*Write names and values: {"rig"'),
    "NaN in JSON": ('# metadata: {"gain": NaN}\n' + GOOD, "line 1: metadata is not JSON .*NaN is no number"),
    "infinite in JSON": ('# metadata: {"gain": 1e999}\n' + GOOD, r"metadata\['gain'\] = inf"),
    "deep JSON": ("# metadata: " + "[" * 100_000 + "\n" + GOOD, "line 1: metadata is not JSON"),
    "metadata twice": ("# metadata: {}\n# metadata: {}\n" + GOOD, "line 2: metadata stands there twice"),
    "odd direction": (
        '# metadata: {"force_along_cut": "up"}\n' + COMPONENTS,
        "force_along_cut is 'up'; it must be one of",
    ),
    "one direction": (
        "time_s,force_x_N\n0,1\n0.1,1\n",
        "force_x only. Declare it as the force along the cut: force='x'",
    ),
    "newer": ("# cutenv-record/2\n" + GOOD, "'cutenv-record/2', newer than this cutenv.*pip install -U cutenv"),
    "never": ("# cutenv-record/0\n" + GOOD, "'cutenv-record/0', which never was"),
    "odd schema": ("# cutenv-record/one\n" + GOOD, "its schema is 'cutenv-record/one', not 'cutenv-record/1'"),
}


def check_refused(path, message, **keywords):
    with pytest.raises(RecordError, match=message) as caught:
        load(path, **keywords)
    assert caught.value.path == path
    assert str(caught.value) == f"{path}: {caught.value.reason}"
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_said_with_file_line_and_cure(file, name):
    text, message = REFUSED[name]
    file.write_text(text, encoding="utf-8")
    check_refused(file, message)


def test_a_direction_that_is_not_there_is_refused(file):
    file.write_text("time_s,force_x_N,force_y_N\n0,1,1\n0.1,1,1\n")
    check_refused(file, "force='-z' asks for force_z, but it holds force_x and force_y", force="-z")
    file.write_text(GOOD)
    check_refused(file, "asks for components of the force, of which it holds none", force="norm")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (GOOD.encode("latin-1").replace(b"0.75", b"\xbd"), "line 3: the byte 0xbd is no text in UTF-8. Save the file"),
        ("# Prüfstand\n".encode("latin-1") + GOOD.encode(), "line 1: the byte 0xfc is no text in UTF-8"),
        (GOOD.encode("utf-16"), "no CSV but text in UTF-16.*CSV in UTF-8"),
        (b"PK\x03\x04" + bytes(100), "a zip file or a spreadsheet"),
        (b"\x1f\x8b" + bytes(100), "a gzip file"),
        (b"PAR1" + bytes(100), "it is no CSV but Parquet. Give it the suffix of what it is"),
        (b"\x89HDF\r\n\x1a\n" + bytes(100), "it is no CSV but HDF5"),
        (bytes(1000), "is no quantity of a cut"),
    ],
)
def test_what_is_no_text_is_refused(file, content, message):
    file.write_bytes(content)
    check_refused(file, message)


@pytest.fixture
def written(file):
    time = np.arange(4) * 1e-3
    cut = Trace(time=time, force=time)
    save([cut, cut, cut], file)
    return file


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2,0.003,0.003\n", "", "announces 12 rows and holds 11, rows were lost or added. Take the whole file again"),
        ("2,0.003,0.003\n", "2,0.003,0.00", "its last line is not whole"),
        ("1,0.0,0.0\n", "1,0.0,0.0\n1,0.0005,0\n", "announces 12 rows and holds 13"),
        ("# rows: 12", "# rows: many", "line 2: rows is not JSON"),
        ("# rows: 12", '# rows: "12"', "announces '12' rows"),
        ("\n1,", "\n7,", "cut 7 begins here, but cut 1 is the next: rows are missing or were moved"),
        ("\n0,", "\n8,", "cut 8 begins here, but cut 0 is the next"),
        ("cut,", '# columns of cut 1: ["time_s"]\ncut,', "cut 1 holds 'force_N', but is said not to hold it"),
        (
            "cut,",
            '# columns of cut 1: ["time_s", "force_N", "depth_m"]\ncut,',
            "said to hold 'depth_m', which is no column",
        ),
        ("cut,", "# columns of cut 1: {}\ncut,", "columns of cut 1 is {}. Save the record again"),
        ("cut,", '# columns of cut 5: ["time_s"]\ncut,', "names columns of cut 5, but holds no such cut"),
    ],
)
def test_a_saved_file_that_was_damaged_is_noticed(written, old, new, message):
    text = written.read_text()
    assert old in text
    written.write_text(text.replace(old, new))
    check_refused(written, message)


def test_rows_may_be_taken_out_on_purpose(written):
    text = written.read_text().replace("2,0.003,0.003\n", "").replace("# rows: 12\n", "")
    written.write_text(text)
    assert [len(cut) for cut in load(written)] == [4, 4, 3]


def test_what_a_cut_is_said_not_to_hold_must_not_be_there(file):
    bare, full = (Trace(time=[0.0, 0.1], force=[1.0, 2.0], depth=depth) for depth in (None, [0.01, 0.01]))
    save([bare, full], file)
    file.write_text(file.read_text().replace("nan", "0.02", 1))
    check_refused(file, "cut 0 holds 'depth_m', but is said not to hold it")


def test_a_cut_that_is_said_to_hold_too_little_is_refused(file):
    file.write_text('# columns of cut 0: ["time_s"]\ncut,time_s,force_N\n0,0,nan\n0,.1,nan\n1,0,1\n1,.1,1\n')
    check_refused(file, "cut 0: it has no column force_N .*it has time_s")


@pytest.mark.parametrize(
    ("header", "given", "si"),
    [
        ("time_s", 1.5, 1.5),
        ("time_ms", 1500.0, 1.5),
        ("time_us", 1.5e6, 1.5),
        ("time_min", 0.025, 1.5),
        ("force_N", -2.0, -2.0),
        ("force_mN", 54.0, 0.054),
        ("force_kN", 0.003, 3.0),
        ("force_gf", 1000.0, 9.80665),
        ("force_kgf", 1.0, 9.80665),
        ("force_lbf", 1.0, 0.45359237 * 9.80665),
        ("force_1", 0.3, 0.3),
        ("position_cm", 2.54, 0.0254),
        ("position_in", 1.0, 0.0254),
        ("depth_mm", 20.0, 0.02),
        ("depth_um", 20.0, 2e-5),
        ("speed_m_s", 0.1, 0.1),
        ("speed_cm_s", 2.54, 0.0254),
        ("speed_cm/s", 2.54, 0.0254),
        ("speed_mm_s", 25.4, 0.0254),
        ("speed_in_s", 1.0, 0.0254),
        ("angle_rad", 1.0, 1.0),
        ("angle_deg", 90.0, math.pi / 2),
        (" angle_deg ", 45.0, math.pi / 4),
    ],
)
def test_every_unit_comes_out_in_si(header, given, si):
    column = parse_header(header)
    (found,) = column.to_si(np.array([given]))
    assert found == pytest.approx(si, rel=1e-15)


def test_parts_of_a_unit_are_divided_to_the_last_bit():
    assert parse_header("position_cm").to_si(np.array([3.1]))[0] == 3.1 / 100
    assert 3.1 / 100 != 3.1 * 0.01


def test_no_two_units_have_one_name():
    for units in FIELD_UNITS.values():
        assert all(NAMED_UNITS[unit.name] is unit for unit in units)
        assert (units[0].si, units[0].factor) == (units[0].sign, 1.0)


def test_the_components_of_a_force_are_told_apart():
    found = [parse_header(f"force_{axis}_mN") for axis in "xyz"]
    assert [column.axis for column in found] == ["x", "y", "z"]
    assert {column.field for column in found} == {"force"}
    assert parse_header("force_N").axis is None


def test_a_normalised_force_is_no_newtons():
    assert parse_header("force_1").force_unit == parse_header("force_x_1").force_unit == "1"
    assert parse_header("force_lbf").force_unit == "N"
    assert parse_header("depth_m").force_unit is None


@pytest.mark.parametrize("field", Reading._fields)
def test_what_is_written_is_si_and_is_read_as_itself(field):
    column = parse_header(header_of(field))
    values = np.array([0.1, 1 / 3])
    assert column.field == field
    assert column.to_si(values) is values


def test_every_field_of_a_trace_has_units():
    assert tuple(UNITS) == Reading._fields
    assert header_of("force", "1") == "force_1"


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("force_Nn", "unit 'Nn'.*Did you mean force_N"),
        ("force_n", "unit 'n'.*Did you mean force_N"),
        ("force_x_mn", r"one of force_x_N, force_x_mN.*Did you mean force_x_mN"),
        ("angle_degrees", "Did you mean angle_deg"),
        ("position_km", "one of position_m, position_cm, .*Did you mean"),
        ("force", "'force' has no unit. Write one of force_N, force_mN"),
        ("force_", "has no unit"),
        ("force_x", "'force_x' has no unit. Write one of force_x_N"),
        ("pos_cm", "'pos_cm' is no quantity of a cut.*Did you mean position_cm"),
        ("Force_N", "Did you mean force_N"),
        ("Time", "Did you mean time_s"),
        ("temperature_C", "such as time_s, force_N, position_m, speed_m_s, angle_rad, depth_m"),
        ("position_x_m", "unit 'x_m'"),
        ("", "is no quantity"),
    ],
)
def test_what_is_not_known_is_refused_with_the_nearest(header, message):
    with pytest.raises(ValueError, match=message):
        parse_header(header)


@pytest.mark.parametrize("arguments", [("cut",), ("force", "mN")])
def test_no_other_field_or_unit_is_written(arguments):
    with pytest.raises(ValueError, match=r"'cut'|'mN'"):
        header_of(*arguments)
