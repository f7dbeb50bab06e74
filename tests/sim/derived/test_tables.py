"""Tables of the thesis: read strictly, with the source, units and printed digits of each."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.sim.tissue.tables import Printed, read_table, table, table_numbers

CHAPTERS = {4: 12, 5: 7, 6: 2, 7: 1}  # with so many tables each
THESIS = tuple(f"{chapter}.{number}" for chapter, last in CHAPTERS.items() for number in range(1, last + 1))
UNITS = ("_Pa", "_cm", "_cm_s", "_cm2", "_per_cm2", "_inch", "_m", "_J_m2")
PURE = ("test", "row", "bead", "level", "dimensions", "nodes_per_element", "n_", "ratio_", "relative_model_size")
GOOD = [
    "# title: made up",
    "# source: nobody, Table 9.9",
    "# note: one",
    "# note: two",
    "# resolution: speed_cm_s = 0.01",
    "# resolution: lem_Pa = 1000",
    "# printed_mean: lem_Pa = 55000 to 1000",
    "speed_cm_s,lem_Pa",
    "0.10,59000",
    "0.38,nan",
]


def read(tmp_path, lines):
    file = tmp_path / "table_9_9.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_table(file, number="9.9")


def test_reads_what_the_file_says(tmp_path):
    read_back = read(tmp_path, GOOD)
    assert (read_back.number, read_back.title, read_back.provenance) == ("9.9", "made up", "nobody, Table 9.9")
    assert read_back.notes == ("one", "two")
    assert read_back.resolution == {"speed_cm_s": 0.01, "lem_Pa": 1000}
    assert read_back.printed_mean == {"lem_Pa": Printed(55000, 1000)}
    np.testing.assert_array_equal(read_back["lem_Pa"], [59000, np.nan])


@pytest.mark.parametrize(
    ("line", "text", "hint"),
    [
        (1, "# title", "line 1: expected '# key: value'"),
        (1, "# titel: made up", "line 1: unknown key 'titel'"),
        (1, "# note: no title", "line 1: expected '# title"),
        (3, "# title: again", "line 3: expected '# title"),
        (5, "# resolution: speed = 0.01", "line 5: 'speed' is not a column"),
        (5, "# resolution: lem_Pa = 10", "line 6: 'lem_Pa' is stated twice"),
        (5, "# note: no resolution", "no '# resolution: speed_cm_s"),
        (6, "# resolution: lem_Pa = some", "line 6: expected a number, got 'some'"),
        (7, "# printed_mean: lem_Pa = 55000", "line 7: expected 'column = value to unit"),
        (8, "speed_cm_s,speed_cm_s", "line 8: column names must be distinct"),
        (8, "speed_cm_s, lem_Pa", "line 8: column names must be distinct"),
        (9, "0.10", "line 9: expected 2 values, got 1"),
        (9, "0.10,59000,1", "line 9: expected 2 values, got 3"),
        (9, "0.10,", "line 9: expected a number, got ''"),
        (9, "0.10,59 kPa", "line 9: expected a number, got '59 kPa'"),
        (9, "0.10,inf", "line 9: expected a finite number or nan"),
        (9, "0.10,NaN", "line 9: expected a finite number or nan"),
        (9, "", "line 9: expected 2 values"),
        (9, "# note: too late", "line 9: expected 2 values"),
    ],
)
def test_a_malformed_file_is_refused_with_file_and_line(tmp_path, line, text, hint):
    with pytest.raises(ValueError, match=rf"table_9_9\.csv, .*{hint}"):
        read(tmp_path, [*GOOD[: line - 1], text, *GOOD[line:]])


@pytest.mark.parametrize("n_lines", [0, 7, 8])
def test_a_file_cut_short_is_refused(tmp_path, n_lines):
    with pytest.raises(ValueError, match="expected a header of column names and at least one row"):
        read(tmp_path, GOOD[:n_lines])


def test_every_table_of_measured_data_is_there():
    assert table_numbers() == THESIS


@pytest.mark.parametrize("number", THESIS)
def test_every_table_states_source_units_and_printed_digits(number):
    data = table(number)
    assert data.provenance.startswith("Teeranoot Chanthasopeephan, 'Characterization of Soft Tissue Cutting")
    assert data.provenance.endswith(f"Table {number}")
    for name in data.columns:
        assert name.endswith(UNITS) or name.startswith(PURE), name
        assert data.resolution[name] >= 0


@pytest.mark.parametrize("number", THESIS)
def test_printed_values_are_multiples_of_their_last_digit(number):
    data = table(number)
    for name, values in data.columns.items():
        if data.resolution[name] > 0 and number != "4.4":  # 4.4 prints some cells finer and says so
            digits = values[np.isfinite(values)] / data.resolution[name]
            np.testing.assert_allclose(digits, np.round(digits), atol=1e-6)


@pytest.mark.parametrize("number", THESIS)
def test_columns_cannot_be_overwritten(number):
    for values in table(number).columns.values():
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0


@pytest.mark.parametrize("number", ["5.8", "4.13", 5.6, "table_5_6", None])
def test_an_unknown_table_names_those_that_exist(number):
    with pytest.raises(ValueError, match=r"table number .*(Did you mean '\d|'4\.1')"):
        table(number)


def test_an_unknown_column_names_those_that_exist():
    with pytest.raises(ValueError, match=r"column of Table 5\.6 must be one of .* Did you mean 'speed_cm_s'"):
        table("5.6")["speed_cm"]
