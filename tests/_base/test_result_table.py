"""Tables as text: aligned columns, units, and reasons in the place of cells."""

from cutenv._base.result_table import Reason, ResultRow, ResultTable, aligned


def test_columns_are_as_wide_as_their_longest_cell_with_their_units():
    table = ResultTable(
        "",
        ["policy", ("tip error", "mm")],
        [ResultRow("nothing", ["103.58 [99.00, 108.16]"]), ResultRow("us", ["1.0"])],
    )
    assert table.lines() == ["policy   tip error [mm]", "nothing  103.58 [99.00, 108.16]", "us       1.0"]
    assert table.lines(right=True)[0] == "policy           tip error [mm]"
    assert table.lines(right=True)[2] == "us                          1.0"


def test_a_reason_runs_on_over_the_empty_cells_after_it():
    lines = aligned([["a", "b", "c"], ["one", Reason("fewer than two people"), ""], ["two", "1.0", "2.0"]])
    assert lines == ["a    b    c", "one  fewer than two people", "two  1.0  2.0"]
